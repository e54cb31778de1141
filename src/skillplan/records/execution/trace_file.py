"""The trace of a performed plan as CSV: one row a sample."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from skillplan.files.atomic_file import replacing
from skillplan.files.output_path import refusing
from skillplan.physics.performance import Sample

SUFFIXES = (".csv",)

_POSE = ("x_m", "y_m", "z_m", "qx", "qy", "qz", "qw")


@contextmanager
def trace_file(
    path: Path, bodies: Sequence[str], option: str
) -> Iterator[Callable[[Sample], None]]:
    """Yield what writes a row of the trace; what was there is replaced in the end.

    Columns are ``time_s``, ``skill``, ``phase`` (what the robot is at in it), tip and target [m],
    joint angles [rad], the opening of the
    jaws [m], the contact force between bodies that are not expected to touch [N], and of every
    body its position [m] and orientation; empty where a body is nowhere.

    Parameters
    ----------
    path
        Where to.
    bodies
        Their names, in the order of the columns.
    option
        Which names the file, for messages.

    Raises
    ------
    OptionError
        If it cannot be written.
    """
    with (
        refusing(option, path),
        replacing(path) as file,
    ):
        text = io.TextIOWrapper(file, "utf-8", newline="")
        trace = _Trace(csv.writer(text, lineterminator="\n"), bodies)

        def note(sample: Sample) -> None:
            with refusing(option, path):
                trace.note(sample)

        yield note
        text.detach()


class _Trace:
    """Writes the heading with the first row, when the number of joints is known."""

    def __init__(self, writer: Any, bodies: Sequence[str]) -> None:
        self._writer = writer
        self._bodies = bodies
        self._begun = False

    def note(self, sample: Sample) -> None:
        """Write a row."""
        if not self._begun:
            self._begun = True
            self._writer.writerow(self._heading(len(sample.joints_rad)))
        cells = [f"{sample.time_s:.6f}", sample.skill, sample.phase]
        figures = (*sample.tip, *sample.target, *sample.joints_rad)
        cells += [_cell(value) for value in (*figures, sample.opening_m, sample.contact_n)]
        for name in self._bodies:
            pose = sample.bodies.get(name)
            cells += (
                [""] * len(_POSE)
                if pose is None
                else [_cell(value) for value in (*pose.position, *pose.orientation)]
            )
        self._writer.writerow(cells)

    def _heading(self, joints: int) -> list[str]:
        heading = ["time_s", "skill", "phase"]
        heading += [f"{point}_{axis}_m" for point in ("tip", "target") for axis in "xyz"]
        heading += [f"joint_{number}_rad" for number in range(1, joints + 1)]
        heading += ["opening_m", "contact_n"]
        return heading + [f"{name}_{figure}" for name in self._bodies for figure in _POSE]


def _cell(value: float) -> str:
    # Rounded to nothing, a figure below zero has no sign.
    return f"{round(value, 6) + 0.0:.6f}"
