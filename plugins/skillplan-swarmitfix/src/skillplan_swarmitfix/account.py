"""Account of a solved bench job beyond its plans: supports, goals, the five steps."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

from skillplan.domains.domain import Account, Listing, Recheck
from skillplan.task.verdict import Verdict
from skillplan_swarmitfix.base.locomotion import BasePath, Phase, along, makespan, timeline
from skillplan_swarmitfix.fleet.simulator import simulate
from skillplan_swarmitfix.heads.heads import Head, HeadKind, normal_yaw
from skillplan_swarmitfix.job import Job
from skillplan_swarmitfix.machine_settings import limits_of, mount_of
from skillplan_swarmitfix.pkm.kinematics import PkmGeometry
from skillplan_swarmitfix.pkm.reach import hold_fault, rule
from skillplan_swarmitfix.trajectory.path_elements import Point2


def account(job: Job) -> Account:
    """Build the account of a job from the plans that exist."""
    config = job.config
    document: dict[str, Any] = {
        "bench": {
            "rows": job.bench.rows,
            "cols": job.bench.cols,
            "pitch_m": job.bench.pitch_m,
            "actions": job.bench.actions,
        }
    }
    if config.robots is not None:
        return fleet_account(job, document)
    listings: list[Listing] = []
    bound = given = None
    if config.trajectory is not None:
        document |= _workpiece(job)
    if job.infeasible:
        return Account(document | {"unreachable": _unreachable(job)})
    if config.trajectory is not None:
        verdicts, heads = _leg_verdicts(job), _heads(job)
        document |= _supports(job, verdicts, heads)
        listings.append(_goals_listing(job, verdicts, heads))
        given = float(job.least_steps)
        # Heads that are planned might have been planned otherwise.
        bound = given if config.heads.subdivisions is not None and job.parts == 1 else None
    phases = _phases(job)
    if phases is None:
        return Account(document, tuple(listings), lower_bound=bound, bound_given=given)
    total = makespan(phases)
    document["timeline"] = [
        {**phase.document(), "sequence": phase.sequence + 1} for phase in phases
    ]
    document["makespan_swings_s"] = total.swing_s
    return Account(
        document,
        tuple(listings),
        appendix={"timeline.csv": _steps_listing(job, phases)},
        lower_bound=bound,
        makespan_s=total.duration_s,
        bound_given=given,
        caveat=_caveat(document),
        not_checked=_left_unchecked(document),
    )


def _unreachable(job: Job) -> dict[str, Any]:
    """Return the first support that the machine reaches from no position."""
    assert job.unheld is not None
    support_m = job.heads[job.unheld].position
    position, verdict = job.centres.nearest(support_m)
    return {
        "support": job.unheld + 1,
        "support_m": list(support_m),
        "nearest": job.bench.name(position),
        "pkm": _machine(verdict),
    }


def _machine(verdict: Verdict) -> dict[str, Any]:
    return {"status": verdict.status.value, "reason": verdict.reason, **verdict.evidence}


def _workpiece(job: Job) -> dict[str, Any]:
    workpiece, base = job.workpiece, job.config.base
    chords, off_m = job.sampling
    return {
        "sampling": {"chords": chords, "deviation_m": off_m},
        "trajectory_notes": job.trajectory_notes,
        "reachable": base.reach_rule,
        **({"relax": base.relax} if base.reach_rule == "required" else {}),
        "workpiece": {
            "closed": workpiece.closed,
            "length_m": workpiece.length_m,
            "points_m": [
                list(point) for segment in workpiece.segments for point in segment.points[:-1]
            ]
            + [list(workpiece.segments[-1].end)],
            "vertices": [
                {
                    "position_m": list(vertex.position),
                    "kind": str(vertex.kind),
                    "corner": str(vertex.corner),
                    "angle_deg": math.degrees(vertex.angle_rad),
                }
                for vertex in workpiece.vertices
            ],
            "segments": [
                {"length_m": segment.true_length_m, "curved": segment.is_curved}
                for segment in workpiece.segments
            ],
        },
    }


def _supports(
    job: Job, verdicts: Sequence[Verdict], heads: Sequence[Mapping[str, Any]]
) -> dict[str, Any]:
    return {
        "heads": heads,
        "goals": [
            {
                "sequence": number,
                "support_m": [list(goal_set.e1), list(goal_set.e2)],
                "candidates": [job.bench.name(position) for position in goal_set.positions],
                "how": str(goal_set.how_of(goal)),
                "note": goal_set.note_of(goal),
                "goal": job.bench.name(goal),
                "pkm": _machine(verdict),
            }
            for number, (goal_set, goal, verdict) in enumerate(
                zip(job.goal_sets, job.goals, verdicts, strict=True), start=1
            )
        ],
        "goal_choice": job.config.base.goal_choice,
        "supports_beyond_leg_limits": sum(verdict.is_infeasible for verdict in verdicts),
    }


def _caveat(document: Mapping[str, Any]) -> str:
    """Count the supports beyond the machine's reach; empty if there are none."""
    beyond = document.get("supports_beyond_leg_limits", 0)
    return _counted(beyond, len(document["goals"])) if beyond else ""


