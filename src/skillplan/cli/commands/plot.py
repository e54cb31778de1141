"""``skillplan plot``."""

from __future__ import annotations

import importlib
import os
import sys
from dataclasses import replace
from typing import Annotated, Any, Literal

import typer

from skillplan.cli.completion import task_files, words
from skillplan.cli.option_fit import refuse_given
from skillplan.cli.option_values import count_option, one_of
from skillplan.cli.options import (
    OUTPUT,
    SOLVER,
    BackEnds,
    PartReading,
    Seed,
    TimeLimit,
    parse_options,
    solver_option,
    split_names,
)
from skillplan.cli.run_figures import RUN_FIGURES, plot_run_folder
from skillplan.errors import OptionError, name_hint

# Figure to the line that the help shows; the module is named after the figure.
FIGURES = {
    "policy": "the bench, with an arrow for what a policy recommends in every position",
    "placement": "heads and bases along the trajectory, and which base holds which head",
    "learning": "steps of an episode against episodes, for two sets of parameters",
    "q-values": "action values of some states against episodes",
    "rewards": "action and reward of every step",
    "gantt": "when head, PKM and base carry out the five steps",
    "fleet": "the ways of several bases on one bench, with their parallel steps",
}
_OF_THE_BENCH = ("fleet", "placement", "policy")

# What a task file takes and a folder of runs does not.
_OF_TASK = (
    "solver",
    "physics",
    "collision",
    "options",
    "changes",
    "part",
    "states",
    "seeds",
    "seed",
)
_PROOF_S = 10.0


LISTS = {
    "Figures of a task": FIGURES,
    "Figures of a folder of runs": RUN_FIGURES,
}


def _figure(value: str) -> str:
    known = {**FIGURES, **RUN_FIGURES}
    if value not in known:
        raise typer.BadParameter(f"No figure {value!r}. {name_hint(value, known)}")
    return value


