"""Back ends queried in processes of their own: several checks at once, and none harms another."""

from __future__ import annotations

import signal
import weakref
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from skillplan.checks.parallel.conversation import Ahead, Conversation, Guesses
from skillplan.checks.single_check import (
    Checked,
    CheckRequest,
    Recipe,
    check,
    construct,
    introduce,
)
from skillplan.checks.ways import asked_by_name
from skillplan.errors import BackEndError
from skillplan.plugins.blame import traceback_text
from skillplan.task.back_end import BackEnd
from skillplan.task.task import Task
from skillplan.task.verdict import Verdict, VerdictStatus
from skillplan.workers.executor import Ended, Executor, Worker, packed
from skillplan.workers.local_processes import LocalProcesses

_WHAT = "checks"


# What a process starts from, what it is queried about, and what it answers.
_Content = tuple[Task, list[Recipe]]
_Job = tuple[int, str, int]
_Fields = tuple[str, str, str, int, int, dict[str, Any], float]


# Signals by which a process is ended from outside, by the system for want of memory for example.
_FROM_OUTSIDE = {
    getattr(signal, name)
    for name in ("SIGKILL", "SIGTERM", "SIGINT", "SIGHUP", "SIGXCPU")
    if hasattr(signal, name)
}


@dataclass(frozen=True, slots=True)
class _Failed:
    """What a back end raised: the message, and the traceback if one is to be shown."""

    words: str
    traceback: str

    def error(self) -> BackEndError:
        """Return the error as it arises in this process."""
        error = BackEndError(self.words)
        error.remote_traceback = self.traceback
        return error


@dataclass(slots=True)
class _Pending:
    """A conversation that waits for a check, and how many processes that check has cost."""

    conversation: Conversation
    request: CheckRequest
    lost: int = 0


@dataclass(slots=True)
class _Guessed:
    """A check that is made ahead, and for what."""

    ahead: Ahead
    request: CheckRequest


