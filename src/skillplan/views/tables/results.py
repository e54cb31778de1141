"""Results and certificates as tables."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from itertools import chain
from typing import TYPE_CHECKING

from skillplan.model.replay import Step
from skillplan.records.advice import Advice, Tip, compute_cycles_per_hour
from skillplan.records.certificate import Asked, Certificate, Claim, Outcome
from skillplan.records.chain_result import ChainResult
from skillplan.records.front import Front
from skillplan.records.result import Result, SimulationOutcome, Status
from skillplan.records.stored.result_folder import PLAN
from skillplan.task.motion import Point
from skillplan.task.task import Metric, Task
from skillplan.views.text.table import Column, Table, render_csv
from skillplan.views.text.wording import describe_covered, format_number, format_percent

if TYPE_CHECKING:
    from skillplan.records.chain_result import ChainResult


PROOF = {
    Status.OPTIMAL: "optimal, proved",
    Status.SOLVED: "solved, not proved to be the best",
    Status.INFEASIBLE: "infeasible: proved that there is no plan",
    Status.UNSOLVED: "unsolved",
    Status.REFUSED: "refused",
    Status.WRONG: "WRONG: the solver's claim does not hold",
    Status.FAILED: "failed",
}


# Largest number of named parts, screws and tools with dwell times of their own.
_MOST_OWNERS = 6
# Shortest wait that is listed [s].
_LEAST_S = 0.05


def tabulate_plan(result: Result, task: Task) -> Table:
    """Return the steps of a plan, with the figures of the result below."""
    title = f"{result.task}: {result.solver}, physics {result.physics}, collision "
    title += result.collision or "none"
    notes = describe_status(result.status, result.reason)
    notes += [*describe_provers(result), *_note_simulation(result, task)]
    notes += describe_unchecked(result.not_checked)
    if task.covered is not None:
        notes.append(f"product    {describe_covered(task.covered)}")
    bound = _describe_bound(result, task)
    if result.cost is not None:
        actions = ",".join(str(step.action) for step in result.steps)
        notes += [
            f"cost       {task.cost_text(result.cost)}  (lower bound "
            f"{task.cost_text(result.lower_bound)}, gap {format_percent(result.gap)})",
            *bound,
            f"sequence   {actions}",
            f"plan       {result.makespan} skills"
            + (f", {format_number(result.makespan_s, 1)} s" if result.makespan_s else ""),
            *describe_times(result.timed_by, task.metric),
            *describe_dwells(task),
            *describe_waits(result.steps),
        ]
    else:
        notes += bound
    notes += [
        f"{key:<10} {result.trace[key]}"
        for key in ("choice", "learner", "learned", "start")
        if key in result.trace
    ]
    notes += _describe_derived(result)
    notes += _trace_notes(result, task.metric.decimals)
    nodes = "-" if result.expanded is None else result.expanded
    timed = task.metric.depends_on_time and result.timed_by
    trajectories = f"{result.trajectories} trajectories, " if timed else ""
    notes.append(
        f"effort     {result.checks} checks, {result.cache_hits} verdicts reused, {trajectories}"
        f"{nodes} nodes, {result.wall_s:.2f} s"
    )
    notes += _describe_ahead(result)
    return Table(title, *tabulate_steps(result.steps, task.metric), notes)


def _describe_derived(result: Result) -> list[str]:
    """Return a note on options that the solver derived from the task, if any."""
    derived = result.trace.get("derived")
    if not isinstance(derived, dict) or not derived:
        return []
    values = ", ".join(f"{name} {_format_option(value)}" for name, value in derived.items())
    return [f"derived    {values}"]


def _format_option(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:,}" if isinstance(value, int | float) else str(value)


def _describe_ahead(result: Result) -> list[str]:
    """Return a note on checks that idle processes made ahead of the search, if any."""
    match result.trace.get("ahead"):
        case {"useful": int(useful), "wasted": int(wasted)}:
            return [f"ahead      {useful} checks made by idle processes of use, {wasted} wasted"]
    return []


def _describe_bound(result: Result, task: Task) -> list[str]:
    """Return the lower bound and its method; nothing without a bound."""
    if result.lower_bound is None or not math.isfinite(result.lower_bound):
        return []
    bound = task.cost_text(result.lower_bound)
    claim = bound if result.cost is not None else f"no plan costs less than {bound},"
    return [f"bound      {claim} by {result.bound_method or result.solver}"]


def describe_times(timed_by: str, metric: Metric) -> list[str]:
    """Return the terms of a weighted sum, and the source of times if costs depend on them."""
    terms = [f"weights    {', '.join(metric.terms)}"] if metric.terms else []
    if not metric.depends_on_time:
        return terms
    if timed_by:
        return [*terms, f"times      trajectories of {timed_by}, and the task's dwell times"]
    return [
        *terms,
        "times      the task's travel_speed_m_per_s and dwell times, as no back end plans "
        "trajectories; swept does",
    ]


def describe_waits(steps: Sequence[Step]) -> list[str]:
    """Return a note on the times that the arm waits for parts, if any."""
    waits = [f"{step.wait_s:.1f} s in {step.skill}" for step in steps if step.wait_s >= _LEAST_S]
    if not waits:
        return []
    whole_s = sum(step.wait_s for step in steps)
    shown = ", ".join(waits[:_MOST_OWNERS])
    more = f" and {len(waits) - _MOST_OWNERS} more" if len(waits) > _MOST_OWNERS else ""
    return [f"waits      {whole_s:.1f} s of the plan for parts: {shown}{more}"]


def describe_dwells(task: Task) -> list[str]:
    """Return a note on parts, screws and tools with dwell times of their own, if any."""
    driven = [source for source in task.dwells_from if ": " in source]
    lines = [f"dwells     {line}" for line in _join_driven(driven)]
    paths = [path for path in task.dwells_from[:-1] if path not in driven]
    own = list(dict.fromkeys(path.rpartition(".durations_s")[0] for path in paths))
    if not own:
        return lines
    shown = ", ".join(own[:_MOST_OWNERS])
    more = f" and {len(own) - _MOST_OWNERS} more" if len(own) > _MOST_OWNERS else ""
    return [*lines, f"dwells     of {shown}{more} by their own durations_s, others by the task's"]


def _join_driven(sources: Sequence[str]) -> Iterator[str]:
    """Yield one line for all screws that are driven alike."""
    names: dict[str, list[str]] = {}
    for source in sources:
        path, _, words = source.partition(": ")
        names.setdefault(words, []).append(path)
    for words, paths in names.items():
        shown = ", ".join(paths[:_MOST_OWNERS])
        more = f" and {len(paths) - _MOST_OWNERS} more" if len(paths) > _MOST_OWNERS else ""
        yield f"of {shown}{more} by {words}"


def tabulate_steps(
    steps: Sequence[Step], metric: Metric
) -> tuple[tuple[Column, ...], list[tuple[str, ...]]]:
    """Return columns and rows of the steps of a plan, without empty columns."""
    walks = any(step.place is not None for step in steps)
    moves = any(step.goal is not None for step in steps) or not steps
    lasts = any(step.duration_s for step in steps) or not steps
    lasts = lasts and not metric.is_duration
    chooses = any(step.way is not None for step in steps)
    columns = (
        Column("step", right=True),
        Column("action", right=True),
        Column("skill"),
        *([Column("way")] if chooses else []),
        *([Column("to")] if walks else []),
        *([Column("to x y z [m]", right=True)] if moves else []),
        Column(metric.heading, right=True),
        *([Column("time [s]", right=True)] if lasts else []),
    )
    rows: list[tuple[str, ...]] = [
        (
            str(step.index + 1),
            str(step.action),
            step.skill,
            *([step.way or "-"] if chooses else []),
            *([step.place or "-"] if walks else []),
            *([_point(step.goal)] if moves else []),
            f"{step.cost:.{metric.decimals}f}",
            *([f"{step.duration_s:.1f}"] if lasts else []),
        )
        for step in steps
    ]
    return columns, rows


def tabulate_comparison(results: Sequence[Result], title: str, decimals: int = 5) -> Table:
    """Return the results of several solvers side by side.

    If costs are times by back ends, a column shows the number of computed trajectories.
    """
    unit = results[0].cost_unit if results else ""
    timed = unit == "s" and any(result.timed_by for result in results)
    columns = (
        Column("solver"),
        Column("status"),
        Column(f"cost [{unit}]" if unit else "cost", right=True),
        Column("gap", right=True),
        Column("skills", right=True),
        Column("makespan [s]", right=True, below=True),
        Column("checks", right=True),
        *([Column("trajectories", right=True, below=True)] if timed else []),
        Column("iterations", right=True),
        Column("seconds", right=True),
        Column("sequence", below=True),
    )
    rows = [
        (
            result.solver,
            result.status.value,
            format_number(result.cost, decimals),
            format_percent(result.gap),
            "-" if result.makespan is None else str(result.makespan),
            format_number(result.makespan_s, 1),
            str(result.checks),
            *([str(result.trajectories)] if timed else []),
            "-" if result.expanded is None else str(result.expanded),
            f"{result.wall_s:.3f}",
            ",".join(str(step.action) for step in result.steps) or "-",
        )
        for result in results
    ]
    notes = [f"{result.solver}: {join_lines(result.reason)}" for result in results if result.reason]
    for result in results:
        notes += [f"{result.solver}: {note}" for note in _trace_notes(result, decimals)]
    sentences = chain.from_iterable(result.not_checked for result in results)
    notes += describe_unchecked(tuple(dict.fromkeys(sentences)))
    return Table(title, columns, rows, notes)


def _trace_notes(result: Result, decimals: int) -> list[str]:
    by_length = result.trace.get("sequences_by_length")
    if not isinstance(by_length, dict):
        return []
    parts = ", ".join(f"{count:,} of {length}" for length, count in by_length.items())
    worst = result.trace.get("worst_cost_by_length", {})
    ended = result.status in (Status.OPTIMAL, Status.INFEASIBLE)
    so_far = "" if ended else " so far"
    if not parts:
        return [f"sequences  no complete one{so_far}"]
    total = sum(by_length.values())
    notes = [f"sequences  {total:,} complete ones{so_far}: {parts} skills"]
    if worst:
        shortest = min(worst)
        unit = f" {result.cost_unit}" if result.cost_unit else ""
        notes.append(
            f"worst      {worst[shortest]:.{decimals}f}{unit} among those of {shortest} skills"
        )
    return notes


def describe_status(status: Status, reason: str) -> list[str]:
    """Return the status with its reason; a reason of several lines follows below."""
    lines = reason.splitlines()
    if len(lines) < 2:
        return [f"status     {PROOF[status]}" + (f" ({reason})" if reason else "")]
    first, *others = lines
    return [
        f"status     {PROOF[status]}",
        f"reason     {first}",
        *(f"           {line}" for line in others),
    ]


def describe_provers(result: Result | ChainResult) -> list[str]:
    """Return the back ends under which the status was checked."""
    label = "checked by" if result.status is Status.SOLVED else "proved by"
    return [f"{label:<9}  {', '.join(result.proved_by)}"] if result.proved_by else []


def _note_simulation(result: Result, task: Task) -> list[str]:
    """Return the outcome of the simulation of the plan, if the task has bodies."""
    if result.cost is None or not task.scene.bodies:
        return []
    if result.simulation is None:
        return ["simulation  not run"]
    return [f"simulation  {describe_simulation(result.simulation, len(result.steps))}"]


def describe_simulation(simulation: SimulationOutcome, steps: int) -> str:
    """Return the outcome of the simulation of a plan as the end of a sentence."""
    by = f"by {simulation.engine}"
    if simulation.complete:
        return f"{by} completes the plan"
    if simulation.failed_step is None:
        return f"{by} does not complete the plan: {simulation.reason}"
    place = f"step {simulation.failed_step} of {steps}"
    return f"{by} fails at {place}, {simulation.skill}: {simulation.reason}"


def describe_unchecked(sentences: Sequence[str]) -> list[str]:
    """Return a note for each sentence about unchecked properties."""
    return [f"not checked  {sentence}" for sentence in sentences]


def join_lines(reason: str) -> str:
    """Return a reason in one line."""
    return "; ".join(reason.splitlines())


def _point(point: Point | None) -> str:
    return "-" if point is None else " ".join(f"{value:.3f}" for value in point)


def tabulate_result(result: Result | ChainResult, task: Task) -> list[Table]:
    """Return the tables of a result: its plan, or the tables of a chain.

    Parameters
    ----------
    task
        The task, or any task of the chain.
    """
    if isinstance(result, Result):
        return [tabulate_plan(result, task)]
    from skillplan.views.tables.chain import tabulate_chain

    return tabulate_chain(result)


def tabulate_saved(result: Result | ChainResult) -> dict[str, Table]:
    """Return the tables that are saved but not shown, by file name."""
    if isinstance(result, Result):
        return {}
    from skillplan.views.tables.chain import tabulate_appendix

    return tabulate_appendix(result)


def tabulate_comparisons(
    results: Sequence[Result] | Sequence[ChainResult], title: str, decimals: int
) -> list[Table]:
    """Return several solvers side by side."""
    single = [result for result in results if isinstance(result, Result)]
    chains = [result for result in results if not isinstance(result, Result)]
    if not chains:
        return [tabulate_comparison(single, title, decimals)]
    from skillplan.views.tables.chain import tabulate_chain_comparison

    return tabulate_chain_comparison(chains, title)


def render_csv_files(result: Result | ChainResult, task: Task) -> dict[str, str]:
    """Return the CSV files of a result by name: its plan and tables of the domain.

    Parameters
    ----------
    task
        The task, or any task of the chain.
    """
    tables = {PLAN: tabulate_result(result, task)[-1], **tabulate_saved(result)}
    return {name: render_csv(table) for name, table in tables.items()}


# Labels of methods; every other method is a proof.
_LABELS = {"replay": "replay", "arithmetic": "figures", "grounding": "replay"}
_PROOF = "proof"
_MOST_NAMED = 5


def tabulate_certificate(certificate: Certificate) -> Table:
    """Return a row for every claim, with the verdict below."""
    everything = len(certificate.claims)
    back_ends = [_describe_back_end(back_end) for back_end in certificate.asked]
    notes = [
        *_describe_task(certificate),
        f"asked      {'; '.join(back_ends) or 'no back end'}"
        + (", with verdicts kept on disk" if certificate.warm else ""),
        *(f"unchecked  {key}: {why}" for key, why in certificate.unchecked.items()),
    ]
    notes += describe_unchecked(certificate.not_checked)
    return _table(
        certificate, certificate.claims, [*notes, _describe_verdict(certificate, everything)]
    )


def summarize_certificate(certificate: Certificate) -> Table:
    """Return a row for every claim that does not hold, with a summary of the others below."""
    amiss = [claim for claim in certificate.claims if claim.outcome is not Outcome.HOLDS]
    groups: dict[str, list[Claim]] = {}
    for claim in certificate.claims:
        groups.setdefault(_LABELS.get(claim.method, _PROOF), []).append(claim)
    notes = [
        *_describe_task(certificate),
        *(
            f"{label:<10} {_describe_held(groups[label])}"
            for label in dict.fromkeys((*_LABELS.values(), _PROOF))
            if label in groups
        ),
    ]
    notes += describe_unchecked(certificate.not_checked)
    return _table(certificate, amiss, [*notes, _describe_verdict(certificate, _MOST_NAMED)])


def _describe_task(certificate: Certificate) -> list[str]:
    """Return a note on options that changed the task of the file, if any."""
    origin = certificate.origin
    if origin is None or not origin.given():
        return []
    return [f"task       {origin.file} with {' '.join(origin.given())}"]


def _describe_back_end(back_end: Asked) -> str:
    options = ", ".join(f"{key}={value}" for key, value in back_end.options.items())
    return f"{back_end.name} {back_end.version}" + (f" ({options})" if options else "")


def _table(certificate: Certificate, claims: Iterable[Claim], notes: Sequence[str]) -> Table:
    columns = (Column("claim"), Column("outcome"), Column("by"), Column("detail"))
    rows = [(claim.claim, claim.outcome.value, claim.method, claim.detail) for claim in claims]
    return Table(f"{certificate.name}: verification", columns, rows, notes)


def _describe_held(claims: Sequence[Claim]) -> str:
    """Return the names or the number of the claims that hold, and the methods of proofs."""
    held = [claim for claim in claims if claim.outcome is Outcome.HOLDS]
    if len(held) < len(claims):
        words = f"{len(held)} of {len(claims)} claims hold"
    else:
        names = list(dict.fromkeys(claim.claim.rpartition(": ")[2] for claim in held))
        words = f"{', '.join(names)} {'holds' if len(names) == 1 else 'hold'}"
        tasks = len({claim.claim.rpartition(": ")[0] for claim in held} - {""})
        words += f", {len(claims)} claims of {tasks} tasks" if tasks > 1 else ""
    methods = list(dict.fromkeys(claim.method for claim in held if claim.method not in _LABELS))
    return f"{words}, by {' and '.join(methods)}" if methods else words


def _describe_verdict(certificate: Certificate, most: int) -> str:
    """Return the conclusion with the names of the claims that do not hold, or their number."""
    refuted = [claim.claim for claim in certificate.refuted]
    if refuted:
        return f"verdict    NOT VALID: {_name_claims(refuted, most)}"
    unconfirmed = [claim.claim for claim in certificate.unconfirmed]
    if unconfirmed:
        return f"verdict    NOT CONFIRMED: not checked: {_name_claims(unconfirmed, most)}"
    open_ = [claim.claim for claim in certificate.claims if claim.outcome is Outcome.NOT_CHECKED]
    rest = f", but for what was not checked: {_name_claims(open_, most)}" if open_ else ""
    return f"verdict    valid{rest}"


def _name_claims(claims: Sequence[str], most: int) -> str:
    return ", ".join(claims) if len(claims) <= most else f"{len(claims)} claims"


_WHOLE = "complete: every point is proved, and there are no others"


def tabulate_front(front: Front) -> Table:
    """Return a row for every point, with the claims of the front below."""
    lasts = "time" not in front.names
    columns = (
        Column("point", right=True),
        *(
            Column(f"{name} [{metric.unit}]" if metric.unit else name, right=True)
            for name, metric in zip(front.names, front.metrics, strict=True)
        ),
        Column("skills", right=True),
        *([Column("time [s]", right=True)] if lasts else []),
        Column("proved"),
        Column("sequence", below=True),
    )
    rows = [
        (
            str(number),
            *(
                f"{cost:.{metric.decimals}f}"
                for cost, metric in zip(point.costs, front.metrics, strict=True)
            ),
            str(len(point.skills)),
            *([f"{point.makespan_s:.1f}"] if lasts else []),
            "yes" if point.proved else "no",
            ",".join(map(str, point.actions)),
        )
        for number, point in enumerate(front.points, start=1)
    ]
    title = f"{front.task}: Pareto front of {front.names[0]} and {front.names[1]}, physics "
    title += f"{front.physics}, collision {front.collision or 'none'}"
    return Table(title, columns, rows, describe_front(front))


def describe_front(front: Front) -> list[str]:
    """Return the claims of a front in words, each after a label."""
    metric = front.metrics[0]
    claim = _WHOLE if front.status is Status.OPTIMAL else PROOF[front.status]
    if front.status is Status.SOLVED:
        claim = "some points; others may be missing"
    notes = [f"status     {claim}" + (f" ({front.reason})" if front.reason else "")]
    if front.reached is not None and front.status is Status.SOLVED:
        notes.append(f"searched   up to a {front.names[0]} of {metric.text(front.reached)}")
    if front.points:
        notes.append(f"proved by  {', '.join(front.proved_by)}")
    if front.confirmed_by:
        ends = f"least {front.names[0]} and least {front.names[1]}"
        notes.append(
            f"confirmed  {ends} by the solver {front.confirmed_by}, each in a search alone"
        )
    timed = next((m for m in front.metrics if m.depends_on_time), None)
    if timed is not None and front.points:
        notes += describe_times(front.timed_by, timed)
    notes += describe_unchecked(front.not_checked)
    if front.stats:
        notes.append(
            f"effort     {front.stats['checks']} checks, {front.stats['labels']} labels, "
            f"{front.stats['expanded']} expanded, {front.stats['wall_s']:.2f} s"
        )
    return notes


def tabulate_advice(advice: Advice) -> Table:
    """Return a row for every change that saves, with the cycle of the file below."""
    base = advice.base
    unit = f" [{base.cost_unit}]" if base.cost_unit else ""
    columns = (
        Column("no", right=True),
        Column("change"),
        Column(f"saves{unit}", right=True),
        Column("share", right=True),
        Column(f"cost{unit}", right=True),
        Column("time [s]", right=True),
        Column("cycles/h", right=True),
        Column("proved"),
    )
    rows = [_make_tip_row(number, tip, advice) for number, tip in enumerate(advice.tips, start=1)]
    title = f"{base.task}: advice, physics {base.physics}, collision {base.collision or 'none'}"
    return Table(title, columns, rows, describe_advice(advice))


def _make_tip_row(number: int, tip: Tip, advice: Advice) -> tuple[str, ...]:
    base, result = advice.base, tip.result
    share = None if not base.cost else tip.saving / base.cost
    return (
        str(number),
        tip.words,
        format_number(tip.saving, advice.decimals),
        format_percent(share),
        format_number(result.cost, advice.decimals),
        format_number(result.makespan_s, 1),
        format_number(compute_cycles_per_hour(result.makespan_s), 1),
        "yes" if tip.proved else "no",
    )


def describe_advice(advice: Advice) -> list[str]:
    """Return the file as it is, and the count of tries, each after a label."""
    base, shares = advice.base, advice.shares
    notes = []
    if base.cost is None:
        notes += describe_status(base.status, base.reason)
    else:
        cost = f"{base.cost:.{advice.decimals}f} {base.cost_unit}".rstrip()
        proved = "proved" if base.gap == 0 else "not proved to be the least"
        notes.append(f"now        {cost}, {proved}, by {', '.join(base.proved_by)}")
    if shares is not None and shares.total_s:
        parts = [("travel", shares.travel_s), ("work", shares.work_s), ("tools", shares.change_s)]
        if shares.wait_s >= _LEAST_S:
            parts.append(("waits", shares.wait_s))
        split = ", ".join(
            f"{name} {value:.1f} s ({format_percent(value / shares.total_s)})"
            for name, value in parts
        )
        notes.append(
            f"cycle      {shares.total_s:.1f} s, {shares.cycles_per_hour:.1f} cycles per hour: "
            f"{split}"
        )
    left = f"; {advice.reason}" if advice.reason else ""
    if advice.cut:
        left = f"; {advice.cut} ended at a limit of the solver and are not listed{left}"
    if advice.wrong:
        left = f"; {advice.wrong} results failed the referee's check and are not listed{left}"
    notes.append(
        f"tried      {advice.tried} of {advice.proposed} changes solved, {advice.useless} of them "
        f"save nothing; {advice.refused} refused by the checks of the file; {advice.longer} places "
        f"left out that do not shorten the plan{left}"
    )
    if advice.tips:
        changes = advice.tips[0].changes
        settings = " ".join(f"--set '{key}={value}'" for key, value in changes.items())
        notes.append(f"first      {settings}")
    return [*notes, *describe_unchecked(base.not_checked)]
