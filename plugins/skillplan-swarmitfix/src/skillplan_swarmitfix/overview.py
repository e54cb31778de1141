"""What there is to see of a bench file before anything is solved: its trajectory's size."""

from __future__ import annotations

from skillplan.domains.domain import Overview
from skillplan_swarmitfix.job import Job
from skillplan_swarmitfix.schema import SwarmitfixConfig


def overview(config: SwarmitfixConfig) -> Overview:
    """Return extent and length of the trajectory of a faultless file; nothing without one."""
    if config.trajectory is None:
        return Overview()
    job = Job(config)
    workpiece = job.workpiece
    points = [point for segment in workpiece.segments for point in segment.points]
    (x_low, x_high), (y_low, y_high) = ((min(c), max(c)) for c in zip(*points, strict=True))
    chords, off_m = job.sampling
    document = {
        "closed": workpiece.closed,
        "segments": len(workpiece.segments),
        "length_m": workpiece.length_m,
        "extent_m": [[x_low, y_low], [x_high, y_high]],
        "chords": chords,
        "deviation_m": off_m,
    }
    form = "closed" if workpiece.closed else "open"
    line = (
        f"trajectory {form}, {workpiece.length_m:.3f} m long, {len(workpiece.segments)} segments, "
        f"x {x_low:.3f} to {x_high:.3f} m, y {y_low:.3f} to {y_high:.3f} m"
    )
    sampled = (f"           {job.sampling_text}",) if job.sampling_text else ()
    return Overview({"trajectory": document}, (line, *sampled))