def _left_unchecked(document: Mapping[str, Any]) -> tuple[str, ...]:
    """Return that the reach of the legs is not required, unless they reach every support."""
    beyond = document.get("supports_beyond_leg_limits", 0)
    if not beyond:
        return ()
    return (
        f"reach: {beyond} of {len(document['goals'])} supports lie beyond the legs, and "
        f"base.reachable is {document['reachable']}",
    )


def recheck_reach(job: Job) -> Recheck:
    """Check a job's supports against the limits of the legs.

    Lengths of legs come from inverse kinematics. Forward kinematics, which shares no formula with
    it, must lead from them back to the head. If a support is out of reach, all positions are tried.
    """
    method = "inverse and forward kinematics"
    if job.unheld is not None:
        support_m = job.heads[job.unheld].position
        reaching = [p for p in range(job.bench.n_positions) if not _hold_fault(job, p, support_m)]
        names = ", ".join(job.bench.name(position) for position in reaching) or "no position"
        return Recheck("reach", not reaching, f"{names} reaches support {job.unheld + 1}", method)
    if len(job.goals) < len(job.goal_sets):
        return Recheck("reach", None, "no positions are chosen for the supports", method)
    faults = [
        f"support {number} from {job.bench.name(goal)}: {fault}"
        for number, (goal_set, goal) in enumerate(zip(job.goal_sets, job.goals, strict=True), 1)
        if (fault := _hold_fault(job, goal, goal_set.e1))
    ]
    count = len(job.goal_sets)
    words = f"all {count} supports are within the limits of the PKM's legs"
    if faults:
        words = f"{_counted(len(faults), count)}; {faults[0]}"
    return Recheck("reach", not faults if job.machine or not faults else None, words, method)


def _counted(beyond: int, count: int) -> str:
    return f"{beyond} of {count} supports are beyond the limits of the PKM's legs"


def _hold_fault(job: Job, position: int, support_m: Point2) -> str:
    """Return why a support cannot be held from a position; empty if it can."""
    x_m, y_m = job.bench.centroids_m[position].tolist()
    away_m = math.dist((x_m, y_m), support_m)
    for key, (least_m, most_m) in job.distances_m.items():
        if not least_m - 1e-9 <= away_m <= most_m + 1e-9:
            return f"{away_m:.4f} m away, and {key} allows {least_m:g} to {most_m:g} m"
    config = job.config
    return hold_fault(PkmGeometry(), limits_of(config), mount_of(config), (x_m, y_m), support_m)


def _heads(job: Job) -> list[dict[str, Any]]:
    """List all heads along the trajectory, including heads inserted by splits."""
    entries: list[dict[str, Any]] = []

    def add(head: Head, *, inserted: bool) -> None:
        entries.append(
            {
                "position_m": list(head.position),
                "yaw_rad": head.yaw_rad,
                "kind": str(head.kind),
                "segment": head.segment + 1,
                "side_m": job.head_rules.side_m,
                "inserted": inserted,
            }
        )

    placed = iter(job.heads)
    before = -1
    for goal_set in job.goal_sets:
        if goal_set.index != before:
            here = next(placed)
            add(here, inserted=False)
        else:
            ahead = (goal_set.e2[0] - goal_set.e1[0], goal_set.e2[1] - goal_set.e1[1])
            yaw = normal_yaw(math.atan2(ahead[1], ahead[0]))
            away_m = math.dist(goal_set.e1, here.position)
            inserted = Head(goal_set.e1, yaw, HeadKind.INTERMEDIATE, here.segment, away_m)
            add(inserted, inserted=True)
        before = goal_set.index
    for head in placed:
        add(head, inserted=False)
    return entries


def _leg_verdicts(job: Job) -> list[Verdict]:
    """Return whether the parallel kinematic machine reaches each support from its goal."""
    geometry, limits, mount = PkmGeometry(), limits_of(job.config), mount_of(job.config)
    verdicts = []
    for goal_set, goal in zip(job.goal_sets, job.goals, strict=True):
        x_m, y_m = job.bench.centroids_m[goal].tolist()
        verdicts.append(rule(geometry, limits, mount, (x_m, y_m), goal_set.e1))
    return verdicts


