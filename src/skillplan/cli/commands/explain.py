"""``skillplan explain``."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Annotated

import typer

from skillplan.cli.load import load_part, load_result, open_cache
from skillplan.cli.options import shared
from skillplan.cli.options.completion import skills, task_files
from skillplan.cli.options.shared import RESULT_HELP
from skillplan.cli.options.values import count_option, option
from skillplan.errors import OptionError

if TYPE_CHECKING:  # --help pays for no imports
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from skillplan.pipeline.restoration import LoadedResult
    from skillplan.records.questions import Freedom
    from skillplan.task.pose import Pose
    from skillplan.task.skill import Skill
    from skillplan.task.state import State
    from skillplan.task.task import Task

_FREE = re.compile(r"free\((.*)\)")
_PICTURES = (".png", ".svg")


def command(
    task: Annotated[
        str,
        typer.Argument(
            metavar="TASK",
            autocompletion=task_files,
            help="A task file: YAML, or TSPLIB's .sop; or a relation.json of import-cad.",
            show_default=False,
        ),
    ],
    skill: Annotated[
        str,
        typer.Argument(
            metavar="SKILL",
            autocompletion=skills,
            help="Name or action number of a skill; or, for a product from CAD, 'free(PART)' to "
            "list the parts that block PART.",
            show_default=False,
        ),
    ],
    back_ends: shared.BackEnds,
    reading: shared.PartReading,
    caching: shared.Caching,
    after: Annotated[
        str | None,
        option(
            "--after 0,1,...",
            shared.TASK,
            "Sequence before the state, or @FILE with one. Default: the initial state.",
        ),
    ] = None,
    result: Annotated[
        str | None,
        option(
            "--from RESULT",
            shared.TASK,
            f"Take the sequence from a result of TASK, {RESULT_HELP}. Uses the changes and "
            "back ends stored in it unless options override them.",
        ),
    ] = None,
    step: Annotated[
        int | None,
        count_option(
            "--step",
            minimum=1,
            maximum=1_000_000,
            text="With --from: the state in which step N of its plan begins; default: the end.",
            rich_help_panel=shared.TASK,
        ),
    ] = None,
    last: Annotated[
        bool,
        option(
            "--last",
            shared.TASK,
            "Explain SKILL after all other parts and screws are at their goals. No sequence "
            "need lead there.",
        ),
    ] = False,
    picture: Annotated[
        str | None,
        option(
            "--picture FILE",
            shared.OUTPUT,
            "Draw the moment of failure, or the end, as .png if the physics moves bodies, or "
            "else the hulls that a detector such as swept compares. An existing file is "
            "replaced.",
        ),
    ] = None,
    animate: Annotated[
        str | None,
        option(
            "--animate FILE",
            shared.OUTPUT,
            "Film the whole skill as .gif. An existing file is replaced.",
        ),
    ] = None,
    style: shared.Style = "table",
) -> int:
    """Explain why SKILL, a name or action number, is feasible or not in a state of TASK.

    Shows the verdict of every stage with the facts it rests on and its measurements. For a task
    from import-cad, 'free(PART)' shows the directions in which a part can be moved away from the
    whole product, or from the parts in place after --after or --from, and the parts that block the
    other directions. A relation.json of import-cad needs no task: all parts are in place, and names
    and directions are those of the CAD file.
    """
    from pathlib import Path

    from skillplan.chart.hypothetical_state import find_state_with_all_else
    from skillplan.cli.output import emit
    from skillplan.cli.showing import draw, illustrator, resolve_drawing_paths
    from skillplan.errors import exit_code
    from skillplan.pipeline.exchange import read_given_plan
    from skillplan.pipeline.solving import make_model
    from skillplan.records.questions import explain, find_state_after
    from skillplan.records.stored.product_relation import is_relation
    from skillplan.views.tables.questions import tabulate_explanation

    if last and (after is not None or result is not None):
        raise OptionError("Give --last alone: --after and --from name another state.")
    part = _FREE.fullmatch(skill.strip())
    if is_relation(Path(task)):
        _refuse_options_of_tasks(
            task,
            {"--after": after, "--from": result, "--step": step, "--last": last or None}
            | {"--picture": picture, "--animate": animate},
        )
        if part is None:
            raise OptionError(f"{task}: is a relation, which has no skills: ask 'free(PART)'.")
        return _explain_freedom(None, task, part.group(1).strip(), None, None, style)
    if result is None:
        if step is not None:
            raise OptionError("--step counts the steps of a result: name it by --from RESULT.")
        loaded, setup, constructed = load_part(task, reading, back_ends)
        before = () if after is None else read_given_plan(after, loaded)
    else:
        if after is not None:
            raise OptionError("Give either --after or --from: both say what was done before.")
        stored = load_result(result, reading, back_ends, task_file=task)
        setup = stored.setup
        loaded, before = _until(stored, step)
        constructed = setup.back_ends(loaded, stored.problem.spare_back_ends)
    if part is not None:
        assembled = after is None and result is None
        name, done = part.group(1).strip(), None if assembled else before
        return _explain_freedom(loaded, task, name, done, picture, style)
    chosen = loaded.skill(skill)
    paths = resolve_drawing_paths(picture, animate)
    cache = open_cache(caching)
    model = make_model(loaded, setup, cache, back_ends=constructed)
    drawer = illustrator(model.feasibility.back_ends, paths) if paths else None
    state = find_state_with_all_else(loaded, chosen) if last else find_state_after(model, before)
    explanation = explain(model, chosen, state)
    if drawer is not None:
        taken = model.feasibility.taken(chosen, explanation.state)
        explanation = explanation.drawn(draw(drawer, taken, explanation.state, paths))
    failed = not explanation.feasible
    emit(style, explanation.document(), tabulate_explanation(explanation), failed=failed)
    return exit_code(solved=explanation.feasible)


def _refuse_options_of_tasks(file: str, options: Mapping[str, object]) -> None:
    for flag, value in options.items():
        if value is not None:
            raise OptionError(
                f"{flag} needs a task, and {file} is the relation of a product. Name its "
                "product.yaml instead."
            )


def _until(stored: LoadedResult, step: int | None) -> tuple[Task, tuple[Skill, ...]]:
    """Return the task of a result, and the steps of its plan before one step, or all."""
    task, plan = stored.planned()
    if step is not None and step > len(plan) + 1:
        raise OptionError(f"--step {step}: the plan of {stored.path} has {len(plan)} steps.")
    before = plan if step is None else plan[: step - 1]
    return task, tuple(task.skill(name) for name in before)


def _explain_freedom(
    task: Task | None,
    file: str,
    part: str,
    before: Sequence[Skill] | None,
    picture: str | None,
    style: str,
) -> int:
    """Print and draw the directions in which a part of a CAD product is free.

    Parameters
    ----------
    task
        A task that import-cad wrote; None for a relation without one.
    file
        File of the task, or of the relation.
    part
        Name of the part.
    before
        The sequence after which parts are in place; None for the whole product.
    picture
        The .png or .svg file to draw; None for none.
    style
        Output format.

    Raises
    ------
    OptionError
        If the task is not from CAD, there is no such part, or the file cannot be written.
    """
    from pathlib import Path

    from skillplan.cli.output import emit
    from skillplan.errors import exit_code
    from skillplan.files.output_path import check_output_path
    from skillplan.records.questions import find_freedom
    from skillplan.records.stored.product_relation import read_relation, read_relation_beside
    from skillplan.views.tables.questions import tabulate_freedom

    path = (
        None if picture is None else check_output_path("--picture", picture, _PICTURES, "pictures")
    )
    relation = read_relation(Path(file)) if task is None else read_relation_beside(Path(file))
    state = None if task is None or before is None else _predict_state(task, before)
    directions = find_freedom(task, relation, part, state)
    if path is not None and task is not None:
        _draw_freedom(directions, task.scene.at(task.goal.requires), path)
        directions = directions.drawn({"picture": str(path)})
    emit(style, directions.document(), tabulate_freedom(directions), failed=not directions.free)
    return exit_code(solved=directions.free)


def _predict_state(task: Task, before: Sequence[Skill]) -> State:
    """Return the predicted state after some skills; no back end is queried."""
    state = task.initial
    for number, skill in enumerate(before, 1):
        if not skill.applicable(state):
            missing = ", ".join(skill.condition(state).why_not(state))
            raise OptionError(f"Step {number} of the sequence, {skill.name}, fails: {missing}.")
        state = skill.prediction_in(state).apply(state)
    return state


def _draw_freedom(directions: Freedom, goals: dict[str, Pose], path: Path) -> None:
    # matplotlib takes half a second.
    from skillplan.views.figures.exploded_figure import draw_freedom
    from skillplan.views.figures.figure_file import save_figure
    from skillplan.views.figures.figure_style import Heading

    try:
        figure = draw_freedom(directions, goals)
    except ValueError as error:
        raise OptionError(f"--picture: {error}") from None
    save_figure(figure.with_heading(Heading(figure.title)), path)
