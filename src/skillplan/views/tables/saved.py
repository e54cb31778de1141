"""The tables that are saved beside a result, as text by the name of the file."""

from __future__ import annotations

from skillplan.records.chain_result import ChainResult
from skillplan.records.result import Result
from skillplan.records.stored.result_folder import PLAN
from skillplan.task.task import Task
from skillplan.views.tables.solved import saved_tables, solved_tables
from skillplan.views.text.table import as_csv


def csv_files(result: Result | ChainResult, task: Task) -> dict[str, str]:
    """Return what is saved beside a result as CSV: its plan, and what the domain has to show.

    Parameters
    ----------
    result
        Of a task or a chain.
    task
        The single task; of a chain any.
    """
    tables = {PLAN: solved_tables(result, task)[-1], **saved_tables(result)}
    return {name: as_csv(table) for name, table in tables.items()}