def _goals_listing(
    job: Job, verdicts: Sequence[Verdict], heads: Sequence[Mapping[str, Any]]
) -> Listing:
    """Return the supports, who can hold them, and who does."""
    rows, notes = [], []
    for number, (goal_set, goal, verdict) in enumerate(
        zip(job.goal_sets, job.goals, verdicts, strict=True), start=1
    ):
        names = [job.bench.name(position) for position in goal_set.positions]
        shown = names if len(names) <= 6 else [*names[:5], f"and {len(names) - 5} more"]
        x_m, y_m = goal_set.e1
        rows.append(
            (
                str(number),
                f"{x_m:.3f} {y_m:.3f}",
                " ".join(shown),
                str(goal_set.how_of(goal)),
                job.bench.name(goal),
                "within limits" if verdict.is_feasible else verdict.reason,
            )
        )
        note = goal_set.note_of(goal)
        if note:
            notes.append(f"support {number}: {note}")
    workpiece = job.workpiece
    kinds = ", ".join(f"{count} {kind}" for kind, count in workpiece.vertex_counts.items())
    curved = sum(segment.is_curved for segment in workpiece.segments)
    above = [
        f"trajectory {'closed' if workpiece.closed else 'open'}, {workpiece.length_m:.4f} m, "
        f"{len(workpiece.segments)} segments ({curved} curved), vertices: {kinds}"
    ]
    spacing_m = [
        math.dist(head["position_m"], following["position_m"])
        for head, following in pairwise(heads)
    ]
    if job.sampling_text:
        above.append(f"           {job.sampling_text}")
    above += [f"           {note}" for note in job.trajectory_notes]
    above.append(f"heads      {len(heads)}, {min(spacing_m):.3f} to {max(spacing_m):.3f} m apart")
    close = sum(spacing < job.head_rules.side_m for spacing in spacing_m)
    if close:
        above.append(
            f"           {close} of them nearer to the next than a head's side of "
            f"{job.head_rules.side_m:g} m"
        )
    beyond = sum(verdict.is_infeasible for verdict in verdicts)
    if beyond:
        above.append(f"PKM        {beyond} of {len(rows)} supports are beyond its legs' limits")
    if notes:
        above.append(f"fallback   {len(notes)} of {len(rows)} supports {_fallback(job)}:")
    notes = [*above, *notes]
    return Listing(
        f"{job.config.name}: {len(heads)} heads, goals of the base by "
        f"{job.config.base.goal_choice}",
        ("goal", "support x y [m]", "candidates", "by", "chosen", "PKM"),
        tuple(rows),
        tuple(notes),
    )


def _fallback(job: Job) -> str:
    """Return why supports fall back on other rules than Eqs 1-4."""
    if job.machine is None:
        return "have no position by Eqs 1-4"
    if job.machine.relax_always:
        return "are held from positions that Eqs 1-4 exclude"
    return "have no position by Eqs 1-4 within reach (base.relax: always lets all drop rules)"


def _phases(job: Job) -> tuple[Phase, ...] | None:
    """Return the five steps of every sequence, or None while paths of the base are missing."""
    paths: list[BasePath] = []
    here = job.home
    for number, goal in enumerate(job.goals, start=1):
        plan = job.plans.get(f"base-{number}")
        if plan is None:
            return None
        path = along(job.bench, here, plan)
        here = path[-1][-1] if path else here
        if here != goal:
            return None
        paths.append(path)
    if job.config.trajectory is not None:
        supports = [goal_set.e1 for goal_set in job.goal_sets]
    else:
        centroids = job.bench.centroids_m[list(job.goals)].tolist()
        supports = [(x_m, y_m) for x_m, y_m in centroids]
    return timeline(job.bench, paths, supports, job.timings, home=job.home)


def _steps_listing(job: Job, phases: tuple[Phase, ...]) -> Listing:
    """Return when each of the five steps of every sequence begins and ends."""
    rows = []
    for phase in phases:
        what = "-"
        if phase.swing is not None:
            swing = phase.swing
            what = (
                f"{swing.action} {swing.start} to {swing.end}: leg {swing.leg} on {swing.pivot}, "
                f"{swing.direction} {swing.angle_deg} deg, PKM {swing.counter_rotation_deg:+d} deg"
            )
        elif phase.support_m is not None:
            what = f"head to {phase.support_m[0]:.3f} {phase.support_m[1]:.3f} m"
        rows.append(
            (
                str(phase.sequence + 1),
                str(phase.step),
                f"{phase.start_s:.2f}",
                f"{phase.end_s:.2f}",
                phase.base,
                what,
            )
        )
    return Listing(
        f"{job.config.name}: the five steps",
        ("sequence", "step", "from [s]", "to [s]", "base", "what"),
        tuple(rows),
    )


