"""Find an order of all components of a task, one after another, or those that spoil every order.

Parts are placed one after another, in the order of the plan as far as the checks allow; a failed
part is tried again after others. If some are left, the search goes backwards from the whole: a part
may be the last if it can be placed with all others there. A part that is gone blocks nothing, so
any choice of a last part will do, unless it held another one up: then it comes before that one, and
the search starts again. If none of the rest can be the last, they are in no order, and the one
whose absence costs the fewest others is left out.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from skillplan.chart.hypothetical_state import HypotheticalStates
from skillplan.checks.feasibility import Feasibility
from skillplan.task.skill import Skill
from skillplan.task.task import Task
from skillplan.task.verdict import Verdict

# Largest number of checks for each part, and of parts that are compared for leaving out.
_CHECKS_A_PART, _MOST_COMPARED = 30, 8


@dataclass(frozen=True, slots=True)
class Conflict:
    """Why a part is in no order of the others.

    Parameters
    ----------
    text
        Clause that follows the part's name.
    by
        Names of the parts that it conflicts with.
    failed
        The part whose skill fails, this one or another.
    is_by_hand
        True if the tool or the arm is in the way, so that another tool may help.
    """

    text: str
    by: tuple[str, ...]
    failed: str
    is_by_hand: bool


@dataclass(frozen=True, slots=True)
class Order:
    """Outcome of the search for an order.

    Parameters
    ----------
    parts
        Parts and screws that go in, in order: if the search was cut short, the most that did.
    skills
        Skills that bring them.
    conflicts
        Parts and screws that spoil every order that was tried, by name.
    without
        Parts and screws that need one of those, and were not tried.
    ended
        False if the limits of time or checks were reached before.
    """

    parts: tuple[str, ...]
    skills: tuple[Skill, ...] = ()
    conflicts: Mapping[str, Conflict] = field(default_factory=dict)
    without: tuple[str, ...] = ()
    ended: bool = True


def find_order(
    task: Task,
    feasibility: Feasibility,
    preferred: Sequence[str],
    needs: Mapping[str, Collection[str]],
    must_stop: Callable[[], bool] = lambda: False,
    *,
    may_drop: bool = True,
    kept: Collection[str] = (),
) -> Order:
    """Return an order of the parts and screws of a task that the back ends accept one by one.

    Parameters
    ----------
    preferred
        Names of parts and screws in the order of the plan.
    needs
        Parts that a part or screw rests on or goes into.
    must_stop
        Returns True once the time is over.
    may_drop
        False to give up where a part would have to be left out.
    kept
        Parts with an order of their own; a part that cannot follow it is left out.
    """
    search = _OrderSearch(task, feasibility, preferred, needs, must_stop, kept)
    return search.run(may_drop=may_drop)


class _Spent(Exception):
    """Raised once the limits of time or checks are reached."""


class _OrderSearch:
    def __init__(
        self,
        task: Task,
        feasibility: Feasibility,
        preferred: Sequence[str],
        needs: Mapping[str, Collection[str]],
        must_stop: Callable[[], bool],
        kept: Collection[str],
    ) -> None:
        self._task, self._feasibility, self._must_stop = task, feasibility, must_stop
        self._kept = kept
        self._hypothetical = HypotheticalStates(task)
        self._chains = {name: self._hypothetical.chain(name) for name in task.operations}
        self._turns = self._list_turns()
        listed = [name for name in preferred if name in task.operations]
        self._alive = [*listed, *(name for name in task.operations if name not in listed)]
        self._needs = {
            name: {need for need in needs.get(name, ()) if need in task.operations}
            for name in task.operations
        }
        # Parts that go in before a part: those that its skills require, and those learned.
        self._before = {name: set(self._list_required(name)) for name in task.operations}
        self._most = feasibility.checks + _CHECKS_A_PART * len(self._alive)
        self._bits = {name: 1 << number for number, name in enumerate(task.operations)}
        # By part: placed parts and missing parts that a verdict rests on, and a refusal or None.
        self._decided: dict[str, list[tuple[int, int, Verdict | None]]] = {
            name: [] for name in task.operations
        }
        self._longest: list[str] = []
        # Reasons of parts that are left out, and their dependants.
        self._conflicts: dict[str, Conflict] = {}
        self._without: list[str] = []

    def run(self, *, may_drop: bool) -> Order:
        try:
            order = self._place_all()
            if self._kept and not {*self._kept} & {*self._alive} - {*order}:
                if len(order) == len(self._alive) or not self._take_after_kept(
                    order, may_drop=may_drop
                ):
                    order, self._conflicts = self._follow(order)
                return self._build_order(order, self._conflicts)
            count = 0
            while count < len(order) < len(self._alive):
                # Those that failed may need others that came later, and time may end before proof.
                count = len(order)
                order = self._place_all()
            while len(order) < len(self._alive):
                taken, failed = self._take_apart(self._alive)
                if len(taken) == len(self._alive):
                    order = taken[::-1]
                    break
                if self._learn(taken, failed):
                    continue
                if not may_drop:
                    break
                gone = self._drop_one(taken, failed)
                # A part that is left out may have held another one up.
                order = order if not gone & {*order} else []
        except _Spent:
            placed = self._longest
            missing = {name: why for name, why in self._conflicts.items() if name not in placed}
            return self._build_order(placed, missing, ended=False)
        return self._build_order(order, self._conflicts)

    def _build_order(
        self, order: Sequence[str], conflicts: Mapping[str, Conflict], *, ended: bool = True
    ) -> Order:
        skills = self._list_skills(order)
        return Order(tuple(order), skills, conflicts, tuple(self._without), ended)

    def _drop_one(
        self, taken: Sequence[str], failed: Mapping[str, Verdict], firm: Collection[str] = ()
    ) -> set[str]:
        """Leave out the part without which most others can be placed, with its dependants.

        Parameters
        ----------
        firm
            See `_take_apart`.
        """
        name, conflict = self._choose_dropped(taken, failed, firm)
        self._conflicts[name] = conflict
        needing = self._list_dependants(name) - {*firm}
        self._without += sorted(needing)
        self._leave_out({name, *needing}, taken)
        return {name, *needing}

    def _leave_out(self, gone: set[str], taken: Sequence[str]) -> None:
        """Go on without some parts; those that were taken away first come last."""
        left = [name for name in self._alive if name not in taken]
        self._alive = [name for name in (*left, *reversed(taken)) if name not in gone]
        for before in self._before.values():
            before -= gone

    def _list_required(self, name: str) -> Iterable[str]:
        """Yield the parts whose goals the skills of a part, or turns before them, require."""
        waiting = [fact for skill in self._chains[name] for fact in skill.precondition.requires]
        seen: set[str] = set()
        while waiting:
            fact = waiting.pop()
            if fact in seen:
                continue
            seen.add(fact)
            owner = self._hypothetical.owner(fact)
            if owner not in (None, name) and fact == self._task.operations.get(str(owner)):
                yield str(owner)
            for turn in self._task.skills if owner is None else ():
                if turn.kind == "turn" and fact in turn.prediction.add:
                    waiting += turn.precondition.requires

    def _place_all(self) -> list[str]:
        """Return the parts that can be placed one after another; each is tried once, in turn."""
        order = self._longest
        for name in self._alive:
            done = frozenset(order)
            if (
                name not in done
                and not self._before[name] - done
                and self._find_failure(name, done) is None
            ):
                order.append(name)
        return order

    def _follow(self, order: list[str]) -> tuple[list[str], dict[str, Conflict]]:
        """Return an order with all parts that can follow it, and why the others cannot."""
        count = 0
        while count < len(order):
            count = len(order)
            order = self._place_all()
        failed: dict[str, Conflict] = {}
        waiting: dict[str, Conflict] = {}
        for name in self._alive:
            by = tuple(sorted(self._before[name] - {*order}))
            verdict = None if by or name in order else self._find_failure(name, {*order})
            if verdict is not None:
                failed[name] = self._explain(name, verdict, order)
            elif by:
                words = f"waits for {' and '.join(by)}"
                waiting[name] = Conflict(words, by, name, is_by_hand=False)
        # Parts that wait for a failed one may follow once another tool brings it.
        return order, failed or waiting

    def _explain(self, name: str, verdict: Verdict, order: Sequence[str]) -> Conflict:
        """Return why a part has no place in an order, with what is in its way."""
        by = tuple(self._list_placed_culprits(name, verdict, order))
        others = self._hypothetical.components(verdict) - {name, *by}
        words = f"fails in every order that was tried: {verdict.stage}: {verdict.reason}"
        is_by_hand = f"{name} runs " not in verdict.reason
        return Conflict(words, by or tuple(sorted(others)), name, is_by_hand)

    def _take_after_kept(self, order: list[str], *, may_drop: bool) -> bool:
        """Put the others after the kept parts of an order, in place; return whether they can be."""
        kept = [name for name in order if name in self._kept]
        needed = {other for name in kept for other in self._before[name]}
        if needed - {*kept}:
            return False
        while True:
            others = [name for name in self._alive if name not in self._kept]
            taken, failed = self._take_apart(others, kept)
            if len(taken) == len(others):
                order[:] = [*kept, *reversed(taken)]
                return True
            if self._learn(taken, failed):
                continue
            if not may_drop:
                return False
            self._drop_one(taken, failed, kept)

    def _take_apart(
        self, parts: Iterable[str], firm: Collection[str] = ()
    ) -> tuple[list[str], dict[str, Verdict]]:
        """Return parts that can be the last ones, in order, and why none of the rest can be.

        Parameters
        ----------
        firm
            Further parts, which are in place.
        """
        there, taken = dict.fromkeys(parts), list[str]()
        failed: dict[str, Verdict] = {}
        while there:
            failed.clear()
            needed = {other for name in there for other in self._before[name]}
            for name in reversed([name for name in there if name not in needed]):
                verdict = self._find_failure(name, {*firm, *there} - {name})
                if verdict is None:
                    del there[name]
                    taken.append(name)
                    break
                failed[name] = verdict
            else:
                break
        return taken, failed

    def _find_failure(self, name: str, done: Collection[str]) -> Verdict | None:
        """Return the verdict that refuses a part once exactly some others are placed, or None."""
        placed = sum(self._bits[other] for other in done)
        for there, gone, refusal in self._decided[name]:
            if not (there & ~placed or gone & placed):
                return refusal
        met: set[str] = set()
        for skill in self._chains[name]:
            if self._must_stop() or self._feasibility.checks > self._most:
                raise _Spent
            state = self._hypothetical.before(skill, done)
            for fact in self._turns[name]:
                state, _ = self._hypothetical.reach(state, fact)
            verdict = self._feasibility.verdict(skill, state)
            if not verdict.is_feasible:
                self._keep(name, placed, self._hypothetical.components(verdict), verdict)
                return verdict
            met |= self._hypothetical.components(verdict)
        self._keep(name, placed, met, None)
        return None

    def _keep(self, name: str, placed: int, met: Iterable[str], refusal: Verdict | None) -> None:
        """Keep a verdict with the parts that it rests on: the places of others change nothing."""
        basis = sum(self._bits[other] for other in met if other != name)
        self._decided[name].append((basis & placed, basis & ~placed, refusal))

    def _learn(self, taken: Sequence[str], failed: Mapping[str, Verdict]) -> bool:
        """Put parts that were taken away before those that they held up."""
        rest = {name for name in self._alive if name not in taken}
        learned = False
        for name, verdict in failed.items():
            absent = {self._hypothetical.owner(fact) for fact in verdict.absent or ()}
            held_by = [other for other in taken if other in absent and not self._leads(name, other)]
            # One that holds it up may suffice, and others, such as a lid, be in its way.
            for needed in (*([other] for other in reversed(held_by)), held_by):
                if needed and self._find_failure(name, {*rest, *needed} - {name}) is None:
                    self._before[name].update(needed)
                    learned = True
                    break
        return learned

    def _leads(self, first: str, last: str) -> bool:
        """Return whether a part goes in before another, as far as is known."""
        waiting, seen = [last], set[str]()
        while waiting:
            for other in self._before[waiting.pop()] - seen:
                if other == first:
                    return True
                seen.add(other)
                waiting.append(other)
        return False

    def _list_placed_culprits(self, name: str, verdict: Verdict, order: Sequence[str]) -> list[str]:
        """Return the placed parts that a verdict rests on, in order."""
        present = set(verdict.present or ())
        goals = self._task.operations
        return [other for other in order if other != name and goals[other] in present]

    def _list_dependants(self, name: str) -> set[str]:
        """Return the parts that need a part, directly or not."""
        gone: set[str] = set()
        waiting = [name]
        while waiting:
            base = waiting.pop()
            for other, needs in self._needs.items():
                if base in needs and other not in gone and other in self._alive:
                    gone.add(other)
                    waiting.append(other)
        return gone

    def _choose_dropped(
        self, taken: Sequence[str], failed: Mapping[str, Verdict], firm: Collection[str] = ()
    ) -> tuple[str, Conflict]:
        """Return the part without which most others can be placed, with the reason.

        Parameters
        ----------
        firm
            See `_take_apart`.
        """
        rest = [name for name in self._alive if name not in taken]
        if not failed:
            # They wait for each other.
            waiting = [name for name in rest if name not in firm]
            name = min(waiting, key=lambda other: (len(self._list_dependants(other)), other))
            by = tuple(sorted(self._before[name] & set(rest)))
            words = f"waits for {' and '.join(by)}, which waits for it"
            return name, Conflict(words, by, name, is_by_hand=False)
        blamed: dict[str, list[str]] = {}
        for name, verdict in failed.items():
            for culprit in self._list_placed_culprits(name, verdict, rest):
                blamed.setdefault(culprit, []).append(name)
        dependants = {name: self._list_dependants(name) for name in {**failed, **blamed}}
        droppable = [name for name in dependants if name not in self._kept] or dependants
        compared = sorted(droppable, key=lambda name: len(dependants[name]))[:_MOST_COMPARED]
        lost: dict[str, int] = {}
        for name in compared:
            gone = {name, *dependants[name]}
            left = [other for other in rest if other not in {*gone, *firm}]
            lost[name] = len(gone) + len(left) - len(self._take_apart(left, firm)[0])
        chosen = min(compared, key=lambda name: (lost[name], name not in failed))
        if chosen in failed:
            return chosen, self._explain(chosen, failed[chosen], rest)
        name = blamed[chosen][0]
        verdict = failed[name]
        words = (
            f"is in the way of {' and '.join(blamed[chosen])} in every order that was tried: "
            f"{verdict.stage}: {verdict.reason}"
        )
        is_by_hand = f"{name} runs " not in verdict.reason
        return chosen, Conflict(words, tuple(blamed[chosen]), name, is_by_hand)

    def _list_turns(self) -> dict[str, list[str]]:
        """Return the facts of the turns before each part: a turn needs a free hand."""
        turned = {
            fact
            for skill in self._task.skills
            if skill.kind == "turn"
            for fact in skill.prediction.add
        } - self._hypothetical.stands
        return {
            name: sorted(turned & {f for skill in chain for f in skill.precondition.requires})
            for name, chain in self._chains.items()
        }

    def _list_skills(self, order: Iterable[str]) -> tuple[Skill, ...]:
        """Return the skills that bring the parts in an order, changes of tools included."""
        state, skills = self._task.initial, list[Skill]()
        for name in order:
            for fact in self._turns[name]:
                state, more = self._hypothetical.reach(state, fact)
                skills += more
            state, more = self._hypothetical.bring(state, name)
            skills += more
        return tuple(skills)
