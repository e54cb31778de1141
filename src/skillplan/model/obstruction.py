"""Reasons why no plan exists: facts that block a skill in every reachable state.

After a proof that no plan exists, the relevant verdicts are known, so no expensive back end is
queried again. `chart.partial_order` finds the cycle, and `chart.conflict` describes it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field

from skillplan.chart.conflict import explain_conflict
from skillplan.chart.hypothetical_state import HypotheticalStates
from skillplan.chart.precedence_query import Relation
from skillplan.checks.feasibility import PRECONDITION
from skillplan.model.skill_model import SkillModel
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.verdict import Verdict

# Number of skills that are described in full.
_MOST_NAMED = 2


@dataclass
class _Tries:
    """The verdicts on one skill in all states in which it is applicable.

    Attributes
    ----------
    last
        The verdict in the state with the most components in place, in which a missing component is
        the least likely cause.
    """

    states: int = 0
    counts: Counter[tuple[str, str]] = field(default_factory=Counter)
    first: dict[tuple[str, str], Verdict] = field(default_factory=dict)
    last: Verdict = field(default_factory=Verdict.feasible)
    in_place: frozenset[str] = frozenset()

    def note(self, verdict: Verdict, in_place: frozenset[str]) -> None:
        self.states += 1
        key = (verdict.stage, verdict.reason)
        self.counts[key] += 1
        self.first.setdefault(key, verdict)
        if self.states == 1 or len(in_place) > len(self.in_place):
            self.last, self.in_place = verdict, in_place

    @property
    def verdict(self) -> Verdict:
        """The most frequent verdict."""
        return self.first[self.counts.most_common(1)[0][0]]


@dataclass
class _Reached:
    """The reachable states, and the verdicts on the skills in them."""

    states: set[State]
    tries: dict[str, _Tries]
    succeeded: set[str]


def explain_obstruction(model: SkillModel, most_states: int = 20_000) -> str | None:
    """Return the reason why the goal is unreachable, in at most three lines.

    The reason is the shortest cycle of precedence that the verdicts of reachable states show.
    Otherwise it lists the skills towards the goal that fail in every state, except skills that fail
    only because of another one.

    Parameters
    ----------
    model
        Model of a task without a plan; its verdicts should be known.
    most_states
        Greatest number of states, >= 1; larger tasks are not analysed.

    Returns
    -------
    str or None
        None if every skill succeeds in some state, but in no order that reaches the goal; or if
        there are too many states.
    """
    reached = _reach(model, most_states)
    if reached is None:
        return None
    blocked = [
        skill
        for skill in model.task.skills
        if skill.name in reached.tries
        and skill.name not in reached.succeeded
        and _matters(model, skill, reached.states)
    ]
    if not blocked:
        return None
    hypothetical = HypotheticalStates(model.task)
    relations = [
        *_needs(model, hypothetical, reached),
        *(
            relation
            for skill in blocked
            for relation in _relations(hypothetical, skill, reached.tries[skill.name].verdict)
        ),
    ]
    cycle = explain_conflict(model.task, relations)
    return "\n".join(cycle or _sentences(hypothetical, blocked, reached.tries))


def _reach(model: SkillModel, most_states: int) -> _Reached | None:
    """Return the reachable states, or None if there are too many."""
    goals = model.task.operations
    seen = {model.initial}
    queue = [model.initial]
    tries: dict[str, _Tries] = {}
    succeeded: set[str] = set()
    for state in queue:
        in_place = frozenset(name for name, goal in goals.items() if goal in state)
        for skill in model.applicable(state):
            verdict = model.verdict(state, skill)
            if not verdict.is_feasible:
                tries.setdefault(skill.name, _Tries()).note(verdict, in_place)
                continue
            succeeded.add(skill.name)
            for _, following in model.transition(state, skill).outcomes:
                if following not in seen:
                    seen.add(following)
                    queue.append(following)
        if len(seen) > most_states:
            return None
    return _Reached(seen, tries, succeeded)


def _matters(model: SkillModel, skill: Skill, seen: set[State]) -> bool:
    """Return whether the skill adds a fact that is not reached otherwise."""
    gained = [fact for effect in skill.effects for fact in effect.add]
    return any(all(fact not in state for state in seen) for fact in gained)


def _needs(
    model: SkillModel, hypothetical: HypotheticalStates, reached: _Reached
) -> Iterator[Relation]:
    """Yield the precedence that preconditions of never applicable skills impose."""
    for skill in model.task.skills:
        component = hypothetical.component(skill)
        if component is None or skill.name in reached.tries or skill.name in reached.succeeded:
            continue
        for fact in skill.precondition.forbids:
            other = hypothetical.owner(fact)
            if other not in (None, component):
                literal = f"not {fact}"
                evidence = {"skill": skill.name, "stage": PRECONDITION, "facts": [literal]}
                reason = f"{skill.name} needs {literal}"
                yield Relation(str(other), component, reason, evidence, component)


def _relations(
    hypothetical: HypotheticalStates, skill: Skill, verdict: Verdict
) -> Iterator[Relation]:
    """Yield the precedence that a skill imposes which fails in every state.

    Only a verdict that rests on a single other component does so.
    """
    component = hypothetical.component(skill)
    others = hypothetical.components(verdict) - {component}
    if component is None or len(others) != 1:
        return
    (other,) = others
    goal = hypothetical.task.operations[other]
    present = set(verdict.present or ())
    evidence = {"skill": skill.name, "stage": verdict.stage, "facts": verdict.facts}
    before, after = (component, other) if goal in present else (other, component)
    yield Relation(before, after, verdict.reason, {**evidence, **verdict.evidence}, component)


def _sentences(
    hypothetical: HypotheticalStates, blocked: list[Skill], tries: dict[str, _Tries]
) -> list[str]:
    """Return a sentence for each skill that fails for a reason of its own, at most two."""
    failing = {hypothetical.component(skill) for skill in blocked}
    roots = []
    for skill in blocked:
        own = {hypothetical.component(skill)}
        if not (hypothetical.components(tries[skill.name].last) - own) & failing:
            roots.append(skill)
    named = (roots or blocked)[:_MOST_NAMED]
    lines = [_sentence(hypothetical, skill, tries[skill.name]) for skill in named]
    more = len(blocked) - len(named)
    if more:
        lines.append(
            f"{more} more skill{'s' * (more > 1)} towards the goal fail{'s' * (more == 1)}"
        )
    return lines


def _sentence(hypothetical: HypotheticalStates, skill: Skill, tries: _Tries) -> str:
    where = "the only state" if tries.states == 1 else f"all {tries.states} states"
    component = hypothetical.component(skill)
    reason = hypothetical.reason(tries.last, component, tries.in_place)
    return f"{skill.name} fails in {where} in which it can be tried: {reason}"
