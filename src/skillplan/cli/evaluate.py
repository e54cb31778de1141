"""``skillplan evaluate``."""

from __future__ import annotations

import click

from skillplan.cli.options import (
    asked,
    back_end_options,
    format_option,
    jobs_option,
    make_setup,
    no_cache_option,
    part_option,
    set_option,
    settings,
    task_argument,
    time_limit_option,
)


@click.command("evaluate")
@task_argument
@click.option(
    "--sequence",
    metavar="0,1,4,...",
    help="Action numbers or skill names, separated by commas.",
)
@click.option(
    "--policy",
    "policy_file",
    metavar="FILE",
    help="Follow the policy of a policies.json instead, without planning anew.",
)
@click.option(
    "--from",
    "start",
    metavar="PLACE",
    help="Start elsewhere: a place such as C20, or facts separated by commas.",
)
@back_end_options
@set_option
@part_option
@time_limit_option(10.0)
@jobs_option
@no_cache_option
@format_option
def command(
    task: str,
    sequence: str | None,
    policy_file: str | None,
    start: str | None,
    physics: str | None,
    collision: str | None,
    options: tuple[str, ...],
    changes: tuple[str, ...],
    part: str | None,
    time_limit_s: float,
    jobs: int,
    no_cache: bool,
    style: str,
) -> int:
    """Replay a sequence of skills on TASK, or follow a stored policy.

    Says whether it is feasible and complete, what it costs, how far that is from the proved
    optimum, and otherwise which condition fails where. The time limit is for proving the
    optimum.
    """
    from contextlib import closing

    from skillplan.cli.output import emit
    from skillplan.cli.waiting import showing_checks, stoppable
    from skillplan.errors import EXIT_INTERRUPTED, EXIT_NO_PLAN, EXIT_SOLVED, OptionError
    from skillplan.model.policy_value import roll_out
    from skillplan.model.replay import replay
    from skillplan.model.verdict_cache import VerdictCache
    from skillplan.report.evaluation import Evaluation
    from skillplan.report.policy_file import read_policy, start_state
    from skillplan.run import make_model, solve, warm_cache
    from skillplan.setup import load_problem

    loaded = load_problem(task, asked(physics, collision), settings(changes)).part(part)
    setup = make_setup(physics, collision, options, ("exact",))(loaded)
    if (sequence is None) == (policy_file is None):
        raise OptionError("Give either --sequence or --policy.")
    stored = None if policy_file is None else read_policy(policy_file, loaded)
    if start is not None:
        try:
            initial = start_state(loaded, start)
        except OptionError as error:
            raise OptionError(f"--from {start}: {error}") from None
        loaded = loaded.replace(initial=initial, sha256=loaded.sha256)
    cache = VerdictCache() if no_cache else warm_cache()
    with showing_checks("replaying") as on_check:
        model = make_model(loaded, setup, cache, jobs=jobs, on_check=on_check)
        with closing(model.feasibility):
            if stored is not None:
                skills = tuple(roll_out(model, stored.policy.get))
            else:
                skills = loaded.parse_sequence(sequence or "")
            walked = replay(model, skills)
    best = None
    if walked.complete:
        with stoppable(time_limit_s, label="proving the optimum") as stop:
            best = solve(loaded, "exact", setup, stop=stop, cache=cache, jobs=jobs)
    evaluation = Evaluation(loaded, skills, walked, best)
    emit(style, evaluation.document(), [evaluation.table()], failed=not walked.complete)
    if best is not None and best.interrupted:
        return EXIT_INTERRUPTED
    return EXIT_SOLVED if walked.complete else EXIT_NO_PLAN
