"""The tables of what was solved, whether a single task or a chain of several."""

from __future__ import annotations

from collections.abc import Sequence

from skillplan.records.chain_result import ChainResult
from skillplan.records.result import Result
from skillplan.task.task import Task
from skillplan.views.tables.chain import appendix_tables, chain_comparison_tables, chain_tables
from skillplan.views.tables.results import comparison_table, plan_table
from skillplan.views.text.table import Table


def solved_tables(result: Result | ChainResult, task: Task) -> list[Table]:
    """Return the plan, or what the domain has to show of a chain and a row for every task.

    Parameters
    ----------
    result
        Of a task or a chain.
    task
        The single task; of a chain any.
    """
    if isinstance(result, ChainResult):
        return chain_tables(result)
    return [plan_table(result, task)]


def saved_tables(result: Result | ChainResult) -> dict[str, Table]:
    """Return the tables that are saved beside and not shown, by the name of the file."""
    return appendix_tables(result) if isinstance(result, ChainResult) else {}


def comparison_tables(
    results: Sequence[Result] | Sequence[ChainResult], title: str, decimals: int
) -> list[Table]:
    """Return several solvers side by side.

    Parameters
    ----------
    results
        All of tasks, or all of chains.
    title
        What stands above.
    decimals
        Of the costs of a single task.
    """
    chains = [result for result in results if isinstance(result, ChainResult)]
    if chains:
        return chain_comparison_tables(chains, title)
    single = [result for result in results if isinstance(result, Result)]
    return [comparison_table(single, title, decimals)]
