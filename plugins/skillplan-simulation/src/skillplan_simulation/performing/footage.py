"""Pictures of one execution: the moment at which it fails, or all of it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from skillplan.physics.linear_motions import linear_motions
from skillplan.physics.performance import Image, View
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan_simulation.execution.skill_runner import SkillRunner
from skillplan_simulation.execution.workcell import Workcell
from skillplan_simulation.record import FRAMES_PER_S, Record
from skillplan_simulation.simulator import STEPS_PER_S
from skillplan_simulation.verdicts.contact_judge import Judge, collision_in

if TYPE_CHECKING:
    from skillplan_simulation.pictures.painted_camera import PaintedCamera

# Bodies without a support are shown after so many frames, as they fall.
_FALLING_FRAMES = 4


@dataclass(frozen=True, slots=True)
class Moment:
    """A frame of an execution, and the bodies to look at.

    Parameters
    ----------
    frame
        Number of the frame; None for the end.
    bodies
        Their names.
    """

    frame: int | None
    bodies: tuple[str, ...]


def caption_of(skill: str, phase: str, time_s: float) -> str:
    """Return what a picture says below: skill, what the robot is at in it, and time."""
    return "   ".join(word for word in (skill, phase, f"{time_s:.2f} s") if word)


class _Taken(Exception):
    """Raised to end an execution whose picture is taken."""


def moment_of_failure(record: Record, judges: Sequence[Judge]) -> Moment:
    """Return when an execution went wrong: the first contact or displacement, else the end."""
    collision = collision_in(record, judges)
    if collision is None:
        return Moment(None, ())
    found = collision.evidence
    return Moment(round(found["at_s"] * FRAMES_PER_S), tuple(found["bodies"]))


def picture(
    workcell: Workcell,
    skill: Skill,
    state: State,
    judges: Sequence[Judge],
    *,
    blamed: bool = False,
) -> Image:
    """Return the moment at which a skill fails in a state, or its end.

    Bodies that collide are painted red and orange, and all else is pale; where none do and the
    skill is to be blamed all the same, it is what it handles.

    Raises
    ------
    ValueError
        If there is nothing to be seen, in words: the arm cannot follow the motion.
    """
    record = workcell.execute(skill, state)
    moment = moment_of_failure(record, judges)
    culprits = moment.bodies
    if blamed and not culprits and skill.motion is not None:
        culprits = tuple(visit.subject for visit in skill.motion.visits(state))
    frame = _FALLING_FRAMES if record.unsettled is not None else moment.frame
    camera = _camera(workcell, skill, state)
    taken: list[Image] = []

    def caption(runner: SkillRunner) -> str:
        return caption_of(skill.name, runner.log.phase_now, runner.world.steps / STEPS_PER_S)

    def watch(runner: SkillRunner) -> None:
        if runner.log.phases and frame is not None and runner.log.frames > frame:
            taken.append(camera.shot(runner.world, runner.arm, caption(runner), culprits)())
            raise _Taken
        if frame is None and runner.world.steps == record.steps:
            taken.append(camera.shot(runner.world, runner.arm, caption(runner), culprits)())

    try:
        workcell.execute(skill, state, watch)
    except _Taken:
        return taken[0]
    if not taken:
        raise ValueError(record.unreachable or "the execution has no such moment")
    return taken[0]


def footage(workcell: Workcell, skill: Skill, state: State, frames_per_s: float) -> Iterator[Image]:
    """Yield pictures of a skill in a state, so many a simulated second.

    Raises
    ------
    ValueError
        If the rate is not above 0 and at most 60 pictures a second.
    """
    if not 0 < frames_per_s <= FRAMES_PER_S:
        raise ValueError(f"There are 0 to {FRAMES_PER_S} pictures a second, not {frames_per_s}.")
    camera = _camera(workcell, skill, state)
    every = STEPS_PER_S / frames_per_s
    taken: list[Image] = []

    def watch(runner: SkillRunner) -> None:
        if runner.world.steps >= len(taken) * every:
            time_s = runner.world.steps / STEPS_PER_S
            caption = caption_of(skill.name, runner.log.phase_now, time_s)
            taken.append(camera.shot(runner.world, runner.arm, caption)())

    workcell.execute(skill, state, watch)
    yield from taken


def _camera(workcell: Workcell, skill: Skill, state: State) -> PaintedCamera:
    motions = linear_motions(workcell.task, skill, state, workcell.settings.drop_height_m)
    x_m, y_m, z_m = motions[-1].tip
    view = View.close_up((x_m, y_m, z_m + 0.05))
    # An execution without pictures does not load the painter.
    from skillplan_simulation.pictures.painted_camera import PaintedCamera

    return PaintedCamera(workcell.task.scene, view)
