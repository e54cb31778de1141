"""Tables of training runs, as Table III of Moller et al."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Sequence

from skillplan.records.interval import Estimate
from skillplan.records.training.method_comparison import MethodComparison
from skillplan.records.training.published_runs import SUCCESS_RATE
from skillplan.records.training.relational_file import RelationalContent
from skillplan.records.training.result import LayoutsResult, RunOutcome, Tally, TrainingResult
from skillplan.records.training.shortfall import Shortfall
from skillplan.solvers.learning.network_policy import ActionRule
from skillplan.solvers.solution import deviation
from skillplan.task.task import Task
from skillplan.views.tables.results import describe_unchecked
from skillplan.views.text.table import Column, Table
from skillplan.views.text.wording import count, format_number, format_percent


def tabulate_layouts(result: LayoutsResult, task: Task) -> Table:
    """Return a row for every layout; all costs are in the metric of the task."""
    unit, decimals = task.metric.unit, task.metric.decimals
    columns = [
        Column("layout"),
        Column(f"optimum [{unit}]" if unit else "optimum", right=True),
        Column("proof [s]", right=True),
        Column("complete", right=True),
        Column("least dev.", right=True),
        Column("mean dev.", right=True),
        Column("most dev.", right=True),
        Column("answer [s]", right=True),
    ]
    rows = [
        [
            row.name,
            format_number(row.optimum.cost, decimals),
            format_number(row.optimum.wall_s, 4),
            f"{row.completed} of {len(row.answers)}",
            *_format_spread(row.deviations),
            format_number(statistics.median(row.answer_s) if row.answer_s else None, 4),
        ]
        for row in result.rows
    ]
    learned = f"{result.learned_on} others" if result.learned_on else "the file's own"
    count = f"{len(result.rows)} layout" if len(result.rows) == 1 else f"{len(result.rows)} layouts"
    title = f"{task.name}: {count} that no run has seen, learned on {learned}"
    return Table(title, columns, rows, _write_layout_notes(result))


def _write_layout_notes(result: LayoutsResult) -> list[str]:
    notes = []
    complete, off = result.complete_share, result.deviation_iqm
    if complete is not None and complete.low is not None and complete.high is not None:
        answers = sum(len(row.answers) for row in result.rows)
        notes.append(
            f"complete   {100 * complete.value:.1f} % (95 %: {100 * complete.low:.1f} to "
            f"{100 * complete.high:.1f} %) of {answers:,} answers; {result.at_most(0.01):,} "
            "within 1 % of the optimum"
        )
    if off is not None:
        note = f"deviation  interquartile mean over the layouts {format_percent(off.value)}"
        if off.low is not None:
            note += f" (95 %: {format_percent(off.low)} to {format_percent(off.high)})"
        notes.append(f"{note}, of the answers that complete")
    answer_s, proof_s = result.answer_s, result.proof_s
    if answer_s is not None and proof_s is not None:
        solver = result.rows[0].optimum.solver
        notes.append(
            f"time       a policy answers in {answer_s:.4f} s, {solver} proves its optimum in "
            f"{proof_s:.4f} s (medians, with cold caches)"
        )
        if result.training_s is not None:
            useful = complete is not None and complete.value > 0
            saved_s = proof_s - answer_s if useful else 0.0
            notes.append(_describe_savings(result.training_s, saved_s, useful))
    return notes


def _describe_savings(training_s: float, saved_s: float, useful: bool) -> str:
    """Return the number of layouts after which training saves time."""
    note = f"training   took {training_s:.1f} s for all runs, which"
    if not useful:
        return f"{note} does not pay off: no answer completes the task"
    if saved_s <= 0:
        return f"{note} never pays off here: a proof is no slower than a policy"
    return f"{note} pays off after {training_s / saved_s:,.0f} layouts"


def _format_spread(values: Sequence[float]) -> list[str]:
    if not values:
        return ["N/A"] * 3
    return [
        format_percent(min(values)),
        format_percent(statistics.fmean(values)),
        format_percent(max(values)),
    ]


_MOST_NAMED = 5


def describe_cause(cause: str, progress_step: int | None, steps: int | None) -> str:
    """Return the reason why runs do not complete a task.

    Parameters
    ----------
    progress_step
        Step of a run at which most goals were first reached; None if no goal was.
    steps
        Intended steps of a run; None if unknown.
    """
    if cause == "policy":
        return "policy: the task was completed, but what was learned does not do so"
    if cause == "steps":
        return "steps: the runs were still getting further when they ended"
    if progress_step is None:
        return "exploration: no goal was reached at all"
    of = "" if steps is None else f" of {steps:,}"
    return f"exploration: nothing further was reached after step {progress_step:,}{of}"


def describe_shortfall(result: TrainingResult) -> list[str]:
    """Return the progress of incomplete runs, their failures, and advice, if there are any."""
    short = result.shortfall
    if short is None:
        return []
    whom = count(len(short.runs), "run")
    goals = count(short.goals, "goal")
    note = f"short      {whom} had at most {short.most_goals} of {goals} at the same time"
    if short.last_progress_step is not None:
        note += f", first at step {short.last_progress_step:,} of {result.steps:,}"
    notes = [note]
    if short.missing:
        notes.append(f"never      reached: {_list_names(short.missing)}")
    if short.never:
        notes.append(f"skills     never executed: {_list_names(short.never)}")
    notes += _describe_ends(short)
    if short.hidden is not None:
        notes.append(
            f"mask       {result.options['mask']}: preconditions hid {short.hidden:.1f} of "
            f"{count(short.skills, 'skill')} on average, and left {short.skills - short.hidden:.1f}"
        )
    cause = describe_cause(short.cause, short.last_progress_step, result.steps)
    return [*notes, f"cause      {cause}", f"try        {short.advice}"]


def _describe_ends(short: Shortfall) -> list[str]:
    notes = []
    episodes = count(short.episodes, "episode")
    if short.dead_states:
        states = count(short.dead_states, "state")
        notes.append(
            f"dead ends  {short.dead_ends:,} of {episodes} entered one: {states} in which every "
            "applicable skill failed, or led to such a state"
        )
    if short.failed:
        worst = _list_names([f"{name} {times:,} times" for name, times in short.failed])
        notes.append(f"failed     {worst}")
    if short.out_of_time:
        notes.append(f"time       {short.out_of_time:,} of {episodes} reached the step limit")
    return notes


def _list_names(names: Sequence[str]) -> str:
    more = len(names) - _MOST_NAMED
    shown = ", ".join(names[:_MOST_NAMED])
    return shown if more <= 0 else f"{shown} and {more} more"


NONE = "N/A"
"""Placeholder of runs that do not complete the task, as in the paper."""
_MOST_RUNS = 10


def tabulate_training(result: TrainingResult) -> list[Table]:
    """Return a row for every run; a note names published results if the task is the paper's."""
    metric = result.task.metric
    cost = metric.heading
    chance = result.chance
    seen = f"best seen [{metric.unit}]" if metric.unit else "best seen"
    columns = [Column("run", right=True), Column("seed", right=True)]
    columns += [Column("sequence", below=True)]
    columns += [Column(f"expected {cost}" if chance else cost, right=True)]
    columns.append(Column("deviation", right=True))
    if result.sampling is None:
        columns.append(Column("success", right=True))
    else:
        rule = result.sampling.rule
        columns.append(Column("greedy", right=True))
        if not result.acts_alike:
            columns.append(Column(f"{rule.kind} {rule.value:g}", right=True))
        columns.append(Column("in training", right=True))
    columns += [Column(seen, right=True), Column("first at step", right=True)]
    rows = [_make_row(result, outcome) for outcome in result.outcomes]
    runs = count(len(result.outcomes), "run")
    title = f"{result.task.name}: {runs} of {result.learner}, {result.steps:,} steps each"
    for key in ("observation", "mask"):
        if key in result.options:
            title += f", {key} {result.options[key]}"
    title += f"; physics {result.physics}, collision {result.collision or 'none'}"
    table = Table(title, columns, rows, _write_notes(result))
    # CSV contains the last table.
    return (
        [table]
        if result.layouts is None
        else [tabulate_layouts(result.layouts, result.task), table]
    )


