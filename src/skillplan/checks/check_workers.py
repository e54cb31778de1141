"""Checks in worker processes: several at once, and a crash harms no other check."""

from __future__ import annotations

import signal
import weakref
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from skillplan.checks.feasibility import Ask, Link
from skillplan.checks.single_check import Checked, CheckRequest, Recipe, check, construct, introduce
from skillplan.checks.variants import map_queried_skills
from skillplan.errors import BackEndError
from skillplan.plugins.blame import format_traceback
from skillplan.task.back_end import BackEnd
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task
from skillplan.task.verdict import Verdict, VerdictStatus
from skillplan.workers.executor import Ended, Executor, Worker, pack_content
from skillplan.workers.local_processes import LocalProcesses

_PURPOSE = "checks"

# Content that a worker starts with, a job, and an answer.
_Content = tuple[Task, list[Recipe]]
_Job = tuple[int, str, int]
_Fields = tuple[str, str, str, int, int, dict[str, Any], float]

# Signals that end a process from outside, for example when memory runs out.
_FROM_OUTSIDE = {
    getattr(signal, name)
    for name in ("SIGKILL", "SIGTERM", "SIGINT", "SIGHUP", "SIGXCPU")
    if hasattr(signal, name)
}


class VerdictSource(Protocol):
    """Known verdicts, and the place to keep new ones."""

    def known(self, link: Link, skill: Skill, state: State) -> Verdict | None:
        """Return a verdict that applies, or None."""

    def begin(self, link: Link) -> None:
        """Note that a back end starts a check."""

    def checked_ahead(self, link: Link, skill: Skill, state: State) -> Checked | None:
        """Return the answer of a check that was made ahead, or None."""

    def keep(self, link: Link, skill: Skill, state: State, checked: Checked) -> None:
        """Keep an answer."""


class _WorkerNeededError(Exception):
    """A decision cannot go on before a worker has checked."""


class SteppedDecision:
    """A decision that stops whenever a worker has to check, and goes on with the answer.

    After each answer the decision runs again from its start. The verdicts of the earlier runs are
    replayed in order, so that every check runs and counts once.

    Parameters
    ----------
    source
        Known verdicts, and the place to keep new ones.
    decide
        Returns the verdict, given a function that queries one back end. It must query the same
        questions in the same order after the same answers.
    """

    def __init__(self, source: VerdictSource, decide: Callable[[Ask], Verdict]) -> None:
        self._source = source
        self._decide = decide
        self._answers: list[Verdict] = []
        self._replayed = 0
        self._open: tuple[Link, Skill, State] | None = None
        self._last: tuple[str, int] | None = None

    def advance(self, checked: Checked | None = None) -> CheckRequest | Verdict:
        """Return the next check for a worker, or the verdict.

        Parameters
        ----------
        checked
            Answer to the last request; None at the start.

        Raises
        ------
        BackEndError
            If a back end that is checked in this process fails.
        """
        if self._open is not None and checked is not None:
            self._keep(*self._open, checked)
            self._open = None
        self._replayed = 0
        try:
            return self._decide(self._ask)
        except _WorkerNeededError:
            assert self._open is not None
            link, skill, state = self._open
            same = self._last == (skill.name, state.bits)
            return CheckRequest(link.number, skill, state, same)

    def _ask(self, link: Link, skill: Skill, state: State) -> Verdict:
        if self._replayed == len(self._answers):
            verdict = self._source.known(link, skill, state)
            if verdict is not None:
                self._answers.append(verdict)
            else:
                self._source.begin(link)
                checked = self._source.checked_ahead(link, skill, state)
                if checked is None and link.in_worker:
                    self._open = link, skill, state
                    raise _WorkerNeededError
                self._keep(link, skill, state, checked or check(link.back_end, skill, state))
        self._replayed += 1
        return self._answers[self._replayed - 1]

    def _keep(self, link: Link, skill: Skill, state: State, checked: Checked) -> None:
        if link.in_worker:
            self._last = skill.name, state.bits
        self._source.keep(link, skill, state, checked)
        self._answers.append(checked.verdict)


