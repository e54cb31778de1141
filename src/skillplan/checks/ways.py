"""Skills with several ways: what back ends are asked of them, and which way is taken.

A back end is asked about one motion at a time: about a skill by one of its ways, under a name of
its own. Which way is taken follows from the state alone, as everything does (the Markov contract).
A part that may be held in several ways is taken by the first grasp by which it can be picked *and*
placed: between the two the hand can do nothing else, so that either state tells the other.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import groupby

from skillplan.task.grasp import Grasp
from skillplan.task.motion import Event, Visit
from skillplan.task.skill import Skill, Way
from skillplan.task.state import State
from skillplan.task.task import Task


@dataclass(frozen=True, slots=True)
class Variant:
    """A skill by one of its ways.

    Parameters
    ----------
    label
        The way in words.
    skill
        What back ends are asked about.
    """

    label: str
    skill: Skill


@dataclass(frozen=True, slots=True)
class Holding:
    """The variants of a skill that hold a part in one way.

    Parameters
    ----------
    picks
        Of the skill that takes the part, one; empty where there is nothing to be chosen.
    places
        Of the skill that leaves it, one for every direction.
    """

    picks: tuple[Variant, ...]
    places: tuple[Variant, ...]


@dataclass(frozen=True, slots=True)
class Pairing:
    """A pick and a place that take and leave a part by the same one of several grasps.

    Parameters
    ----------
    pick, place
        The two skills.
    holdings
        Their variants, by grasp, the preferred first.
    """

    pick: Skill
    place: Skill
    holdings: tuple[Holding, ...]


class Ways:
    """The variants of all skills of a task.

    Parameters
    ----------
    task
        Whose skills.

    Attributes
    ----------
    asked
        By name what back ends are asked about: skills without ways, and the variants of others.
    """

    def __init__(self, task: Task) -> None:
        self._variants: dict[str, tuple[Variant, ...]] = {}
        self.asked: dict[str, Skill] = {}
        for skill in task.skills:
            variants = tuple(Variant(way.label, skill.by(way)) for way in skill.ways)
            if variants:
                self._variants[skill.name] = variants
            for one in variants or (Variant("", skill),):
                self.asked[one.skill.name] = one.skill
        self._pairings: dict[str, Pairing] = {}
        for pairing in self._paired(task):
            for skill in (pairing.pick, pairing.place):
                self._pairings[skill.name] = pairing
        self._stands = _stands(task)

    def of(self, skill: Skill) -> tuple[Variant, ...]:
        """Return the variants of a skill, the preferred first; none where it has one motion."""
        return self._variants.get(skill.name, ())

    def pairing(self, skill: Skill) -> Pairing | None:
        """Return with which other skill one shares the grasp, or None."""
        return self._pairings.get(skill.name)

    def lane(self, skill: Skill) -> str:
        """Return a name that skills share where an answer about one may be one about another."""
        pairing = self._pairings.get(skill.name)
        return skill.name if pairing is None else pairing.pick.name

    def variant(self, skill: Skill, label: str) -> Skill:
        """Return a skill by the way of some words."""
        return next(one.skill for one in self.of(skill) if one.label == label)

    def before_pick(self, pairing: Pairing, held: State) -> State:
        """Return where a part that is held would be picked, the arm being over it already.

        Where the arm came from is forgotten by then: the state that a pick begins in is the one
        that its prediction tells, with the arm where the pick ends.
        """
        pick = pairing.pick
        added = pick.prediction.add.bits & ~self._stands
        requires, forbids = pick.precondition.requires.bits, pick.precondition.forbids.bits
        return State(held.bits & ~added & ~forbids | requires, held.facts)

    def settled(self, pairing: Pairing, skill: Skill) -> int:
        """Return bits of the facts that do not depend on the state in which a skill is begun.

        In the states that decide about the grasp: those that the pick needs or changes.
        """
        pick = pairing.pick
        bits = pick.precondition.requires.bits | pick.precondition.forbids.bits
        added = pick.prediction.add.bits
        if skill.name == pick.name:
            return bits | added | pick.prediction.delete.bits
        return bits | added & ~self._stands

    def _paired(self, task: Task) -> Iterator[Pairing]:
        """Yield the picks and places that share several grasps."""
        picks, places = _by_subject(task, Event.GRASP), _by_subject(task, Event.RELEASE)
        for subject, takers in picks.items():
            leavers = places.get(subject, [])
            if len(takers) != 1 or len(leavers) != 1:
                continue
            pick, place = takers[0], leavers[0]
            holdings = []
            for grasp, ways in groupby(place.ways, _grasp):
                labels = {way.label for way in ways}
                holdings.append(
                    Holding(
                        tuple(self._labelled(pick, {w.label for w in _by(pick, grasp)})),
                        tuple(self._labelled(place, labels)),
                    )
                )
            if all(holding.picks for holding in holdings):
                yield Pairing(pick, place, tuple(holdings))

    def _labelled(self, skill: Skill, labels: set[str]) -> Iterator[Variant]:
        return (one for one in self.of(skill) if one.label in labels)


def asked_about(task: Task) -> tuple[Skill, ...]:
    """Return what back ends are asked about of a task: its skills, those with ways by each."""
    if not any(skill.ways for skill in task.skills):
        return task.skills
    return tuple(Ways(task).asked.values())


def asked_by_name(task: Task) -> Mapping[str, Skill]:
    """Return what back ends are asked about of a task, by name."""
    return {skill.name: skill for skill in asked_about(task)}


def _by_subject(task: Task, event: Event) -> dict[str, list[Skill]]:
    """Return the skills whose ways hold a part in several ways, by the part."""
    found: dict[str, list[Skill]] = {}
    for skill in task.skills:
        subjects = {
            visit.subject
            for way in skill.ways
            for visit in _visits(way)
            if visit.event is event and visit.grasp is not None
        }
        for subject in subjects:
            found.setdefault(subject, []).append(skill)
    return found


def _by(skill: Skill, grasp: Grasp | None) -> list[Way]:
    return [way for way in skill.ways if _grasp(way) == grasp]


def _grasp(way: Way) -> Grasp | None:
    return next((visit.grasp for visit in _visits(way) if visit.grasp is not None), None)


def _visits(way: Way) -> Iterator[Visit]:
    return (visit for route in way.motion.routes for visit in route.visits)


def _stands(task: Task) -> int:
    bits = 0
    for robot in task.scene.robots:
        for fact in robot.places:
            if fact in task.facts:
                bits |= task.facts.bit(fact)
    return bits