def _make_row(result: TrainingResult, outcome: RunOutcome) -> list[str]:
    decimals, greedy = result.task.metric.decimals, outcome.greedy
    shown = greedy is not None and greedy.complete
    sequence = NONE if greedy is None or not shown else ",".join(map(str, greedy.actions))
    off = deviation(outcome.cost, result.optimum.cost)
    cells = [str(outcome.run), str(outcome.seed), sequence]
    cells += [format_number(outcome.cost, decimals) if shown else NONE]
    cells.append(format_percent(off) if shown else NONE)
    if result.sampling is not None:
        cells.append(_format_rate(outcome.greedy_tally))
    if not result.acts_alike:
        cells.append(_format_rate(outcome.tally))
    if result.sampling is not None:
        cells.append("-" if outcome.training is None else _format_rate(outcome.training.recent))
    first = None if outcome.training is None else outcome.training.first_success_step
    cells += [
        format_number(outcome.best_cost_seen, decimals),
        "-" if first is None else f"{first:,}",
    ]
    return cells


def _write_notes(result: TrainingResult) -> list[str]:
    task = result.task
    notes = [_describe_optimum(result), *describe_unchecked(result.optimum.not_checked)]
    notes.append(_describe_runs(result))
    off, cost = result.deviation_iqm, result.cost_iqm
    if off is not None:
        notes.append(f"deviation  interquartile mean {_format_interval(off, format_percent)}")
    elif cost is not None:
        notes.append(f"cost       interquartile mean {_format_interval(cost, task.cost_text)}")
    if off is not None or cost is not None:
        notes[-1] += f", of the {count(result.completed, 'run')} that complete"
    score = result.score_iqm
    if score is not None and result.completed < len(result.outcomes):
        notes.append(
            f"score      interquartile mean {_format_interval(score, _format_score)}, of all "
            f"{count(len(result.outcomes), 'run')}: optimum / cost, 0 if a run does not complete"
        )
    notes += _describe_success(result)
    if result.best_seen is not None:
        note = f"best seen  {task.cost_text(result.best_seen)} while learning"
        seen_off = deviation(result.best_seen, result.seen_optimum)
        notes.append(note if seen_off is None else f"{note}, deviation {format_percent(seen_off)}")
    notes += _describe_plans(result) + _describe_baseline(result) + _describe_paper(result)
    faults = [outcome for outcome in result.outcomes if outcome.reason]
    for outcome in faults[:_MOST_RUNS]:
        notes.append(f"run {outcome.run:<7}{outcome.status.value}: {outcome.reason}")
    if len(faults) > _MOST_RUNS:
        notes.append(f"runs       {len(faults) - _MOST_RUNS} more do not complete")
    if result.warm_start is not None:
        notes.append(f"begun      {result.warm_start.text}")
    notes += describe_shortfall(result)
    if result.interrupted:
        notes.append("stopped    before all steps were done; train --resume goes on")
    notes += result.notes
    effort = f"{count(result.checks, 'check')}, {count(result.executions, 'execution')}"
    notes.append(f"effort     {effort}, {result.wall_s:.1f} s")
    if result.steps_per_s is not None:
        notes[-1] += f", {result.steps_per_s:,.0f} steps/s"
    return notes