class Conversation(Protocol):
    """A sequence of checks in which each depends on the answers so far."""

    @property
    def is_needed(self) -> bool:
        """True if the open check still matters."""

    def advance(self, checked: Checked | None) -> CheckRequest | None:
        """Return the next check, given the last answer; None at the end."""

    def fail(self, error: BackEndError) -> None:
        """End the conversation: a back end failed on the open check."""


class Ahead(Conversation, Protocol):
    """Checks that are made before they are needed."""

    @property
    def request(self) -> CheckRequest | None:
        """The first check."""

    def adopt(self) -> None:
        """Note that a query now needs the open check."""


class Guesses(Protocol):
    """A source of checks that may be needed soon."""

    def guess(self) -> Ahead | None:
        """Return checks to make ahead; None if no query is likely enough."""

    def forget(self) -> None:
        """Drop the guesses: the queries they belong to are answered."""


class QueryBatch:
    """Queries that are answered together, each by one check at most.

    Queries of one lane run in sequence, because the verdict on the first may answer the rest.
    Lanes are independent.

    Parameters
    ----------
    decide
        Returns the decision on a skill in a state.
    lane
        Returns the lane of a skill.

    Attributes
    ----------
    lanes
        One conversation per lane.
    """

    def __init__(
        self,
        decide: Callable[[Skill, State], SteppedDecision],
        queries: Sequence[tuple[Skill, State]],
        lane: Callable[[Skill], str],
    ) -> None:
        self._decide = decide
        self._queries = queries
        self._verdicts: dict[int, Verdict] = {}
        self._errors: dict[int, BackEndError] = {}
        positions: dict[str, list[int]] = {}
        for position, (skill, _) in enumerate(queries):
            positions.setdefault(lane(skill), []).append(position)
        self._by_name = {name: Lane(self, own) for name, own in positions.items()}
        self.lanes = list(self._by_name.values())

    def is_open(self, lane: str) -> bool:
        """Return whether a lane has open queries."""
        return lane in self._by_name and self._by_name[lane].is_open

    def begin(self, position: int) -> SteppedDecision:
        """Return the decision on a query."""
        return self._decide(*self._queries[position])

    def settle(self, position: int, verdict: Verdict) -> None:
        """Store the verdict on a query."""
        self._verdicts[position] = verdict

    def fail(self, position: int, error: BackEndError) -> None:
        """Store the error of a query."""
        self._errors[position] = error

    def is_needed(self, position: int) -> bool:
        """Return whether all earlier queries have succeeded so far."""
        return not self._errors or position < min(self._errors)

    def verdicts(self) -> list[Verdict]:
        """Return the verdicts in the order of the queries, once all lanes have ended.

        Raises
        ------
        BackEndError
            If a back end failed; the error of the first such query.
        """
        if self._errors:
            raise self._errors[min(self._errors)]
        return [self._verdicts[position] for position in range(len(self._queries))]


class Lane:
    """The queries of one lane of a batch, as a conversation.

    Parameters
    ----------
    positions
        Positions of the queries in the batch.
    """

    def __init__(self, batch: QueryBatch, positions: Sequence[int]) -> None:
        self._batch = batch
        self._left = deque(positions)
        self._position = -1
        self._decision: SteppedDecision | None = None

    @property
    def is_open(self) -> bool:
        """True if a query is left or in progress."""
        return bool(self._left) or self._decision is not None

    @property
    def is_needed(self) -> bool:
        """True if the open check still matters."""
        return self._batch.is_needed(self._position)

    def advance(self, checked: Checked | None) -> CheckRequest | None:
        """Return the next check, given the last answer; None at the end."""
        while True:
            if self._decision is None:
                if not self._left or not self._batch.is_needed(self._left[0]):
                    return None
                self._position = self._left.popleft()
                self._decision = self._batch.begin(self._position)
            try:
                step = self._decision.advance(checked)
            except BackEndError as error:
                self.fail(error)
                return None
            if isinstance(step, CheckRequest):
                return step
            self._batch.settle(self._position, step)
            self._decision = checked = None

    def fail(self, error: BackEndError) -> None:
        """Store the error of the query in progress."""
        self._batch.fail(self._position, error)


