"""Answers of check, chart, explain and evaluate as tables."""

from __future__ import annotations

from collections.abc import Sequence

from skillplan.chart.conflict import explain_conflict
from skillplan.chart.partial_order import closure, reduction
from skillplan.chart.precedence_chart import DerivedChart
from skillplan.records.evaluation import Evaluation
from skillplan.records.questions import Checked, Explanation, Freedom, Preview, Way
from skillplan.records.result import tolerance
from skillplan.records.stored.product_relation import Obstacle
from skillplan.task.skill import Outcome
from skillplan.task.task import Task
from skillplan.task.verdict import Verdict
from skillplan.views.tables.results import describe_times, describe_unchecked, tabulate_steps
from skillplan.views.text.table import Column, ItemList, Table
from skillplan.views.text.wording import (
    format_evidence,
    format_percent,
    format_yes_no,
    list_evidence,
    name_direction,
)


def tabulate_chart(chart: DerivedChart, task: Task, back_ends: Sequence[str]) -> Table:
    """Return the derived relation, with a comparison with the hand-made chart below."""
    direct = reduction([(r.before, r.after) for r in chart.relations])
    by_hand = set(chart.hand_made or ())
    implied = closure(by_hand)
    rows = []
    for relation in chart.relations:
        pair = (relation.before, relation.after)
        if pair not in direct and pair not in by_hand and (not by_hand or pair in implied):
            continue
        mark = "drawn" if pair in by_hand else "implied" if pair in implied else "extra"
        rows.append(
            (
                relation.before,
                relation.after,
                mark if chart.hand_made is not None else "-",
                str(relation.evidence["skill"]),
                relation.reason,
            )
        )
    rows += [(before, after, "MISSING", "-", "-") for before, after in chart.missing]
    columns = [Column(name) for name in ("before", "after", "hand-made")]
    columns += [Column("asked", short="query"), Column("reason")]
    if chart.hand_made is None:
        notes = ["The task file has no hand-made chart to compare with."]
    elif not chart.missing and not chart.extra:
        notes = ["The derived relation equals the hand-made chart."]
    else:
        notes = [f"missing {len(chart.missing)}, extra {len(chart.extra)}"]
    hidden = len(chart.relations) - sum(1 for row in rows if row[2] != "MISSING")
    if hidden:
        notes.append(f"{hidden} more derived pairs follow from these; --format json has all.")
    notes += [f"{skill} is never feasible: {why}" for skill, why in chart.impossible.items()]
    notes += chart.beyond_order(task)
    notes += _describe_choices(chart)
    notes += [f"{skill} could not be worked out" for skill in chart.undecided]
    if chart.cycle:
        first, *others = explain_conflict(task, chart.relations)
        notes += [f"No order exists: {first}", *others]
    notes += chart.contradictions
    title = f"{task.name}: precedence relation derived by {', '.join(back_ends)}"
    return Table(title, columns, rows, notes)


def _describe_choices(chart: DerivedChart) -> list[str]:
    """Return a note for each choice that orders leave, with all skills that share it."""
    skills: dict[str, list[str]] = {}
    for alternative in chart.alternatives:
        skills.setdefault(str(alternative), []).append(alternative.skill)
    return [
        f"{' and '.join(names)} leave{'s' * (len(names) == 1)} a choice: {choice}"
        for choice, names in skills.items()
    ]


_RESTS_ON = "rests on"


def tabulate_explanation(explanation: Explanation) -> list[Table]:
    """Return the stages, with the state and the conditions of the skill below."""
    task = explanation.task
    rows = [
        (
            verdict.stage,
            verdict.status.value,
            verdict.reason or "-",
            _describe_basis(verdict, task),
            format_evidence(verdict.evidence) or "-",
        )
        for verdict in explanation.stages
    ]
    columns = [Column(name) for name in ("stage", "verdict", "reason")]
    columns += [Column(name, listed=True) for name in (_RESTS_ON, "evidence")]
    lists = [
        ItemList(
            f"{verdict.stage}: {verdict.status.value}",
            [(_RESTS_ON, _describe_basis(verdict, task)), *list_evidence(verdict.evidence)],
        )
        for verdict in explanation.stages
    ]
    outcome = "feasible" if explanation.feasible else "not feasible"
    title = f"{task.name}: {explanation.skill.name} is {outcome}"
    return [Table(title, columns, rows, _write_notes(explanation), lists)]


def _write_notes(explanation: Explanation) -> list[str]:
    return [
        f"state         {', '.join(explanation.state)}",
        f"precondition  {explanation.skill.condition(explanation.state)}",
        f"prediction    {_describe_changes(explanation, explanation.prediction)}",
        *(
            f"otherwise     {_describe_changes(explanation, outcome)}, "
            f"with probability {outcome.probability:g}"
            for outcome in explanation.otherwise
        ),
        *(
            f"note          {note}"
            for note in explanation.task.notes.get(explanation.skill.name, ())
        ),
        *(f"{what:<13} {path}" for what, path in explanation.files.items()),
    ]


def _describe_changes(explanation: Explanation, outcome: Outcome) -> str:
    gone = explanation.state & outcome.delete
    return ", ".join([*outcome.add, *(f"not {fact}" for fact in gone)])


def _describe_basis(verdict: Verdict, task: Task) -> str:
    facts = verdict.facts
    return "all facts" if len(facts) == len(task.facts) else ", ".join(facts) or "no fact"


_MM_PER_M = 1000.0


