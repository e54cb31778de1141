"""``skillplan export``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from skillplan.cli.load import load_file, load_result, make_setup, open_cache
from skillplan.cli.options import shared
from skillplan.cli.options.completion import plugin_names, task_files
from skillplan.cli.options.shared import RESULT_HELP
from skillplan.cli.options.values import option

if TYPE_CHECKING:  # --help pays for no imports
    from skillplan.exporters.exporter import Exporter, TrainedPolicy
    from skillplan.model.skill_model import SkillModel
    from skillplan.pipeline.setup import Setup
    from skillplan.records.training.network_policy_file import StoredNetwork
    from skillplan.task.skill import Skill
    from skillplan.task.task import Task

_FAMILY = "the file describes a family of layouts; handed over is the one that stands in the file"


def command(
    task: Annotated[
        str,
        typer.Argument(
            metavar="TASK|RESULT|RUN",
            autocompletion=task_files,
            help=f"A task file; {RESULT_HELP}; or a folder of train, for the formats of policies.",
            show_default=False,
        ),
    ],
    to: Annotated[
        str,
        option(
            "--to FORMAT",
            shared.OUTPUT,
            "Format, such as csv; 'skillplan plugins exporter' lists them.",
            autocompletion=plugin_names("exporter"),
            show_default=False,
        ),
    ],
    out: Annotated[
        str,
        option(
            "--out FILE",
            shared.OUTPUT,
            "New file; a format with several files writes them into a folder of this name.",
            show_default=False,
        ),
    ],
    reading: shared.ResultReading,
    back_ends: shared.BackEnds,
    checking: shared.Checking,
    sequence: Annotated[
        str | None,
        option(
            "--sequence 0,1,4,...",
            shared.TASK,
            "Plan of TASK: action numbers or skill names, separated by commas, or @FILE with "
            "a plan. RESULT contains its own plan.",
        ),
    ] = None,
    derived: Annotated[
        bool, option("--derived", shared.OUTPUT, "Has no effect; kept for older scripts.")
    ] = False,
) -> int:
    """Export a task, a plan of it, or a trained policy to the formats of other tools.

    The plan of RESULT or --sequence is replayed first, and exported only if it reaches the goal. A
    task that a format cannot express is refused with the reason. Options of the format and of back
    ends are given by -O.
    """
    from contextlib import closing

    from skillplan.checks.single_check import list_not_checked
    from skillplan.cli.waiting import show_checks
    from skillplan.cli.writing import tell, write_out
    from skillplan.errors import exit_code
    from skillplan.files.output_path import check_output_file, check_output_folder
    from skillplan.model.replay import replay
    from skillplan.pipeline.exchange import export_files, list_notes, make_exporter, make_handover
    from skillplan.pipeline.solving import make_model

    source = _read(task, sequence, to, back_ends, reading, checking)
    loaded, setup, skills = source.task, source.setup, source.skills
    exporter = make_exporter(to, setup.options.get(to, {}))
    path = check_output_file("--out", out) if exporter.suffix else check_output_folder("--out", out)
    with show_checks("exporting") as on_check:
        model = make_model(
            loaded, setup, open_cache(checking), jobs=checking.jobs, on_check=on_check
        )
        with closing(model.feasibility):
            plan = None if skills is None else replay(model, skills)
            if plan is not None and not plan.complete:
                violation = plan.violations[0]
                where = (
                    f"step {violation.step + 1}, {violation.skill}"
                    if violation.skill
                    else "its end"
                )
                tell(f"skillplan: error: the plan does not hold: {where}: {violation.reason}")
                return exit_code(solved=False)
            policies = {
                run: _describe_policy(model, stored, source.layouts)
                for run, stored in source.policies.items()
            }
            handover = make_handover(model, setup, plan, policies)
            files = export_files(exporter, handover)
            notes = [*list_notes(exporter, handover), *([_FAMILY] if source.family else [])]
            if plan is not None:
                back_ends_of = model.feasibility.back_ends
                notes += [f"not checked: {entry}" for entry in list_not_checked(back_ends_of)]
    _write(exporter, path, files)
    for note in notes:
        tell(f"skillplan: note: {note}")
    what = loaded.name if plan is None else f"{len(plan.steps)} skills, {_cost(loaded, plan.cost)}"
    whether = " if nothing fails" if plan is not None and handover.chance else ""
    write_out(f"{out}: {what}{whether}\n")
    return exit_code()


@dataclass(frozen=True)
class _Source:
    """A task with its back ends, its plan or policies if any, and whether it has a family.

    Its policies may have been trained on layouts of the family.
    """

    task: Task
    setup: Setup
    skills: tuple[Skill, ...] | None = None
    family: bool = False
    policies: Mapping[int, StoredNetwork] = field(default_factory=dict)
    layouts: bool = False


def _read(
    path: str,
    sequence: str | None,
    to: str,
    back_ends: shared.BackEnds,
    reading: shared.ResultReading,
    checking: shared.Checking,
) -> _Source:
    """Return what is to be exported."""
    from skillplan.errors import OptionError
    from skillplan.pipeline import registry
    from skillplan.records.stored.result_folder import find_run_folder, is_relational, is_result

    exporter = registry.load("exporter", to)
    if is_relational(path):
        raise OptionError(
            f"{path}: holds a relational policy. skillplan computes its inputs, so that it acts "
            f"here only: 'skillplan search-optimal TASK --solver relational -O run={path}'."
        )
    if find_run_folder(path) is not None:
        if exporter.needs_policies:
            reading.refuse_task_file(path, "a folder of train")
            return _read_policies(path, to, back_ends, checking)
        raise OptionError(
            f"{path}: holds training runs. Their policies choose by state, which is no plan: "
            "give a result of search-optimal, or the task file with --sequence; --to onnx exports "
            "a policy."
        )
    if is_result(path):
        if sequence is not None:
            raise OptionError("--sequence is for a task file; a result holds its own plan.")
        loaded = load_result(path, reading, back_ends, solver=to, executor=checking.executor)
        task, plan = loaded.planned()
        skills = tuple(task.skill(name) for name in plan)
        family = loaded.problem.domain.has_family(loaded.problem.config)
        return _Source(task, loaded.setup, skills, family)
    problem = load_file(path, reading, back_ends)
    task = problem.part(reading.part)
    setup = make_setup(back_ends, task, (to,), executor=checking.executor)
    if sequence is None:
        return _Source(task, setup, None, problem.domain.has_family(problem.config))
    from skillplan.pipeline.exchange import read_given_plan

    given = read_given_plan(sequence, task)
    return _Source(task, setup, given, problem.domain.has_family(problem.config))


def _read_policies(
    path: str, to: str, back_ends: shared.BackEnds, checking: shared.Checking
) -> _Source:
    """Return the policies of a training and its task, as it was learned."""
    from skillplan.pipeline.setup import CHART
    from skillplan.records.training.run_folder import RunFolder

    folder = RunFolder(path)
    manifest, learned = folder.manifest, folder.manifest.task
    changes = [f"{key}={value}" for key, value in learned.changes.items()]
    problem = load_file(str(folder.checked_copy()), shared.Reading(changes), back_ends, warn=False)
    task = problem.part(learned.part)
    layouts, with_chart, kept = manifest.family is not None, True, {}
    if layouts or not task.deterministic:
        # Their costs are computed here, with the back ends that judged the training.
        with_chart = back_ends.collision is not None or CHART in manifest.collision
        back_ends = replace(
            back_ends,
            physics=back_ends.physics or manifest.physics,
            collision=back_ends.collision or ",".join(manifest.collision) or None,
        )
        kept = manifest.back_end_options
    setup = make_setup(back_ends, task, (to,), executor=checking.executor, with_chart=with_chart)
    options = {
        name: {**kept.get(name, {}), **setup.options.get(name, {})}
        for name in {**kept, **setup.options}
    }
    policies = {run.run: run.policy for run in folder.runs() if run.policy is not None}
    return _Source(task, replace(setup, options=options), policies=policies, layouts=layouts)


def _describe_policy(model: SkillModel, stored: StoredNetwork, layouts: bool) -> TrainedPolicy:
    """Return a stored policy with its cost, expected under chance.

    Under chance and on several layouts a training keeps no cost: one episode does not show it.
    """
    from skillplan.env.observation import Observation
    from skillplan.pipeline.exchange import describe_policy
    from skillplan.training.policies import roll_out_greedily

    described, content = describe_policy(stored), stored.content
    if model.task.deterministic and not (layouts and content.cost is None):
        return described
    observation = Observation.of(model.task, content.observation)
    problem = stored.misfit(model.task, observation)
    if problem is not None:
        return replace(described, cost=None, problem=problem)
    outcome = roll_out_greedily(model, observation, stored.network, content.mask)
    return replace(described, cost=outcome.cost, problem=outcome.reason)


def _write(exporter: Exporter, path: Path, files: Mapping[str, str | bytes]) -> None:
    from skillplan.errors import OptionError
    from skillplan.files.atomic_file import write_as_one, write_new
    from skillplan.files.output_path import report_write_errors

    with report_write_errors("--out", path):
        if not exporter.suffix:
            path.mkdir(exist_ok=True)
            write_as_one(path, files, within=path)
            return
        (content,) = files.values()
        try:
            write_new(path, content)
        except FileExistsError:
            raise OptionError(f"--out {path}: is there already. Name a new file.") from None


def _cost(task: Task, cost: float) -> str:
    return f"cost {task.cost_text(cost)}"
