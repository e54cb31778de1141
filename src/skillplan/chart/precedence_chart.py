"""A precedence relation derived from back ends.

The operations of every component are checked in states in which other components are done or not.
``a before b`` if b's operation fails without a, or a's operation fails because b is an obstacle.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise

from skillplan.chart.conflict import explain_conflict
from skillplan.chart.hypothetical_state import HypotheticalStates
from skillplan.chart.partial_order import ClosedRelation, closure, find_shortest_path
from skillplan.chart.partial_order import cycle as shortest_cycle
from skillplan.chart.precedence_query import (
    CheckSteps,
    PrecedenceQuery,
    Relation,
    Undecided,
    run_queries,
)
from skillplan.checks.feasibility import Feasibility
from skillplan.task.skill import Skill
from skillplan.task.task import Task
from skillplan.task.verdict import Verdict

# Greatest number of states checked for the alternatives of a skill.
_MOST_STATES = 256
# Greatest number of conditions in a message.
_MOST_CONDITIONS = 64

Condition = frozenset[tuple[str, bool]]
"""Components, and whether each is done."""


@dataclass(frozen=True, slots=True)
class Alternatives:
    """Groups of pairs, at least one of which must hold.

    Parameters
    ----------
    skill
        Skill that needs them.
    any_of
        At least two groups of pairs, each the first before the second.
    """

    component: str
    skill: str
    any_of: tuple[tuple[tuple[str, str], ...], ...]

    def __str__(self) -> str:
        groups = (
            " and ".join(f"{first} before {second}" for first, second in pairs)
            for pairs in self.any_of
        )
        return ", or ".join(groups)


def alternatives(
    query: PrecedenceQuery, derived: ClosedRelation
) -> CheckSteps[Alternatives | None]:
    """Return the alternatives for a skill, or None if an order has no choice.

    Parameters
    ----------
    derived
        Relation that holds in every order, closed by transitivity.
    """
    search = _Search(query, derived)
    try:
        yield from search.explore(frozenset(), frozenset())
    except Undecided:
        return None
    conditions = simplify_conditions(search.conditions)
    common = frozenset.intersection(*conditions) if conditions else frozenset()
    choices = sorted(
        (sorted(condition - common) for condition in conditions),
        key=lambda choice: (len(choice), choice),
    )
    if len(choices) < 2 or not all(choices) or len(choices) > _MOST_CONDITIONS:
        return None
    component = query.component
    groups = (
        tuple((other, component) if done else (component, other) for other, done in choice)
        for choice in choices
    )
    return Alternatives(component, query.skill.name, tuple(groups))


class _Search:
    """Covers the sets of components that may be done before a skill."""

    def __init__(self, query: PrecedenceQuery, derived: ClosedRelation) -> None:
        self.query = query
        self.derived = derived
        self.conditions: list[Condition] = []
        self._before = derived.before(query.component)
        self._never = derived.after(query.component) | {query.component}
        self._left = _MOST_STATES

    def explore(self, done: frozenset[str], undone: frozenset[str]) -> CheckSteps[None]:
        """Collect the conditions for the skill, if some components are done and others are not.

        The verdict with only the required components done holds for all sets that agree on the
        components it names. The other sets differ in one of these.
        """
        here = self._closed(done)
        if here & (undone | self._never):
            return
        self._left -= 1
        if self._left < 0:
            raise Undecided
        verdict = yield from self.query.check(here)
        named = self.query.hypothetical.components(verdict) - self._never
        if verdict.is_feasible:
            self.conditions.append(frozenset((component, component in here) for component in named))
        passed = undone
        for other in self.query.order:
            if other in named and other not in here and other not in undone:
                yield from self.explore(here | {other}, passed)
                passed |= {other}

    def _closed(self, done: frozenset[str]) -> frozenset[str]:
        """Return the components that are done if some are: with all their predecessors."""
        return frozenset(self._before | done).union(
            *(self.derived.before(component) for component in done)
        )


def simplify_conditions(conditions: Iterable[Condition]) -> tuple[Condition, ...]:
    """Return the weakest conditions, one of which holds if and only if one of some conditions does.

    By consensus and absorption (Quine 1955): two conditions that contradict each other in one
    component imply the union of their remainders.
    """
    weakest = _weakest(conditions)
    while True:
        more = {
            consensus
            for first, second in combinations(weakest, 2)
            if (consensus := _consensus(dict(first), dict(second))) is not None
            if not any(weaker <= consensus for weaker in weakest)
        }
        if not more or len(weakest) > _MOST_STATES:
            return tuple(weakest)
        weakest = _weakest([*weakest, *more])


def _weakest(conditions: Iterable[Condition]) -> list[Condition]:
    unique = list(dict.fromkeys(conditions))
    return [condition for condition in unique if not any(other < condition for other in unique)]


def _consensus(first: Mapping[str, bool], second: Mapping[str, bool]) -> Condition | None:
    opposed = [name for name in first if second.get(name, first[name]) != first[name]]
    if len(opposed) != 1:
        return None
    both = {**first, **second}
    del both[opposed[0]]
    return frozenset(both.items())


_MOST_LINES = 3
_MOST_NAMED = 3


@dataclass(frozen=True)
class DerivedChart:
    """A derived relation, and the hand-made one.

    Parameters
    ----------
    relations
        Derived relations, in the order of the task's components.
    hand_made
        Chart of the task file, or None.
    missing
        Hand-made pairs that the derived ones do not imply.
    extra
        Derived pairs that the hand-made ones do not imply.
    impossible
        Skills that are feasible in no hypothetical state, with the reason.
    conditional
        Skills that depend on more than a relation can express, such as on one of two supports, and
        the facts that matter.
    undecided
        Skills that a back end cannot decide about, or whose dependences are too complex.
    alternatives
        Alternatives of conditional skills, if they concern the order.
    demands
        Relations of all skills, those included that another skill implies.
    """

    relations: tuple[Relation, ...]
    hand_made: tuple[tuple[str, str], ...] | None
    missing: tuple[tuple[str, str], ...]
    extra: tuple[Relation, ...]
    impossible: Mapping[str, str]
    conditional: Mapping[str, tuple[str, ...]]
    undecided: tuple[str, ...] = ()
    alternatives: tuple[Alternatives, ...] = ()
    demands: tuple[Relation, ...] = ()

    @property
    def cycle(self) -> tuple[str, ...]:
        """The shortest cycle of components, or none."""
        return shortest_cycle((r.before, r.after) for r in self.relations)

    @property
    def contradiction(self) -> tuple[str, ...]:
        """A cycle of derived and hand-made pairs together, or none."""
        derived = [(r.before, r.after) for r in self.relations]
        return shortest_cycle([*derived, *(self.hand_made or ())])

    def beyond_order(self, task: Task) -> tuple[str, ...]:
        """Return a sentence for each kind of dependence that no order of components expresses.

        Skills with `alternatives` are left out.
        """
        skills: dict[str, list[str]] = {}
        facts: dict[str, dict[str, None]] = {}
        chosen = {choice.skill for choice in self.alternatives}
        hypothetical = HypotheticalStates(task)
        for skill, literals in self.conditional.items():
            for literal in () if skill in chosen else literals:
                fact = literal.removeprefix("not ")
                kind = hypothetical.dependence(fact)
                if skill not in skills.setdefault(kind, []):
                    skills[kind].append(skill)
                facts.setdefault(kind, {}).setdefault(fact)
        return tuple(
            f"{_listed(names)} depend{'s' * (len(names) == 1)} on {kind} ({_listed(facts[kind])}), "
            "which no order of parts expresses; searches check it in every state"
            for kind, names in skills.items()
        )

    @property
    def contradictions(self) -> tuple[str, ...]:
        """Messages about hand-made pairs that contradict the derived relation, with reasons.

        If only several pairs together do, the shortest cycle of both relations. Empty if the
        derived relation alone allows no order.
        """
        if self.cycle:
            return ()
        derived = [(r.before, r.after) for r in self.relations]
        lines = []
        for before, after in self.hand_made or ():
            path = find_shortest_path(derived, after, before)
            if path:
                words = f"chart: {before} before {after} contradicts geometry: "
                lines.append(words + self._path_words(path))
        if not lines and self.contradiction:
            lines.append(f"chart and geometry contradict: {self._path_words(self.contradiction)}")
        return tuple(lines)

    def _path_words(self, path: Sequence[str]) -> str:
        """Return a message about a path, with the reason for each derived pair."""
        relations = {(r.before, r.after): r for r in self.relations}
        reasons = [
            f"{relations[pair].evidence['skill']}: {relations[pair].reason}"
            for pair in pairwise(path)
            if pair in relations
        ]
        return f"{' before '.join(path)} ({'; '.join(reasons)})"

    def obstacle(self, task: Task) -> str | None:
        """Return the reason why no order can exist, in at most three lines, or None."""
        needed = {name for name, fact in task.operations.items() if fact in task.goal.requires}
        relations = [r for r in self.relations if {r.before, r.after} <= needed]
        lines = explain_conflict(task, relations)
        never = [
            f"{skill} is never feasible: {why}"
            for skill, why in self.impossible.items()
            if _get_component(task.skill(skill)) in needed
        ]
        return "\n".join((lines or never)[:_MOST_LINES]) or None


def _get_component(skill: Skill) -> str | None:
    """Return the screw that a skill fastens, or the part that it handles."""
    return skill.parameters.get("screw") or skill.parameters.get("part")


def _listed(names: Collection[str]) -> str:
    """Return some names, and the number of the others."""
    shown, more = [*names][:_MOST_NAMED], len(names) - _MOST_NAMED
    return ", ".join(shown) + (f" and {more} more" if more > 0 else "")


def derive_chart(feasibility: Feasibility) -> DerivedChart:
    """Return the precedence chart of a task, from its back ends."""
    task = feasibility.task
    relation_of: dict[tuple[str, str], Relation] = {}
    impossible: dict[str, str] = {}
    undecided: list[str] = []
    hypothetical = HypotheticalStates(task)
    # A part with a buffer or with several goals gets there in several ways, and so does one with
    # several tools; no order follows.
    placed = Counter(
        _get_component(skill) or "" for skill in task.skills if skill.kind in ("place", "fasten")
    )
    several = {name for name, count in placed.items() if count > 1}
    if task.scene.workholders or any(holder.fixtures for holder in task.scene.holders):
        # An order in one orientation, or among open jaws, need not hold in another.
        several = set(task.operations)
    undecided += [
        f"{'fasten' if goal.startswith('fastened') else 'place'}({name})"
        for name, goal in task.operations.items()
        if name in several
    ]
    queries = [
        PrecedenceQuery(hypothetical, component, skill)
        for component in task.operations
        if component not in several
        for skill in hypothetical.chain(component)
    ]
    for query, why in zip(queries, run_queries(feasibility, [*map(_derive, queries)]), strict=True):
        if why is None:
            undecided.append(query.skill.name)
        elif why:
            impossible[query.skill.name] = why
        for relation in query.found:
            relation_of.setdefault((relation.before, relation.after), relation)
    derived = closure(relation_of)
    order = ClosedRelation(derived)
    stuck = [query for query in queries if query.skill.name in impossible]
    reasons = run_queries(feasibility, [_last_reason(query, order) for query in stuck])
    impossible |= {q.skill.name: why for q, why in zip(stuck, reasons, strict=True) if why}
    left = [
        query
        for query in queries
        if query.skill.name not in (*undecided, *impossible)
        and (query.component, query.component) not in derived
    ]
    conditional: dict[str, tuple[str, ...]] = {}
    steps = [query.beyond(order) for query in left]
    for query, more in zip(left, run_queries(feasibility, steps), strict=True):
        if more is None:
            undecided.append(query.skill.name)
        elif more:
            conditional[query.skill.name] = more
    unsure = [query for query in left if query.skill.name in conditional]
    choices = run_queries(feasibility, [alternatives(query, order) for query in unsure])
    rank = {component: i for i, component in enumerate(task.operations)}
    relations = tuple(sorted(relation_of.values(), key=lambda r: (rank[r.before], rank[r.after])))
    hand_made = tuple((line.before, line.after) for line in task.chart if not line.instead)
    by_hand = closure(hand_made)
    return DerivedChart(
        relations,
        hand_made or None,
        tuple(pair for pair in hand_made if pair not in derived),
        tuple(r for r in relations if hand_made and (r.before, r.after) not in by_hand),
        impossible,
        conditional,
        tuple(undecided),
        tuple(choice for choice in choices if choice is not None),
        tuple(relation for query in queries for relation in query.found),
    )


def _last_reason(query: PrecedenceQuery, order: ClosedRelation) -> CheckSteps[str]:
    """Return the reason why a skill fails if all components are in place that may precede it.

    A skill that is never feasible fails in every state, mostly because another component is
    missing. The relevant reason remains when none is missing. A reason that no other component can
    change, such as a place out of reach, comes first.
    """
    alone = yield from query.check(frozenset())
    if not alone.is_feasible and _is_of_itself(alone, query.order):
        return f"{alone.stage}: {alone.reason}"
    done = frozenset(query.order) - {query.component} - order.after(query.component)
    verdict = yield from query.check(done)
    if verdict.is_feasible:
        return ""
    return query.hypothetical.reason(verdict, query.component, done)


def _is_of_itself(verdict: Verdict, components: Collection[str]) -> bool:
    """Return whether a skill fails independently of all other components.

    Only evidence from geometry or dynamics shows this.
    """
    evidence = verdict.evidence
    measured = {"bodies", "missed_by_m", "distance_m"} & evidence.keys()
    blames = set(evidence.get("bodies", ())) & set(components)
    return bool(measured) and not blames and "possible_supports" not in evidence


def _derive(query: PrecedenceQuery) -> CheckSteps[str]:
    """Add the relations of a skill, and return the reason if it is never feasible."""
    needed = yield from query.feasible_set()
    if needed is None:
        verdict = yield from query.check(frozenset())
        return f"{verdict.stage}: {verdict.reason}"
    yield from query.relations(needed)
    return ""
