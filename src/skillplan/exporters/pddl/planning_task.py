"""A task as PDDL: its actions, the texts of domain and problem, and which action is which skill."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property

from skillplan.exporters.handover import Handover
from skillplan.exporters.identifiers import Identifiers, quoted
from skillplan.exporters.pddl.action_costs import Scale, Variant, scale_of, variants
from skillplan.exporters.pddl.order import Order, order_of
from skillplan.exporters.pddl.vocabulary import Vocabulary
from skillplan.model.skill_model import SkillModel
from skillplan.task.condition import Condition
from skillplan.task.state import State
from skillplan.task.task import Task


class PlanningTask:
    """A task as PDDL has it; back ends are queried when its order or its costs are needed.

    Parameters
    ----------
    handover
        The task.
    accept_rounding
        Whether costs may be as small as what rounding comes to.

    Raises
    ------
    NoActionCosts
        By what needs costs, if they cannot be said.
    """

    def __init__(self, handover: Handover, *, accept_rounding: bool = False) -> None:
        self.handover = handover
        self.accept_rounding = accept_rounding
        self.model: SkillModel = handover.model
        self.task: Task = handover.task
        self.vocabulary = Vocabulary(self.task)

    @cached_property
    def order(self) -> Order:
        """What the verdicts come to."""
        return order_of(self.handover)

    @cached_property
    def variants(self) -> tuple[Variant, ...]:
        """The actions there are."""
        return tuple(one for one in self._possible if one.skill.name not in self.order.impossible)

    @cached_property
    def _possible(self) -> tuple[Variant, ...]:
        """The actions there would be if no skill were infeasible everywhere."""
        return tuple(one for skill in self.task.skills for one in variants(self.model, skill))

    @cached_property
    def actions(self) -> Identifiers:
        """Identifiers of the actions, by skill and what tells its variants apart."""
        return Identifiers(map(_name, self._possible), self.vocabulary.taken)

    @cached_property
    def scale(self) -> Scale:
        """How costs are written as whole numbers."""
        costs = [cost for one in self.variants for cost in (one.constant, *one.origins.values())]
        limit = self.task.step_limit
        accepted = self.accept_rounding
        return scale_of(costs, self.task.metric.unit, limit, accept_rounding=accepted)

    def domain(self) -> str:
        """Return the domain."""
        known = self.vocabulary
        predicates = dict.fromkeys(map(known.predicate, self.task.facts.names))
        lines = [*self._head(), f"(define (domain {self._name})"]
        lines.append("  (:requirements :strips :typing :negative-preconditions :action-costs)")
        types = [known.types[name] for name in known.types]
        lines += [f"  (:types {' '.join(types)} - object)"] if types else []
        # In the domain, as actions name them.
        constants = known.objects_by_type().items()
        lines += ["  (:constants"] if constants else []
        lines += [f"    {' '.join(names)} - {kind}" for kind, names in constants]
        lines += ["  )"] if constants else []
        lines.append("  (:predicates")
        for name in predicates:
            own, kind = known.predicates[name], known.type_of(name)
            lines.append(f"    ({own})" if kind is None else f"    ({own} ?x - {kind})")
        lines += [f"    ({guard} ?from - {kind})" for guard, kind in self._guards()]
        lines.append("  )")
        lines.append("  (:functions (total-cost) - number")
        for one in self.variants:
            if one.origins:
                lines.append(f"    ({self._cost_of(one)} ?from - {self._kind(one)}) - number")
        lines.append("  )")
        for one in self.variants:
            lines += self._action(one)
        return "\n".join(lines) + "\n)\n"

    def problem(self) -> str:
        """Return the problem."""
        known = self.vocabulary
        lines = [*self._head(), f"(define (problem {self._name}_problem)"]
        lines.append(f"  (:domain {self._name})")
        lines.append("  (:init (= (total-cost) 0)")
        lines += [f"    {known.atom(fact)}" for fact in self.task.initial]
        for one in self.variants:
            for fact, cost in one.origins.items():
                place = known.object(fact)
                lines.append(f"    (= ({self._cost_of(one)} {place}) {self.scale.whole(cost)})")
                if not self._everywhere(one):
                    lines.append(f"    ({self._guard(one)} {place})")
        lines.append("  )")
        goal = " ".join(self._literals(self.task.goal))
        lines += [f"  (:goal (and {goal}))", "  (:metric minimize (total-cost))"]
        return "\n".join(lines) + "\n)\n"

    def plan(self) -> str:
        """Return the plan in the form of planners: an action a line, and what it costs."""
        lines, total = [], 0
        by_skill: dict[str, list[Variant]] = {}
        for one in self.variants:
            by_skill.setdefault(one.skill.name, []).append(one)
        for planned in self.handover.skills:
            variant = next(
                one
                for one in by_skill[planned.skill.name]
                if Condition(one.requires, one.forbids).holds(planned.before)
            )
            words = [self.actions[_name(variant)]]
            cost = variant.constant
            for fact, known_cost in variant.origins.items():
                if fact in planned.before:
                    words.append(self.vocabulary.object(fact))
                    cost = known_cost
            total += self.scale.whole(cost)
            lines.append(f"({' '.join(words)})")
        return "\n".join([*lines, f"; cost = {total} (general cost)"]) + "\n"

    def skill_of(self, action: str) -> str | None:
        """Return the name of the skill of an action; None of an unknown one."""
        key = self.actions.name_of(action)
        found = (one.skill.name for one in self._possible if _name(one) == key)
        return None if key is None else next(found)

    @cached_property
    def _name(self) -> str:
        return Identifiers([self.task.name], self.vocabulary.taken)[self.task.name]

    def _head(self) -> Iterator[str]:
        task, scale = self.task, self.scale
        yield f"; {quoted(task.name)}, written by skillplan."
        yield f"; Order of operations: {quoted(self.order.origin)[1:-1]}."
        if self.order.beyond:
            yield f"; Left out: {quoted(self.order.beyond)[1:-1]}. Replay plans before use."
        for skill, why in self.order.impossible.items():
            yield f"; No action for {quoted(skill)}, which is never feasible: {quoted(why)[1:-1]}."
        if scale.exact:
            yield f"; Costs are whole numbers [{scale.unit}], not rounded."
        else:
            most = task.step_limit
            yield f"; Costs are in whole {scale.unit}s, rounded to the nearest. A plan of n skills"
            yield f"; is off by at most n / 2 of them, one of {most} by {most / 2:g}. Plans that"
            yield f"; are nearer to each other than {most} of them may change places: the best one"
            yield "; here may cost so much more than the best one of the task, and no more."
        yield f"; Not said here: no plan of the task has more than {task.step_limit} skills."
        yield "; Names:"
        for names in (self.actions, self.vocabulary.predicates, self.vocabulary.objects):
            yield from (f";   {line}" for line in names.lines())

    def _action(self, one: Variant) -> Iterator[str]:
        known = self.vocabulary
        needs = self.order.needs.get(one.skill.name, ())
        forbids = self.order.forbids.get(one.skill.name, ())
        literals = self._literals(Condition(one.requires, one.forbids))
        literals += [known.atom(fact) for fact in needs if fact not in one.requires]
        literals += [f"(not {known.atom(fact)})" for fact in forbids if fact not in one.forbids]
        effects = self._effects(one)
        if one.origins:
            literals.append(f"({self._where(one)} ?from)")
            if not self._everywhere(one):
                literals.append(f"({self._guard(one)} ?from)")
            effects.append(f"(increase (total-cost) ({self._cost_of(one)} ?from))")
            parameters = f"(?from - {self._kind(one)})"
        else:
            effects.append(f"(increase (total-cost) {self.scale.whole(one.constant)})")
            parameters = "()"
        yield f"  (:action {self.actions[_name(one)]}"
        yield f"    :parameters {parameters}"
        yield f"    :precondition (and {' '.join(literals)})"
        yield f"    :effect (and {' '.join(effects)}))"

    def _effects(self, one: Variant) -> list[str]:
        """Return what is brought about, without what is false anyway."""
        known, facts = self.vocabulary, self.task.facts
        bits = one.outcome.delete.bits & ~one.forbids.bits
        for group in facts.exclusive:
            members = facts.of(*group).bits
            if members & one.requires.bits:
                bits &= ~members | one.requires.bits
        origins = facts.of(*one.origins).bits
        effects = []
        if origins and origins & ~(one.outcome.delete.bits | one.outcome.add.bits) == 0:
            # Wherever it stood, it stands there no more, unless it comes back.
            effects.append(f"(not ({self._where(one)} ?from))")
            bits &= ~origins
        added = [known.atom(fact) for fact in one.outcome.add - one.requires]
        return effects + [f"(not {known.atom(fact)})" for fact in facts.names_of(bits)] + added

    def _literals(self, condition: Condition) -> list[str]:
        known = self.vocabulary
        return [
            *(known.atom(fact) for fact in condition.requires),
            *(f"(not {known.atom(fact)})" for fact in condition.forbids),
        ]

    def _where(self, one: Variant) -> str:
        return self.vocabulary.predicates[self._predicate(one)]

    def _kind(self, one: Variant) -> str:
        return str(self.vocabulary.type_of(self._predicate(one)))

    def _predicate(self, one: Variant) -> str:
        return self.vocabulary.predicate(next(iter(one.origins)))

    def _cost_of(self, one: Variant) -> str:
        return f"cost-{self.actions[_name(one)]}"

    def _guard(self, one: Variant) -> str:
        return f"from-{self.actions[_name(one)]}"

    def _guards(self) -> Iterator[tuple[str, str]]:
        for one in self.variants:
            if one.origins and not self._everywhere(one):
                yield self._guard(one), self._kind(one)

    def _everywhere(self, one: Variant) -> bool:
        """Whether the skill may be begun wherever the robot may stand."""
        predicate = self._predicate(one)
        known = [f for f in self.task.facts.names if self.vocabulary.predicate(f) == predicate]
        left: State = self.task.facts.of(*known) - one.forbids
        return len(left) <= len(one.origins)


def _name(one: Variant) -> str:
    return f"{one.skill.name} {one.label}".strip()
