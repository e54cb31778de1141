"""Runs of agents on instances in worker processes, one at a time in each.

A process is used again for the next run, and ended if its run goes on long after its limit.
"""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from skillplan import __version__
from skillplan.benchmark.agents import find_version, is_learner, make_agent
from skillplan.benchmark.instances import Instance, hash_instances
from skillplan.benchmark.proving import run
from skillplan.benchmark.submission import Row, Submission, read_submission
from skillplan.errors import OptionError, SkillplanError
from skillplan.files.atomic_file import write_whole
from skillplan.files.json_file import format_document
from skillplan.pipeline import registry
from skillplan.plugins.blame import ends_program
from skillplan.records import schemas
from skillplan.records.result import Status
from skillplan.workers.executor import Answer, News, Worker, pack_content
from skillplan.workers.local_processes import LocalProcesses

SEARCH_LIMIT_S = 10.0
LEARNING_LIMIT_S = 30.0
STEPS = 10_000
_PURPOSE = "the benchmark"
# Agents that have run in this process.
_loaded: set[str] = set()
# A run that goes on is ended this long after its limit [s]: kernels are loaded, plans replayed.
_GRACE_S = 120.0
# Time limit of the first run of an agent in a process, which does not count [s].
_LOADING_S = 0.5
# Its steps: a roll-out of `SETTINGS` and an update.
_LOADING_STEPS = 300
# Expected time of a run beyond its limit: start of the process and replay [s].
_OVERHEAD_S = 1.0
# The file of the results is written at most this often [s].
_WRITE_EVERY_S = 5.0


@dataclass(frozen=True)
class Run:
    """One agent on one instance with one seed."""

    agent: str
    instance: Instance
    seed: int
    limit_s: float
    steps: int

    @property
    def key(self) -> tuple[str, str, int]:
        """As `Row.key`."""
        return self.agent, self.instance.name, self.seed


@dataclass(frozen=True)
class Campaign:
    """The runs of a command.

    Parameters
    ----------
    agents
        Names of agents, as `make_agent` takes them.
    instances
        The instances.
    everywhere
        True if learners run on all instances, instead of learning tasks only.
    runs
        Number of seeds of learners, from `seed` on. Other agents run once.
    search_limit_s, learning_limit_s
        Time limits of a run [s].
    steps
        Environment steps of learners from elsewhere.
    """

    agents: Sequence[str]
    instances: Sequence[Instance]
    everywhere: bool = False
    runs: int = 1
    seed: int = 0
    jobs: int = 1
    search_limit_s: float = SEARCH_LIMIT_S
    learning_limit_s: float = LEARNING_LIMIT_S
    steps: int = STEPS

    def __post_init__(self) -> None:
        for name in self.agents:
            make_agent(name, self.steps)

    @cached_property
    def learners(self) -> frozenset[str]:
        """The agents that learn."""
        return frozenset(name for name in self.agents if is_learner(name))

    def list_runs(self) -> list[Run]:
        """Return all runs, instance by instance."""
        return [
            Run(agent, instance, self.seed + number, self.limit_s(agent), self.steps)
            for instance in self.instances
            for agent in self.agents
            if agent not in self.learners or self.everywhere or instance.learning
            for number in range(self.runs if agent in self.learners else 1)
        ]

    def limit_s(self, agent: str) -> float:
        """Return the time limit of an agent [s]."""
        return self.learning_limit_s if agent in self.learners else self.search_limit_s

    def worst_case_s(self, runs: Sequence[Run]) -> float:
        """Return the duration of some runs if each takes all of its time [s]."""
        return sum(each.limit_s + _OVERHEAD_S for each in runs) / self.jobs

    def begin(self) -> Submission:
        """Return the document without rows."""
        return Submission(
            skillplan=__version__,
            benchmark=hash_instances(self.instances),
            machine=describe_machine(),
            jobs=self.jobs,
            search_limit_s=self.search_limit_s,
            learning_limit_s=self.learning_limit_s,
            steps=self.steps,
            agents={name: find_version(name) for name in self.agents},
            rows=[],
        )


def describe_machine() -> str:
    """Return processor, cores and system of this machine."""
    model = platform.processor() or platform.machine()
    return f"{model}, {os.cpu_count()} cores, {platform.system()}"


