"""Skills with several motions: their variants, and the variant that is executed in a state.

Back ends check one motion at a time: a variant, which is a skill with a name of its own. The state
alone determines the variant that is executed (the Markov contract). If a part has several grasps,
one that allows both pick *and* place is taken: the cheapest, or the first if all cost the same. The
hand does nothing else between the two, so each of their states determines the other.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby

from skillplan.task.motion import Event, Grasp, Visit
from skillplan.task.skill import Skill, Way
from skillplan.task.state import State
from skillplan.task.task import Task
from skillplan.task.verdict import Verdict, VerdictStatus

VARIANTS = "ways"
"""Stage of a verdict that refuses all variants of a skill at different stages."""

_MOST_REASONS = 6


@dataclass(frozen=True, slots=True)
class Variant:
    """A skill with one of its motions.

    Parameters
    ----------
    label
        Describes the motion.
    """

    label: str
    skill: Skill


@dataclass(frozen=True, slots=True)
class GraspVariants:
    """The variants of a pick and a place that share one grasp.

    Parameters
    ----------
    picks
        One variant of the pick, or none.
    places
        Variants of the place, one per direction.
    """

    picks: tuple[Variant, ...]
    places: tuple[Variant, ...]


@dataclass(frozen=True, slots=True)
class Pairing:
    """A pick and a place that must share one of several grasps.

    Parameters
    ----------
    grasps
        Their variants by grasp, the preferred grasp first.
    """

    pick: Skill
    place: Skill
    grasps: tuple[GraspVariants, ...]


class SkillVariants:
    """The variants of all skills of a task.

    Attributes
    ----------
    queried
        Skills that back ends check, by name: skills with one motion, and all variants.
    """

    def __init__(self, task: Task) -> None:
        self._variants: dict[str, tuple[Variant, ...]] = {}
        self.queried: dict[str, Skill] = {}
        for skill in task.skills:
            variants = tuple(Variant(way.label, skill.by(way)) for way in skill.ways)
            if variants:
                self._variants[skill.name] = variants
            for queried in [variant.skill for variant in variants] or [skill]:
                self.queried[queried.name] = queried
        self._pairings: dict[str, Pairing] = {}
        self._places = 0
        if self._variants:
            self._places = _robot_place_bits(task)
            for pairing in self._pair(task):
                self._pairings[pairing.pick.name] = pairing
                self._pairings[pairing.place.name] = pairing

    def of(self, skill: Skill) -> tuple[Variant, ...]:
        """Return the variants of a skill, the preferred first; none if it has one motion."""
        return self._variants.get(skill.name, ())

    def pairing(self, skill: Skill) -> Pairing | None:
        """Return the pairing in which a skill shares its grasp, or None."""
        return self._pairings.get(skill.name)

    def lane(self, skill: Skill) -> str:
        """Return a name that is equal for skills whose verdicts may answer each other."""
        pairing = self._pairings.get(skill.name)
        return skill.name if pairing is None else pairing.pick.name

    def by_label(self, skill: Skill, label: str) -> Skill:
        """Return the variant of a skill with a label."""
        return next(variant.skill for variant in self.of(skill) if variant.label == label)

    def before_pick(self, pairing: Pairing, held: State) -> State:
        """Return the state before the pick of a held part, with the arm already over the part.

        The previous place of the arm is lost: the arm is where the pick ends.
        """
        pick = pairing.pick
        added = pick.prediction.add.bits & ~self._places
        requires, forbids = pick.precondition.requires.bits, pick.precondition.forbids.bits
        return State(held.bits & ~added & ~forbids | requires, held.facts)

    def settled(self, pairing: Pairing, skill: Skill) -> int:
        """Return bits of the facts that are the same whenever a skill of a pairing may start.

        These are the facts that the pick needs or changes.
        """
        pick = pairing.pick
        bits = pick.precondition.requires.bits | pick.precondition.forbids.bits
        added = pick.prediction.add.bits
        if skill.name == pick.name:
            return bits | added | pick.prediction.delete.bits
        return bits | added & ~self._places

    def _pair(self, task: Task) -> Iterator[Pairing]:
        picks, places = _by_part(task, Event.GRASP), _by_part(task, Event.RELEASE)
        for part, picks_of_part in picks.items():
            places_of_part = places.get(part, [])
            if len(picks_of_part) != 1 or len(places_of_part) != 1:
                continue
            pick, place = picks_of_part[0], places_of_part[0]
            grasps = []
            for grasp, ways in groupby(place.ways, _grasp):
                pick_labels = {way.label for way in pick.ways if _grasp(way) == grasp}
                place_labels = {way.label for way in ways}
                grasps.append(
                    GraspVariants(
                        tuple(self._labelled(pick, pick_labels)),
                        tuple(self._labelled(place, place_labels)),
                    )
                )
            if all(grasp.picks for grasp in grasps):
                yield Pairing(pick, place, tuple(grasps))

    def _labelled(self, skill: Skill, labels: set[str]) -> Iterator[Variant]:
        return (variant for variant in self.of(skill) if variant.label in labels)


def list_queried_skills(task: Task) -> tuple[Skill, ...]:
    """Return the skills that back ends check: skills with one motion, and all variants."""
    if not any(skill.ways for skill in task.skills):
        return task.skills
    return tuple(SkillVariants(task).queried.values())


def map_queried_skills(task: Task) -> Mapping[str, Skill]:
    """Return the skills that back ends check, by name."""
    return {skill.name: skill for skill in list_queried_skills(task)}


Decide = Callable[[Skill, State], Verdict]
"""Returns the verdict of the chain of back ends on a variant."""


@dataclass(frozen=True, slots=True)
class Prices:
    """Costs that differ between the variants of a skill.

    Parameters
    ----------
    cost
        Returns the cost of a variant in a state; may query a back end.
    basis
        Bits of the facts that a cost may depend on.
    """

    cost: Callable[[Skill, State], float]
    basis: int


def choose_variant(
    variants: SkillVariants,
    decide: Decide,
    skill: Skill,
    state: State,
    prices: Prices | None = None,
) -> Verdict:
    """Return the verdict on an applicable skill with several motions.

    Parameters
    ----------
    decide
        Returns the verdict on a variant.
    prices
        None if all variants cost the same.

    Returns
    -------
    Verdict
        Feasible by the cheapest feasible variant, the first of equal cost, which its evidence
        names; infeasible if all variants are; else unknown. It rests on the facts of all
        variants that were checked.
    """
    pairing = variants.pairing(skill)
    if pairing is None:
        verdicts = VariantVerdicts(skill, state)
        chosen = _choose_cheapest(verdicts, decide, variants.of(skill), state, prices)
        return verdicts.refuse() if chosen is None else verdicts.grant(chosen.label)
    if skill.name == pairing.place.name:
        return _decide_place(variants, pairing, decide, state, prices)
    return _decide_pick(variants, pairing, decide, state, prices)


def _choose_cheapest(
    verdicts: VariantVerdicts,
    decide: Decide,
    variants: Sequence[Variant],
    state: State,
    prices: Prices | None,
    settled: int = 0,
) -> Variant | None:
    """Return the cheapest feasible variant, the first of equal cost, or None.

    Parameters
    ----------
    settled
        Bits of facts that are given by the skill's being applicable.
    """
    feasible = []
    for variant in variants:
        verdict = decide(variant.skill, state)
        if verdicts.note(variant.label, verdict, settled) is VerdictStatus.FEASIBLE:
            if prices is None:
                return variant
            feasible.append(variant)
    if prices is None or len(feasible) < 2:
        return feasible[0] if feasible else None
    verdicts.rest_on(prices.basis & ~settled)
    cost = prices.cost
    return min(feasible, key=lambda variant: cost(variant.skill, state))


class _Grasps:
    """The grasps of a pairing that allow both pick and place, the one to take first.

    That is the preferred one, or the one whose pick and place cost least. The pick is counted from
    above the part, because the state of the place does not show where the arm came from.

    Parameters
    ----------
    before, held
        States of the pick, with the arm over the part, and of the place.
    settled
        Bits of facts that are given by the applicable skill's pick, and by its place.
    """

    def __init__(
        self,
        verdicts: VariantVerdicts,
        decide: Decide,
        pairing: Pairing,
        before: State,
        held: State,
        settled: tuple[int, int],
        prices: Prices | None,
    ) -> None:
        self._verdicts, self._decide, self._pairing = verdicts, decide, pairing
        self._before, self._held, self._settled, self._prices = before, held, settled, prices

    def __iter__(self) -> Iterator[tuple[Variant, Variant]]:
        prices = self._prices
        if prices is None:
            yield from self._feasible()
            return
        pairs = list(self._feasible())
        if len(pairs) > 1:
            # Both states give the cost, whichever skill is decided.
            self._verdicts.rest_on(prices.basis & ~self._settled[0])
            pairs.sort(
                key=lambda pair: (
                    prices.cost(pair[0].skill, self._before)
                    + prices.cost(pair[1].skill, self._held)
                )
            )
        yield from pairs

    def _feasible(self) -> Iterator[tuple[Variant, Variant]]:
        """Yield pick and place by each grasp that allows both, the preferred one first."""
        for grasp in self._pairing.grasps:
            # Places are refused more often, and mostly before a path of the arm is sought.
            place = _choose_cheapest(
                self._verdicts,
                self._decide,
                grasp.places,
                self._held,
                self._prices,
                self._settled[1],
            )
            if place is None:
                continue
            (pick,) = grasp.picks
            verdict = self._decide(pick.skill, self._before)
            status = self._verdicts.note(pick.label, verdict, self._settled[0])
            if status is VerdictStatus.FEASIBLE:
                yield pick, place


def _decide_place(
    variants: SkillVariants, pairing: Pairing, decide: Decide, state: State, prices: Prices | None
) -> Verdict:
    """Return the verdict on a place, by the grasp that the pick took."""
    verdicts = VariantVerdicts(pairing.place, state)
    before = variants.before_pick(pairing, state)
    settled = variants.settled(pairing, pairing.place)
    grasps = _Grasps(verdicts, decide, pairing, before, state, (settled, 0), prices)
    for _, place in grasps:
        return verdicts.grant(place.label)
    return verdicts.refuse()


def _decide_pick(
    variants: SkillVariants, pairing: Pairing, decide: Decide, state: State, prices: Prices | None
) -> Verdict:
    """Return the verdict on a pick, with the grasp that the following place takes."""
    verdicts = VariantVerdicts(pairing.pick, state)
    held = pairing.pick.prediction_in(state).apply(state)
    before = variants.before_pick(pairing, held)
    settled = variants.settled(pairing, pairing.pick)
    grasps = _Grasps(verdicts, decide, pairing, before, held, (settled, settled), prices)
    grasp_of_place: str | None = None
    for pick, _ in grasps:
        verdict = decide(pick.skill, state)
        feasible = verdicts.note(f"{pick.label} from here", verdict) is VerdictStatus.FEASIBLE
        if feasible and grasp_of_place is None:
            return verdicts.grant(pick.label)
        if feasible:
            reason = (
                f"{pick.label} could be taken from here, and the place would take {grasp_of_place}"
            )
            return Verdict.unknown(reason).grounded(state, verdict.stage)
        # The state after the pick does not show that another grasp was taken.
        grasp_of_place = grasp_of_place or pick.label
    return verdicts.refuse()


@dataclass(frozen=True, slots=True)
class _VariantVerdict:
    """The verdict on a variant.

    Parameters
    ----------
    settled
        Bits of facts that are given by the skill's being applicable.
    """

    label: str
    verdict: Verdict
    settled: int


class VariantVerdicts:
    """The verdicts on variants of a skill in a state, in the order of the checks."""

    def __init__(self, skill: Skill, state: State) -> None:
        self._skill = skill
        self._state = state
        self._verdicts: list[_VariantVerdict] = []
        self._basis = 0

    def note(self, label: str, verdict: Verdict, settled: int = 0) -> VerdictStatus:
        """Add a verdict and return its status.

        Parameters
        ----------
        settled
            Bits of facts that are given by the skill's being applicable.
        """
        self._verdicts.append(_VariantVerdict(label, verdict, settled))
        return verdict.status

    def rest_on(self, bits: int) -> None:
        """Add facts on which the choice of the variant depends."""
        self._basis |= bits

    def grant(self, label: str) -> Verdict:
        """Return the verdict that the skill is feasible by a variant."""
        present, absent = self._facts()
        condition = self._skill.condition(self._state)
        evidence: dict[str, object] = {"way": label}
        refused = {refusal.label: refusal.verdict.reason for refusal in self._refusals()}
        if refused:
            evidence["refused"] = refused
        return Verdict.feasible(present | condition.requires, absent | condition.forbids, evidence)

    def refuse(self) -> Verdict:
        """Return the verdict if no variant is feasible: unknown if that on a variant is."""
        refusals = self._refusals()
        for refusal in refusals:
            verdict = refusal.verdict
            if verdict.status is VerdictStatus.UNKNOWN:
                reason = f"by no way it is granted, and {refusal.label}: {verdict.reason}"
                evidence = dict(verdict.evidence)
                return Verdict.unknown(reason, evidence).grounded(self._state, verdict.stage)
        present, absent = self._facts()
        stages = {refusal.verdict.stage for refusal in refusals}
        evidence = {"ways": {refusal.label: refusal.verdict.reason for refusal in refusals}}
        verdict = Verdict.infeasible(_join_reasons(refusals), present, absent, evidence)
        return replace(verdict, stage=stages.pop() if len(stages) == 1 else VARIANTS)

    def _refusals(self) -> list[_VariantVerdict]:
        return [entry for entry in self._verdicts if not entry.verdict.is_feasible]

    def _facts(self) -> tuple[State, State]:
        """Return the true and the false facts on which all verdicts rest."""
        bits = self._basis
        for entry in self._verdicts:
            present, absent = entry.verdict.present, entry.verdict.absent
            if present is None or absent is None:
                bits |= self._state.facts.all_bits
            else:
                bits |= (present.bits | absent.bits) & ~entry.settled
        facts, here = self._state.facts, self._state.bits
        return facts.state(bits & here), facts.state(bits & ~here)


def _join_reasons(refusals: Sequence[_VariantVerdict]) -> str:
    """Return the reasons of refusals in one sentence; equal reasons share a clause."""
    labels: dict[str, list[str]] = {}
    for refusal in refusals:
        labels.setdefault(refusal.verdict.reason, []).append(refusal.label)
    clauses = [f"{' and '.join(names)}: {reason}" for reason, names in labels.items()]
    more = len(clauses) - _MOST_REASONS
    if more > 0:
        clauses = [*clauses[:_MOST_REASONS], f"{more} more"]
    return "; ".join(clauses)


def _by_part(task: Task, event: Event) -> dict[str, list[Skill]]:
    """Return the skills whose motions grasp or release a part by a named grasp, by part."""
    skills: dict[str, list[Skill]] = {}
    for skill in task.skills:
        parts = {
            visit.subject
            for way in skill.ways
            for visit in _visits(way)
            if visit.event is event and visit.grasp is not None
        }
        for part in parts:
            skills.setdefault(part, []).append(skill)
    return skills


def _grasp(way: Way) -> Grasp | None:
    return next((visit.grasp for visit in _visits(way) if visit.grasp is not None), None)


def _visits(way: Way) -> Iterator[Visit]:
    return (visit for route in way.motion.routes for visit in route.visits)


def _robot_place_bits(task: Task) -> int:
    bits = 0
    for robot in task.scene.robots:
        for fact in robot.places:
            if fact in task.facts:
                bits |= task.facts.bit(fact)
    return bits
