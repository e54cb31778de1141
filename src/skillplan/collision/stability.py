"""The detector ``stability``: contact forces hold the product, or clamps, holders, screws and fits.

After a part is placed or let go of, all parts that touch it stand by themselves or are held. During
a turn, gravity pulls along every direction that it takes, and nothing but the workholder and its
holders turns along.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from pydantic import Field

from skillplan.collision.detector import Detector
from skillplan.collision.solid import TOUCH_M, Solid
from skillplan.collision.standing import (
    Standing,
    Touch,
    Weight,
    decide_standing,
    find_touches,
    weigh,
)
from skillplan.task import back_end
from skillplan.task.back_end import BackEnd
from skillplan.task.pose import Pose
from skillplan.task.scene import WORLD, Body, Placement, Workholder
from skillplan.task.shape import Box
from skillplan.task.skill import Skill
from skillplan.task.state import AND, State
from skillplan.task.task import Task
from skillplan.task.verdict import Verdict

TABLE = "the table"
_TABLE_M = 40.0
# Angle between two directions of gravity at which a turn is checked [degrees].
_STEP_DEG = 10.0
_GRAVITY_M_PER_S2 = 9.81
# Jaws on both sides of a part bear its weight by friction.
_JAWS = 2
# Facts of bodies that belong to a product.
_BUILT_IN = ("placed(", "at_goal(", "single(", "fastened(")


@dataclass(frozen=True)
class _There:
    """A body at one of its places."""

    body: Body
    placement: Placement

    @property
    def key(self) -> tuple[str, str]:
        return self.body.name, self.placement.fact

    @cached_property
    def solid(self) -> Solid:
        return Solid(self.body.exact_shapes, self.placement.pose)


@dataclass(frozen=True)
class _Product:
    """Bodies that touch each other in a state, and the facts that this rests on.

    Parameters
    ----------
    loose
        Parts that may move, by name.
    touches
        Contacts of these parts with each other and with firm bodies.
    joined
        Pairs of parts that move as one.
    held
        Parts that a holder keeps, or that are fixed to a firm body.
    """

    loose: dict[str, _There]
    weights: dict[str, Weight]
    touches: list[Touch]
    joined: list[tuple[str, str]]
    held: set[str]


class StabilityDetector(Detector):
    """Checks that placed parts stand or are held, also while they turn."""

    name = "stability"
    expected_s = 0.002

    class Options(back_end.Options):
        """Options of contact forces."""

        friction: float = Field(
            default=0.3,
            ge=0,
            le=2,
            description="coefficient of friction where parts lie on others, and between jaws [-]",
        )
        tilt_deg: float = Field(
            default=2.0,
            ge=0,
            le=30,
            description="tilt of the ground in any direction at which parts must still stand [deg]",
        )

    options: Options

    def __init__(self, task: Task, options: Options | None = None) -> None:
        super().__init__(task, options)
        self._is_alone = True
        self._touches: dict[tuple[tuple[str, str], tuple[str, str]], Touch | None] = {}
        # By touches, parts, joined pairs, held parts, direction against gravity and tilt.
        self._standing: dict[tuple[object, ...], Standing] = {}
        self._verdicts: dict[str, list[Verdict]] = {}

    def beside(self, others: Sequence[BackEnd]) -> None:
        """Check for another back end that checks geometry."""
        self._is_alone = not any(other.expensive or isinstance(other, Detector) for other in others)

    def not_checked(self) -> tuple[str, ...]:
        """Return forces of works and insertions, and all geometry if no other detector is there."""
        pushed = [skill.kind for skill in self.task.skills if skill.kind in ("press", "dispense")]
        works = "forces of works on loose parts"
        alone = "collisions, reach and the arm's motion: only the stability of parts is checked"
        bare = [part for h in self.task.scene.holders if not h.fixtures for part in h.facts]
        room = f"the room for the supports of {', '.join(bare)}: no holder of theirs has a body"
        notes = ((works, pushed), (alone, self._is_alone), (room, bare))
        return tuple(words for words, applies in notes if applies)

    def check(self, skill: Skill, state: State) -> Verdict:
        """Check that parts stand during and after `skill`; see :meth:`BackEnd.check`."""
        known = self._verdicts.setdefault(skill.name, [])
        for verdict in known:
            if verdict.applies_in(state):
                return verdict
        verdict = self._judge(skill, state)
        known.append(verdict)
        return verdict

    def _judge(self, skill: Skill, state: State) -> Verdict:
        if skill.kind == "turn":
            return self._judge_turn(skill, state)
        part = skill.parameters.get("part")
        if part is None or skill.kind not in ("place", "release"):
            return Verdict.feasible(self.task.facts.none, self.task.facts.none)
        before = _Basis(state)
        after = skill.prediction_in(state).apply(state)
        # Facts that the skill changes follow from it.
        basis = _Basis(after)
        there = self._find_there(part, basis)
        if there is None:
            return before.copy_of(basis, skill).feasible()
        product = self._collect(there, basis, None)
        reason = self._find_fall(product, after, [(0.0, 0.0, 1.0)], self.options.tilt_deg)
        return before.copy_of(basis, skill).judge(reason, sorted(product.loose))

    def _judge_turn(self, skill: Skill, state: State) -> Verdict:
        workholder = self.task.scene.find_workholder(skill.parameters["workholder"])
        begin = workholder.find_orientation(state)
        (end,) = (
            fact for fact in skill.prediction_in(state).add if fact in workholder.orientations
        )
        basis = _Basis(state)
        basis.hold(begin)
        product = _Product({}, {}, [], [], set())
        for there in self._list_built_in():
            turns = begin in there.placement.fact.split(AND)
            if not turns or there.body.name in product.loose:
                continue
            if basis.hold(there.placement.fact):
                more = self._collect(there, basis, workholder)
                product.loose.update(more.loose)
                product.weights.update(more.weights)
                product.touches.extend(more.touches)
                product.joined.extend(more.joined)
                product.held.update(more.held)
        ups = list(_list_ups(workholder, begin, end))
        tilt_deg = max(self.options.tilt_deg, _STEP_DEG / 2)
        reason = self._find_fall(product, state, ups, tilt_deg)
        if reason is not None:
            reason = f"{reason} while {skill.parameters['workholder']} turns"
        return basis.judge(reason, sorted(product.loose))

    def _find_fall(
        self,
        product: _Product,
        state: State,
        ups: Iterable[tuple[float, float, float]],
        tilt_deg: float,
    ) -> str | None:
        """Return the reason why parts move, or None if all stand or are held."""
        firm = _close(product.held, product.joined)
        if product.loose.keys() <= firm:
            return self._find_weak_holder(product, state, ups, tilt_deg)
        for up in ups:
            standing = self._decide_standing(product, product.held, up, tilt_deg)
            if not standing.stands:
                return standing.reason
        return self._find_weak_holder(product, state, ups, tilt_deg)

    def _find_weak_holder(
        self,
        product: _Product,
        state: State,
        ups: Iterable[tuple[float, float, float]],
        tilt_deg: float,
    ) -> str | None:
        """Return the reason why the force of a holder that is needed does not suffice, or None."""
        for holder in self.task.scene.holders:
            held = [part for part, fact in holder.facts.items() if fact in state]
            if holder.force_n is None or not held or held[0] not in product.loose:
                continue
            others = product.held - set(held)
            alone = [self._decide_standing(product, others, up, tilt_deg).stands for up in ups]
            mass_kg = sum(weight.mass_kg for weight in product.weights.values())
            needed_n = mass_kg * _GRAVITY_M_PER_S2
            bears_n = _JAWS * self.options.friction * holder.force_n
            if not all(alone) and needed_n > bears_n:
                return (
                    f"{holder.name} bears {bears_n:.3g} N by friction with its force of "
                    f"{holder.force_n:g} N, and {held[0]} with all on it weighs {needed_n:.3g} N"
                )
        return None

    def _decide_standing(
        self, product: _Product, held: set[str], up: tuple[float, float, float], tilt_deg: float
    ) -> Standing:
        """Return whether a product stands; the answer is kept, whichever part came last."""
        key = (
            frozenset(map(id, product.touches)),
            frozenset(there.key for there in product.loose.values()),
            frozenset(map(frozenset, product.joined)),
            frozenset(held),
            up,
            tilt_deg,
        )
        if key not in self._standing:
            self._standing[key] = decide_standing(
                product.weights,
                product.touches,
                held,
                joined=product.joined,
                up=up,
                friction=self.options.friction,
                tilt_deg=tilt_deg,
            )
        return self._standing[key]

    def _find_there(self, part: str, basis: _Basis) -> _There | None:
        """Return where a part is built in, or None."""
        for there in self._list_built_in():
            if there.body.name == part and basis.hold(there.placement.fact):
                return there
        return None

    def _collect(self, first: _There, basis: _Basis, turning: Workholder | None) -> _Product:
        """Return the parts that touch a part, directly or over others that are not held.

        Parameters
        ----------
        turning
            Workholder that turns; only its own bodies are firm then.
        """
        product = _Product({}, {}, [], [], set())
        border = [first]
        while border:
            there = border.pop()
            name = there.body.name
            if name in product.loose:
                continue
            product.loose[name] = there
            product.weights[name] = weigh(there.solid, there.body.mass_kg)
            for holder in self.task.scene.holders:
                if name in holder.facts and basis.hold(holder.facts[name]):
                    product.held.add(name)
            border += self._join(there, basis, product)
            for other in self._places:
                if other.body.name == name or not self._touch(there, other):
                    continue
                if other.body.name != TABLE and not basis.hold(other.placement.fact):
                    continue
                touch = self._touch(there, other)
                assert touch is not None
                if _is_firm(other, turning):
                    product.touches.append(touch)
                elif _is_loose(other):
                    if other.body.name not in product.loose:
                        product.touches.append(touch)
                    if name not in product.held:
                        border.append(other)
        reached = product.loose.keys()
        kept = [
            touch
            for touch in product.touches
            if all(n in reached or not self._is_part(n) for n in (touch.body, touch.other))
        ]
        # A held part bounds the product; parts beyond it do not matter.
        return replace(product, touches=kept)

    def _join(self, there: _There, basis: _Basis, product: _Product) -> Iterator[_There]:
        """Yield the parts that screws and fits join to a part, and add the pairs."""
        name = there.body.name
        for body in self.task.scene.bodies:
            partners: list[str] = []
            if name in body.joins and len(body.joins) > 1:
                if not basis.hold(self.task.operations[body.name]):
                    continue
                partners = [other for other in body.joins if other != name]
            elif body.name == name:
                partners = [fit.into for fit in body.fits if fit.holds]
            elif any(fit.holds and fit.into == name for fit in body.fits):
                if not basis.hold(self.task.operations[body.name]):
                    continue
                partners = [body.name]
            for partner in partners:
                if not self._is_part(partner):
                    product.held.add(name)
                    continue
                other = self._find_there(partner, basis)
                if other is not None:
                    product.joined.append((name, partner))
                    yield other

    def _is_part(self, name: str) -> bool:
        """Return True for a part that a hand moves."""
        return name in self.task.operations

    def _touch(self, there: _There, other: _There) -> Touch | None:
        """Return the contact of a part with a body, or None; kept, one for both of two parts."""
        if _is_loose(other) and other.key < there.key:
            there, other = other, there
        key = (there.key, other.key)
        if key not in self._touches:
            low, high = there.solid.box.low, there.solid.box.high
            box = other.solid.box
            near = all(
                low[axis] <= box.high[axis] + TOUCH_M and box.low[axis] <= high[axis] + TOUCH_M
                for axis in range(3)
            )
            solids = {there.body.name: there.solid, other.body.name: other.solid}
            touches = find_touches(solids) if near else []
            self._touches[key] = touches[0] if touches else None
        return self._touches[key]

    @cached_property
    def _places(self) -> tuple[_There, ...]:
        """All bodies at the places where they may bear a part: table, fixtures, product."""
        table = Body(
            TABLE,
            (Box((_TABLE_M, _TABLE_M, 1.0), (0.0, 0.0, -0.5)),),
            (Placement("", Pose((0.0, 0.0, 0.0))),),
            1.0,
            fixed=True,
        )
        there = [_There(table, table.placements[0])]
        for body in self.task.scene.bodies:
            starts = tuple(f"{kind}(" for kind in ("at_start", "in_buffer", "held"))
            for placement in body.placements:
                loads = placement.frame == WORLD and placement.solid and not body.joins
                if loads and not placement.fact.startswith(starts):
                    there.append(_There(body, placement))
        return tuple(there)

    def _list_built_in(self) -> Iterator[_There]:
        return (there for there in self._places if _is_loose(there))


def _is_loose(there: _There) -> bool:
    return not there.body.fixed and there.placement.fact.startswith(_BUILT_IN)


def _is_firm(there: _There, turning: Workholder | None) -> bool:
    """Return True for a body that does not move, or that turns with a workholder."""
    if _is_loose(there):
        return False
    if turning is None:
        return True
    return bool(set(there.placement.fact.split(AND)) & turning.orientations.keys())


def _close(names: set[str], joined: Iterable[tuple[str, str]]) -> set[str]:
    """Return some parts, and the parts joined to them directly or over others."""
    closed, pairs = set(names), list(joined)
    while True:
        more = {name for pair in pairs if closed & set(pair) for name in pair} - closed
        if not more:
            return closed
        closed |= more


def _list_ups(workholder: Workholder, begin: str, end: str) -> Iterator[tuple[float, float, float]]:
    """Yield the directions against gravity in a turn, seen from the product where it begins."""
    x, y, z, w = workholder.turn(begin, end, 0.5).orientation
    angle_deg = math.degrees(4 * math.atan2(math.hypot(x, y, z), abs(w)))
    count = max(1, math.ceil(angle_deg / _STEP_DEG))
    for number in range(count + 1):
        yield workholder.turn(begin, end, number / count).inverse().rotate((0.0, 0.0, 1.0))


class _Basis:
    """Facts that a verdict rests on, read from one state."""

    def __init__(self, state: State) -> None:
        self.state = state
        self.present = self.absent = 0

    def hold(self, fact: str) -> bool:
        """Return whether a fact holds, and record it."""
        if fact in self.state:
            self.present |= self.state.facts.bit(fact)
            return True
        self.absent |= self.state.find_missing(fact).bits
        return False

    def copy_of(self, after: _Basis, skill: Skill) -> _Basis:
        """Return the basis in the state before a skill, from that in the state after it."""
        outcome = skill.prediction_in(self.state)
        changed = outcome.add.bits | outcome.delete.bits
        self.present |= after.present & ~changed
        self.absent |= after.absent & ~changed
        return self

    def feasible(self) -> Verdict:
        """Return that all stand."""
        facts = self.state.facts
        return Verdict.feasible(facts.state(self.present), facts.state(self.absent))

    def judge(self, reason: str | None, bodies: Sequence[str]) -> Verdict:
        """Return the verdict for a reason, or that all stand."""
        if reason is None:
            return self.feasible()
        facts = self.state.facts
        present, absent = facts.state(self.present), facts.state(self.absent)
        return Verdict.infeasible(reason, present, absent, {"bodies": list(bodies)})
