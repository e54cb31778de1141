"""``skillplan plot``."""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Mapping
from typing import Any

import click
from click.shell_completion import CompletionItem

from skillplan.cli.option_fit import refuse_given
from skillplan.cli.options import (
    PluginName,
    TaskPath,
    asked,
    back_end_options,
    make_setup,
    parse_options,
    part_option,
    seed_option,
    set_option,
    settings,
    split_names,
    time_limit_option,
)
from skillplan.cli.run_figures import plot_run_folder
from skillplan.errors import OptionError, name_hint
from skillplan.views.figures.catalogue import (
    RUN_FIGURES,
    TASK_FIGURES,
    CatalogueEntry,
    figure_module,
)

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


def _listed(figures: Mapping[str, CatalogueEntry]) -> str:
    return "\n".join(f"  {name:<10} {figure.line}" for name, figure in figures.items())


EPILOG = (
    f"\b\nFigures of a task:\n{_listed(TASK_FIGURES)}\n\n"
    f"\b\nFigures of a folder of runs, by default both, as PNG and SVG, into the folder:\n"
    f"{_listed(RUN_FIGURES)}"
)


class FigureName(click.ParamType[str]):
    """A figure's name; completes to the figures there are."""

    name = "figure"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Return the name, or say which is nearest."""
        known = {**TASK_FIGURES, **RUN_FIGURES}
        if value not in known:
            self.fail(f"No figure {value!r}. {name_hint(str(value), known)}", param, ctx)
        return str(value)

    def shell_complete(
        self, ctx: click.Context, param: click.Parameter, incomplete: str
    ) -> list[CompletionItem]:
        """Return the figures that begin like what was typed."""
        return [
            CompletionItem(name, help=one.line)
            for name, one in {**TASK_FIGURES, **RUN_FIGURES}.items()
            if name.startswith(incomplete)
        ]


@click.command("plot", epilog=EPILOG)
@click.argument("task", type=TaskPath(), metavar="TASK|RUN")
@click.argument("figure", type=FigureName(), required=False)
@click.option(
    "--out",
    metavar="FILE",
    help="Where to, .png or .svg; default: TASK-FIGURE.png in the current folder, after the "
    "task's name, or FIGURE.png and FIGURE.svg in RUN. What was there is replaced.",
)
@click.option(
    "--solver",
    type=PluginName("solver"),
    metavar="NAME",
    help="Which solver's answer is drawn; default: sarsa for policy, learning and q-values, "
    "fleet for fleet, auto for rewards, else exact.",
)
@back_end_options
@set_option
@part_option
@click.option(
    "--states",
    metavar="NAMES",
    help="For q-values: places such as C66,C13; default: where the way starts, and where it "
    "goes on.",
)
@click.option(
    "--seeds",
    type=click.IntRange(1, 100),
    default=5,
    show_default=True,
    metavar="N",
    help="For learning: how many runs with seeds from --seed on the mean and the band are of.",
)
@seed_option
@click.option(
    "--against",
    type=click.Choice(["steps", "episodes"]),
    default="steps",
    show_default=True,
    help="Of a RUN: environment steps, of which all runs do as many, or episodes, as the paper "
    "has it.",
)
@time_limit_option()
@click.option(
    "--dpi",
    type=click.IntRange(30, 600),
    default=150,
    show_default=True,
    metavar="N",
    help="Dots per inch of a PNG.",
)
@click.pass_context
def command(
    ctx: click.Context,
    task: str,
    figure: str | None,
    out: str | None,
    solver: str | None,
    physics: str | None,
    collision: str | None,
    options: tuple[str, ...],
    changes: tuple[str, ...],
    part: str | None,
    states: str | None,
    seeds: int,
    seed: int,
    against: str,
    time_limit_s: float | None,
    dpi: int,
) -> int:
    """Solve TASK and draw FIGURE of it, or draw what a RUN has learned; prints what is written.

    RUN is a folder that train has written.
    """
    from skillplan.cli.output import exit_code
    from skillplan.cli.waiting import stoppable
    from skillplan.cli.writing import write_out
    from skillplan.pipeline.chain import solve_chain
    from skillplan.pipeline.run import solve
    from skillplan.pipeline.setup import load_problem
    from skillplan.records.result import Status

    if os.path.isdir(task):
        from skillplan.records.training.run_folder import RunFolder

        folder = RunFolder(task)
        refuse_given(ctx, _OF_TASK, "is for a task file, not for a folder of runs")
        if figure in TASK_FIGURES:
            raise OptionError(
                f"Figure {figure!r} is of a task file; of a folder of runs there are "
                f"{' and '.join(RUN_FIGURES)}."
            )
        _check_matplotlib()
        limit_s = _PROOF_S if time_limit_s is None else time_limit_s
        return plot_run_folder(folder, figure, out, against, limit_s, dpi)
    refuse_given(ctx, ("against",), "is for a folder of runs, not for a task file")
    if figure is None:
        raise OptionError(f"Name a figure of the task: {', '.join(TASK_FIGURES)}.")
    if figure in RUN_FIGURES:
        raise OptionError(
            f"Figure {figure!r} is of a folder of runs, which train writes; of a task file there "
            f"are {', '.join(TASK_FIGURES)}."
        )
    module = _module(figure)
    from skillplan.pipeline.registry import load, make_options
    from skillplan.views.figures.figure_file import checked_path, save_figure
    from skillplan.views.figures.figure_request import FigureRequest, Outcome

    if states is not None and figure != "q-values":
        raise OptionError(f"--states is for q-values; {figure} takes none.")
    problem = load_problem(task, asked(physics, collision), settings(changes))
    path = checked_path(f"{problem.name}-{figure}.png" if out is None else out)
    name = module.SOLVER if solver is None else solver
    given = parse_options(options, name).get(name, {})
    request = FigureRequest(
        figure,
        problem,
        name,
        given,
        seed,
        part,
        tuple(split_names(states or "")),
        seeds,
        make_options("solver", name, load("solver", name), given).model_dump(),
    )
    outcomes = []
    with stoppable(time_limit_s, label=f"{name} for {figure}") as stop:
        for run in module.runs(request):
            entries = (*options, *(f"{name}.{key}={value}" for key, value in run.options.items()))
            setup = make_setup(physics, collision, entries, (name,))(run.task or problem.tasks[-1])
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
    return figure_module(figure)


def _check_matplotlib() -> None:
    try:
        importlib.import_module("matplotlib")
    except ImportError:
        message = "plot needs matplotlib, which is not installed: pip install matplotlib."
        raise OptionError(message) from None
