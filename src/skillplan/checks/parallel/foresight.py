"""Checks made in idle processes before they are asked for.

A search that waits for an expensive check lets other processes check what it is likely to ask next,
as lazy searches evaluate edges in parallel (Phillips, Likhachev and Koenig, "PA*SE: parallel A* for
slow expansions", 2014). What they say lies aside: it is no kept verdict, and counts as a check only
once it is really asked for. So verdicts and counts are those of one process.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

from skillplan.checks.deciding import Checking, Link, deciding
from skillplan.checks.single_check import Checked, CheckRequest
from skillplan.checks.verdict_cache import VerdictCache
from skillplan.checks.way_choice import choosing
from skillplan.checks.ways import Ways
from skillplan.errors import BackEndError
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.verdict import Verdict, VerdictStatus

Likely = Callable[[], Iterator[tuple[State, Skill]]]
"""Begins to yield what is likely to be asked next, the most likely first."""

_Asked = tuple[int, str, int]


class Foresight:
    """What was checked ahead, and what is worth checking ahead.

    Parameters
    ----------
    chain
        The back ends, the cheapest first.
    cache
        Where verdicts are kept; read only.
    ways
        Of the task.

    Attributes
    ----------
    made
        Checks of other processes that were begun ahead.
    useful
        How many of them have been asked for since.
    """

    def __init__(self, chain: tuple[Link, ...], cache: VerdictCache, ways: Ways) -> None:
        self.made = 0
        self.useful = 0
        self._chain = chain
        self._cache = cache
        self._ways = ways
        self._said: dict[_Asked, Checked] = {}
        # By back end and skill, so that what holds in other states, too, is found.
        self._verdicts: dict[tuple[int, str], list[Verdict]] = {}
        self._open: dict[str, Guess] = {}
        self._likely: Likely | None = None
        self._coming: Iterator[tuple[State, Skill]] | None = None
        self._asks: Callable[[str], bool] = lambda lane: False

    def expect(self, asks: Callable[[str], bool], likely: Likely) -> None:
        """Take it that skills of lanes are asked about, and after them what is likely.

        Parameters
        ----------
        asks
            Whether a lane is asked about at the moment.
        likely
            Begins to yield what is likely to be asked next.
        """
        self._asks = asks
        self._likely, self._coming = likely, None

    def forget(self) -> None:
        """Take it that nobody waits any more."""
        self._likely = self._coming = None

    @property
    def wasted(self) -> int:
        """Checks of other processes that nobody has asked for so far."""
        return self.made - self.useful

    def expected(self, skill: Skill, state: State) -> bool | None:
        """Return whether a skill with one motion is feasible, as far as was checked; else None."""
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
        """Return checks to be made ahead, begun; None where nothing is likely enough."""
        if self._likely is None:
            return None
        if self._coming is None:
            self._coming = self._likely()
        for state, skill in self._coming:
            lane = self._ways.lane(skill)
            # Of one skill the verdict that is under way may answer this question, too.
            if self._asks(lane) or lane in self._open or not skill.applicable(state):
                continue
            guess = Guess(self, lane, self._checking(skill, state))
            if guess.request is not None:
                self._open[lane] = guess
                return guess
        return None

    def take(self, link: Link, skill: Skill, state: State) -> Checked | None:
        """Return what was said ahead about what is asked now in earnest, or None."""
        checked = self._said.pop(_asked(link.number, skill, state), None)
        if checked is not None:
            self.useful += link.apart
        return checked

    def settle(self, guess: Guess, *, useful: bool = False) -> None:
        """Note that checks that were made ahead have come to an end, or are asked for by now."""
        self.useful += useful
        if self._open.get(guess.lane) is guess:
            del self._open[guess.lane]

    def _checking(self, skill: Skill, state: State) -> Checking:
        decide = partial(deciding, self._chain, self)
        if skill.ways:
            return choosing(self._ways, decide, skill, state)
        return decide(skill, state)

    # What checks ahead: known from the cache or from here, and kept here.

    def known(self, link: Link, skill: Skill, state: State) -> Verdict | None:
        """Return what a back end has said that holds in a state, kept or ahead, or None."""
        verdict = self._cache.find(link.back_end, skill, state)
        if verdict is not None:
            return verdict
        ahead = self._verdicts.get((link.number, skill.name), ())
        return next((one for one in ahead if one.applies_in(state)), None)

    def begin(self, link: Link) -> None:
        """Count a check that another process makes ahead."""
        self.made += link.apart

    def foretold(self, link: Link, skill: Skill, state: State) -> Checked | None:
        """Return None: what was checked ahead is known."""
        return None

    def keep(self, link: Link, skill: Skill, state: State, checked: Checked) -> None:
        """Lay aside what was said."""
        self._said[_asked(link.number, skill, state)] = checked
        self._verdicts.setdefault((link.number, skill.name), []).append(checked.verdict)


class Guess:
    """Checks of one skill in one state that are made ahead, as a conversation.

    Parameters
    ----------
    foresight
        Where it lies aside what is said.
    lane
        The name that skills share where an answer about one may be one about another.
    checking
        What is to be checked.

    Attributes
    ----------
    request
        What is to be checked first; None where nothing needs another process.
    """

    wanted = True

    def __init__(self, foresight: Foresight, lane: str, checking: Checking) -> None:
        self.lane = lane
        self._foresight = foresight
        self._checking = checking
        self.request = self._go_on(None)

    def go_on(self, said: Checked | None) -> CheckRequest | None:
        """Return what is to be checked next, given what was said to the last; None at the end."""
        following = self._go_on(said)
        if following is None:
            self._foresight.settle(self)
        return following

    def fail(self, _error: BackEndError) -> None:
        """Leave it: whoever asks in earnest is told what is wrong."""
        self._foresight.settle(self)

    def adopt(self) -> None:
        """Note that the check under way is asked for in earnest, and leave it to who does."""
        self._foresight.settle(self, useful=True)

    def _go_on(self, said: Checked | None) -> CheckRequest | None:
        try:
            return next(self._checking) if said is None else self._checking.send(said)
        except (StopIteration, BackEndError):
            return None


def _asked(back_end: int, skill: Skill, state: State) -> _Asked:
    return back_end, skill.name, state.bits
