"""Tables of the benchmark: agents with intervals, instances with proofs, noise floors, refusals."""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace

from skillplan.benchmark.instances import Instance
from skillplan.benchmark.proving import measure_gap
from skillplan.benchmark.submission import Refusal, Row, Submission
from skillplan.records.interval import Estimate, interquartile_mean, share, t_quantile
from skillplan.records.result import Status
from skillplan.views.text.table import Column, Table

# Numbers of runs for which the smallest meaningful difference is shown.
_RUNS = (3, 5, 10)
_POWER = 0.8
_NUMBERS = "tasks", "solved [%]", "proved [%]", "optimal [%]", "gap [%]", "time [s]"


def tabulate_agents(submission: Submission, instances: Mapping[str, Instance]) -> list[Table]:
    """Return a table of the agents that ran on all instances, and one of the learning tasks.

    Parameters
    ----------
    submission
        The results.
    instances
        All instances by name.
    """
    rows = [row for row in submission.rows if row.instance in instances]
    learning = {row.instance for row in rows if instances[row.instance].learning}
    listed = dict.fromkeys([*submission.agents, *(row.agent for row in rows)])
    agents = [agent for agent in listed if any(row.agent == agent for row in rows)]
    # Learners run on learning tasks only, unless all are requested.
    wide = [
        agent
        for agent in agents
        if any(row.agent == agent and row.instance not in learning for row in rows)
    ]
    limits = f"{submission.search_limit_s:g} s for a search, {submission.learning_limit_s:g} s "
    limits += "for a learner"
    tables = []
    if wide or not agents:
        names = {row.instance for row in rows}
        tables.append(_tabulate(f"all instances, {limits}", rows, instances, wide, names))
    if wide != agents:
        tables.append(_tabulate(f"learning tasks, {limits}", rows, instances, agents, learning))
    notes = [*_list_notes(rows), f"machine  {submission.machine}; {submission.jobs} at once"]
    tables[-1] = replace(tables[-1], notes=notes)
    return tables


def tabulate_rows(submission: Submission, instances: Mapping[str, Instance]) -> Table:
    """Return a row for every run."""
    headings = "agent", "instance", "seed", "status", "cost", "bound", "optimum", "wall [s]"
    rows = [
        [
            row.agent,
            row.instance,
            str(row.seed),
            str(row.status),
            "" if row.cost is None else repr(row.cost),
            "" if row.lower_bound is None else repr(row.lower_bound),
            str(instances[row.instance].optimum) if row.instance in instances else "",
            f"{row.wall_s:g}",
        ]
        for row in submission.rows
    ]
    return Table("runs", [Column(heading) for heading in headings], rows)


def _tabulate(
    title: str,
    rows: Sequence[Row],
    instances: Mapping[str, Instance],
    agents: Sequence[str],
    names: Collection[str],
) -> Table:
    columns = [Column("agent"), *(Column(heading, right=True) for heading in _NUMBERS)]
    cells = []
    for agent in agents:
        own = [row for row in rows if row.agent == agent and row.instance in names]
        if own:
            cells.append([agent, *_list_cells(own, instances)])
    return Table(title, columns, cells)


def _list_cells(rows: Sequence[Row], instances: Mapping[str, Instance]) -> list[str]:
    """Return the figures of one agent; seeds of an instance are averaged first."""

    def average(measure: Callable[[Row], float]) -> list[float]:
        by_instance: dict[str, list[float]] = {}
        for row in rows:
            by_instance.setdefault(row.instance, []).append(measure(row))
        return [statistics.fmean(values) for values in by_instance.values()]

    def gap(row: Row) -> float:
        return measure_gap(row.cost, instances[row.instance].optimum)

    def solved(row: Row) -> bool:
        return row.is_solved or row.status is Status.INFEASIBLE

    shares = (
        average(lambda row: float(solved(row))),
        average(lambda row: float(row.is_proved and solved(row))),
        average(lambda row: float(row.is_solved and gap(row) == 0)),
    )
    return [
        str(len(shares[0])),
        *(_format(share(math.fsum(values), len(values)), 100, 0) for values in shares),
        _format(interquartile_mean(average(gap)), 100, 2),
        _format(interquartile_mean(average(lambda row: row.wall_s)), 1, 2),
    ]


def _format(estimate: Estimate | None, factor: float, decimals: int) -> str:
    if estimate is None:
        return "-"
    text = f"{factor * estimate.value:.{decimals}f}"
    if estimate.low is not None and estimate.high is not None:
        low, high = factor * estimate.low, factor * estimate.high
        text += f" ({low:.{decimals}f}-{high:.{decimals}f})"
    return text


