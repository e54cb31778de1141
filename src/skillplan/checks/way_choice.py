"""Which way of a skill is taken in a state: of those that all back ends grant the cheapest.

Where all cost the same, that is the first.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass

from skillplan.checks.deciding import Checking
from skillplan.checks.single_check import Checked, CheckRequest
from skillplan.checks.way_verdict import WayAccount
from skillplan.checks.ways import Pairing, Variant, Ways
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.verdict import Verdict, VerdictStatus

Deciding = Callable[[Skill, State], Checking]


@dataclass(frozen=True, slots=True)
class Prices:
    """What skills cost by each of their ways, where that is not the same.

    Parameters
    ----------
    cost
        Of a skill with one motion in a state; may query a back end.
    basis
        Bits of the facts that it may depend on.
    """

    cost: Callable[[Skill, State], float]
    basis: int


def choosing(
    ways: Ways, deciding: Deciding, skill: Skill, state: State, prices: Prices | None = None
) -> Checking:
    """Decide about a skill with several ways that is applicable in a state.

    Parameters
    ----------
    ways
        Of the task.
    deciding
        Begins to decide about a skill by one of its ways.
    skill, state
        What is asked.
    prices
        None where all ways cost the same.

    Returns
    -------
    Verdict
        Feasible by the cheapest way that is granted, of one price the first, which its evidence
        names; infeasible where all are refused; else unknown. It rests on the facts of all ways
        that were looked at.
    """
    pairing = ways.pairing(skill)
    if pairing is None:
        account = WayAccount(skill, state)
        taken = yield from _cheapest(account, deciding, ways.of(skill), state, prices)
        return account.denied() if taken is None else account.granted(taken.label)
    if skill.name == pairing.place.name:
        return (yield from _placing(ways, pairing, deciding, state, prices))
    return (yield from _picking(ways, pairing, deciding, state))


def _cheapest(
    account: WayAccount,
    deciding: Deciding,
    variants: Sequence[Variant],
    state: State,
    prices: Prices | None,
) -> Generator[CheckRequest, Checked, Variant | None]:
    """Return the cheapest variant that is granted, the first of one price, or None."""
    granted = []
    for one in variants:
        verdict = yield from deciding(one.skill, state)
        if account.note(one.label, verdict) is VerdictStatus.FEASIBLE:
            if prices is None:
                return one
            granted.append(one)
    if prices is None or len(granted) < 2:
        return granted[0] if granted else None
    account.rest_on(prices.basis)
    cost = prices.cost
    return min(granted, key=lambda one: cost(one.skill, state))


def _placing(
    ways: Ways, pairing: Pairing, deciding: Deciding, state: State, prices: Prices | None
) -> Checking:
    """Decide about a place: its grasp is the first by which the part could be picked, too."""
    account = WayAccount(pairing.place, state)
    over = ways.before_pick(pairing, state)
    settled = ways.settled(pairing, pairing.place)
    for holding in pairing.holdings:
        (pick,) = holding.picks
        verdict = yield from deciding(pick.skill, over)
        if account.note(pick.label, verdict, settled) is not VerdictStatus.FEASIBLE:
            continue
        taken = yield from _cheapest(account, deciding, holding.places, state, prices)
        if taken is not None:
            return account.granted(taken.label)
    return account.denied()


def _picking(ways: Ways, pairing: Pairing, deciding: Deciding, state: State) -> Checking:
    """Decide about a pick: by the grasp that the place after it takes, and from where it is."""
    account = WayAccount(pairing.pick, state)
    held = pairing.pick.prediction_in(state).apply(state)
    over = ways.before_pick(pairing, held)
    settled = ways.settled(pairing, pairing.pick)
    due: str | None = None
    for holding in pairing.holdings:
        (pick,) = holding.picks
        verdict = yield from deciding(pick.skill, over)
        free = account.note(pick.label, verdict, settled) is VerdictStatus.FEASIBLE
        for place in holding.places if free else ():
            verdict = yield from deciding(place.skill, held)
            if account.note(place.label, verdict, settled) is not VerdictStatus.FEASIBLE:
                continue
            verdict = yield from deciding(pick.skill, state)
            granted = account.note(f"{pick.label} from here", verdict) is VerdictStatus.FEASIBLE
            if granted and due is None:
                return account.granted(pick.label)
            if granted:
                reason = f"{pick.label} could be taken from here, and the place would take {due}"
                return Verdict.unknown(reason).grounded(state, verdict.stage)
            # The state after the pick would not tell that another grasp was taken.
            due = due or pick.label
            break
    return account.denied()
