"""The exporter ``pddl``: domain, problem and plan in PDDL 2.1."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from functools import cached_property
from itertools import pairwise
from typing import ClassVar, Final

from pydantic import Field

from skillplan.exporters.exporter import (
    Exporter,
    Handover,
    Identifiers,
    get_argument,
    note_arrivals,
    quote,
    refuse_chance,
)
from skillplan.exporters.pddl.action_costs import (
    NoActionCosts,
    Scale,
    Variant,
    Variants,
    choose_scale,
)
from skillplan.exporters.pddl.conditions import (
    Case,
    ConsistentStates,
    Cover,
    find_covers,
    list_cases,
)
from skillplan.model.skill_model import SkillModel
from skillplan.task import back_end
from skillplan.task.state import Condition, State
from skillplan.task.task import Task

_WORDS = """
define domain problem requirements types constants objects predicates functions action parameters
precondition effect init goal metric minimize maximize total_cost total_time increase decrease
assign scale_up scale_down and or not imply forall exists when either object number derived axiom
always sometime within over all start end from
"""
KEYWORDS: Final = frozenset(_WORDS.split())
PLACE = "location"
_UNKNOWN = "thing"


class Vocabulary:
    """Names of a task's facts in PDDL."""

    def __init__(self, task: Task) -> None:
        self.task = task
        arguments: dict[str, list[str]] = {}
        for fact in task.facts.names:
            arguments.setdefault(self.predicate(fact), [])
            if get_argument(fact):
                arguments[self.predicate(fact)].append(get_argument(fact))
        self._type_of = {
            predicate: _find_type(task, predicate, values)
            for predicate, values in arguments.items()
            if values
        }
        self.types = Identifiers(dict.fromkeys(self._type_of.values()), KEYWORDS)
        taken = KEYWORDS | {self.types[name] for name in self.types}
        self.predicates = Identifiers(arguments, taken)
        self.taken = taken | {self.predicates[name] for name in self.predicates}
        keys = {
            self._object(fact): None for fact in task.facts.names if get_argument(fact)
        }  # an ordered set
        self.objects = Identifiers(keys, self.taken)

    @staticmethod
    def predicate(fact: str) -> str:
        """Return the name of a fact's predicate; with and without argument they differ."""
        return f"{fact.partition('(')[0]}()" if get_argument(fact) else fact

    def type_of(self, predicate: str) -> str | None:
        """Return the identifier of the type of a predicate's argument, or None."""
        name = self._type_of.get(predicate)
        return None if name is None else self.types[name]

    def atom(self, fact: str) -> str:
        """Return a fact as an atom, such as ``(placed part_pcb)``."""
        name = self.predicates[self.predicate(fact)]
        return f"({name} {self.object(fact)})" if get_argument(fact) else f"({name})"

    def object(self, fact: str) -> str:
        """Return the identifier of a fact's object."""
        return self.objects[self._object(fact)]

    def objects_by_type(self) -> dict[str, list[str]]:
        """Return the identifiers of all objects by type."""
        objects: dict[str, list[str]] = {}
        for key in self.objects:
            objects.setdefault(self.types[key.partition("/")[0]], []).append(self.objects[key])
        return objects

    def _object(self, fact: str) -> str:
        return f"{self._type_of[self.predicate(fact)]}/{get_argument(fact)}"


def _find_type(task: Task, predicate: str, arguments: Iterable[str]) -> str:
    """Return the type of a predicate's arguments: a parameter of skills, or places."""
    facts = {fact for fact in task.facts.names if Vocabulary.predicate(fact) == predicate}
    stands = {fact for robot in task.scene.robots for fact in robot.places} | set(task.places)
    if facts <= stands:
        return PLACE
    values: dict[str, set[str]] = {}
    for skill in task.skills:
        for key, value in skill.parameters.items():
            values.setdefault(key, set()).add(value)
    fitting = [key for key, known in values.items() if set(arguments) <= known and "/" not in key]
    return min(fitting, key=lambda key: len(values[key]), default=_UNKNOWN)


# Separator of a skill's identifier and an action's label, not part of either.
_JOINT = "-"
# Not an identifier of any task, like steps-done and step-after.
_STEP = "step-number"
_MOST_NAMED = 4