def _list_notes(rows: Sequence[Row]) -> list[str]:
    notes = [
        "(a-b): 95 % intervals over instances: Wilson's of shares, bootstrapped of interquartile "
        "means. Seeds of an instance are averaged first.",
        "gap: 1 - optimum / cost; 100 % without a plan. proved: cost and own bound agree. optimal: "
        "the cost is the proved optimum.",
    ]
    for status in (Status.REFUSED, Status.FAILED, Status.WRONG):
        for agent in dict.fromkeys(row.agent for row in rows):
            own = [row for row in rows if row.agent == agent and row.status is status]
            if own:
                notes.append(f"{status}  {agent} on {len(own)}: {own[0].instance}: {own[0].reason}")
    return notes


def tabulate_instances(instances: Sequence[Instance]) -> Table:
    """Return the instances with their optima and the codes that proved them."""
    columns = [
        Column("suite"),
        Column("instance"),
        Column("status"),
        Column("optimum", right=True),
        Column("unit"),
        Column("proved by"),
        Column("learning"),
    ]
    rows = [
        [
            each.suite,
            each.name,
            each.status,
            "-" if each.optimum is None else f"{each.optimum:.6g}",
            each.unit,
            each.proof_text,
            "yes" if each.learning else "",
        ]
        for each in instances
    ]
    twice = sum(len(each.proofs) == 2 for each in instances)
    once = sum(len(each.proofs) == 1 for each in instances)
    note = f"{len(rows)} instances: {twice} proved by two codes, {once} by one"
    return Table("benchmark", columns, rows, [note])


def tabulate_noise(instances: Sequence[Instance]) -> Table | None:
    """Return the noise floors of learning tasks; None without any."""
    columns = [
        Column("instance"),
        Column("agent"),
        Column("runs", right=True),
        Column("solved", right=True),
        Column("gap", right=True),
        Column("sd", right=True),
        *(Column(f"{count} runs", right=True) for count in _RUNS),
    ]
    rows = [
        [
            each.name,
            spread.agent,
            str(spread.runs),
            f"{100 * spread.solved:.0f} %",
            f"{100 * spread.gap:.2f} %",
            f"{100 * spread.gap_sd:.2f}",
            *(_format_difference(spread.gap_sd, count) for count in _RUNS),
        ]
        for each in instances
        for spread in each.noise
    ]
    notes = [
        "sd: standard deviation of the gap over seeds [percentage points]. N runs: smallest "
        "difference of two mean gaps of N runs each that a t test at 5 % finds, power 80 %; "
        "- if all seeds end alike."
    ]
    return Table("noise floor of learning tasks", columns, rows, notes) if rows else None


def _format_difference(sd: float, runs: int) -> str:
    if not sd:
        return "-"
    points = 100 * smallest_difference(sd, runs)
    return f"{points:.2f}" if points < 100 else ">100"


def smallest_difference(sd: float, runs: int) -> float:
    """Return the smallest difference of two means that a two-sided t test at 5 % finds.

    Parameters
    ----------
    sd
        Standard deviation of one run.
    runs
        Number of runs on each side, >= 2.

    Returns
    -------
    float
        The difference that is found with a power of 80 %, from the noncentral t distribution.
    """
    from scipy.special import nctdtrinc

    # The other tail has a probability below 1e-5.
    shift = nctdtrinc(2 * runs - 2, 1 - _POWER, t_quantile(2 * runs - 2))
    return float(shift * sd * math.sqrt(2 / runs))


def tabulate_check(
    tables: Sequence[Table], refusals: Sequence[Refusal], held: Sequence[Row], notes: Sequence[str]
) -> list[Table]:
    """Return the tables of agents with the outcome of a check, and refused rows if there are any.

    Parameters
    ----------
    tables
        Tables of the agents, at least one.
    refusals
        Rows that the referee refuses.
    held
        The other rows.
    notes
        Notes on the header.
    """
    columns = [Column("agent"), Column("instance"), Column("seed", right=True), Column("reason")]
    rows = [[r.row.agent, r.row.instance, str(r.row.seed), r.reason] for r in refusals]
    plans = sum(row.is_solved for row in held)
    outcome = (
        f"{len(held)} of {len(held) + len(refusals)} rows hold. Plans and policies executed "
        f"again: {plans}; rows without: {len(held) - plans}"
    )
    if not held and not refusals:
        outcome = "no rows: nothing to check"
    notes = [*notes, outcome]
    if refusals:
        return [*tables, Table("refused rows", columns, rows, notes)]
    return [*tables[:-1], replace(tables[-1], notes=[*tables[-1].notes, *notes])]
