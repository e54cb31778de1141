"""``skillplan evaluate``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import typer

from skillplan.cli.options.completion import task_files
from skillplan.cli.options.fit import refuse_given
from skillplan.cli.options.limits import TimeLimit
from skillplan.cli.options.shared import BackEnds, Checking, PartReading
from skillplan.cli.options.single import Seed, Style
from skillplan.cli.result_input import RESULT_HELP, load
from skillplan.cli.training_runs.evaluation import RollOuts, Wanted, evaluate_run_folders

if TYPE_CHECKING:  # --help pays for no imports
    from skillplan.pipeline.setup import Setup
    from skillplan.solvers.solution import Policy
    from skillplan.task.skill import Skill
    from skillplan.task.task import Task

OF_TASK = "Of a task: what is replayed"
# What only a task file takes, what it does not, and what only a folder of runs takes.
_REPLAYED = ("sequence", "policy_file", "start")
_RECORDED = ("task_file", "changed_task")
_TRIED = ("episodes", "temperature", "seed", "layouts", "changed_task")
_RUN_ONLY = ("episodes", "temperature", "seed", "layouts")
# Whoever proves the optimum beside a sequence; its options need not name it.
DEFAULT_SOLVER = "auto"


@dataclass(frozen=True, slots=True)
class Replayed:
    """What is replayed on a task, and from where.

    Parameters
    ----------
    sequence
        Action numbers or skill names, with commas.
    policy_file
        A policies.json to follow instead.
    start
        Where to start, if not where the task does.
    """

    sequence: Annotated[
        str | None,
        typer.Option(
            "--sequence",
            metavar="0,1,4,...",
            help="Action numbers or skill names, separated by commas; or @ and a file with a plan: "
            "CSV, JSON, a plan of a PDDL planner, a behaviour tree.",
            rich_help_panel=OF_TASK,
        ),
    ] = None
    policy_file: Annotated[
        str | None,
        typer.Option(
            "--policy",
            metavar="FILE",
            help="Follow the policy of a policies.json instead, or of the folder that has it, "
            "without planning again.",
            rich_help_panel=OF_TASK,
        ),
    ] = None
    start: Annotated[
        str | None,
        typer.Option(
            "--from",
            metavar="PLACE",
            help="Start elsewhere: a place such as C20, or facts separated by commas.",
            rich_help_panel=OF_TASK,
        ),
    ] = None

    def on(self, task: Task, setup: Setup) -> tuple[Task, Sequence[Skill] | Policy]:
        """Return the task from where it is started, and the sequence or the policy.

        Raises
        ------
        OptionError
            If not just one of them is given, or something does not fit the task.
        """
        from skillplan.errors import OptionError
        from skillplan.pipeline.exchange.plan_input import given_plan
        from skillplan.records.stored.policy_file import read_policy, start_state
        from skillplan.records.stored.result_folder import policies_path

        if (self.sequence is None) == (self.policy_file is None):
            raise OptionError("Give either --sequence or --policy.")
        stored = None
        if self.policy_file is not None:
            path = policies_path(self.policy_file)
            within = None if path == self.policy_file else self.policy_file
            stored = read_policy(path, task, within=within).policy
        if self.start is not None:
            try:
                initial = start_state(task, self.start)
            except OptionError as error:
                raise OptionError(f"--from {self.start}: {error}") from None
            task = task.replace(initial=initial, sha256=task.sha256)
        return task, given_plan(self.sequence or "", task) if stored is None else stored


def command(
    ctx: typer.Context,
    inputs: Annotated[
        list[str],
        typer.Argument(
            metavar="TASK|RESULT|RUN...",
            autocompletion=task_files,
            help=f"A task file; {RESULT_HELP}; or one or several folders that train has written.",
            show_default=False,
        ),
    ],
    replayed: Replayed,
    roll_outs: RollOuts,
    reading: PartReading,
    *,
    seed: Seed = 0,
    back_ends: BackEnds,
    checking: Checking,
    time_limit_s: TimeLimit = 10.0,
    style: Style = "table",
) -> int:
    """Replay a sequence of skills on TASK or the plan of RESULT, or try the policies of a RUN.

    Says whether it is feasible and complete, what it costs, how far that is from the proved
    optimum, or how far it may be at most, and otherwise which condition fails where. The time
    limit is for proving the optimum. The task of RESULT is read as it was then, with the same
    back ends, but for what is said otherwise.

    The policy of every run of a RUN is followed greedily and by drawn actions, beside chance
    alone. Back ends are those of the training. Several are shown side by side.

    A RUN of train --family generated:A-B carries over: its policy is followed greedily on any
    --task FILE, with the applicable mask.
    """
    from skillplan.cli.training_runs.family import carried_skills
    from skillplan.errors import OptionError
    from skillplan.records.stored.result_folder import is_relational, is_result, run_folder

    if is_relational(inputs[0]):
        refuse_given(ctx, _REPLAYED, "is for a task file, not for a policy that carries over")
        refuse_given(ctx, _TRIED, "is for runs of training, not for a policy that carries over")
        if len(inputs) > 1:
            raise OptionError(
                f"{inputs[0]} carries over: evaluate takes it alone, with one --task."
            )
        if roll_outs.task_file is None:
            raise OptionError(f"{inputs[0]} carries over: name the task to try it on by --task.")
        task = reading.task(roll_outs.task_file, back_ends)
        setup = back_ends.setup(task, (DEFAULT_SOLVER,), executor=checking.executor)
        skills = carried_skills(inputs[0], task, setup)
        return _evaluate(task, setup, skills, checking, time_limit_s, style)
    folders = [run_folder(one) for one in inputs]
    if len(inputs) > 1 and None in folders:
        odd = inputs[folders.index(None)]
        raise OptionError(f"{odd} is no folder of training runs; of others evaluate takes one.")
    if folders[0] is not None:
        refuse_given(ctx, _REPLAYED, "is for a task file, not for a folder of runs")
        refuse_given(ctx, ("part",), "is for a task file, not for a folder of runs")
        wanted = Wanted(roll_outs, reading, back_ends, checking, seed, time_limit_s)
        return evaluate_run_folders([one for one in folders if one is not None], wanted, style)
    if is_result(inputs[0]):
        refuse_given(ctx, _RUN_ONLY, "is for a folder of runs, not for a result")
        refuse_given(ctx, _REPLAYED, "is for a task file; a result holds its own plan")
        loaded = load(
            inputs[0],
            reading,
            back_ends,
            solver=DEFAULT_SOLVER,
            task_file=roll_outs.task_file,
            changed_task=roll_outs.changed_task,
            executor=checking.executor,
        )
        task, plan = loaded.planned()
        skills = task.parse_sequence(",".join(plan))
        return _evaluate(task, loaded.setup, skills, checking, time_limit_s, style)
    refuse_given(ctx, _RUN_ONLY, "is for a folder of runs, not for a task file")
    refuse_given(ctx, _RECORDED, "is for a result or a folder of runs, not for a task file")
    task = reading.task(inputs[0], back_ends)
    setup = back_ends.setup(task, (DEFAULT_SOLVER,), executor=checking.executor)
    task, skills_or_policy = replayed.on(task, setup)
    return _evaluate(task, setup, skills_or_policy, checking, time_limit_s, style)


def _evaluate(
    task: Task,
    setup: Setup,
    plan: Sequence[Skill] | Policy,
    checking: Checking,
    time_limit_s: float | None,
    style: str,
) -> int:
    """Replay a sequence, or what a policy does; print what it comes to and return the exit code."""
    from contextlib import closing

    from skillplan.checks.verdict_cache import VerdictCache
    from skillplan.cli.output import emit
    from skillplan.cli.waiting import showing_checks, stoppable
    from skillplan.errors import exit_code
    from skillplan.model.policy_value import roll_out
    from skillplan.model.replay import replay
    from skillplan.pipeline.solving import make_model, solve
    from skillplan.records.evaluation import Evaluation
    from skillplan.solvers.solution import Plan, Policy
    from skillplan.views.tables.questions import evaluation_table

    cache = checking.cache() or VerdictCache()
    with showing_checks("replaying") as on_check:
        model = make_model(task, setup, cache, jobs=checking.jobs, on_check=on_check)
        with closing(model.feasibility):
            skills = tuple(roll_out(model, plan.get) if isinstance(plan, Policy) else plan)
            walked = replay(model, skills)
    best = None
    if walked.complete and task.deterministic:
        with stoppable(time_limit_s, label="proving the optimum") as stop:
            known = Plan(tuple(skill.name for skill in skills), walked.cost)
            best = solve(
                task,
                DEFAULT_SOLVER,
                setup,
                stop=stop,
                cache=cache,
                jobs=checking.jobs,
                start=known,
            )
    evaluation = Evaluation(task, skills, walked, best)
    emit(style, evaluation.document(), [evaluation_table(evaluation)], failed=not walked.complete)
    interrupted = best is not None and best.interrupted
    return exit_code(interrupted=interrupted, solved=walked.complete)
