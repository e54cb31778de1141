"""``skillplan explain``."""

from __future__ import annotations

from typing import Annotated

import typer

from skillplan.cli.completion import skills
from skillplan.cli.options import (
    OUTPUT,
    TASK,
    BackEnds,
    Caching,
    PartReading,
    Style,
    TaskFile,
)


def command(
    task: TaskFile,
    skill: Annotated[
        str,
        typer.Argument(
            metavar="SKILL",
            autocompletion=skills,
            help="A skill's name or action number.",
            show_default=False,
        ),
    ],
    back_ends: BackEnds,
    reading: PartReading,
    caching: Caching,
    after: Annotated[
        str | None,
        typer.Option(
            "--after",
            metavar="0,1,...",
            help="The sequence that leads to the state in question; default: the initial state.",
            rich_help_panel=TASK,
        ),
    ] = None,
    picture: Annotated[
        str | None,
        typer.Option(
            "--picture",
            metavar="FILE",
            help="Draw the moment at which it fails, or its end, as .png, if the physics moves "
            "bodies. What was there is replaced.",
            rich_help_panel=OUTPUT,
        ),
    ] = None,
    animate: Annotated[
        str | None,
        typer.Option(
            "--animate",
            metavar="FILE",
            help="Likewise, film the whole skill as .gif.",
            rich_help_panel=OUTPUT,
        ),
    ] = None,
    style: Style = "table",
) -> int:
    """Say why SKILL, a name or action number, is feasible or not in a state of TASK.

    Shows the verdict of every stage with the facts it rests on and what was measured.
    """
    from skillplan.cli.output import emit
    from skillplan.cli.showing import draw, drawing_paths, performer
    from skillplan.errors import EXIT_NO_PLAN, EXIT_SOLVED
    from skillplan.pipeline.run import make_model
    from skillplan.records.explanation import explain

    loaded = reading.task(task, back_ends)
    setup = back_ends.setup(loaded)
    chosen = loaded.skill(skill)
    before = loaded.parse_sequence(after) if after is not None else ()
    paths = drawing_paths(picture, animate)
    cache = caching.cache()
    model = make_model(loaded, setup, cache)
    engine = performer(model.feasibility.back_ends, "draw") if paths else None
    explanation = explain(model, chosen, before)
    if engine is not None:
        explanation = explanation.drawn(draw(engine, chosen, explanation.state, paths))
    failed = not explanation.feasible
    emit(style, explanation.document(), explanation.tables(), failed=failed)
    return EXIT_SOLVED if explanation.feasible else EXIT_NO_PLAN