class PlanningTask:
    """A task in PDDL; back ends are queried when the actions are needed.

    Parameters
    ----------
    accept_rounding
        True to accept costs as small as the rounding error of a plan.

    Raises
    ------
    NoActionCosts
        If an operation needs costs that PDDL cannot represent.
    """

    def __init__(
        self, handover: Handover, *, accept_rounding: bool = False, count_steps: bool = False
    ) -> None:
        self.handover = handover
        self.accept_rounding = accept_rounding
        self.count_steps = count_steps
        self.model: SkillModel = handover.model
        self.task: Task = handover.task
        self.vocabulary = Vocabulary(self.task)
        self._skills = _name_skills(self.task, self.vocabulary)

    @cached_property
    def origin(self) -> str:
        """Source of the skills' conditions, in words."""
        if self.handover.charted:
            return "the task's hand-made chart"
        if all(skill.motion is None for skill in self.task.skills):
            return "the preconditions of the skills; no back end judges them"
        names = ", ".join(back_end.name for back_end in self.model.feasibility.back_ends)
        return f"derived from the verdicts of {names}"

    @cached_property
    def left_out(self) -> str:
        """Skills with unknown verdicts, in words; may be empty."""
        words = {
            skill: f"{skill} ({cover.left_out})"
            for (skill, _), cover in self._covers.items()
            if cover.left_out
        }
        more = len(words) - _MOST_NAMED
        listed = "; ".join([*words.values()][:_MOST_NAMED])
        return f"{listed}; and {more} more" if more > 0 else listed

    @cached_property
    def impossible(self) -> Mapping[str, str]:
        """Skills that are never feasible, with the reason."""
        possible = {skill for (skill, _), cover in self._covers.items() if cover.feasible}
        return {
            skill: cover.refusal
            for (skill, _), cover in self._covers.items()
            if skill not in possible and cover.refusal
        }

    @cached_property
    def variants(self) -> tuple[Variant, ...]:
        """The actions."""
        split = Variants(self.model, self._states)
        return tuple(
            variant
            for case in self._cases
            for variant in split.of(case, self._covers[case.skill.name, case.label])
        )

    @cached_property
    def _states(self) -> ConsistentStates:
        return ConsistentStates(self.task)

    @cached_property
    def _cases(self) -> tuple[Case, ...]:
        return tuple(case for skill in self.task.skills for case in list_cases(skill))

    @cached_property
    def _covers(self) -> dict[tuple[str, str], Cover]:
        return find_covers(self.model, self._states, self._cases)

    @cached_property
    def actions(self) -> dict[str, str]:
        """Identifiers of the actions, by skill and label."""
        labels: dict[str, list[str]] = {}
        for variant in self.variants:
            labels.setdefault(variant.skill.name, []).append(variant.label)
        actions = {}
        for skill, own in labels.items():
            words = Identifiers(label for label in own if label)
            for label in own:
                suffix = f"{_JOINT}{words[label]}" if label else ""
                actions[f"{skill} {label}".strip()] = f"{self._skills[skill]}{suffix}"
        return actions

    @cached_property
    def scale(self) -> Scale:
        """Conversion of costs to whole numbers."""
        costs = [
            cost
            for variant in self.variants
            for cost in (variant.constant, *variant.origins.values())
        ]
        limit = self.task.step_limit
        accepted = self.accept_rounding
        return choose_scale(costs, self.task.metric.unit, limit, accept_rounding=accepted)

    def domain(self) -> str:
        """Return the domain."""
        known = self.vocabulary
        predicates = dict.fromkeys(map(known.predicate, self.task.facts.names))
        lines = [*self._head(), f"(define (domain {self._name})"]
        lines.append("  (:requirements :strips :typing :negative-preconditions :action-costs)")
        types = [known.types[name] for name in known.types]
        types += [_STEP] if self.count_steps else []
        lines += [f"  (:types {' '.join(types)} - object)"] if types else []
        # Actions name the objects, so they are constants of the domain.
        constants = known.objects_by_type().items()
        lines += ["  (:constants"] if constants else []
        lines += [f"    {' '.join(names)} - {kind}" for kind, names in constants]
        lines += ["  )"] if constants else []
        lines.append("  (:predicates")
        for name in predicates:
            own, kind = known.predicates[name], known.type_of(name)
            lines.append(f"    ({own})" if kind is None else f"    ({own} ?x - {kind})")
        lines += [f"    ({guard} ?from - {kind})" for guard, kind in self._guards()]
        if self.count_steps:
            lines += [f"    (steps-done ?x - {_STEP})", f"    (step-after ?x ?y - {_STEP})"]
        lines.append("  )")
        lines.append("  (:functions (total-cost) - number")
        for variant in self.variants:
            if variant.origins:
                cost = self._cost_of(variant)
                lines.append(f"    ({cost} ?from - {self._kind(variant)}) - number")
        lines.append("  )")
        for variant in self.variants:
            lines += self._action(variant)
        return "\n".join(lines) + "\n)\n"

    def problem(self) -> str:
        """Return the problem."""
        known = self.vocabulary
        lines = [*self._head(), f"(define (problem {self._name}_problem)"]
        lines.append(f"  (:domain {self._name})")
        steps = [f"step-{n}" for n in range(self.task.step_limit + 1)] if self.count_steps else []
        lines += [f"  (:objects {' '.join(steps)} - {_STEP})"] if steps else []
        lines.append("  (:init (= (total-cost) 0)")
        lines += [f"    (steps-done {step})" for step in steps[:1]]
        lines += [f"    (step-after {step} {after})" for step, after in pairwise(steps)]
        lines += [f"    {known.atom(fact)}" for fact in self.task.initial]
        for variant in self.variants:
            for fact, cost in variant.origins.items():
                place = known.object(fact)
                lines.append(f"    (= ({self._cost_of(variant)} {place}) {self.scale.whole(cost)})")
                if not self._everywhere(variant):
                    lines.append(f"    ({self._guard(variant)} {place})")
        lines.append("  )")
        goal = " ".join(self._literals(self.task.goal))
        lines += [f"  (:goal (and {goal}))", "  (:metric minimize (total-cost))"]
        return "\n".join(lines) + "\n)\n"

    def plan(self) -> str:
        """Return the plan as planners write it: an action in each line, and the total cost."""
        lines, total = [], 0
        by_skill: dict[str, list[Variant]] = {}
        for candidate in self.variants:
            by_skill.setdefault(candidate.skill.name, []).append(candidate)
        for number, planned in enumerate(self.handover.skills):
            variant = next(
                candidate
                for candidate in by_skill[planned.skill.name]
                if Condition(candidate.requires, candidate.forbids).holds(planned.before)
                and (
                    not candidate.origins
                    or any(fact in planned.before for fact in candidate.origins)
                )
            )
            words = [self.actions[_build_key(variant)]]
            cost = variant.constant
            for fact, known_cost in variant.origins.items():
                if fact in planned.before:
                    words.append(self.vocabulary.object(fact))
                    cost = known_cost
            total += self.scale.whole(cost)
            words += [f"step-{number}", f"step-{number + 1}"] if self.count_steps else []
            lines.append(f"({' '.join(words)})")
        return "\n".join([*lines, f"; cost = {total} (general cost)"]) + "\n"

    @cached_property
    def _name(self) -> str:
        return Identifiers([self.task.name], self.vocabulary.taken)[self.task.name]

    def _head(self) -> Iterator[str]:
        task, scale = self.task, self.scale
        yield f"; {quote(task.name)}, written by skillplan."
        yield f"; Order of operations: {quote(self.origin)[1:-1]}."
        if self.left_out:
            yield f"; Never done where no verdict is known: {quote(self.left_out)[1:-1]}."
        for skill, why in self.impossible.items():
            yield f"; No action for {quote(skill)}, which is never feasible: {quote(why)[1:-1]}."
        if scale.exact:
            yield f"; Costs are whole numbers [{scale.unit}], not rounded."
        else:
            most = task.step_limit
            yield f"; Costs are in whole {scale.unit}s, rounded to the nearest. A plan of n skills"
            yield f"; is off by at most n / 2 of them, one of {most} by {most / 2:g}. Plans that"
            yield f"; are nearer to each other than {most} of them may change places: the best one"
            yield "; here may cost so much more than the best one of the task, and no more."
        if not self.count_steps:
            yield f"; Not said here: no plan of the task has more than {task.step_limit} skills."
        yield "; Names:"
        yield from (f";   {own} = {quote(name)}" for name, own in self.actions.items())
        for names in (self.vocabulary.predicates, self.vocabulary.objects):
            yield from (f";   {line}" for line in names.lines())

    def _action(self, variant: Variant) -> Iterator[str]:
        literals = self._literals(Condition(variant.requires, variant.forbids))
        effects = self._effects(variant)
        parameters = []
        if variant.origins:
            literals.append(f"({self._where(variant)} ?from)")
            if not self._everywhere(variant):
                literals.append(f"({self._guard(variant)} ?from)")
            effects.append(f"(increase (total-cost) ({self._cost_of(variant)} ?from))")
            parameters.append(f"?from - {self._kind(variant)}")
        else:
            effects.append(f"(increase (total-cost) {self.scale.whole(variant.constant)})")
        if self.count_steps:
            literals += ["(steps-done ?now)", "(step-after ?now ?next)"]
            effects += ["(not (steps-done ?now))", "(steps-done ?next)"]
            parameters.append(f"?now ?next - {_STEP}")
        yield f"  (:action {self.actions[_build_key(variant)]}"
        yield f"    :parameters ({' '.join(parameters)})"
        yield f"    :precondition (and {' '.join(literals)})"
        yield f"    :effect (and {' '.join(effects)}))"

    def _effects(self, variant: Variant) -> list[str]:
        """Return the effects that change something."""
        known, facts = self.vocabulary, self.task.facts
        bits = variant.outcome.delete.bits & ~variant.forbids.bits
        for group in facts.exclusive:
            members = facts.of(*group).bits
            if members & variant.requires.bits:
                bits &= ~members | variant.requires.bits
        origins = facts.of(*variant.origins).bits
        effects = []
        if origins and origins & ~(variant.outcome.delete.bits | variant.outcome.add.bits) == 0:
            # The robot leaves its place, unless the action adds it again.
            effects.append(f"(not ({self._where(variant)} ?from))")
            bits &= ~origins
        added = [known.atom(fact) for fact in variant.outcome.add - variant.requires]
        return effects + [f"(not {known.atom(fact)})" for fact in facts.names_of(bits)] + added

    def _literals(self, condition: Condition) -> list[str]:
        known = self.vocabulary
        return [
            *(known.atom(fact) for fact in condition.requires),
            *(f"(not {known.atom(fact)})" for fact in condition.forbids),
        ]

    def _where(self, variant: Variant) -> str:
        return self.vocabulary.predicates[self._predicate(variant)]

    def _kind(self, variant: Variant) -> str:
        return str(self.vocabulary.type_of(self._predicate(variant)))

    def _predicate(self, variant: Variant) -> str:
        return self.vocabulary.predicate(next(iter(variant.origins)))

    def _cost_of(self, variant: Variant) -> str:
        return f"cost-{self.actions[_build_key(variant)]}"

    def _guard(self, variant: Variant) -> str:
        return f"from-{self.actions[_build_key(variant)]}"

    def _guards(self) -> Iterator[tuple[str, str]]:
        for variant in self.variants:
            if variant.origins and not self._everywhere(variant):
                yield self._guard(variant), self._kind(variant)

    def _everywhere(self, variant: Variant) -> bool:
        """Return True if the skill may start at every place of the robot."""
        predicate = self._predicate(variant)
        known = [f for f in self.task.facts.names if self.vocabulary.predicate(f) == predicate]
        left: State = self.task.facts.of(*known) - variant.forbids
        return len(left) <= len(variant.origins)


