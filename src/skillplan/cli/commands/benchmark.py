"""``skillplan benchmark``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import typer

from skillplan.cli.options import shared
from skillplan.cli.options.completion import plugin_lists
from skillplan.cli.options.values import count_option, option, split_names

if TYPE_CHECKING:  # --help pays for no imports
    from skillplan.benchmark.instances import Instance
    from skillplan.benchmark.runs import Campaign

INSTANCES = "Instances"

EPILOG = (
    "AGENT is a solver, fast-downward, random, or MODULE:NAME or FILE.py:NAME of a callable that "
    "takes the Gymnasium environment and returns an object with learn(total_timesteps) and "
    "predict(observation), such as sb3_contrib:MaskablePPO. Without AGENT all installed baselines "
    "run. Learners run on learning tasks, unless --suite or --only selects instances."
)


@dataclass(frozen=True, slots=True)
class Selection:
    """The instances that take part."""

    suites: Annotated[
        str | None, option("--suite A,B", INSTANCES, "Suites, separated by commas. Default: all.")
    ] = None
    only: Annotated[
        str | None,
        option(
            "--only PATTERNS",
            INSTANCES,
            "Instances whose names match one of several patterns, such as 'board-1*,walk-*'.",
        ),
    ] = None

    @property
    def is_explicit(self) -> bool:
        """Return whether an option selects instances."""
        return self.suites is not None or self.only is not None


@dataclass(frozen=True, slots=True)
class Instead:
    """What the command does instead of running agents."""

    listing: Annotated[
        bool,
        option(
            "--list",
            INSTANCES,
            "List instances, their optima and who proved them, and noise floors.",
        ),
    ] = False
    check: Annotated[
        str | None,
        option(
            "--check FILE",
            shared.OUTPUT,
            "Execute the plans and policies of a submission again, and refuse false rows.",
        ),
    ] = None
    prove: Annotated[
        bool,
        option(
            "--prove",
            INSTANCES,
            "Prove the optima again by two codes, measure noise floors, and print the data "
            "of one kind of task.",
        ),
    ] = False


def command(
    agents: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[AGENT]...",
            autocompletion=plugin_lists("solver"),
            help="Agents to run.",
            show_default=False,
        ),
    ] = None,
    *,
    selection: Selection,
    instead: Instead,
    time_limit_s: Annotated[
        float | None,
        shared.time_limit_option(
            "Time limit of a run. Default: 10 for a search, 30 for a learner."
        ),
    ] = None,
    steps: Annotated[
        int,
        count_option(
            "--steps",
            minimum=1,
            maximum=10**9,
            text="Environment steps of a learner from elsewhere, unless its time ends before",
            rich_help_panel=shared.LIMITS,
        ),
    ] = 10_000,
    runs: Annotated[
        int,
        count_option(
            "--runs",
            minimum=1,
            maximum=1_000,
            text="Seeds of each learner, from --seed on",
            rich_help_panel=shared.SOLVER,
        ),
    ] = 1,
    seed: shared.Seed = 0,
    jobs: shared.Jobs = 1,
    out: Annotated[
        str | None,
        option(
            "--out FILE",
            shared.OUTPUT,
            "Write a submission: all results with their plans, as .json. A file of the same "
            "benchmark is continued.",
        ),
    ] = None,
    style: shared.Style = "table",
) -> int:
    """Run agents on tasks with proved optima under equal limits, and compare them.

    A worker process does one run at a time, and is used again for the next one. The referee
    executes all plans and adds up their costs. The table shows shares, gaps to the optimum and
    times with 95 % intervals over instances. Ctrl-C prints the results so far; the same command
    with --out continues.
    """
    from skillplan.benchmark.instances import choose_instances, load_instances
    from skillplan.errors import OptionError
    from skillplan.files.output_path import check_output_path

    if [instead.listing, instead.check is not None, instead.prove].count(True) > 1:
        raise OptionError("Give one of --list, --check and --prove.")
    if agents and (instead.listing or instead.check or instead.prove):
        raise OptionError("--list, --check and --prove run no agents.")
    if out is not None and (instead.listing or instead.check is not None or instead.prove):
        raise OptionError("--list, --check and --prove write no file. Leave out --out.")
    known = load_instances()
    chosen = choose_instances(known, split_names(selection.suites or ""), selection.only)
    if instead.listing:
        return _list(chosen, style)
    if instead.check is not None:
        return _check(instead.check, known, style)
    if instead.prove:
        return _prove(chosen, time_limit_s)
    if out is not None:
        check_output_path("--out", out, (".json",), "submissions")
    from skillplan.benchmark.agents import list_baselines
    from skillplan.benchmark.runs import LEARNING_LIMIT_S, SEARCH_LIMIT_S, Campaign

    campaign = Campaign(
        tuple(dict.fromkeys(agents or list_baselines())),
        chosen,
        everywhere=selection.is_explicit,
        runs=runs,
        seed=seed,
        jobs=jobs,
        search_limit_s=time_limit_s or SEARCH_LIMIT_S,
        learning_limit_s=time_limit_s or LEARNING_LIMIT_S,
        steps=steps,
    )
    return _run(campaign, known, out, style)


def _run(campaign: Campaign, known: list[Instance], out: str | None, style: str) -> int:
    """Run agents, print their table, and return the exit code."""
    import sys

    from skillplan.benchmark.runs import ResultFile, do_runs
    from skillplan.cli.interruption import counting
    from skillplan.cli.output import emit
    from skillplan.cli.writing import tell
    from skillplan.errors import exit_code
    from skillplan.records.result import Status
    from skillplan.views.tables.benchmark import tabulate_agents, tabulate_rows

    file = ResultFile(out, campaign, known)
    file.write()
    every = campaign.list_runs()
    done = file.done
    left = [each for each in every if each.key not in done]
    worst_min = campaign.worst_case_s(left) / 60
    tell(
        f"skillplan: {len(left)} runs of {len(every)} to do, {worst_min:.1f} min at most on "
        f"{campaign.jobs} {'process' if campaign.jobs == 1 else 'processes'}"
    )
    interrupted = False
    with counting("benchmark", len(left)) as count:
        try:
            for row in do_runs(left, campaign.jobs, lambda: count.interrupted):
                file.add(row)
                count.one_more()
                if not sys.stderr.isatty():
                    tell(f"{row.instance}: {row.agent}, seed {row.seed}: {row.status}")
        finally:
            file.write()
        interrupted = count.interrupted
    submission = file.submission
    instances = {each.name: each for each in known}
    tables = tabulate_agents(submission, instances)
    if style == "csv":
        tables.append(tabulate_rows(submission, instances))
    # A task that stays unsolved is a result.
    faulty = any(row.status in (Status.FAILED, Status.WRONG) for row in submission.rows)
    code = exit_code(interrupted=interrupted, wrong=faulty)
    document = submission.model_dump(mode="json", by_alias=True)
    emit(style, document, tables, failed=code != 0)
    return code


def _list(instances: list[Instance], style: str) -> int:
    """Print instances with their optima, and noise floors."""
    from skillplan.cli.output import emit
    from skillplan.records import schemas
    from skillplan.views.tables.benchmark import tabulate_instances, tabulate_noise

    noise = tabulate_noise(instances)
    tables = [*([] if noise is None or style == "csv" else [noise]), tabulate_instances(instances)]
    values = [each.model_dump(mode="json", exclude_defaults=True) for each in instances]
    emit(style, {"schema": schemas.BENCHMARK_INSTANCES, "instances": values}, tables)
    return 0


def _check(path: str, known: list[Instance], style: str) -> int:
    """Check a submission, print its table and the refused rows, and return the exit code."""
    from skillplan.benchmark.submission import (
        Row,
        check_rows,
        find_limit_s,
        list_header_notes,
        read_submission,
    )
    from skillplan.cli.output import emit
    from skillplan.errors import exit_code
    from skillplan.records.result import Status
    from skillplan.views.tables.benchmark import tabulate_agents, tabulate_check

    instances = {each.name: each for each in known}
    submission = read_submission(path)
    refusals = list(check_rows(submission, instances))
    refused = {refusal.row.key for refusal in refusals}
    kept = [row for row in submission.rows if row.key not in refused]
    sound = submission.model_copy(update={"rows": kept})
    # Refused rows are failures, so that a forgery gains nothing.
    failures = [
        Row(
            agent=row.agent,
            instance=row.instance,
            sha256=row.sha256,
            seed=row.seed,
            status=Status.FAILED,
            wall_s=find_limit_s(row.agent, submission),
            reason=f"refused: {reason}",
        )
        for row, reason in ((refusal.row, refusal.reason) for refusal in refusals)
    ]
    counted = submission.model_copy(update={"rows": [*kept, *failures]})
    document = {
        **sound.model_dump(mode="json", by_alias=True),
        "refused": [
            {**refusal.row.model_dump(mode="json"), "reason": refusal.reason}
            for refusal in refusals
        ],
    }
    notes = list_header_notes(submission, instances)
    tables = tabulate_check(tabulate_agents(counted, instances), refusals, kept, notes)
    is_sound = bool(kept) and not refusals
    emit(style, document, tables, failed=not is_sound)
    return exit_code(solved=is_sound)


def _prove(instances: list[Instance], limit_s: float | None) -> int:
    """Prove instances of one kind of task and print their document."""
    from skillplan.benchmark.instances import format_instances
    from skillplan.benchmark.proving import check_provers, measure_noise, prove
    from skillplan.cli.interruption import counting
    from skillplan.cli.writing import tell, write_out
    from skillplan.errors import OptionError, exit_code

    kinds = dict.fromkeys(each.kind for each in instances)
    if len(kinds) > 1:
        suites = ", ".join(dict.fromkeys(each.suite for each in instances))
        raise OptionError(
            f"--prove prints the data of one kind of task, not of {', '.join(kinds)}. Name suites "
            f"of one kind with --suite: {suites}."
        )
    check_provers()
    proved = []
    with counting("proofs", len(instances)) as count:
        for each in instances:
            if count.interrupted:
                return exit_code(interrupted=True)
            instance = prove(each, limit_s or 60.0)
            if instance.learning and instance.status == "optimal":
                instance = measure_noise(instance)
            tell(f"{instance.name}: {instance.optimum} by {instance.proof_text}")
            proved.append(instance)
            count.one_more()
    write_out(format_instances(proved))
    return exit_code(solved=all(each.status != "open" for each in proved))
