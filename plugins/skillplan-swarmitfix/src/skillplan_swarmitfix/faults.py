"""Faults of a bench file that its schema cannot see: positions, trajectory, reach, robots."""

from __future__ import annotations

from collections.abc import Iterator

from skillplan.errors import Issue
from skillplan.files.schema_errors import continue_sentence
from skillplan_swarmitfix.bench.bench import Bench
from skillplan_swarmitfix.fleet.task import fleet_faults
from skillplan_swarmitfix.heads.grid import MOST_HEADS, HeadGrid
from skillplan_swarmitfix.heads.task import segment_fault
from skillplan_swarmitfix.job import Job
from skillplan_swarmitfix.machine_settings import bench_of, mount_of
from skillplan_swarmitfix.pkm.reach import Mount
from skillplan_swarmitfix.schema import SwarmitfixConfig
from skillplan_swarmitfix.trajectory.faults import Outline, faults
from skillplan_swarmitfix.trajectory.schema import element_key, elements_of, unit_doubt

MOST_STATES = 500_000
"""Positions of the bench, over all goals of the base."""
MOST_PLACES = 10_000
"""Positions of the bench, over all robots."""
MOST_HEADS_IN_ALL = 20_000
"""Heads to choose from, over all segments."""


def issues(config: SwarmitfixConfig) -> Iterator[Issue]:
    """Yield every fault; faults of a level only if the levels above have none."""
    bench = bench_of(config)
    faults = [*_positions(config, bench), *_mount(config), *_side(config)]
    if config.base.goals is not None:
        faults += _states(bench, len(config.base.goals), ("base", "goals"))
    if config.heads.subdivisions is not None:
        faults += _states(bench, sum(config.heads.subdivisions), ("heads", "subdivisions"))
    if config.trajectory is not None:
        try:
            faults += _trajectory(config, bench)
        except ValueError as error:
            faults.append(Issue(continue_sentence(str(error)), ("trajectory",)))
    if not faults and config.robots is not None:
        robots = Job(config).robots
        faults += _places(bench, len(robots))
        faults += [Issue(message, path) for message, path in fleet_faults(bench, robots)]
    if not faults and config.trajectory is not None:
        faults += list(_machine(config)) or _heads(config)
    yield from faults


def _positions(config: SwarmitfixConfig, bench: Bench) -> Iterator[Issue]:
    named: list[tuple[str, tuple[str | int, ...]]] = []
    if config.robots is None:
        named.append((config.base.home, ("base", "home")))
    named += [(name, ("base", "goals", i)) for i, name in enumerate(config.base.goals or ())]
    for robot, ends in (config.robots or {}).items():
        named += [(ends.home, ("robots", robot, "home")), (ends.goal, ("robots", robot, "goal"))]
    for name, path in named:
        try:
            bench.position(name)
        except ValueError as error:
            yield Issue(continue_sentence(str(error)), path)


def _states(bench: Bench, goals: int, path: tuple[str | int, ...]) -> Iterator[Issue]:
    states = goals * bench.n_positions
    if states > MOST_STATES:
        message = (
            f"{goals:,} goals on a bench of {bench.n_positions:,} positions are {states:,} states, "
            f"more than {MOST_STATES:,}. Split the job, or give a smaller bench."
        )
        yield Issue(message, path)


def _places(bench: Bench, robots: int) -> Iterator[Issue]:
    places = robots * bench.n_positions
    if places > MOST_PLACES:
        message = (
            f"{robots} robots on a bench of {bench.n_positions:,} positions have {places:,} "
            f"places, more than {MOST_PLACES:,}. Give fewer robots, or a smaller bench."
        )
        yield Issue(message, ("robots",))


def _mount(config: SwarmitfixConfig) -> Iterator[Issue]:
    try:
        mount_of(config)
    except ValueError:
        message = (
            f"must be above {Mount().height_m:g}, the height of the machine's base, not "
            f"{config.pkm.sheet_height_m}."
        )
        yield Issue(message, ("pkm", "sheet_height_m"))


def _machine(config: SwarmitfixConfig) -> Iterator[Issue]:
    if config.base.reach_rule == "ignored":
        return
    try:
        _ = Job(config).pkm_reach_m
    except ValueError as error:
        yield Issue(continue_sentence(str(error)), ("pkm",))


def _side(config: SwarmitfixConfig) -> Iterator[Issue]:
    trajectory, side = config.trajectory, config.base.side
    if trajectory is not None and not trajectory.closed and side in ("inward", "outward"):
        message = f"an open trajectory has no {side} side. Give left or right."
        yield Issue(message, ("base", "side"))


def _trajectory(config: SwarmitfixConfig, bench: Bench) -> Iterator[Issue]:
    trajectory = config.trajectory
    assert trajectory is not None
    start, elements = elements_of(trajectory)
    problems = faults(
        start, elements, trajectory.closed, trajectory.chord_tolerance_m, _outline(bench)
    )
    located = {message for message, path in problems if path}
    for message, path in problems:
        # The line that closes a trajectory ends at a start that is to blame itself.
        if path or message not in located:
            key = ("trajectory", *element_key(trajectory, path))
            yield Issue(trajectory.place_of(path, message), key)
    doubt = unit_doubt(trajectory) if problems else None
    if doubt is not None:
        # A wrong unit alone may put a trajectory off the bench or make it too small.
        yield doubt.under("trajectory")
    if config.heads.subdivisions is not None and not problems:
        segments = len(Job(config).workpiece.segments)
        given = len(config.heads.subdivisions)
        if given != segments:
            message = (
                f"has {given} entries, but the trajectory has {segments} segments; give one each."
            )
            yield Issue(message, ("heads", "subdivisions"))


def _outline(bench: Bench) -> Outline:
    low, high = bench.pins_m.min(axis=0), bench.pins_m.max(axis=0)
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])


def _heads(config: SwarmitfixConfig) -> Iterator[Issue]:
    """Yield the reasons why the trajectory cannot be supported."""
    job = Job(config)
    problems = [] if config.heads.subdivisions is not None else list(_segments(job))
    if not problems:
        problems = [
            Issue(continue_sentence(str(error)), ("trajectory",)) for error in job.unreachable()
        ]
    if not problems:
        goals = len(job.heads) if job.infeasible else len(job.goal_sets)
        problems = list(_states(job.bench, goals, ("trajectory",)))
    yield from problems


def _segments(job: Job) -> Iterator[Issue]:
    """Yield why segments cannot be supported."""
    segments = job.workpiece.segments
    grids = [HeadGrid(segment, *job.ends(segment), job.head_rules) for segment in segments]
    heads = [grid.last - 1 for grid in grids]
    if max(heads) <= MOST_HEADS and sum(heads) > MOST_HEADS_IN_ALL:
        message = (
            f"the {len(grids):,} segments have {sum(heads):,} heads to choose from, more than "
            f"{MOST_HEADS_IN_ALL:,} in all. Make step_m longer than {job.head_rules.step_m:g} m, "
            "or split the trajectory."
        )
        yield Issue(message, ("heads", "step_m"))
        return
    for segment, count in zip(segments, heads, strict=True):
        fault = segment_fault(segment, *job.ends(segment), job.head_rules)
        if fault is not None:
            key = "step_m" if count > MOST_HEADS else "max_gap_m"
            yield Issue(fault, ("heads", key))
