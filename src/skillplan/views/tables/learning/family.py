"""A policy that was learned on a family of boards as a table."""

from __future__ import annotations

from skillplan.records.training.relational_file import RelationalContent
from skillplan.views.text.table import Column, Table
from skillplan.views.text.wording import percent


def family_table(learned: RelationalContent, folder: str) -> Table:
    """Return what was learned on, and what came of it on boards that were not.

    Parameters
    ----------
    learned
        The policy's document.
    folder
        Where it lies.
    """
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
        row += [str(trial.boards), str(trial.completed), *map(percent, deviations)]
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
