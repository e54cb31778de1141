"""The swept motion of a skill: its collisions in any state, and the verdict in one state."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from skillplan.physics.linear_motions import LinearMotion
from skillplan.task.motion import AXES, Event, Point
from skillplan.task.pose import DOWN, Pose, cross, dot, is_same_direction, unit
from skillplan.task.scene import Body, Scene
from skillplan.task.state import State
from skillplan.task.verdict import Verdict, VerdictStatus
from skillplan_pinocchio.arm_model import Vector
from skillplan_pinocchio.gravity import Overload
from skillplan_pinocchio.hand_sweeps import HandSweeps
from skillplan_pinocchio.motion_plan import ArmMotion, Elbow, MotionPlanner
from skillplan_pinocchio.planning.continuous_check import Hit
from skillplan_pinocchio.planning.travel import Unfound
from skillplan_pinocchio.shapes import ConvexPiece, Obstacle, make_standing_pieces, may_touch
from skillplan_pinocchio.skill_travels import SkillTravels
from skillplan_pinocchio.support import Supports, find_supports
from skillplan_pinocchio.sweep import Sweep, Touch


@dataclass(frozen=True)
class Collision:
    """A collision that happens while a fact holds.

    Parameters
    ----------
    fact
        Fact that holds while the obstacle is there; None for a collision in every state.
    reason
        Reason as one clause.
    evidence
        Evidence without the place and depth of a contact.
    touch
        Contact, or None.
    """

    fact: str | None
    reason: str
    evidence: Mapping[str, Any]
    touch: Touch | None = None

    @property
    def whole_evidence(self) -> Mapping[str, Any]:
        """Evidence with the place and depth of a contact [m]."""
        if self.touch is None:
            return self.evidence
        position, depth_m = self.touch.position, self.touch.penetration_m
        return {**self.evidence, "position_m": list(position), "penetration_m": depth_m}


@dataclass(frozen=True)
class ElbowChoice:
    """Alternative paths of the arm, one of which must be free.

    Parameters
    ----------
    paths
        Collisions of the links by elbow position, preferred first.
    """

    paths: tuple[tuple[Collision, ...], ...]
    motion: int


@dataclass(frozen=True)
class Stops:
    """The faces that may end an insertion at its goal.

    Parameters
    ----------
    into
        Bodies that the part has fits in.
    ahead
        Faces that a deeper part would press on.
    along
        Direction of the insertion, in words.
    gaps_m
        Distance to the next body ahead, by its fact [m]; 0 and None for the table.
    """

    body: str
    into: tuple[str, ...]
    ahead: Supports
    along: str
    gaps_m: Mapping[tuple[str, str | None], float]


@dataclass(frozen=True)
class SweptMotion:
    """All events that can make a skill infeasible along one path of the arm.

    Parameters
    ----------
    events
        Collisions in order of the motion.
    supports
        Supports of the parts left behind.
    stops
        Ends of the insertions of parts with a fit.
    travels
        Travels to the motions; None if a motion is impossible or travels are not checked.
    """

    events: tuple[Collision | ElbowChoice, ...]
    supports: tuple[Supports, ...]
    stops: tuple[Stops, ...] = ()
    travels: SkillTravels | None = None


_HAND_SHARE = 0.1
"""Share of the tolerance for hand and tool: the arm presses with full force."""

# Reach of a fit about its part [m].
_REACH_M = 0.0005
# Distance at which a body ahead of an insertion is looked for, and its accuracy [m].
_FAR_M, _ACCURACY_M = 0.02, 2e-5
# Largest component along an axis that still serves to level a direction.
_STEEP = 0.9


class SweptMotionBuilder:
    """Builds swept motions.

    Parameters
    ----------
    sweeps
        Sweeps of hand, tool and load.
    travels
        Returns the travels to motions.
    check_support
        True if parts left behind need support.
    """

    def __init__(
        self,
        scene: Scene,
        planner: MotionPlanner,
        sweeps: HandSweeps,
        travels: Callable[[Sequence[ArmMotion]], SkillTravels],
        *,
        check_support: bool,
    ) -> None:
        self.scene = scene
        self.planner = planner
        self.sweeps = sweeps
        self.travels = travels
        self.check_support = check_support
        self._approaches: dict[LinearMotion, tuple[Collision, ...]] = {}
        # Sweeps of approaches whose collisions with everything are not known yet.
        self._stretches: dict[LinearMotion, tuple[tuple[Sweep, ...], ...]] = {}

    def build(self, motions: Sequence[ArmMotion]) -> SweptMotion:
        """Return the swept motion of a skill from its planned motions."""
        events: list[Collision | ElbowChoice] = []
        supports: list[Supports] = []
        stops: list[Stops] = []
        for index, planned in enumerate(motions):
            motion = planned.motion
            if planned.unreachable is not None:
                evidence = {
                    "position_m": [round(value, 6) for value in planned.unreachable.position],
                    "missed_by_m": planned.unreachable.distance_m,
                }
                events.append(Collision(None, planned.unreachable.reason, evidence))
                return SweptMotion(tuple(events), tuple(supports), tuple(stops))
            events += self.approach(motion)
            events += self._links(planned, index)
            for stretch in self.sweeps.retreat(motion):
                events += self._collisions(stretch)
            if self.check_support and motion.visit.event in (Event.RELEASE, Event.DRIVE):
                supports.append(self._supports(motion))
                if motion.visit.is_fitted and self._stopped_by(motion):
                    stops.append(self._stops(motion))
        return SweptMotion(tuple(events), tuple(supports), tuple(stops), self.travels(motions))

    def approach(self, motion: LinearMotion) -> tuple[Collision, ...]:
        """Return the collisions of hand and load up to the target, in any state."""
        if motion not in self._approaches:
            stretches = self._stretches.pop(motion, None) or self.sweeps.approach(motion)
            collisions = [hit for stretch in stretches for hit in self._collisions(stretch)]
            self._approaches[motion] = (*self._clash(motion), *collisions)
        return self._approaches[motion]

    def find_first_hit(
        self, motion: LinearMotion, holds: Callable[[str], bool]
    ) -> Collision | None:
        """Return the first collision of hand and load up to the target with what is there.

        Parameters
        ----------
        holds
            Returns whether a fact holds.
        """
        if motion not in self._stretches:
            self._stretches[motion] = tuple(self.sweeps.approach(motion))
        clash = next(self._clash(motion), None)
        hits = (self._collisions(stretch, holds) for stretch in self._stretches[motion])
        return clash or next((collisions[0] for collisions in hits if collisions), None)

    def _collisions(
        self, sweeps: Iterable[Sweep], holds: Callable[[str], bool] = lambda fact: True
    ) -> list[Collision]:
        """Return the collisions with what may be there, in the order of the motion."""
        collisions: list[tuple[float, Collision]] = []
        for sweep in sweeps:
            for obstacle in self.planner.obstacles:
                if obstacle.body in sweep.spares or not obstacle.stops(load=sweep.is_load):
                    continue
                if obstacle.fact is not None and not holds(obstacle.fact):
                    continue
                share = 1.0 if sweep.is_load else _HAND_SHARE
                tolerance_m = share * self.planner.tolerance_m
                tolerance_m += sweep.overlaps_m.get(obstacle.body, 0.0)
                touch = sweep.touch(obstacle, tolerance_m, self.planner.samples)
                if touch is not None:
                    collisions.append(
                        (
                            touch.fraction,
                            make_collision(
                                obstacle.fact, sweep.mover, obstacle.body, sweep.label, touch
                            ),
                        )
                    )
        return [collision for _, collision in sorted(collisions, key=lambda pair: pair[0])]

    def _clash(self, motion: LinearMotion) -> Iterator[Collision]:
        clash = self.sweeps.clash(motion, self.planner.tolerance_m)
        if clash is not None:
            mover, label, touch = clash
            yield make_collision(None, mover, motion.visit.subject, label, touch)

    def _links(self, planned: ArmMotion, number: int) -> Iterator[ElbowChoice]:
        paths = tuple(_collect_elbow_collisions(elbow, "the approach") for elbow in planned.elbows)
        if all(paths):
            yield ElbowChoice(paths, number)

    def _supports(self, motion: LinearMotion) -> Supports:
        visit = motion.visit
        body = self.scene.body(visit.subject)
        pieces = make_standing_pieces(body, visit.pose)
        # A zone bears nothing.
        obstacles = tuple(item for item in self.planner.obstacles if item.zone is None)
        if visit.event is Event.DRIVE and not is_same_direction(visit.along, DOWN):
            # A screw is supported along its axis.
            level = visit.pose.inverse()
            pieces = _transform_pieces(level, pieces)
            obstacles = tuple(
                replace(obstacle, pieces=_transform_pieces(level, obstacle.pieces))
                for obstacle in obstacles
            )
        supports = find_supports(body.name, pieces, obstacles, self.planner.tolerance_m)
        if visit.event is Event.RELEASE and self.scene.holders:
            supports = replace(supports, holders=tuple(self.list_holding(body.name)))
        if not visit.is_fitted:
            return supports
        holding = {fit.into for fit in body.fits if fit.holds}
        holders = [
            (obstacle.body, obstacle.fact)
            for obstacle in obstacles
            if obstacle.body in holding
            and any(may_touch(own, other, -_REACH_M) for own in pieces for other in obstacle.pieces)
        ]
        return replace(supports, holders=(*supports.holders, *holders))

    def list_holding(self, part: str) -> list[tuple[str, str | None]]:
        """Return the holders of a part, each with the fact that it holds it."""
        return [
            (holder.name, holder.facts[part])
            for holder in self.scene.holders
            if part in holder.facts
        ]

    def _stopped_by(self, motion: LinearMotion) -> tuple[str, ...]:
        """Return the partners of fits of a released part whose insertion a face must end."""
        fits = self.scene.body(motion.visit.subject).fits
        return tuple(fit.into for fit in fits if fit.stops)

    def _stops(self, motion: LinearMotion) -> Stops:
        """Return the faces ahead of a part at its goal, and the gaps to bodies that are deeper."""
        visit, tolerance_m = motion.visit, self.planner.tolerance_m
        body = self.scene.body(visit.subject)
        x, y, z = visit.along
        across = AXES["y"] if abs(y) < _STEEP else AXES["x"]
        level = Pose.of_axes((0.0, 0.0, 0.0), unit(cross(across, visit.along)), (-x, -y, -z))
        frame = level.inverse()
        standing = make_standing_pieces(body, visit.pose)
        pieces = _transform_pieces(frame, standing)
        obstacles = tuple(
            replace(obstacle, pieces=_transform_pieces(frame, obstacle.pieces))
            for obstacle in self.planner.obstacles
            if obstacle.zone is None
        )
        ahead = find_supports(body.name, pieces, obstacles, tolerance_m)
        gaps_m = {}
        for obstacle in obstacles:
            if obstacle.body == body.name:
                continue
            deep_m = tolerance_m + self._overlap_m(body, obstacle.body)
            gap_m = _find_gap_m(body.name, pieces, obstacle, deep_m)
            if gap_m is not None:
                gaps_m[obstacle.body, obstacle.fact] = gap_m
        return Stops(body.name, self._stopped_by(motion), ahead, _name(visit.along), gaps_m)

    @staticmethod
    def _overlap_m(body: Body, other: str) -> float:
        return max((fit.overlap_m for fit in body.fits if fit.into == other), default=0.0)


def _find_gap_m(
    name: str, pieces: tuple[ConvexPiece, ...], obstacle: Obstacle, deep_m: float
) -> float | None:
    """Return how far pieces may go down until they are too deep in a body [m], or None."""

    def is_deep(far_m: float) -> bool:
        sweep = Sweep("", name, pieces, (0.0, 0.0, -far_m), frozenset())
        return sweep.touch(obstacle, deep_m, 1) is not None

    low_m, high_m = 0.0, _FAR_M
    if not is_deep(high_m):
        return None
    while high_m - low_m > _ACCURACY_M:
        middle_m = (low_m + high_m) / 2
        low_m, high_m = (low_m, middle_m) if is_deep(middle_m) else (middle_m, high_m)
    return max(0.0, high_m - deep_m)


def _name(direction: Point) -> str:
    """Return the name of a direction: ``-z``, or its components."""
    for name, axis in AXES.items():
        along = dot(axis, direction)
        if abs(abs(along) - 1) < 1e-9:
            return f"{'+' if along > 0 else '-'}{name}"
    return "(" + " ".join(f"{value + 0.0:.3g}" for value in direction) + ")"


def _transform_pieces(frame: Pose, pieces: Iterable[ConvexPiece]) -> tuple[ConvexPiece, ...]:
    return tuple(piece.seen_from(frame) for piece in pieces)


def _collect_elbow_collisions(elbow: Elbow, label: str) -> tuple[Collision, ...]:
    """Return the collisions of the arm with one elbow position, permanent ones first."""
    links = tuple(
        make_collision(
            obstacle.fact,
            f"link {link_touch.link} of the arm",
            obstacle.body,
            label,
            link_touch.touch,
        )
        for obstacle, link_touch in elbow.meets
    )
    own: tuple[Collision, ...] = ()
    if elbow.itself is not None:
        own = (_make_self_collision(elbow.itself),)
    if elbow.overload is not None:
        during = "the approach or retreat"
        own += (Collision(None, elbow.overload.reason, elbow.overload.evidence(during)),)
    return (*own, *links)


def _make_self_collision(hit: Hit) -> Collision:
    label = "the approach or retreat"
    return Collision(
        None,
        f"{hit.mover} runs into {hit.other} on {label}",
        {
            "moving": hit.mover,
            "bodies": [],
            "links": [hit.mover, hit.other],
            "during": label,
            "position_m": list(hit.position),
            "fraction": hit.place,
        },
    )


def make_collision(fact: str | None, mover: str, body: str, label: str, touch: Touch) -> Collision:
    """Return the collision of what moves with a body during a phase."""
    evidence = {"moving": mover, "bodies": [body], "during": label, "fraction": touch.fraction}
    return Collision(fact, f"{mover} runs into {body} on {label}", evidence, touch)


class VerdictInState:
    """Decides a verdict in one state and records the facts it rests on.

    Parameters
    ----------
    state
        State in which the skill starts.
    present, absent
        Bits of facts on which the verdict rests from the start.
    stand
        Returns the fact for the arm's place and its joint angles there [rad], or None if it cannot
        stand there.
    """

    def __init__(
        self,
        state: State,
        present: int,
        absent: int,
        stand: Callable[[], tuple[str, Vector | None]],
    ) -> None:
        self.state = state
        self.present = present
        self.absent = absent
        self.stand = stand
        self._elbows: dict[int, int] = {}

    def on(self, motion: SweptMotion) -> Verdict:
        """Return the verdict on a swept motion."""
        for event in motion.events:
            collision = self._collision(event)
            if collision is not None:
                return Verdict.infeasible(collision.reason, *self._rests, collision.whole_evidence)
        for supports in motion.supports:
            verdict = self._unsupported(supports)
            if verdict is not None:
                return verdict
        for stops in motion.stops:
            verdict = self._unstopped(stops)
            if verdict is not None:
                return verdict
        return self._travelled(motion.travels)

    def _travelled(self, travels: SkillTravels | None) -> Verdict:
        """Return the verdict on travels, which is the most expensive check."""
        if travels is None:
            return Verdict.feasible(*self._rests)
        checked_travels = travels.find(*self.stand(), self._elbows, self._holds)
        last = checked_travels[-1].travel if checked_travels else None
        if isinstance(last, Unfound):
            hit = last.hit
            evidence = {
                "moving": hit.mover,
                "bodies": [hit.body],
                "during": "the travel",
                "position_m": list(hit.position),
                "fraction": hit.place,
                "checks": last.checks,
            }
            status = VerdictStatus.INFEASIBLE if last.is_proof else VerdictStatus.UNKNOWN
            present, absent = self._rests
            return Verdict(status, last.reason, "", present, absent, evidence)
        if isinstance(last, Overload):
            during = "the travel"
            reason = f"{last.reason} on {during}; no other way was looked for"
            present, absent = self._rests
            evidence = dict(last.evidence(during))
            return Verdict(VerdictStatus.UNKNOWN, reason, "", present, absent, evidence)
        planned = [travel.evidence for travel in checked_travels if travel.evidence is not None]
        return Verdict.feasible(*self._rests, {"travels": planned} if planned else None)

    @property
    def _rests(self) -> tuple[State, State]:
        facts = self.state.facts
        return facts.state(self.present), facts.state(self.absent)

    def _collision(self, event: Collision | ElbowChoice) -> Collision | None:
        """Return the collision of an event in this state, or None."""
        if isinstance(event, Collision):
            return event if self._holds(event.fact) else None
        blocking: Collision | None = None
        for number, path in enumerate(event.paths):
            collision = next((collision for collision in path if self._holds(collision.fact)), None)
            if collision is None:
                self._elbows[event.motion] = number
                return None
            blocking = blocking or collision
        return blocking

    def _unstopped(self, stops: Stops) -> Verdict | None:
        """Return an infeasible verdict if nothing ends an insertion at its goal, or None."""
        contacts = stops.ahead.contacts
        if any(self._holds(contact.fact) for contact in contacts):
            return None
        there = {key: gap_m for key, gap_m in stops.gaps_m.items() if self._holds(key[1])}
        reason = f"nothing stops {stops.body} at its goal: it could go deeper along {stops.along}"
        if there:
            (nearest, _), gap_m = min(there.items(), key=lambda item: item[1])
            reason += f", and {nearest} is {gap_m * 1e3:.1f} mm ahead"
        possible = sorted({contact.body for contact in contacts})
        evidence = {"body": stops.body, "bodies": [], "possible_supports": possible}
        return Verdict.infeasible(reason, *self._rests, evidence)

    def _unsupported(self, supports: Supports) -> Verdict | None:
        """Return an infeasible verdict if a body is not supported, or None."""
        if any(self._holds(fact) for _, fact in supports.holders):
            return None
        there = [self._holds(contact.fact) for contact in supports.contacts]
        if supports.hold(there):
            return None
        contacts = zip(supports.contacts, there, strict=True)
        names = sorted({contact.body for contact, holds in contacts if holds})
        reason = (
            f"{supports.body} would tip off {', '.join(names)}"
            if names
            else f"{supports.body} has nothing beneath it"
        )
        possible = sorted({contact.body for contact in supports.contacts})
        evidence = {"body": supports.body, "bodies": names, "possible_supports": possible}
        return Verdict.infeasible(reason, *self._rests, evidence)

    def _holds(self, fact: str | None) -> bool:
        """Return whether a fact holds, recording it; None always holds."""
        if fact is None:
            return True
        mask = self.state.facts.bit(fact)
        missing = mask & ~self.state.bits
        if not missing:
            self.present |= mask
            return True
        # Of a conjunction, one fact that does not hold is reason enough.
        self.absent |= missing & -missing
        return False
