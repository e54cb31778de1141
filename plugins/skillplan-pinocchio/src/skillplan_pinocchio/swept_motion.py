"""The swept motion of a skill: its collisions in any state, and the verdict in one state."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from skillplan.physics.linear_motions import LinearMotion
from skillplan.task.motion import Event
from skillplan.task.pose import DOWN, Pose, is_same_direction
from skillplan.task.scene import Scene
from skillplan.task.state import State
from skillplan.task.verdict import Verdict, VerdictStatus
from skillplan_pinocchio.arm_model import Vector
from skillplan_pinocchio.gravity import Overload
from skillplan_pinocchio.hand_sweeps import HandSweeps
from skillplan_pinocchio.motion_plan import ArmMotion, Elbow, MotionPlanner
from skillplan_pinocchio.planning.continuous_check import Hit
from skillplan_pinocchio.planning.travel import Unfound
from skillplan_pinocchio.shapes import ConvexPiece, Obstacle, make_standing_pieces
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
    """

    fact: str | None
    reason: str
    evidence: Mapping[str, Any]


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
class SweptMotion:
    """All events that can make a skill infeasible along one path of the arm.

    Parameters
    ----------
    events
        Collisions in order of the motion.
    supports
        Supports of the parts left behind.
    travels
        Travels to the motions; None if a motion is impossible or travels are not checked.
    """

    events: tuple[Collision | ElbowChoice, ...]
    supports: tuple[Supports, ...]
    travels: SkillTravels | None = None


class SweptMotionBuilder:
    """Builds swept motions.

    Parameters
    ----------
    sweeps
        Sweeps of hand, tool and load.
    travels
        Returns the travels to motions; None skips their check.
    check_support
        True if parts left behind need support.
    """

    def __init__(
        self,
        scene: Scene,
        planner: MotionPlanner,
        sweeps: HandSweeps,
        travels: Callable[[Sequence[ArmMotion]], SkillTravels] | None,
        *,
        check_support: bool,
    ) -> None:
        self.scene = scene
        self.planner = planner
        self.sweeps = sweeps
        self.travels = travels
        self.check_support = check_support

    def build(self, motions: Sequence[ArmMotion]) -> SweptMotion:
        """Return the swept motion of a skill from its planned motions."""
        events: list[Collision | ElbowChoice] = []
        supports: list[Supports] = []
        for index, planned in enumerate(motions):
            motion = planned.motion
            if planned.unreachable is not None:
                evidence = {
                    "position_m": [round(value, 6) for value in planned.unreachable.position],
                    "missed_by_m": planned.unreachable.distance_m,
                }
                events.append(Collision(None, planned.unreachable.reason, evidence))
                return SweptMotion(tuple(events), tuple(supports))
            events += self._clash(motion)
            for stretch in self.sweeps.approach(motion):
                events += self._collisions(stretch)
            events += self._links(planned, index)
            for stretch in self.sweeps.retreat(motion):
                events += self._collisions(stretch)
            if self.check_support and motion.visit.event in (Event.RELEASE, Event.DRIVE):
                supports.append(self._supports(motion))
        travels = None if self.travels is None else self.travels(motions)
        return SweptMotion(tuple(events), tuple(supports), travels)

    def _collisions(self, sweeps: Iterable[Sweep]) -> list[Collision]:
        """Return the collisions of any state, in the order of the motion."""
        collisions: list[tuple[float, Collision]] = []
        for sweep in sweeps:
            for obstacle in self.planner.obstacles:
                if obstacle.body in sweep.spares or not obstacle.stops(load=sweep.is_load):
                    continue
                touch = sweep.touch(obstacle, self.planner.tolerance_m, self.planner.samples)
                if touch is not None:
                    collisions.append(
                        (touch.fraction, _make_collision(obstacle, sweep.mover, sweep.label, touch))
                    )
        return [collision for _, collision in sorted(collisions, key=lambda pair: pair[0])]

    def _clash(self, motion: LinearMotion) -> Iterator[Collision]:
        clash = self.sweeps.clash(motion, self.planner.tolerance_m)
        if clash is not None:
            mover, touch = clash
            target = Obstacle(motion.visit.subject, None, ())
            yield _make_collision(target, mover, "the approach", touch)

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
        return find_supports(body.name, pieces, obstacles, self.planner.tolerance_m)


def _transform_pieces(frame: Pose, pieces: Iterable[ConvexPiece]) -> tuple[ConvexPiece, ...]:
    return tuple(piece.seen_from(frame) for piece in pieces)


def _collect_elbow_collisions(elbow: Elbow, label: str) -> tuple[Collision, ...]:
    """Return the collisions of the arm with one elbow position, permanent ones first."""
    links = tuple(
        _make_collision(obstacle, f"link {link_touch.link} of the arm", label, link_touch.touch)
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


def _make_collision(obstacle: Obstacle, mover: str, label: str, touch: Touch) -> Collision:
    return Collision(
        obstacle.fact,
        f"{mover} runs into {obstacle.body} on {label}",
        {
            "moving": mover,
            "bodies": [obstacle.body],
            "during": label,
            "position_m": list(touch.position),
            "fraction": touch.fraction,
            "penetration_m": touch.penetration_m,
        },
    )


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
                return Verdict.infeasible(collision.reason, *self._rests, collision.evidence)
        for supports in motion.supports:
            verdict = self._unsupported(supports)
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

    def _unsupported(self, supports: Supports) -> Verdict | None:
        """Return an infeasible verdict if a body is not supported, or None."""
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
        bit = self.state.facts.bit(fact)
        if self.state.bits & bit:
            self.present |= bit
            return True
        self.absent |= bit
        return False
