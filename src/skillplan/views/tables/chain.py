"""Results of chains as tables: one solver task by task, and several solvers side by side."""

from __future__ import annotations

from collections.abc import Sequence

from skillplan.records.chain_result import ChainPart, ChainResult
from skillplan.records.result import Result, Status
from skillplan.solvers.solution import relative_gap
from skillplan.views.tables.installation import tabulate_listing
from skillplan.views.tables.results import PROOF, describe_provers, describe_unchecked, join_lines
from skillplan.views.text.table import Column, Table
from skillplan.views.text.wording import format_number, format_percent


def tabulate_chain(result: ChainResult) -> list[Table]:
    """Return the tables of the domain, then a row for every task, with the sum below."""
    columns = (
        Column("task"),
        Column("from"),
        Column("to"),
        Column("way", below=True, short="path"),
        Column("cost", right=True),
        Column("optimum", right=True),
        Column("time [s]", right=True),
        Column("solver"),
        Column("iterations", right=True),
        Column("seconds", right=True),
    )
    rows = [_make_row(part) for part in result.parts]
    notes = [f"status     {PROOF[result.status]}{_describe_reason(result)}"]
    notes += [*describe_provers(result), *describe_unchecked(result.not_checked)]
    if result.cost is not None:
        main = result.main[0].task
        notes += [
            f"cost       {main.cost_text(result.cost)}  ({_describe_bound(result)}), "
            f"stage {result.stage}",
            *_describe_makespan(result),
        ]
        reused = sum(part.reused for part in result.parts)
        if reused:
            notes.append(f"stored     {reused} tasks answered by a policy learned before")
    if result.replans:
        notes.append(f"replanned  {result.replans} times, with heads closer together")
    notes.append(f"effort     {result.wall_s:.2f} s")
    title = f"{result.name}: {result.solver}, physics {result.parts[-1].result.physics}, collision "
    title += result.parts[-1].result.collision or "none"
    listings = [tabulate_listing(listing) for listing in result.account.listings]
    return [*listings, Table(title, columns, rows, notes)]


def _describe_makespan(result: ChainResult) -> list[str]:
    """Return the length of the plan: in steps of one robot, or in parallel steps of several."""
    time_s = f"{format_number(result.makespan_s, 1)} s"
    steps, bound = result.account.parallel_steps, result.account.parallel_bound
    if steps is None:
        if result.cost_unit == "steps":
            return [f"makespan   {result.makespan} steps, {time_s}"]
        return [f"plan       {result.makespan} skills, {time_s}"]
    proof = (
        ""
        if bound is None
        else f"  (lower bound {bound}, gap {format_percent(relative_gap(steps, bound))}"
    )
    proof += ", proved to be the least)" if steps == bound else ")" if proof else ""
    return [
        f"plan       {result.makespan} skills",
        f"makespan   {steps} parallel steps, {time_s}{proof}",
    ]


def _describe_bound(result: ChainResult) -> str:
    """Return the proved bound on a chain's cost."""
    main = result.main[0].task
    if result.lower_bound is None and result.bound_given is not None:
        return f"given the stages before at least {main.cost_text(result.bound_given)}"
    return f"lower bound {main.cost_text(result.lower_bound)}, gap {format_percent(result.gap)}"


def _describe_reason(result: ChainResult) -> str:
    """Return the prover, if it is not the solver itself, and the reason of the result."""
    own = all(
        part.result.status is Status.OPTIMAL
        for part in result.parts
        if part.task.preset is None and not part.reused
    )
    by = "" if own or result.status is not Status.OPTIMAL else " by the exact search beside it"
    return by + (f" ({join_lines(result.reason)})" if result.reason else "")


def tabulate_appendix(result: ChainResult) -> dict[str, Table]:
    """Return the domain's tables that are saved but not shown, by file name."""
    return {name: tabulate_listing(listing) for name, listing in result.account.appendix.items()}


def _make_row(part: ChainPart) -> tuple[str, ...]:
    result, decimals = part.result, part.task.metric.decimals
    start, goal = part.ends
    return (
        part.task.name,
        start or "-",
        goal or "-",
        _describe_path(part),
        format_number(result.cost, decimals),
        format_number(part.optimum, decimals),
        format_number(result.makespan_s, 1),
        f"{result.solver}, stored" if part.reused else result.solver,
        "-" if result.expanded is None else str(result.expanded),
        f"{result.wall_s:.3f}",
    )


