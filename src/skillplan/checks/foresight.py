"""Checks that idle workers make before a search needs them.

While a search waits for an expensive check, other workers check its likely next queries, as
lazy searches evaluate edges in parallel (Phillips, Likhachev and Koenig, "PA*SE: parallel A* for
slow expansions", 2014). These answers are set aside. They count as checks, and become kept
verdicts, only when a query needs them, so verdicts and counts equal those of a single process.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

from skillplan.checks.check_workers import SteppedDecision
from skillplan.checks.feasibility import Ask, Link, ask_chain
from skillplan.checks.single_check import Checked, CheckRequest
from skillplan.checks.variants import SkillVariants, choose_variant
from skillplan.checks.verdict_cache import VerdictCache
from skillplan.errors import BackEndError
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.verdict import Verdict, VerdictStatus

Likely = Callable[[], Iterator[tuple[State, Skill]]]
"""Starts to yield the queries that may follow, the most likely first."""

_Query = tuple[int, str, int]


class Foresight:
    """Answers that were made ahead, and the choice of further checks to make ahead.

    Parameters
    ----------
    chain
        The back ends, the cheapest first.
    cache
        Kept verdicts; read only.

    Attributes
    ----------
    made
        Checks that workers have begun ahead.
    useful
        Number of these that a query has needed since.
    """

    def __init__(
        self, chain: tuple[Link, ...], cache: VerdictCache, variants: SkillVariants
    ) -> None:
        self.made = 0
        self.useful = 0
        self._chain = chain
        self._cache = cache
        self._variants = variants
        self._answers: dict[_Query, Checked] = {}
        # By back end and skill: a verdict may also apply in other states.
        self._verdicts: dict[tuple[int, str], list[Verdict]] = {}
        self._open: dict[str, Guess] = {}
        self._likely: Likely | None = None
        self._coming: Iterator[tuple[State, Skill]] | None = None
        self._is_queried: Callable[[str], bool] = lambda lane: False

    def expect(self, is_queried: Callable[[str], bool], likely: Likely) -> None:
        """Set the current and the likely next queries.

        Parameters
        ----------
        likely
            Starts to yield the queries that may follow.
        """
        self._is_queried = is_queried
        self._likely, self._coming = likely, None

    def forget(self) -> None:
        """Drop the likely queries: the current ones are answered."""
        self._likely = self._coming = None

    @property
    def wasted(self) -> int:
        """Checks of workers that no query has needed so far."""
        return self.made - self.useful

    def expected(self, skill: Skill, state: State) -> bool | None:
        """Return whether a skill is feasible according to the answers so far.

        None if a back end has not answered, or if the skill has several motions.
        """
        if skill.ways:
            return None
        for link in self._chain:
            verdict = self.known(link, skill, state)
            if verdict is None:
                return None
            if verdict.status is VerdictStatus.INFEASIBLE:
                return False
        return True

    def guess(self) -> Guess | None:
        """Return checks to make ahead, or None if no query is likely enough."""
        if self._likely is None:
            return None
        if self._coming is None:
            self._coming = self._likely()
        for state, skill in self._coming:
            lane = self._variants.lane(skill)
            # A verdict in progress on the same lane may answer this query, too.
            if self._is_queried(lane) or lane in self._open or not skill.applicable(state):
                continue
            guess = Guess(self, lane, self._decide_in_steps(skill, state))
            if guess.request is not None:
                self._open[lane] = guess
                return guess
        return None

    def take(self, link: Link, skill: Skill, state: State) -> Checked | None:
        """Return and remove the answer to a query, or None if it was not checked ahead."""
        checked = self._answers.pop((link.number, skill.name, state.bits), None)
        if checked is not None:
            self.useful += link.in_worker
        return checked

    def settle(self, guess: Guess, *, useful: bool = False) -> None:
        """Close a guess that has ended, or whose open check a query needs now."""
        self.useful += useful
        if self._open.get(guess.lane) is guess:
            del self._open[guess.lane]

    def _decide_in_steps(self, skill: Skill, state: State) -> SteppedDecision:
        def decide(ask: Ask) -> Verdict:
            ask_all = partial(ask_chain, self._chain, ask)
            if skill.ways:
                return choose_variant(self._variants, ask_all, skill, state)
            return ask_all(skill, state)

        return SteppedDecision(self, decide)

    # The methods of a VerdictSource.

    def known(self, link: Link, skill: Skill, state: State) -> Verdict | None:
        """Return a kept verdict, or an answer made ahead, that applies in a state; or None."""
        verdict = self._cache.find(link.back_end, skill, state)
        if verdict is not None:
            return verdict
        answers = self._verdicts.get((link.number, skill.name), ())
        return next((verdict for verdict in answers if verdict.applies_in(state)), None)

    def begin(self, link: Link) -> None:
        """Count a check that a worker makes ahead."""
        self.made += link.in_worker

    def checked_ahead(self, link: Link, skill: Skill, state: State) -> Checked | None:
        """Return None: `known` returns these answers."""
        return None

    def keep(self, link: Link, skill: Skill, state: State, checked: Checked) -> None:
        """Set an answer aside."""
        self._answers[link.number, skill.name, state.bits] = checked
        self._verdicts.setdefault((link.number, skill.name), []).append(checked.verdict)


class Guess:
    """Checks of one skill in one state that are made ahead, as a conversation.

    Parameters
    ----------
    foresight
        Keeps the answers.
    decision
        The decision that needs the checks.

    Attributes
    ----------
    request
        The first check; None if no worker is needed.
    """

    is_needed = True

    def __init__(self, foresight: Foresight, lane: str, decision: SteppedDecision) -> None:
        self.lane = lane
        self._foresight = foresight
        self._decision = decision
        self.request = self._next_request(None)

    def advance(self, checked: Checked | None) -> CheckRequest | None:
        """Return the next check, given the last answer; None at the end."""
        request = self._next_request(checked)
        if request is None:
            self._foresight.settle(self)
        return request

    def fail(self, _error: BackEndError) -> None:
        """Close the guess; a query that needs it reports the error."""
        self._foresight.settle(self)

    def adopt(self) -> None:
        """Close the guess; a query needs the open check and goes on from there."""
        self._foresight.settle(self, useful=True)

    def _next_request(self, checked: Checked | None) -> CheckRequest | None:
        try:
            step = self._decision.advance(checked)
        except BackEndError:
            return None
        return step if isinstance(step, CheckRequest) else None