class ResultFile:
    """The file of a campaign, which is continued if it exists.

    Parameters
    ----------
    path
        The file; None for none.
    campaign
        The campaign. A file with other limits is refused.
    instances
        All instances. A file with others is refused.

    Attributes
    ----------
    submission
        Its document, with the rows so far.

    Raises
    ------
    OptionError
        If the file is of another campaign, or cannot be read or written.
    """

    def __init__(self, path: str | None, campaign: Campaign, instances: Iterable[Instance]) -> None:
        self._known = {each.name: each for each in instances}
        self._path = None if path is None else Path(path)
        self._written_s = -1e9
        self.submission = campaign.begin()
        if path is None or not Path(path).exists():
            return
        before, now = read_submission(path), self.submission
        for key in ("skillplan", "search_limit_s", "learning_limit_s", "steps"):
            was, is_now = getattr(before, key), getattr(now, key)
            if was != is_now:
                raise OptionError(
                    f"--out {path}: was begun with another {key}: {was} there, {is_now} now. Name "
                    "a new file."
                )
        agents = {**before.agents, **now.agents}
        kept = [row for row in before.rows if row.status is not Status.FAILED]
        for name in dict.fromkeys(row.agent for row in kept):
            was, is_now = before.agents.get(name, "no version"), agents.get(name, "no version")
            if was != is_now:
                is_file = is_now.startswith("sha256 ")
                place = name.rpartition(":")[0] if is_file else name
                versions = "" if is_file else f": {was} there, {is_now} now"
                raise OptionError(
                    f"--out {path}: was begun with another {place}{versions}; name a new file."
                )
        for row in kept:
            instance = self._known.get(row.instance)
            if instance is None or row.sha256 != instance.sha256:
                raise OptionError(
                    f"--out {path}: has a row of {row.instance} that is not of this benchmark. "
                    "Name a new file."
                )
        self.submission = now.model_copy(update={"agents": agents, "rows": kept})

    @property
    def done(self) -> set[tuple[str, str, int]]:
        """The runs that are in the file."""
        return {row.key for row in self.submission.rows}

    def add(self, row: Row) -> None:
        """Add a row, and write the file from time to time."""
        self.submission.rows.append(row)
        if time.monotonic() >= self._written_s + _WRITE_EVERY_S:
            self.write()

    def write(self) -> None:
        """Write the file, if there is one.

        Raises
        ------
        OptionError
            If it cannot be written.
        """
        named = dict.fromkeys(row.instance for row in self.submission.rows)
        if named:
            digest = hash_instances(self._known[name] for name in named)
            self.submission = self.submission.model_copy(update={"benchmark": digest})
        if self._path is None:
            return
        self._written_s = time.monotonic()
        content = self.submission.model_dump(mode="json", exclude={"document"})
        try:
            write_whole(self._path, format_document(schemas.BENCHMARK, content) + "\n")
        except OSError as error:
            raise OptionError(f"--out {self._path}: {error.strerror}.") from None


def do_runs(runs: Sequence[Run], jobs: int, stopped: Callable[[], bool]) -> Iterator[Row]:
    """Yield the rows of runs as they end.

    A run whose process ends, or goes on long after its limit, has failed. A stop discards
    unfinished runs.

    Parameters
    ----------
    runs
        The runs.
    jobs
        Number of processes, >= 1.
    stopped
        Returns True to stop; called several times per second.

    Raises
    ------
    SkillplanError
        If processes cannot be started.
    """
    executor = LocalProcesses(jobs)
    content = pack_content(None, _PURPOSE)
    waiting = list(reversed(runs))
    at: dict[Worker, tuple[Run, float]] = {}
    idle: list[Worker] = []
    try:
        while (at or waiting) and not stopped():
            while waiting and len(at) < executor.slots:
                worker = idle.pop() if idle else executor.start(_prepare, content, _PURPOSE)
                at[worker] = waiting.pop(), time.monotonic()
                worker.take(at[worker][0])
            for worker in executor.first_ready(at):
                answer = worker.answer()
                if answer is None or isinstance(answer, News):
                    continue
                each, _ = at.pop(worker)
                if isinstance(answer, Answer):
                    idle.append(worker)
                    yield answer.content
                    continue
                worker.end()
                if not answer.started and not answer.killed:
                    raise worker.not_started()
                yield _fail(each, f"its process ended by {answer.how}")
            for worker, (each, begun_s) in list(at.items()):
                if time.monotonic() > begun_s + each.limit_s + _GRACE_S:
                    del at[worker]
                    worker.end(gently=False)
                    yield _fail(each, f"it went on {_GRACE_S:g} s after its limit")
    finally:
        executor.close()


def _prepare(_: None) -> Callable[[Run], Row]:
    """Return the function that does runs in a worker process."""
    return do_run


def _load_kernels(each: Run) -> None:
    """Run an agent for a moment, so that its libraries and kernels are loaded before the clock."""
    if each.agent in _loaded:
        return
    _loaded.add(each.agent)
    if each.agent in registry.names("solver"):
        from skillplan.solvers.auto import AutoSolver
        from skillplan.solvers.ordering.solver import SequencingSolver

        if issubclass(registry.load("solver", each.agent), AutoSolver | SequencingSolver):
            from skillplan.solvers.ordering.portfolio import warm_up

            warm_up()
    run(each.instance, each.instance.load(), each.agent, _LOADING_S, each.seed, _LOADING_STEPS)


def do_run(each: Run) -> Row:
    """Do a run; its errors become part of the row."""
    try:
        _load_kernels(each)
        task = each.instance.load()
        instance = each.instance
        result = run(instance, task, each.agent, each.limit_s, each.seed, each.steps)
        return Row.of(each.agent, instance, task, result)
    except SkillplanError as error:
        return _fail(each, str(error))
    except BaseException as error:
        if ends_program(error):
            raise
        return _fail(each, f"{type(error).__name__}: {error}")


def _fail(each: Run, reason: str) -> Row:
    return Row(
        agent=each.agent,
        instance=each.instance.name,
        sha256=each.instance.sha256,
        seed=each.seed,
        status=Status.FAILED,
        wall_s=each.limit_s,
        reason=reason,
    )
