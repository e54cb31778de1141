"""Everything that can befall a skill on one way, in whatever state: worked out once."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from skillplan.physics.linear_motions import Stroke
from skillplan.task.motion import Event, Point
from skillplan.task.scene import Pose, Scene
from skillplan_pinocchio.arm_clearance import LinkTouch
from skillplan_pinocchio.hand_sweeps import HandSweeps
from skillplan_pinocchio.motion_plan import ArmStroke, MotionPlanner, spared
from skillplan_pinocchio.obstacles import Obstacle
from skillplan_pinocchio.shapes import pieces_of
from skillplan_pinocchio.support import Ground, ground_of
from skillplan_pinocchio.sweep import Sweep, Touch
from skillplan_pinocchio.timing import JointPath


@dataclass(frozen=True)
class Hit:
    """A collision that happens where a fact holds.

    Parameters
    ----------
    fact
        Holds while the obstacle is there; None for a collision in every state.
    reason
        One clause.
    evidence
        What was measured, as JSON values.
    """

    fact: str | None
    reason: str
    evidence: Mapping[str, Any]


@dataclass(frozen=True)
class Choice:
    """Ways of the arm, of which one has to be free.

    Parameters
    ----------
    ways
        By position of the elbow, the preferred first: what its links hit, in order.
    """

    ways: tuple[tuple[Hit, ...], ...]


@dataclass(frozen=True)
class Course:
    """Everything that can befall a skill on one way.

    Parameters
    ----------
    events
        In order of the motion.
    grounds
        What has to bear the bodies that are left behind.
    """

    events: tuple[Hit | Choice, ...]
    grounds: tuple[Ground, ...]


@dataclass(frozen=True)
class Travels:
    """The ways at safe height to above each stroke.

    Parameters
    ----------
    start
        Where the tip comes from [m].
    ways
        Of the joints, by stroke; None where the arm cannot stand at an end.
    """

    start: Point
    ways: tuple[JointPath | None, ...]


class CourseMaker:
    """Works out courses.

    Parameters
    ----------
    scene
        The task's scene.
    planner
        Finds the ways of the arm.
    sweeps
        Of what the arm holds.
    check_support
        Whether something has to bear what is left behind.
    """

    def __init__(
        self,
        scene: Scene,
        planner: MotionPlanner,
        sweeps: HandSweeps,
        *,
        check_support: bool,
    ) -> None:
        self.scene = scene
        self.planner = planner
        self.sweeps = sweeps
        self.check_support = check_support

    def course(self, strokes: Iterable[ArmStroke], travels: Travels | None = None) -> Course:
        """Return what can befall a skill.

        Parameters
        ----------
        strokes
            As the arm makes them.
        travels
            The ways to above each stroke; None where nothing is tall enough to be met on them.
        """
        events: list[Hit | Choice] = []
        grounds = []
        here = None if travels is None else travels.start
        for index, planned in enumerate(strokes):
            stroke = planned.stroke
            if planned.unreachable is not None:
                evidence = {
                    "position_m": [round(value, 6) for value in planned.unreachable.position],
                    "missed_by_m": planned.unreachable.distance_m,
                }
                events.append(Hit(None, planned.unreachable.reason, evidence))
                break
            if travels is not None and here is not None:
                events += self._hits(self.sweeps.travel(stroke, here))
                events += self._travel_links(stroke, travels.ways[index])
                here = stroke.above
            events += self._clash(stroke)
            events += self._hits(self.sweeps.approach(stroke))
            events += self._links(planned)
            events += self._hits(self.sweeps.retreat(stroke))
            if self.check_support and stroke.visit.event in (Event.RELEASE, Event.DRIVE):
                grounds.append(self._ground(stroke))
        return Course(tuple(events), tuple(grounds))

    def _hits(self, sweeps: Iterable[Sweep]) -> list[Hit]:
        """Return every collision that some state would cause, in the order of the motion."""
        found: list[tuple[float, Hit]] = []
        for sweep in sweeps:
            for obstacle in self.planner.obstacles:
                if obstacle.body in sweep.spares:
                    continue
                touch = sweep.touch(obstacle, self.planner.tolerance_m, self.planner.samples)
                if touch is not None:
                    found.append((touch.fraction, _hit(obstacle, sweep.mover, sweep.label, touch)))
        return [hit for _, hit in sorted(found, key=lambda pair: pair[0])]

    def _clash(self, stroke: Stroke) -> Iterator[Hit]:
        clash = self.sweeps.clash(stroke, self.planner.tolerance_m)
        if clash is not None:
            mover, touch = clash
            target = Obstacle(stroke.visit.subject, None, ())
            yield _hit(target, mover, "the approach", touch)

    def _links(self, planned: ArmStroke) -> Iterator[Choice]:
        ways = tuple(_link_hits(elbow.meets, "the approach") for elbow in planned.elbows)
        if all(ways):
            yield Choice(ways)

    def _travel_links(self, stroke: Stroke, path: JointPath | None) -> Iterator[Choice]:
        if path is None:
            return
        way = _link_hits(self.planner.met(path, spared(stroke)), "the travel")
        if way:
            yield Choice((way,))

    def _ground(self, stroke: Stroke) -> Ground:
        visit = stroke.visit
        body = self.scene.body(visit.subject)
        pieces = pieces_of(body, Pose.upright(visit.position, visit.yaw_rad))
        return ground_of(body.name, pieces, self.planner.obstacles, self.planner.tolerance_m)


def _link_hits(meets: Iterable[tuple[Obstacle, LinkTouch]], label: str) -> tuple[Hit, ...]:
    return tuple(
        _hit(obstacle, f"link {found.link} of the arm", label, found.touch)
        for obstacle, found in meets
    )


def _hit(obstacle: Obstacle, mover: str, label: str, touch: Touch) -> Hit:
    return Hit(
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
