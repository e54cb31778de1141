"""A plan as bars on a time line: who does what with which tool, from when to when."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from skillplan.task.task import Task

CHANGE = "tool change"
FAILED, NOT_SIMULATED = "fails in simulation", "as planned, not simulated"
"""Marks of bars in a plan whose simulation failed."""


@dataclass(frozen=True, slots=True)
class PlanBar:
    """What one agent does for a while.

    Parameters
    ----------
    row
        Who, and with what, such as ``panda, gripper``.
    label
        What is written into the bar: the part, the place.
    kind
        The kind of skill or step, which has a colour.
    start_s, end_s
        When [s], from 0.
    title
        All there is to say of it.
    short
        What is written instead where there is no room for the label; empty for a part of it.
    mark
        `FAILED` or `NOT_SIMULATED`; empty for none.

    Raises
    ------
    ValueError
        If it ends before it starts.
    """

    row: str
    label: str
    kind: str
    start_s: float
    end_s: float
    title: str
    short: str = ""
    mark: str = ""

    def __post_init__(self) -> None:
        if not 0 <= self.start_s <= self.end_s:
            raise ValueError(f"A bar cannot run from {self.start_s} s to {self.end_s} s.")


def plan_bars(
    task: Task,
    skills: Sequence[str],
    durations_s: Sequence[float],
    times_s: Mapping[int, tuple[float, float]] | None = None,
    failed: int | None = None,
) -> list[PlanBar]:
    """Return a plan whose skills follow each other as bars.

    Parameters
    ----------
    task
        Whose plan it is.
    skills, durations_s
        Names of skills in order, and how long each takes [s].
    times_s
        Measured begin and end of steps [s]. Steps without them follow as planned.
    failed
        Step at which a simulation failed, from 0; later ones were not simulated.
    """
    bars = []
    now_s = 0.0
    for index, (name, duration_s) in enumerate(zip(skills, durations_s, strict=True)):
        skill = task.skill(name)
        tool = skill.parameters.get("tool")
        changes = skill.kind in ("load", "offload")
        agent = ", ".join(skill.agents)
        row = f"{agent}, {CHANGE}" if changes else f"{agent}, {tool}" if tool else agent
        begin_s, end_s = (times_s or {}).get(index, (now_s, now_s + duration_s))
        mark = "" if failed is None or index < failed else NOT_SIMULATED
        mark = FAILED if index == failed else mark
        subject = next((v for k, v in skill.parameters.items() if k in ("screw", "part")), tool)
        title = f"{index + 1}. {name}: {begin_s:.2f} s to {end_s:.2f} s, {end_s - begin_s:.2f} s"
        title += f", {mark}" if mark else ""
        label = str(subject or name)
        bars.append(PlanBar(row, label, skill.kind, begin_s, end_s, title, str(index + 1), mark))
        now_s = end_s
    return bars