@dataclass(frozen=True, slots=True)
class _Failure:
    """An error of a back end in a worker: its message, and its traceback if that is shown."""

    message: str
    traceback: str

    def error(self) -> BackEndError:
        """Return the error as this process raises it."""
        error = BackEndError(self.message)
        error.remote_traceback = self.traceback
        return error


@dataclass(slots=True)
class _Pending:
    """An open check of a conversation, and the number of workers that died in it."""

    conversation: Conversation
    request: CheckRequest
    lost: int = 0


@dataclass(slots=True)
class _Guessed:
    """A check that is made ahead."""

    ahead: Ahead
    request: CheckRequest


class CheckWorkers:
    """Worker processes that each hold the back ends of a task and check for this process.

    They start when needed. They end on `close`, with this object, or with the program.

    Parameters
    ----------
    task
        The task whose skills are checked.
    back_ends
        In the order of their numbers; each worker makes its own, of the same classes and options.
    jobs
        Number of local workers, >= 1.
    executor
        Runs the workers instead, and sets their number.
    """

    def __init__(
        self, task: Task, back_ends: Sequence[BackEnd], jobs: int, executor: Executor | None = None
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
        """End the workers; another query starts new ones."""
        self._executor.close()
        self._idle.clear()
        self._busy.clear()
        self._ahead.clear()

    def run(
        self,
        conversations: Iterable[Conversation],
        poll: Callable[[], None] = lambda: None,
        guesses: Guesses | None = None,
    ) -> None:
        """Run conversations to their ends, each with one check at a time.

        A check whose worker dies is repeated once in a fresh worker. If that dies, too, the
        verdict is unknown.

        Parameters
        ----------
        poll
            Called several times a second; its exceptions end the checks in progress.
        guesses
            Checks for idle workers. Those in progress at the end go on; the next call collects
            their answers.

        Raises
        ------
        SkillplanError
            If workers cannot be started, or a back end fails to start in one.
        """
        waiting: deque[_Pending] = deque()
        for conversation in conversations:
            poll()
            following = _advance(conversation, None)
            if following is not None:
                waiting.append(following)
        try:
            while waiting or self._busy:
                self._hand_out(waiting)
                if guesses is not None and not waiting:
                    self._check_ahead(guesses)
                poll()
                for worker in self._executor.first_ready([*self._busy, *self._ahead]):
                    if worker in self._busy:
                        self._collect(worker, waiting)
                    else:
                        self._collect_ahead(worker)
        except BaseException:
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
            if not pending.conversation.is_needed or self._adopt(pending):
                waiting.popleft()
            elif self._working < self.jobs:
                waiting.popleft()
                self._give(self._worker(fresh=pending.lost > 0), pending)
            else:
                return

    @property
    def _working(self) -> int:
        return len(self._busy) + len(self._ahead)

    def _adopt(self, pending: _Pending) -> bool:
        """Wait for the worker that makes a check ahead already, if there is one."""
        needed = pending.request
        for worker, guessed in self._ahead.items():
            guessed_request = guessed.request
            if (
                guessed_request.back_end == needed.back_end
                and guessed_request.state == needed.state
            ):
                if guessed_request.skill.name != needed.skill.name:
                    continue
                del self._ahead[worker]
                self._busy[worker] = pending
                guessed.ahead.adopt()
                return True
        return False

    def _check_ahead(self, guesses: Guesses) -> None:
        """Give guesses to idle workers."""
        while self._busy and self._working < self.jobs:
            ahead = guesses.guess()
            if ahead is None or ahead.request is None:
                return
            self._give_ahead(self._worker(fresh=False), _Guessed(ahead, ahead.request))

    def _give_ahead(self, worker: Worker, guessed: _Guessed) -> None:
        self._ahead[worker] = guessed
        worker.take(_job(guessed.request))

    def _collect_ahead(self, worker: Worker) -> None:
        """Take the answer to a check made ahead, and give the worker the next one of it."""
        news = worker.answer()
        if news is None:
            return
        ahead = self._ahead.pop(worker).ahead
        if isinstance(news, Ended):
            worker.end()
            ahead.fail(BackEndError("the process is gone"))
            return
        self._idle.append(worker)
        if isinstance(news.content, _Failure):
            ahead.fail(news.content.error())
            return
        request = ahead.advance(self._checked(news.content))
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
            recipes = [Recipe.of(back_end) for back_end in self.back_ends]
            self._content = pack_content((self.task, recipes), _PURPOSE)
        return self._executor.start(_prepare, self._content, _PURPOSE)

    def _give(self, worker: Worker, pending: _Pending) -> None:
        self._busy[worker] = pending
        worker.take(_job(pending.request))

    def _collect(self, worker: Worker, waiting: deque[_Pending]) -> None:
        """Take the answer of a worker, and go on with the conversation."""
        news = worker.answer()
        if news is None:
            return
        pending = self._busy[worker]
        if isinstance(news, Ended):
            del self._busy[worker]
            worker.end()
            self._repeat_or_give_up(worker, news, pending, waiting)
            return
        if isinstance(news.content, _Failure):
            pending.conversation.fail(news.content.error())
            following = None
        else:
            following = _advance(pending.conversation, self._checked(news.content))
        if following is not None and following.request.goes_on:
            self._give(worker, following)
            return
        del self._busy[worker]
        self._idle.append(worker)
        if following is not None:
            waiting.append(following)

    def _repeat_or_give_up(
        self, worker: Worker, ended: Ended, pending: _Pending, waiting: deque[_Pending]
    ) -> None:
        """Repeat a check whose worker died; give up after the second.

        The verdict is unknown if both were ended from outside. If the second crashed or ended
        itself, the back end has failed, as it would in this process.
        """
        if not ended.started and not ended.killed:
            raise worker.not_started()
        pending.lost += 1
        if pending.lost == 1:
            waiting.appendleft(pending)
            return
        request = pending.request
        name = self.back_ends[request.back_end].name
        reason = f"the process that checked it was ended by {_name_end(ended)}, twice"
        if ended.exit_code is not None and -ended.exit_code not in _FROM_OUTSIDE:
            error = BackEndError(f"Back end {name!r} failed on {request.skill.name}: {reason}.")
            pending.conversation.fail(error)
            return
        unknown = Verdict.unknown(reason).grounded(request.state, name)
        following = _advance(pending.conversation, Checked(unknown, 0.0))
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


def _advance(conversation: Conversation, checked: Checked | None) -> _Pending | None:
    request = conversation.advance(checked)
    return None if request is None else _Pending(conversation, request)


def _name_end(ended: Ended) -> str:
    if ended.exit_code is None or ended.exit_code >= 0:
        return ended.how
    try:
        return f"{ended.how} ({signal.Signals(-ended.exit_code).name})"
    except ValueError:
        return ended.how


def _prepare(content: _Content) -> Callable[[_Job], _Fields | _Failure]:
    """Return the function that checks, in a worker."""
    task, recipes = content
    back_ends = construct(task, recipes)
    introduce(back_ends)
    skills = map_queried_skills(task)

    def answer(job: _Job) -> _Fields | _Failure:
        back_end, name, bits = job
        try:
            checked = check(back_ends[back_end], skills[name], task.facts.state(bits))
        except BackEndError as error:
            return _Failure(str(error), format_traceback(error))
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