def _describe_plans(result: TrainingResult) -> list[str]:
    """Return notes on plans with a learned model, and on runs that explored instead."""
    records = [run.training for run in result.outcomes if run.training is not None]
    notes = []
    steps = sorted(record.settled_step for record in records if record.settled_step is not None)
    if result.planned:
        note = f"plans      settled in {len(steps)} of {count(len(records), 'run')}"
        if steps:
            last = f" to {steps[-1]:,}" if steps[-1] != steps[0] else ""
            note += f" after {steps[0]:,}{last} steps"
        if len(records) > 1:
            note += "; seeds of a planner do not form a sample, so their costs get no interval"
        notes.append(note)
    explores = sum(record.explores for record in records)
    if explores:
        notes.append(
            f"explored   {explores} of {count(len(records), 'run')} without plans: schemas fit one "
            "task without chance, in which an action has the same effects everywhere"
        )
    return notes


def _describe_optimum(result: TrainingResult) -> str:
    best = result.optimum
    if best.cost is None:
        return f"optimum    not proved: {best.reason}"
    what = "expected, " if result.chance else ""
    note = f"optimum    {result.task.cost_text(best.cost)}, {what}proved by {best.solver}"
    return note if best.wall_s is None else f"{note} in {best.wall_s:.2f} s"


def _describe_runs(result: TrainingResult) -> str:
    total = len(result.outcomes)
    note = f"runs       {result.completed} of {total} complete"
    if result.optimum.cost is not None:
        note += f", {result.at_most(0.5e-4)} at 0.00 % ({result.at_most(0.0)} at the optimum "
        note += f"itself), {result.at_most(0.01)} within 1 %"
    return f"{note}, {len(result.failed)} failed" if result.failed else note


