"""Warning on a trajectory file without a unit whose size does not fit a bench."""

from __future__ import annotations

from skillplan.errors import Issue
from skillplan_swarmitfix.trajectory.schema import TrajectoryConfig, in_file
from skillplan_swarmitfix.trajectory.units import DEFAULT_UNIT, is_doubtful


def unit_doubt(config: TrajectoryConfig) -> Issue | None:
    """Return why the unit that was guessed for a file is hardly meant, by its key; or None."""
    extent_m = config.guessed_unit_extent_m
    if config.file is None or extent_m is None or not is_doubtful(extent_m):
        return None
    message = (
        f"Its unit is not given, and read in {DEFAULT_UNIT} it is {extent_m:.3g} m long. Give "
        "trajectory.unit, such as m or in."
    )
    return Issue(in_file(config.file, "", message), ("file",))