def tabulate_freedom(freedom: Freedom) -> list[Table]:
    """Return the directions, with the parts in place below."""
    rows = [_make_row(way) for way in freedom.ways]
    columns = [
        Column("direction"),
        Column("blocked by"),
        Column("after [mm]", right=True),
        Column("width [mm]", right=True),
        Column("at x y z [mm]"),
    ]
    free = [name_direction(way.direction) for way in freedom.ways if not way.obstacles]
    outcome = f"free along {', '.join(free)}" if free else "blocked in all directions"
    notes = [f"in place   {', '.join(freedom.present) or 'no other part'}"]
    if freedom.part in freedom.stuck:
        others = [name for name in freedom.stuck if name != freedom.part]
        among = f", nor {', '.join(others)}" if others else ""
        notes.append(f"stuck      no motion that import-cad searched frees it{among}")
    if any(obstacle.sensitive for way in freedom.ways for obstacle in way.obstacles):
        tolerance_mm = freedom.tolerance_m * _MM_PER_M
        notes.append(f"* half or double the tolerance of {tolerance_mm:g} mm says otherwise")
    notes += [f"{what:<10} {path}" for what, path in freedom.files.items()]
    name = freedom.path if freedom.task is None else freedom.task.name
    return [Table(f"{name}: {freedom.part} is {outcome}", columns, rows, notes)]


def _make_row(way: Way) -> tuple[str, ...]:
    name = name_direction(way.direction)
    if not way.obstacles:
        return (name, "nothing: free", "-", "-", "-")
    first = way.obstacles[0]
    parts = ", ".join(
        f"{obstacle.part}{'*' if obstacle.sensitive else ''}" for obstacle in way.obstacles
    )
    return (name, parts, _format_mm(first.distance_m), _format_mm(first.width_m), _place(first))


def _place(obstacle: Obstacle) -> str:
    return " ".join(_format_mm(value) for value in obstacle.point_m)


def _format_mm(length_m: float) -> str:
    return f"{length_m * _MM_PER_M:.1f}"


def tabulate_evaluation(evaluation: Evaluation) -> Table:
    """Return the steps of a sequence with their costs and violations."""
    task, walked = evaluation.task, evaluation.walked
    notes = [
        f"feasible   {format_yes_no(walked.feasible)}",
        f"complete   {format_yes_no(walked.complete)}",
    ]
    if walked.steps:
        what = "cost" if walked.complete else "so far"
        timed = walked.duration_s and not task.metric.is_duration
        lasts = f", {walked.duration_s:.1f} s" if timed else ""
        notes.append(f"{what:<10} {task.cost_text(walked.cost)}{lasts}")
    if evaluation.deviation is not None:
        notes.append(
            f"deviation  {format_percent(evaluation.deviation)} of the proved optimum "
            f"{task.cost_text(evaluation.optimum)}"
        )
    elif walked.complete and evaluation.optimum is None:
        if task.deterministic:
            notes.append("deviation  unknown: the optimum was not proved in time")
            notes += _describe_bound(evaluation)
        else:
            notes.append(
                "deviation  none: under chance a sequence is one run that a policy may take, "
                "here with every nominal outcome"
            )
    if evaluation.best is not None:
        notes += describe_times(evaluation.best.timed_by, task.metric)
    if walked.total_reward is not None:
        notes.append(f"reward     {walked.total_reward:.5f}")
    for fault in walked.violations:
        where = f"step {fault.step + 1} ({fault.skill})" if fault.skill else "the end"
        notes.append(f"violation  at {where}: {fault.stage}: {fault.reason}")
        if fault.facts and fault.skill:
            notes.append(f"           rests on {', '.join(fault.facts)}")
    start = [place.name for place in task.places_in(task.initial)]
    if start:
        notes.insert(0, f"from       {', '.join(start)}")
    columns, rows = tabulate_steps(walked.steps, task.metric)
    return Table(f"{task.name}: evaluation", columns, rows, notes)


def _describe_bound(evaluation: Evaluation) -> list[str]:
    """Return the bound and the best plan if no optimum was proved."""
    best, task = evaluation.best, evaluation.task
    if best is None or best.lower_bound is None:
        return []
    bound = task.cost_text(best.lower_bound)
    notes = [f"bound      {bound} by {best.bound_method}, gap {format_percent(evaluation.gap)}"]
    if best.cost is not None and best.cost < evaluation.walked.cost - tolerance(best.cost):
        notes.append(f"found      a plan of {task.cost_text(best.cost)}")
    return notes


def tabulate_checked(checked: Checked) -> list[Table]:
    """Return a row for every task of a file."""
    return [_tabulate_tasks(checked)]


def _tabulate_tasks(checked: Checked) -> Table:
    columns = [
        Column("task"),
        Column("actions", right=True),
        Column("facts", right=True),
        Column("observed", right=True),
        Column("step limit", right=True),
        Column("back ends"),
    ]
    keys = ("skills", "facts", "observation", "step_limit")
    rows = [
        (task["name"], *(str(task[key]) for key in keys), ", ".join(task["back_ends"]))
        for task in checked.document()["tasks"]
    ]
    notes = [f"kind       {checked.problem.kind}", f"sha256     {checked.problem.sha256}"]
    notes += describe_unchecked(checked.not_checked)
    return Table(
        f"{checked.problem.name}: valid",
        columns,
        rows,
        [*notes, *_describe_preview(checked.preview)],
    )


def _describe_preview(preview: Preview) -> list[str]:
    """Return findings before solving: overview, orders and warnings."""
    notes = list(preview.overview.lines)
    for order in preview.orders:
        if not order.back_ends:
            notes.append(f"order      not derived of {order.not_derived}; give --collision for it")
            continue
        by = f"by {', '.join(order.back_ends)}"
        pairs = f"{order.pairs} pair{'' if order.pairs == 1 else 's'} of components {by}"
        notes.append(f"order      {f'none {by}' if order.lines else pairs}")
    return [*notes, *(f"warning    {warning}" for warning in preview.warnings)]