class CheckWorkers:
    """Processes that each have the back ends of a task and check for this one.

    They are started when needed and end when closed, with this object, or with the program.

    Parameters
    ----------
    task
        The task whose skills are checked.
    back_ends
        In the order of their indices; each process makes its own of the same classes and
        options.
    jobs
        The most processes at once, >= 1.
    executor
        Where they run instead; it has the number of them, too.

    Raises
    ------
    ValueError
        If `jobs` is below 1.
    """

    def __init__(
        self,
        task: Task,
        back_ends: Sequence[BackEnd],
        jobs: int,
        executor: Executor | None = None,
    ) -> None:
        self.task = task
        self._executor = LocalProcesses(jobs) if executor is None else executor
        self.jobs = self._executor.slots
        self.back_ends = tuple(back_ends)
        self._content: bytes | None = None
        self._idle: list[Worker] = []
        self._busy: dict[Worker, _Pending] = {}
        self._ahead: dict[Worker, _Guessed] = {}
        weakref.finalize(self, self._executor.close)

    def close(self) -> None:
        """End the processes; another query starts new ones."""
        self._executor.close()
        self._idle.clear()
        self._busy.clear()
        self._ahead.clear()

    def hold(
        self,
        conversations: Iterable[Conversation],
        poll: Callable[[], None] = lambda: None,
        guesses: Guesses | None = None,
    ) -> None:
        """Carry on conversations to their ends, each with one check at a time.

        A check whose process is killed is made once more in a fresh one; if that is killed, too,
        the verdict is unknown.

        Parameters
        ----------
        conversations
            What is to be checked.
        poll
            Called several times a second; what it raises ends the checks in progress.
        guesses
            What idle processes check meanwhile. They go on with that when this returns; what they
            said is heard in the next call.

        Raises
        ------
        SkillplanError
            If processes cannot be started, or a back end fails to start in one.
        """
        waiting: deque[_Pending] = deque()
        for conversation in conversations:
            poll()
            following = _go_on(conversation, None)
            if following is not None:
                waiting.append(following)
        try:
            while waiting or self._busy:
                self._hand_out(waiting)
                if guesses is not None and not waiting:
                    self._look_ahead(guesses)
                poll()
                for worker in self._executor.first_ready([*self._busy, *self._ahead]):
                    if worker in self._busy:
                        self._hear(worker, waiting)
                    else:
                        self._hear_ahead(worker)
        except BaseException:
            # Nobody waits for these any more.
            for worker in (*self._busy, *self._ahead):
                worker.end(gently=False)
            self._busy.clear()
            self._ahead.clear()
            raise
        finally:
            if guesses is not None:
                guesses.forget()

    def _hand_out(self, waiting: deque[_Pending]) -> None:
        while waiting:
            pending = waiting[0]
            if not pending.conversation.wanted or self._adopted(pending):
                waiting.popleft()
            elif self._working < self.jobs:
                waiting.popleft()
                self._give(self._worker(fresh=pending.lost > 0), pending)
            else:
                return

    @property
    def _working(self) -> int:
        return len(self._busy) + len(self._ahead)

    def _adopted(self, pending: _Pending) -> bool:
        """Wait for a process that makes a check already, if there is one."""
        wanted = pending.request
        for worker, guessed in self._ahead.items():
            made = guessed.request
            if made.back_end == wanted.back_end and made.state == wanted.state:
                if made.skill.name != wanted.skill.name:
                    continue
                del self._ahead[worker]
                self._busy[worker] = pending
                guessed.ahead.adopt()
                return True
        return False

    def _look_ahead(self, guesses: Guesses) -> None:
        """Have processes that have nothing to do check what is likely to be asked next."""
        while self._busy and self._working < self.jobs:
            ahead = guesses.guess()
            if ahead is None or ahead.request is None:
                return
            self._give_ahead(self._worker(fresh=False), _Guessed(ahead, ahead.request))

    def _give_ahead(self, worker: Worker, guessed: _Guessed) -> None:
        self._ahead[worker] = guessed
        worker.take(_job(guessed.request))

    def _hear_ahead(self, worker: Worker) -> None:
        """Take what a process says of what was checked ahead, and have it go on with that."""
        said = worker.answer()
        if said is None:
            return
        ahead = self._ahead.pop(worker).ahead
        if isinstance(said, Ended):
            worker.end()
            ahead.fail(BackEndError("the process is gone"))
            return
        self._idle.append(worker)
        if isinstance(said.content, _Failed):
            ahead.fail(said.content.error())
            return
        request = ahead.go_on(self._checked(said.content))
        if request is not None:
            self._idle.remove(worker)
            self._give_ahead(worker, _Guessed(ahead, request))

    def _worker(self, *, fresh: bool) -> Worker:
        while self._idle and (not fresh or len(self._idle) + self._working >= self.jobs):
            worker = self._idle.pop()
            if worker.alive and not fresh:
                return worker
            worker.end(gently=False)
        if self._content is None:
            made = [Recipe.of(back_end) for back_end in self.back_ends]
            self._content = packed((self.task, made), _WHAT)
        return self._executor.start(_prepare, self._content, _WHAT)

    def _give(self, worker: Worker, pending: _Pending) -> None:
        self._busy[worker] = pending
        worker.take(_job(pending.request))

    def _hear(self, worker: Worker, waiting: deque[_Pending]) -> None:
        """Take what a process says, and go on with the conversation that it is for."""
        said = worker.answer()
        if said is None:
            return
        pending = self._busy[worker]
        if isinstance(said, Ended):
            del self._busy[worker]
            worker.end()
            self._lose(worker, said, pending, waiting)
            return
        if isinstance(said.content, _Failed):
            pending.conversation.fail(said.content.error())
            following = None
        else:
            following = _go_on(pending.conversation, self._checked(said.content))
        if following is not None and following.request.goes_on:
            self._give(worker, following)
            return
        del self._busy[worker]
        self._idle.append(worker)
        if following is not None:
            waiting.append(following)

    def _lose(
        self, worker: Worker, ended: Ended, pending: _Pending, waiting: deque[_Pending]
    ) -> None:
        """Have a check made once more whose process is gone; give up after the second.

        It is unknown if something else ended both. If the last one crashed or ended itself, the
        back end has failed, as it does in this process.
        """
        if not ended.started and not ended.killed:
            raise worker.not_started()
        pending.lost += 1
        if pending.lost == 1:
            waiting.appendleft(pending)
            return
        request = pending.request
        name = self.back_ends[request.back_end].name
        reason = f"the process that checked it was ended by {_named(ended)}, twice"
        if ended.exit_code is not None and -ended.exit_code not in _FROM_OUTSIDE:
            error = BackEndError(f"Back end {name!r} failed on {request.skill.name}: {reason}.")
            pending.conversation.fail(error)
            return
        unknown = Verdict.unknown(reason)
        following = _go_on(
            pending.conversation, Checked(unknown.grounded(request.state, name), 0.0)
        )
        if following is not None:
            waiting.append(following)

    def _checked(self, fields: _Fields) -> Checked:
        status, reason, stage, present, absent, evidence, took_s = fields
        facts = self.task.facts
        verdict = Verdict(
            VerdictStatus(status),
            reason,
            stage,
            facts.state(present),
            facts.state(absent),
            evidence,
        )
        return Checked(verdict, took_s)


def _job(request: CheckRequest) -> _Job:
    return request.back_end, request.skill.name, request.state.bits


def _go_on(conversation: Conversation, said: Checked | None) -> _Pending | None:
    request = conversation.go_on(said)
    return None if request is None else _Pending(conversation, request)


def _named(ended: Ended) -> str:
    if ended.exit_code is None or ended.exit_code >= 0:
        return ended.how
    try:
        return f"{ended.how} ({signal.Signals(-ended.exit_code).name})"
    except ValueError:
        return ended.how


def _prepare(content: _Content) -> Callable[[_Job], _Fields | _Failed]:
    """Return what checks, in a process of its own."""
    task, made = content
    back_ends = construct(task, made)
    introduce(back_ends)
    skills = asked_by_name(task)

    def answer(job: _Job) -> _Fields | _Failed:
        back_end, name, bits = job
        try:
            checked = check(back_ends[back_end], skills[name], task.facts.state(bits))
        except BackEndError as error:
            return _Failed(str(error), traceback_text(error))
        verdict = checked.verdict
        assert verdict.present is not None
        assert verdict.absent is not None
        return (
            verdict.status.value,
            verdict.reason,
            verdict.stage,
            verdict.present.bits,
            verdict.absent.bits,
            dict(verdict.evidence),
            checked.took_s,
        )

    return answer
