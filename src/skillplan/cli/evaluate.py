"""``skillplan evaluate``."""

from __future__ import annotations

import click

from skillplan.cli.options import (
    asked,
    back_end_options,
    format_option,
    make_setup,
    task_argument,
    time_limit_option,
)


@click.command("evaluate")
@task_argument
@click.option(
    "--sequence",
    metavar="0,1,4,...",
    required=True,
    help="Action numbers or skill names, separated by commas.",
)
@back_end_options
@time_limit_option(10.0)
@format_option
def command(
    task: str,
    sequence: str,
    physics: str | None,
    collision: str | None,
    options: tuple[str, ...],
    time_limit_s: float,
    style: str,
) -> int:
    """Replay a sequence of skills on TASK.

    Says whether it is feasible and complete, what it costs, how far that is from the proved
    optimum, and otherwise which condition fails where. The time limit is for proving the
    optimum.
    """
    from skillplan.cli.output import emit
    from skillplan.cli.waiting import stoppable
    from skillplan.errors import EXIT_INTERRUPTED, EXIT_NO_PLAN, EXIT_SOLVED
    from skillplan.model.replay import replay
    from skillplan.report.evaluation import Evaluation
    from skillplan.run import make_model, solve, warm_cache
    from skillplan.setup import load_problem

    loaded = load_problem(task, asked(physics, collision)).task
    setup = make_setup(physics, collision, options, ("exact",))(loaded)
    skills = loaded.parse_sequence(sequence)
    cache = warm_cache()
    walked = replay(make_model(loaded, setup, cache), skills)
    best = None
    if walked.complete:
        with stoppable(time_limit_s, label="proving the optimum") as stop:
            best = solve(loaded, "exact", setup, stop=stop, cache=cache)
    evaluation = Evaluation(loaded, skills, walked, best)
    emit(style, evaluation.document(), [evaluation.table()], failed=not walked.complete)
    if best is not None and best.interrupted:
        return EXIT_INTERRUPTED
    return EXIT_SOLVED if walked.complete else EXIT_NO_PLAN
