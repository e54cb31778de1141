"""The tables of what was solved, whether a single task or a chain of several."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from skillplan.records.result import Result
from skillplan.task.task import Task
from skillplan.views.tables.results import comparison_table, plan_table
from skillplan.views.text.table import Table

if TYPE_CHECKING:  # most results are of a single task
    from skillplan.records.chain_result import ChainResult


def solved_tables(result: Result | ChainResult, task: Task) -> list[Table]:
    """Return the plan, or what the domain has to show of a chain and a row for every task.

    Parameters
    ----------
    result
        Of a task or a chain.
    task
        The single task; of a chain any.
    """
    if isinstance(result, Result):
        return [plan_table(result, task)]
    from skillplan.views.tables.chain import chain_tables

    return chain_tables(result)


def saved_tables(result: Result | ChainResult) -> dict[str, Table]:
    """Return the tables that are saved beside and not shown, by the name of the file."""
    if isinstance(result, Result):
        return {}
    from skillplan.views.tables.chain import appendix_tables

    return appendix_tables(result)


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
    single = [result for result in results if isinstance(result, Result)]
    chains = [result for result in results if not isinstance(result, Result)]
    if not chains:
        return [comparison_table(single, title, decimals)]
    from skillplan.views.tables.chain import chain_comparison_tables

    return chain_comparison_tables(chains, title)