def _describe_success(result: TrainingResult) -> list[str]:
    notes = []
    if result.sampling is not None and result.success.estimate is not None:
        drawn, greedy = result.sampling, result.greedy_success
        if greedy.estimate is not None:
            each = "with the task's chance" if result.chance else "one per run"
            notes.append(
                f"greedy     {_format_share(greedy.estimate.value)} of "
                f"{count(greedy.episodes, 'greedy roll-out')} complete, {each}"
            )
        if result.acts_alike:
            return [*notes, *_describe_training(result)]
        whose = "the policies' own rule" if drawn.temperature is None else "--temperature"
        notes.append(
            f"success    {_format_interval(result.success.estimate, _format_share)} of "
            f"{count(result.success.episodes, 'sampled roll-out')} by {whose}, "
            f"{_describe_rule(drawn.rule)}, seed {drawn.seed}"
        )
        spread = result.success_iqm
        if spread is not None and len(result.outcomes) > 1:
            notes[-1] += (
                f"; interquartile mean of the runs {_format_interval(spread, _format_share)}"
            )
    return [*notes, *_describe_training(result)]


def _describe_training(result: TrainingResult) -> list[str]:
    trained = result.training_success
    if trained.estimate is None:
        return []
    rate = trained.estimate.bare if result.planned else trained.estimate
    return [
        f"training   {_format_interval(rate, _format_share)} of the "
        f"{count(trained.episodes, 'episode')} that ended in the last "
        f"{result.recent_steps:,} steps of a run completed the task"
    ]


def _describe_rule(rule: ActionRule) -> str:
    if rule.kind == "softmax":
        return f"softmax of the scores at temperature {rule.value:g}"
    return f"epsilon-greedy with epsilon {rule.value:g}" if rule.value else "greedy"


def _describe_baseline(result: TrainingResult) -> list[str]:
    base = result.baseline
    if base is None or base.tally.estimate is None:
        return []
    rate = _format_interval(base.tally.estimate, _format_share)
    note = f"random     {rate} of {count(base.tally.episodes, 'episode')} of even chance, mask "
    note += base.mask
    if base.best_cost is not None:
        off = deviation(base.best_cost, result.episode_optimum)
        note += f"; the best costs {result.task.cost_text(base.best_cost)}"
        note += "" if off is None else f", deviation {format_percent(off)}"
    return [note]


def _describe_paper(result: TrainingResult) -> list[str]:
    theirs = result.published
    if not theirs:
        return []
    complete = [run for run in theirs if run.cost is not None]
    at_optimum = sum(run.deviation == 0 for run in complete)
    return [
        f"paper      Moller et al., Table III: {len(complete)} of {len(theirs)} complete, "
        f"{at_optimum} at 0.00 %; success about {100 * SUCCESS_RATE:.0f} %"
    ]


def _format_interval(estimate: Estimate, text: Callable[[float], str]) -> str:
    if estimate.low is None or estimate.high is None:
        return text(estimate.value)
    return f"{text(estimate.value)} (95 %: {text(estimate.low)} to {text(estimate.high)})"


def _format_share(fraction: float) -> str:
    return f"{100 * fraction:.1f} %"


def _format_score(score: float) -> str:
    return f"{score:.3f}"


def _format_rate(tally: Tally) -> str:
    return "-" if tally.rate is None else _format_share(tally.rate)


def tabulate_family(learned: RelationalContent, folder: str) -> Table:
    """Return the training boards of a policy and its trial on other boards."""
    columns = [
        Column("boards", right=True),
        Column("states", right=True),
        Column("updates", right=True),
        Column("tried", right=True),
        Column("completed", right=True),
        Column("median deviation", right=True),
        Column("greatest", right=True),
        Column("time [s]", right=True),
    ]
    trace, trial = learned.trace, learned.trial
    row = [str(learned.boards), *(str(trace.get(key, "")) for key in ("states", "updates"))]
    if trial is None:
        row += ["-", "-", "-", "-"]
    else:
        deviations = (trial.median_deviation, trial.greatest_deviation)
        row += [str(trial.boards), str(trial.completed), *map(format_percent, deviations)]
    notes = [f"written to {folder}; on any task: skillplan evaluate {folder} --task FILE"]
    if trial is None:
        notes.insert(0, "interrupted: it has learned as far as the figures say, and was not tried")
    else:
        notes.insert(
            0,
            f"tried      on {trial.boards} boards of the family that it has not learned on; "
            f"deviations from the proved optimum of {trial.proved}",
        )
    row.append(f"{learned.wall_s:.1f}")
    return Table(f"{learned.family}: {learned.solver}", columns, [row], notes)


_ABSENT = "-"