def command(
    ctx: typer.Context,
    task: Annotated[
        str,
        typer.Argument(
            metavar="TASK|RUN",
            autocompletion=task_files,
            help="A task file, or a folder that train has written.",
            show_default=False,
        ),
    ],
    figure: Annotated[
        str | None,
        typer.Argument(
            metavar="FIGURE",
            parser=_figure,
            autocompletion=words({**FIGURES, **RUN_FIGURES}),
            help="One of those below; of a RUN by default all, as PNG and SVG, into the folder.",
        ),
    ] = None,
    *,
    reading: PartReading,
    solver: Annotated[
        str | None,
        solver_option(
            "Which solver's answer is drawn; default: sarsa for policy, learning and q-values, "
            "fleet for fleet, auto for rewards, else exact."
        ),
    ] = None,
    seed: Seed = 0,
    seeds: Annotated[
        int,
        count_option(
            "--seeds",
            least=1,
            most=100,
            text="For learning: how many runs with seeds from --seed on the mean and the band are "
            "of.",
            rich_help_panel=SOLVER,
        ),
    ] = 5,
    back_ends: BackEnds,
    time_limit_s: TimeLimit = None,
    states: Annotated[
        str | None,
        typer.Option(
            "--states",
            metavar="NAMES",
            help="For q-values: places such as C66,C13; default: where the path starts, and where "
            "it goes on.",
            rich_help_panel=OUTPUT,
        ),
    ] = None,
    against: Annotated[
        Literal["steps", "episodes"],
        typer.Option(
            "--against",
            parser=one_of(("steps", "episodes")),
            metavar="AXIS",
            help="Of a RUN: steps of the environment, of which all runs do as many, or episodes, "
            "as the paper has it.",
            rich_help_panel=OUTPUT,
        ),
    ] = "steps",
    dpi: Annotated[
        int,
        count_option(
            "--dpi",
            least=30,
            most=600,
            text="Dots per inch of a PNG.",
            rich_help_panel=OUTPUT,
        ),
    ] = 150,
    out: Annotated[
        str | None,
        typer.Option(
            "--out",
            metavar="FILE",
            help="Where to, .png or .svg; default: TASK-FIGURE.png in the current folder, after "
            "the task's name, or FIGURE.png and FIGURE.svg in RUN. What was there is replaced.",
            rich_help_panel=OUTPUT,
        ),
    ] = None,
) -> int:
    """Solve TASK and draw FIGURE of it, or draw what a RUN has learned; prints what is written.

    RUN is a folder that train has written.
    """
    from skillplan.cli.output import exit_code
    from skillplan.cli.waiting import stoppable
    from skillplan.cli.writing import write_out
    from skillplan.pipeline.chain import solve_chain
    from skillplan.pipeline.run import solve
    from skillplan.records.result import Status

    if os.path.isdir(task):
        from skillplan.records.training.run_folder import RunFolder

        folder = RunFolder(task)
        refuse_given(ctx, _OF_TASK, "is for a task file, not for a folder of runs")
        if figure in FIGURES:
            raise OptionError(
                f"Figure {figure!r} is of a task file; of a folder of runs there are "
                f"{' and '.join(RUN_FIGURES)}."
            )
        _check_matplotlib()
        limit_s = _PROOF_S if time_limit_s is None else time_limit_s
        return plot_run_folder(folder, figure, out, against, limit_s, dpi)
    refuse_given(ctx, ("against",), "is for a folder of runs, not for a task file")
    if figure is None:
        raise OptionError(f"Name a figure of the task: {', '.join(FIGURES)}.")
    if figure in RUN_FIGURES:
        raise OptionError(
            f"Figure {figure!r} is of a folder of runs, which train writes; of a task file there "
            f"are {', '.join(FIGURES)}."
        )
    module = _module(figure)
    from skillplan.pipeline.registry import load, make_options
    from skillplan.views.figures.figure_file import checked_path, save_figure
    from skillplan.views.figures.figure_request import FigureRequest, Outcome

    if states is not None and figure != "q-values":
        raise OptionError(f"--states is for q-values; {figure} takes none.")
    problem = reading.problem(task, back_ends)
    path = checked_path(f"{problem.name}-{figure}.png" if out is None else out)
    name = module.SOLVER if solver is None else solver
    given = parse_options(back_ends.options, name).get(name, {})
    request = FigureRequest(
        figure,
        problem,
        name,
        given,
        seed,
        reading.part,
        tuple(split_names(states or "")),
        seeds,
        make_options("solver", name, load("solver", name), given).model_dump(),
    )
    outcomes = []
    with stoppable(time_limit_s, label=f"{name} for {figure}") as stop:
        for run in module.runs(request):
            own = [f"{name}.{key}={value}" for key, value in run.options.items()]
            chosen = replace(back_ends, options=[*back_ends.options, *own])
            setup = chosen.setup(run.task or problem.tasks[-1], (name,))
            stop.renew()
            if run.task is None:
                answer: Any = solve_chain(problem, name, setup, seed=seed + run.seed, stop=stop)
            else:
                answer = solve(run.task, name, setup, seed=seed + run.seed, stop=stop)
            if answer.cost is None or answer.interrupted:
                learned = run.may_fail and answer.status is Status.UNSOLVED and answer.trace
                if answer.interrupted or not learned:
                    _say_why(problem.name, answer)
                    return exit_code([answer])
            outcomes.append(Outcome(run, answer))
    save_figure(module.draw(request, outcomes), path, dpi)
    write_out(f"{path}\n")
    return 0


def _say_why(name: str, answer: Any) -> None:
    reason = answer.reason.rstrip(".")
    print(f"skillplan: {name}: {answer.status}: {reason}. Nothing drawn.", file=sys.stderr)


def _module(figure: str) -> Any:
    """Return the module that draws a figure of a task."""
    _check_matplotlib()
    package = "skillplan.views.figures"
    if figure in _OF_THE_BENCH:
        package += ".swarmitfix"
    return importlib.import_module(f"{package}.{figure.replace('-', '_')}_figure")


def _check_matplotlib() -> None:
    try:
        importlib.import_module("matplotlib")
    except ImportError:
        message = "plot needs matplotlib, which is not installed: pip install matplotlib."
        raise OptionError(message) from None
