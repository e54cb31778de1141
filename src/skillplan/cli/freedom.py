"""``explain TASK 'free(PART)'``: what is in the way of a part of a product from CAD."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from skillplan.cli.output import emit
from skillplan.errors import OptionError, exit_code
from skillplan.files.output_path import output_path
from skillplan.records.freedom import Freedom, freedom
from skillplan.records.stored.product_relation import relation_beside
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task
from skillplan.views.tables.questions import freedom_tables

_ASKED = re.compile(r"free\((.*)\)")
_PICTURES = (".png", ".svg")


def asked_part(skill: str) -> str | None:
    """Return the part of ``free(PART)``, or None of any other skill."""
    found = _ASKED.fullmatch(skill.strip())
    return found.group(1).strip() if found else None


def tell_freedom(
    task: Task,
    task_file: str,
    part: str,
    before: Sequence[Skill] | None,
    picture: str | None,
    style: str,
) -> int:
    """Print in which directions a part is free, and draw it; return the exit code.

    Parameters
    ----------
    task, task_file
        Of a product from CAD.
    part
        Its name in the task.
    before
        The sequence after which parts are in place; None for the whole product.
    picture
        The file to draw into, .png or .svg; None for no picture.
    style
        Of the output.

    Raises
    ------
    OptionError
        If the task is not from CAD, there is no such part, or the file cannot be written.
    """
    path = None if picture is None else output_path("--picture", picture, _PICTURES, "pictures")
    relation = relation_beside(Path(task_file))
    state = None if before is None else _state_after(task, before)
    found = freedom(task, relation, part, state)
    if path is not None:
        _draw(found, path)
        found = found.drawn({"picture": str(path)})
    emit(style, found.document(), freedom_tables(found), failed=not found.free)
    return exit_code(solved=found.free)


def _state_after(task: Task, before: Sequence[Skill]) -> State:
    """Return what skills lead to as predicted; no back end is asked about them."""
    state = task.initial
    for number, skill in enumerate(before, 1):
        if not skill.applicable(state):
            missing = ", ".join(skill.condition(state).why_not(state))
            raise OptionError(f"Step {number} of the sequence, {skill.name}, fails: {missing}.")
        state = skill.prediction_in(state).apply(state)
    return state


def _draw(found: Freedom, path: Path) -> None:
    # matplotlib takes half a second.
    from skillplan.views.figures.figure_file import save_figure
    from skillplan.views.figures.figure_style import Heading
    from skillplan.views.figures.freedom_figure import freedom_picture

    try:
        picture = freedom_picture(found, found.task.scene.at(found.task.goal.requires))
    except ValueError as error:
        raise OptionError(f"--picture: {error}") from None
    save_figure(picture.with_heading(Heading(picture.title)), path)