Move = tuple[str, int, int, int]
"""Robot, action, position before and after, both from 0."""


def fleet_account(job: Job, document: Mapping[str, Any]) -> Account:
    """Return every robot's path, and the steps in which swings can run side by side."""
    bench, robots = job.bench, job.robots
    alone = {name: int(bench.distances(goal)[start]) for name, (start, goal) in robots.items()}
    known: dict[str, Any] = {
        **document,
        "independent_bound_sum": sum(alone.values()),
        "independent_bound_max": max(alone.values()),
    }
    plan = job.plans.get(job.config.name)
    if plan is None:
        return Account(known)
    moves = _moves(job, {name: start for name, (start, _) in robots.items()}, plan)
    steps = parallel_steps(job, moves)
    swings_s = _swing_times(job, steps)
    steps_s = [max(times_s) for times_s in swings_s]
    fault = simulate(bench, robots, steps)
    known |= {
        "robots": [
            {
                "robot": name,
                "start": bench.name(start),
                "goal": bench.name(goal),
                "path": [
                    bench.name(start),
                    *(bench.name(after) for robot, _, _, after in moves if robot == name),
                ],
                "swings": sum(robot == name for robot, *_ in moves),
                "swings_alone": alone[name],
            }
            for name, (start, goal) in robots.items()
        ],
        "schedule": [
            [
                [robot, f"B{action}", bench.name(before), bench.name(after)]
                for robot, action, before, after in step
            ]
            for step in steps
        ],
        # Each step is as long as its longest swing.
        "swings_s": swings_s,
        "steps_s": steps_s,
        "parallel_makespan": len(steps),
        "parallel_s": sum(steps_s),
        "simulated": "valid" if fault is None else str(fault),
    }
    return Account(
        known,
        (_listing(job, known),),
        makespan_s=known["parallel_s"],
        parallel_steps=known["parallel_makespan"],
        parallel_bound=known["independent_bound_max"],
    )


def _moves(job: Job, places: dict[str, int], plan: Sequence[str]) -> list[Move]:
    """Return the moves of a plan of skills such as ``r1.B2``."""
    places, moves = dict(places), []
    for skill in plan:
        robot, _, action = skill.rpartition(".B")
        before = places[robot]
        after = int(job.bench.successors[before, int(action)])
        moves.append((robot, int(action), before, after))
        places[robot] = after
    return moves


def parallel_steps(job: Job, moves: Sequence[Move]) -> list[list[Move]]:
    """Return synchronous steps, each move as early as those before it allow.

    Two swings may run at once if they sweep no pin in common; a robot's own follow each other.
    """
    steps: list[list[Move]] = []
    free_from: dict[str, int] = {}
    last_swept: dict[int, int] = {}
    for robot, action, before, after in moves:
        swept = job.bench.swept_pins(before, action)
        step = max(
            [free_from.get(robot, 0), *(last_swept[pin] + 1 for pin in swept if pin in last_swept)]
        )
        free_from[robot] = step + 1
        last_swept.update(dict.fromkeys(swept, step))
        steps += [[] for _ in range(step + 1 - len(steps))]
        steps[step].append((robot, action, before, after))
    return steps


def _swing_times(job: Job, steps: Sequence[Sequence[Move]]) -> list[list[float]]:
    """Return the duration of each swing of each step [s]."""
    degrees, of_swing = job.bench.swing_deg, job.timings.of_swing
    return [
        [of_swing(int(degrees[before, action])) for _, action, before, _ in step] for step in steps
    ]


def _listing(job: Job, known: Mapping[str, Any]) -> Listing:
    rows = tuple(
        (
            entry["robot"],
            entry["start"],
            entry["goal"],
            " ".join(entry["path"]),
            str(entry["swings"]),
            str(entry["swings_alone"]),
        )
        for entry in known["robots"]
    )
    notes = (
        f"parallel   {known['parallel_makespan']} steps side by side, {known['parallel_s']:.1f} s "
        "if each waits for the longest swing of the one before; the farthest robot alone needs "
        f"{known['independent_bound_max']}",
        f"alone      {known['independent_bound_sum']} swings in all, if each had the bench for "
        "itself",
        f"simulated  {known['simulated']}",
    )
    columns = ("robot", "from", "to", "path", "swings", "alone")
    return Listing(f"{job.config.name}: {len(rows)} bases on one bench", columns, rows, notes)