def tabulate_methods(comparison: MethodComparison) -> Table:
    """Return the scores of methods, their profile, and probabilities of improvement."""
    others = comparison.methods
    columns = [
        Column("method"),
        Column("tasks", right=True),
        Column("runs", right=True),
        Column("score", right=True),
        *(Column(f"> {tau:g}", right=True) for tau in _TAUS),
        *(Column(f"P(> {other.name})", right=True) for other in others[1:]),
    ]
    known = {(first, second): estimate for first, second, estimate in comparison.improvements}
    rows = [
        [
            method.name,
            str(len(set(method.tasks))),
            str(method.runs),
            _format_figure(method.score_iqm, _format_score)
            + (" deterministic" if method.deterministic else ""),
            *(_format_whole(value) for value in method.profile(_TAUS).shares),
            *(_format_figure(known.get((method, other)), _format_score) for other in others[1:]),
        ]
        for method in others
    ]
    notes = [
        "score      optimum / cost of a run's policy, 0 if it does not complete: interquartile "
        "mean of all runs",
        "profile    > tau: share of the runs that score above tau",
        "P(> B)     probability that a run scores above one of B, ties half; each pair stands once",
        "intervals  95 %, stratified bootstrap over the runs of each task; Agarwal et al. (2021)",
    ]
    apart = [
        f"{first.name} and {second.name}"
        for place, first in enumerate(others)
        for second in others[place + 1 :]
        if (first, second) not in known
    ]
    if apart:
        notes.insert(3, f"no P       of methods whose tasks differ: {_list_names(apart)}")
    return Table("methods compared by the scores of their runs", columns, rows, notes)


# Scores whose profile stands in a table.
_TAUS = (0.0, 0.9, 0.95, 0.99, 0.999)


def tabulate_trainings(results: Sequence[TrainingResult]) -> Table:
    """Return a row for every training, at least one."""
    columns = [
        Column("runs in"),
        Column("task"),
        Column("solver"),
        Column("seeds"),
        Column("runs", right=True),
        Column("steps", right=True),
        Column("complete", right=True),
        Column("of all, 95 %", right=True),
        Column("optimal", right=True),
        Column("deviation", right=True),
        Column("cost", right=True),
        Column("success", right=True),
        Column("best seen", right=True),
    ]
    title = f"{len(results)} trainings side by side"
    notes = [
        "deviation and cost are interquartile means of the runs that complete, success of all, "
        "with 95 % intervals of the bootstrap; the share that completes has Wilson's"
    ]
    planned = [result.run_dir for result in results if result.planned]
    if planned:
        notes.append(f"{', '.join(planned)}: a deterministic planner, whose seeds are no samples")
    notes += [
        f"{result.run_dir}: success by {_describe_rule(result.sampling.rule)}"
        for result in results
        if result.sampling is not None
    ]
    notes += [f"{result.run_dir}: interrupted" for result in results if result.interrupted]
    return Table(title, columns, [_make_training_row(result) for result in results], notes)


def _make_training_row(result: TrainingResult) -> list[str]:
    optimal, decimals = result.at_most(0.0), result.task.metric.decimals
    return [
        result.run_dir,
        result.task.name,
        result.learner,
        _format_seeds([outcome.seed for outcome in result.outcomes]),
        str(len(result.outcomes)),
        f"{result.steps:,}",
        str(result.completed),
        _format_figure(result.completion, _format_whole),
        _ABSENT if optimal is None else str(optimal),
        _format_figure(result.deviation_iqm, format_percent),
        _format_figure(result.cost_iqm, lambda cost: format_number(cost, decimals)),
        _format_figure(result.success_iqm, format_percent),
        format_number(result.best_seen, decimals),
    ]


def _format_figure(estimate: Estimate | None, text: Callable[[float], str]) -> str:
    if estimate is None:
        return _ABSENT
    if estimate.low is None or estimate.high is None:
        return text(estimate.value)
    return f"{text(estimate.value)} [{text(estimate.low)}, {text(estimate.high)}]"


def _format_whole(fraction: float) -> str:
    return f"{100 * fraction:.0f} %"


def _format_seeds(seeds: Sequence[int]) -> str:
    """Return the seeds, consecutive ones as a range."""
    ranges: list[list[int]] = []
    for seed in sorted(seeds):
        if ranges and seed == ranges[-1][1] + 1:
            ranges[-1][1] = seed
        else:
            ranges.append([seed, seed])
    return ", ".join(f"{a}" if a == b else f"{a}-{b}" for a, b in ranges) or _ABSENT
