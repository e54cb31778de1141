"""``skillplan evaluate``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import typer

from skillplan.cli.load import load_file, load_result, make_setup, open_cache
from skillplan.cli.options import shared
from skillplan.cli.options.completion import task_files
from skillplan.cli.options.shared import RESULT_HELP
from skillplan.cli.options.values import Mode, check_options, count_option, option, positive_number

if TYPE_CHECKING:  # --help pays for no imports
    from skillplan.pipeline.setup import Setup
    from skillplan.solvers.solution import Policy
    from skillplan.task.skill import Skill
    from skillplan.task.task import Task

OF_TASK, OF_RESULT, OF_RUN = "For a task", "For a result or a run", "For a run"
# Proves the optimum to compare with; options without a plugin name belong to it.
DEFAULT_SOLVER = "auto"

TaskOfResult = Annotated[
    str | None, shared.task_option("Task file to use instead of the stored one.", OF_RESULT)
]
ChangedTask = Annotated[
    bool,
    option(
        "--changed-task",
        OF_RESULT,
        "Evaluate although the task has changed since it was solved or learned.",
    ),
]


@dataclass(frozen=True, slots=True)
class Replayed:
    """The sequence or policy to replay on a task, and its start."""

    sequence: Annotated[
        str | None,
        option(
            "--sequence 0,1,4,...",
            OF_TASK,
            "Action numbers or skill names, separated by commas, or @FILE with a plan: CSV, "
            "JSON, the plan of a PDDL planner or a behaviour tree.",
        ),
    ] = None
    policy_file: Annotated[
        str | None,
        option(
            "--policy FILE",
            OF_TASK,
            "Follow the policy of a policies.json, or of the folder that contains it.",
        ),
    ] = None
    start: Annotated[
        str | None,
        option(
            "--from PLACE",
            OF_TASK,
            "Start elsewhere: at a place such as C20, or with facts separated by commas.",
        ),
    ] = None


@dataclass(frozen=True, slots=True)
class RollOuts:
    """Roll-outs of the policies of training runs."""

    episodes: Annotated[
        int,
        count_option(
            "--episodes",
            minimum=1,
            maximum=1_000_000,
            text="Number of sampled roll-outs per run.",
            rich_help_panel=OF_RUN,
        ),
    ] = 100
    temperature: Annotated[
        float | None,
        option(
            "--temperature T",
            OF_RUN,
            "Sample in proportion to exp(score / T) instead of by the policy's own rule: for "
            "ppo T = 1, for dqn its final epsilon.",
            parser=positive_number(),
        ),
    ] = None
    layouts: Annotated[
        int | None,
        count_option(
            "--layouts",
            minimum=0,
            maximum=10_000,
            text="Unseen layouts of the task file's family to try as well, by default 20 after a "
            "training on a family, else none.",
            rich_help_panel=OF_RUN,
        ),
    ] = None


def command(
    ctx: typer.Context,
    inputs: Annotated[
        list[str],
        typer.Argument(
            metavar="TASK|RESULT|RUN...",
            autocompletion=task_files,
            help=f"A task file; {RESULT_HELP}; or one or several folders of train.",
            show_default=False,
        ),
    ],
    replayed: Replayed,
    task_file: TaskOfResult = None,
    changed_task: ChangedTask = False,
    *,
    roll_outs: RollOuts,
    reading: shared.PartReading,
    seed: shared.Seed = 0,
    back_ends: shared.BackEnds,
    checking: shared.Checking,
    time_limit_s: shared.TimeLimit = 10.0,
    style: shared.Style = "table",
) -> int:
    """Replay a sequence on TASK or the plan of RESULT, or try the policies of a training RUN.

    Prints whether the plan is feasible and complete, its cost, and its deviation from the proved
    optimum, or the bound on it. If a condition fails, prints which one and where. --time-limit
    limits the proof. Uses the task and back ends stored in RESULT unless options override them.

    Every policy of a RUN is followed greedily and by its own rule (ppo samples, dqn explores with
    its final epsilon), and compared with random actions, with the back ends of the training.
    Several RUNs are compared in one table, with the probability that one learner beats another.

    The policy of train --family generated:A-B is followed greedily on any --task FILE.
    """
    from skillplan.cli.writing import tell
    from skillplan.errors import OptionError
    from skillplan.records.stored.result_folder import find_run_folders, is_relational, is_result

    kinds: dict[Mode, str] = {
        replay_on_task: "a task file",
        replay_result: "a result",
        follow_family_policy: "a policy that carries over",
        evaluate_runs: "a folder of runs",
    }
    first, common = inputs[0], (back_ends, checking, time_limit_s, style)
    if is_relational(first):
        check_options(ctx, follow_family_policy, kinds)
        if len(inputs) > 1:
            raise OptionError(f"{first} carries over: evaluate takes it alone, with one --task.")
        return follow_family_policy(first, task_file, reading, *common)
    runs, notes = find_run_folders(inputs, "evaluate")
    if runs:
        check_options(ctx, evaluate_runs, kinds)
        for note in notes:
            tell(f"skillplan: note: {note}")
        changes = shared.Reading(reading.changes)
        return evaluate_runs(runs, task_file, changed_task, roll_outs, changes, seed, *common)
    if is_result(first):
        check_options(ctx, replay_result, kinds)
        return replay_result(first, task_file, changed_task, reading, *common)
    check_options(ctx, replay_on_task, kinds)
    return replay_on_task(first, replayed, reading, *common)


def replay_on_task(
    path: str,
    replayed: Replayed,
    reading: shared.PartReading,
    back_ends: shared.BackEnds,
    checking: shared.Checking,
    time_limit_s: shared.TimeLimit,
    style: shared.Style,
) -> int:
    """Replay a sequence, or follow a stored policy, on a task."""
    from skillplan.errors import OptionError
    from skillplan.pipeline.exchange import read_given_plan
    from skillplan.records.stored.policy_file import read_policy
    from skillplan.records.stored.result_folder import find_policies_path
    from skillplan.task.task import read_start_state

    task = load_file(path, reading, back_ends).part(reading.part)
    setup = make_setup(back_ends, task, (DEFAULT_SOLVER,), executor=checking.executor)
    if (replayed.sequence is None) == (replayed.policy_file is None):
        raise OptionError("Give either --sequence or --policy.")
    policy = None
    if replayed.policy_file is not None:
        policy_path = find_policies_path(replayed.policy_file)
        within = None if policy_path == replayed.policy_file else replayed.policy_file
        policy = read_policy(policy_path, task, within=within).policy
    if replayed.start is not None:
        try:
            initial = read_start_state(task, replayed.start)
        except OptionError as error:
            raise OptionError(f"--from {replayed.start}: {error}") from None
        task = task.replace(initial=initial, sha256=task.sha256)
    plan = read_given_plan(replayed.sequence or "", task) if policy is None else policy
    return _replay(task, setup, plan, checking, time_limit_s, style)


def replay_result(
    path: str,
    task_file: TaskOfResult,
    changed_task: ChangedTask,
    reading: shared.PartReading,
    back_ends: shared.BackEnds,
    checking: shared.Checking,
    time_limit_s: shared.TimeLimit,
    style: shared.Style,
) -> int:
    """Replay the plan of a stored result."""
    loaded = load_result(
        path,
        reading,
        back_ends,
        solver=DEFAULT_SOLVER,
        task_file=task_file,
        changed_task=changed_task,
        executor=checking.executor,
    )
    task, plan = loaded.planned()
    skills = task.parse_sequence(",".join(plan))
    return _replay(task, loaded.setup, skills, checking, time_limit_s, style)


def follow_family_policy(
    path: str,
    task_file: TaskOfResult,
    reading: shared.PartReading,
    back_ends: shared.BackEnds,
    checking: shared.Checking,
    time_limit_s: shared.TimeLimit,
    style: shared.Style,
) -> int:
    """Follow a policy that was trained on random boards greedily on a task."""
    from pathlib import Path

    from skillplan.errors import OptionError
    from skillplan.training.family_training import follow_policy, read_policy

    if task_file is None:
        raise OptionError(f"{path} carries over: name the task to try it on by --task.")
    task = load_file(task_file, reading, back_ends).part(reading.part)
    setup = make_setup(back_ends, task, (DEFAULT_SOLVER,), executor=checking.executor)
    skills, _ = follow_policy(read_policy(Path(path)).policy, task, setup)
    return _replay(task, setup, skills, checking, time_limit_s, style)


def evaluate_runs(
    inputs: Sequence[str],
    task_file: TaskOfResult,
    changed_task: ChangedTask,
    roll_outs: RollOuts,
    reading: shared.Reading,
    seed: shared.Seed,
    back_ends: shared.BackEnds,
    checking: shared.Checking,
    time_limit_s: shared.TimeLimit,
    style: shared.Style,
) -> int:
    """Try the policies of training runs."""
    from skillplan.cli.training_runs.evaluation import RunsRequest, evaluate_run_folders

    request = RunsRequest(
        task_file, changed_task, roll_outs, reading, back_ends, checking, seed, time_limit_s
    )
    return evaluate_run_folders(inputs, request, style)


def _replay(
    task: Task,
    setup: Setup,
    plan: Sequence[Skill] | Policy,
    checking: shared.Checking,
    time_limit_s: float | None,
    style: str,
) -> int:
    """Replay a sequence or follow a policy, print the evaluation and return the exit code."""
    from contextlib import closing

    from skillplan.checks.verdict_cache import VerdictCache
    from skillplan.cli.output import emit
    from skillplan.cli.waiting import show_checks, stoppable
    from skillplan.errors import exit_code
    from skillplan.model.policy_value import roll_out
    from skillplan.model.replay import replay
    from skillplan.pipeline.solving import make_model, solve
    from skillplan.records.evaluation import Evaluation
    from skillplan.solvers.solution import Plan, Policy
    from skillplan.views.tables.questions import tabulate_evaluation

    cache = open_cache(checking) or VerdictCache()
    with show_checks("replaying") as on_check:
        model = make_model(task, setup, cache, jobs=checking.jobs, on_check=on_check)
        with closing(model.feasibility):
            skills = tuple(roll_out(model, plan.get) if isinstance(plan, Policy) else plan)
            replayed = replay(model, skills)
    best = None
    if replayed.complete and task.deterministic:
        with stoppable(time_limit_s, label="proving the optimum") as stop:
            known = Plan(tuple(skill.name for skill in skills), replayed.cost)
            best = solve(
                task, DEFAULT_SOLVER, setup, stop=stop, cache=cache, jobs=checking.jobs, start=known
            )
    evaluation = Evaluation(task, skills, replayed, best)
    emit(
        style,
        evaluation.document(),
        [tabulate_evaluation(evaluation)],
        failed=not replayed.complete,
    )
    interrupted = best is not None and best.interrupted
    return exit_code(interrupted=interrupted, solved=replayed.complete)
