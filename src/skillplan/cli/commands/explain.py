"""``skillplan explain``."""

from __future__ import annotations

import click

from skillplan.cli.options import (
    SkillName,
    asked,
    back_end_options,
    format_option,
    make_setup,
    no_cache_option,
    part_option,
    set_option,
    settings,
    task_argument,
)


@click.command("explain")
@task_argument
@click.argument("skill", type=SkillName())
@click.option(
    "--after",
    metavar="0,1,...",
    help="The sequence that leads to the state asked about; default: the initial state.",
)
@click.option(
    "--picture",
    metavar="FILE",
    help="Draw the moment at which it fails, or its end, as .png, if the physics moves bodies. "
    "What was there is replaced.",
)
@click.option("--animate", metavar="FILE", help="Likewise, film the whole skill as .gif.")
@back_end_options
@set_option
@part_option
@no_cache_option
@format_option
def command(
    task: str,
    skill: str,
    after: str | None,
    picture: str | None,
    animate: str | None,
    physics: str | None,
    collision: str | None,
    options: tuple[str, ...],
    changes: tuple[str, ...],
    part: str | None,
    no_cache: bool,
    style: str,
) -> int:
    """Say why SKILL, a name or action number, is feasible or not in a state of TASK.

    Shows the verdict of every stage with the facts it rests on and what was measured.
    """
    from skillplan.cli.output import emit
    from skillplan.cli.showing import draw, drawing_paths, performer
    from skillplan.errors import EXIT_NO_PLAN, EXIT_SOLVED
    from skillplan.pipeline.run import make_model, warm_cache
    from skillplan.pipeline.setup import load_problem
    from skillplan.records.explanation import explain
    from skillplan.views.tables.explanation import explanation_tables

    loaded = load_problem(task, asked(physics, collision), settings(changes)).part(part)
    setup = make_setup(physics, collision, options)(loaded)
    chosen = loaded.skill(skill)
    before = loaded.parse_sequence(after) if after is not None else ()
    paths = drawing_paths(picture, animate)
    cache = None if no_cache else warm_cache()
    model = make_model(loaded, setup, cache)
    engine = performer(model.feasibility.back_ends, "draw") if paths else None
    explanation = explain(model, chosen, before)
    if engine is not None:
        explanation = explanation.drawn(draw(engine, chosen, explanation.state, paths))
    failed = not explanation.feasible
    emit(style, explanation.document(), explanation_tables(explanation), failed=failed)
    return EXIT_SOLVED if explanation.feasible else EXIT_NO_PLAN