def _describe_path(part: ChainPart) -> str:
    """Return the places and, if their names are short, the skills between them."""
    skills = [step.skill for step in part.result.steps]
    if not part.path:
        more = [f"and {len(skills) - _MOST} more"] if len(skills) > _MOST else []
        return " ".join([*skills[:_MOST], *more]) or "-"
    if len(part.path) != len(skills) + 1 or any(len(skill) > _SHORT for skill in skills):
        return " ".join(part.path)
    first, *rest = part.path
    return " ".join(
        [first, *(f"{skill} {place}" for skill, place in zip(skills, rest, strict=True))]
    )


# Longest name of a skill that is shown between places.
_SHORT = 6
# Number of shown skills of a sequence without places; JSON and CSV have all.
_MOST = 12


def tabulate_chain_comparison(results: Sequence[ChainResult], title: str) -> list[Table]:
    """Return the solvers' sums, and their sequences side by side as in the paper's Table 3."""
    unit = next((result.cost_unit for result in results if result.cost is not None), "")
    summary = Table(
        title,
        (
            Column("solver"),
            Column("status"),
            Column(f"cost [{unit}]" if unit else "cost", right=True),
            Column("gap", right=True),
            Column("makespan", right=True),
            Column("makespan [s]", right=True),
            Column("iterations", right=True),
            Column("seconds", right=True),
        ),
        [
            (
                result.solver,
                result.status.value,
                _format_cost(result),
                format_percent(result.gap),
                _format_steps(result),
                format_number(result.makespan_s, 1),
                "-" if result.iterations is None else str(result.iterations),
                f"{result.wall_s:.3f}",
            )
            for result in results
        ],
        [
            *(
                f"{result.solver}: {join_lines(result.reason)}"
                for result in results
                if result.reason
            ),
            *_note_incomparable(results),
            *(
                f"{result.solver}: replanned {result.replans} times, with heads closer together"
                for result in results
                if result.replans
            ),
        ],
    )
    return [summary, *_compare_sequences([result for result in results if result.complete])]


def _note_incomparable(results: Sequence[ChainResult]) -> list[str]:
    """Return a note if costs rest on different plans of earlier stages."""
    upper = {
        tuple(
            tuple(step.skill for step in part.result.steps)
            for part in result.parts
            if part.task.stage != result.stage and part.task.preset is None
        )
        for result in results
        if result.complete
    }
    if len(upper) < 2:
        return []
    return ["the solvers planned the stages before differently: costs do not compare"]


def _is_single(result: ChainResult) -> bool:
    """Return whether the chain is of one robot, whose makespan is its number of steps."""
    return result.account.parallel_steps is None


def _format_steps(result: ChainResult) -> str:
    """Return the makespan in steps, which several robots take in parallel."""
    parallel = result.account.parallel_steps
    steps = result.makespan if parallel is None else parallel
    return "-" if steps is None else str(steps)


def _format_cost(result: ChainResult) -> str:
    return format_number(result.cost, result.parts[-1].task.metric.decimals)


def _compare_sequences(results: Sequence[ChainResult]) -> list[Table]:
    """Return tables of solvers whose sequences lead from and to the same places."""
    alike: dict[tuple[tuple[str | None, str | None], ...], list[ChainResult]] = {}
    for result in results:
        alike.setdefault(tuple(part.ends for part in result.main), []).append(result)
    return [_tabulate_sequences(group) for group in alike.values()]


def _tabulate_sequences(results: Sequence[ChainResult]) -> Table:
    """Return makespan, time and iterations of every sequence for every solver."""
    columns = [Column("sequence"), Column("from"), Column("to")]
    columns += [
        Column(f"{result.solver} {'makespan' if _is_single(result) else 'skills'}", right=True)
        for result in results
    ]
    columns += [Column(f"{result.solver} [s]", right=True) for result in results]
    columns += [Column(f"{result.solver} iterations", right=True) for result in results]
    rows = []
    for index, part in enumerate(results[0].main):
        start, goal = part.ends
        parts = [result.main[index].result for result in results]
        rows.append(
            (
                part.task.name,
                start or "-",
                goal or "-",
                *(_format_figure(result, "makespan") for result in parts),
                *(_format_figure(result, "wall_s") for result in parts),
                *(_format_figure(result, "expanded") for result in parts),
            )
        )
    return Table(f"{results[0].name}: sequence by sequence", columns, rows)


def _format_figure(result: Result, name: str) -> str:
    value = getattr(result, name)
    if value is None:
        return "-"
    return f"{value:.4f}" if isinstance(value, float) else str(value)
