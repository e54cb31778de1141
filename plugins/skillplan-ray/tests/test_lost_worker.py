"""What a worker makes of the losses that Ray tells, without Ray."""

from __future__ import annotations

import pickle
from types import SimpleNamespace
from typing import Any

import pytest

from skillplan.workers import Answer, Ended
from skillplan_ray import DONE, READY, RayWorker


class RayError(Exception):
    """As Ray raises it."""


NODE = RayError("The actor died because its node has died.\n ip: 10.0.0.7")
PROCESS = RayError("The actor died unexpectedly before finishing this task.\n ip: 10.0.0.7")
READY_NOW = (READY, {})


def answered(content: Any) -> tuple[str, bytes]:
    return DONE, pickle.dumps(content)


class Method:
    """A method of an actor that yields what it is told to."""

    def __init__(self, said: list[Any], calls: list[Any]) -> None:
        self.said, self.calls = said, calls

    def options(self, **_: Any) -> Method:
        return self

    def remote(self, *words: Any) -> Any:
        self.calls.append(words)
        return iter(self.said)


class Scripted:
    """A cluster whose actors do what is written: what each says when it starts, and of its job."""

    alive = True

    def __init__(self, *actors: tuple[Any, Any]) -> None:
        self.to_come, self.cpus = list(actors), 0.0
        self.jobs: list[Any] = []
        task_error = type("RayTaskError", (RayError,), {})
        self.ray = SimpleNamespace(
            exceptions=SimpleNamespace(RayError=RayError, RayTaskError=task_error),
            get=self.get,
            wait=lambda streams, timeout: (streams, []),
        )

    def get(self, said: Any) -> Any:
        if isinstance(said, Exception):
            raise said
        return said

    def actor(self, prepare: Any, content: Any, cpus: float) -> tuple[Any, float]:
        ready, of_job = self.to_come.pop(0)
        self.cpus += cpus
        created = SimpleNamespace(make_ready=Method([ready], []), do=Method([of_job], self.jobs))
        return created, cpus

    def give_back(self, cpus: float) -> None:
        self.cpus -= cpus

    def check(self, place: str, there: Any) -> None:
        """All machines are the same."""


def said(cluster: Any, *, patience_s: float = 60.0) -> Any:
    """Return what becomes of a job."""
    worker = RayWorker(cluster, int, None, "tests", cpus=1.0, patience_s=patience_s)
    worker.take("job")
    answer = None
    while answer is None:
        answer = worker.answer()
    return answer


def test_an_actor_that_is_placed_on_a_machine_being_lost_is_placed_again():
    """Its job has not begun: that is no loss of the job's, and the CPUs are counted once."""
    cluster = Scripted((NODE, None), (NODE, None), (READY_NOW, answered(7)))
    assert said(cluster) == Answer(7)
    assert [pickle.loads(words[0]) for words in cluster.jobs] == ["job"] * 3
    assert cluster.cpus == 1.0


@pytest.mark.parametrize(
    ("actor", "started", "how"),
    [
        pytest.param((READY_NOW, NODE), True, "machine", id="a machine in the middle of a job"),
        pytest.param((READY_NOW, PROCESS), True, "process", id="a process in the middle of a job"),
        pytest.param((PROCESS, None), False, "process", id="a process that becomes ready"),
    ],
)
def test_any_other_loss_is_told(actor, started, how):
    """Whoever gave the job decides whether it is done once more."""
    ended = said(Scripted(actor))
    assert isinstance(ended, Ended)
    assert (ended.started, ended.how) == (started, f"the loss of its {how} on 10.0.0.7")


def test_a_machine_that_stays_lost_is_told_in_the_end():
    """After as long as a worker may take to be ready."""
    ended = said(Scripted((NODE, None)), patience_s=-1.0)
    assert isinstance(ended, Ended)
    assert not ended.started