class ActionNames:
    """Reads the actions of plans without querying back ends."""

    def __init__(self, task: Task) -> None:
        self._skills = _name_skills(task, Vocabulary(task))

    def skill_of(self, action: str) -> str | None:
        """Return the name of an action's skill; None for an unknown action."""
        return self._skills.name_of(action.partition(_JOINT)[0])


def _name_skills(task: Task, vocabulary: Vocabulary) -> Identifiers:
    return Identifiers((skill.name for skill in task.skills), vocabulary.taken)


def _build_key(variant: Variant) -> str:
    return f"{variant.skill.name} {variant.label}".strip()


DOMAIN, PROBLEM, PLAN = "domain.pddl", "problem.pddl", "plan.txt"


class PddlExporter(Exporter):
    """A folder with domain and problem in PDDL 2.1, typed, with action costs, and the plan."""

    name: ClassVar[str] = "pddl"
    suffix: ClassVar[str] = ""
    needs_plan: ClassVar[bool] = False

    class Options(back_end.Options):
        """Options of costs and of the step limit."""

        accept_rounding: bool = Field(
            default=False,
            description="accept costs as small as the error of rounding a plan to whole "
            "micrometres or microseconds [-]",
        )
        count_steps: bool = Field(
            default=False, description="include the step limit; planners take longer [-]"
        )

    options: Options
    _made: PlanningTask | None = None

    def refuses(self, handover: Handover) -> str | None:
        """Refuse chance, and costs that PDDL cannot represent or rounding hides."""
        refusal = refuse_chance(handover)
        if refusal:
            return refusal
        if handover.task.counts_waits:
            return (
                "parts arrive at a time ('arrives_s'), and costs that contain the waits depend on "
                "more than the state. Give cost: distance"
            )
        try:
            self.planning_task(handover).scale  # noqa: B018
        except NoActionCosts as error:
            return str(error)
        return None

    def notes(self, handover: Handover) -> tuple[str, ...]:
        """Return that times of arrival and skills with unknown verdicts are left out."""
        left_out = self.planning_task(handover).left_out
        unknown = (f"never done where no verdict is known: {left_out}",) if left_out else ()
        return (*unknown, *note_arrivals(handover))

    def files(self, handover: Handover) -> Mapping[str, str | bytes]:
        """Return domain and problem, and the plan if there is one."""
        task = self.planning_task(handover)
        files = {DOMAIN: task.domain(), PROBLEM: task.problem()}
        return {PLAN: task.plan(), **files} if handover.plan is not None else files

    def planning_task(self, handover: Handover) -> PlanningTask:
        """Return the planning task, constructed once."""
        if self._made is None or self._made.handover is not handover:
            self._made = PlanningTask(
                handover,
                accept_rounding=self.options.accept_rounding,
                count_steps=self.options.count_steps,
            )
        return self._made
