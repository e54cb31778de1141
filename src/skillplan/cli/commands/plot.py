"""``skillplan plot``."""

from __future__ import annotations

import importlib
import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from skillplan.cli.load import load_file, load_result, make_setup, verify_before_showing
from skillplan.cli.options import shared
from skillplan.cli.options.completion import task_files
from skillplan.cli.options.shared import RESULT_HELP
from skillplan.cli.options.values import (
    Mode,
    check_options,
    count_option,
    is_given,
    one_of,
    option,
    parse_options,
    split_names,
)
from skillplan.cli.writing import tell, write_out
from skillplan.errors import OptionError, name_hint
from skillplan.views.figures.catalogue import (
    RUN_FIGURES,
    describe_figures,
    list_figure_names,
    load_figure_module,
)

if TYPE_CHECKING:  # --help pays for no imports
    from pathlib import Path

    from skillplan.cli.interruption import Deadline
    from skillplan.domains.load import Problem
    from skillplan.pipeline.restoration import LoadedResult
    from skillplan.solvers.stop import Stop
    from skillplan.task.task import Task

# Time limit for proving the optimum of a training that has none yet [s].
_PROOF_S = 10.0


@dataclass(frozen=True, slots=True)
class Solving:
    """Solver and seeds of a figure."""

    solver: Annotated[
        str | None,
        shared.solver_option(
            "Solver whose answer is drawn. Default: the solver of RESULT; for TASK that of the "
            "figure: sarsa for learning, exact for precedence, auto for most."
        ),
    ] = None
    seed: shared.Seed = 0
    seeds: Annotated[
        int,
        count_option(
            "--seeds",
            minimum=1,
            maximum=100,
            text="For learning: number of seeds to average over, starting at --seed.",
            rich_help_panel=shared.SOLVER,
        ),
    ] = 5


States = Annotated[
    str | None,
    option(
        "--states NAMES",
        shared.OUTPUT,
        "For q-values: places such as --states C66,C13, or facts that each hold in one state, "
        "such as --states 'held(pcb)'. Default: the first states of the path.",
    ),
]
Against = Annotated[
    Literal["steps", "episodes"],
    option(
        "--against AXIS",
        shared.OUTPUT,
        "Horizontal axis for a RUN: environment steps, which are equal for all runs, or "
        "episodes, as in the paper.",
        parser=one_of(("steps", "episodes")),
    ),
]


@dataclass(frozen=True, slots=True)
class FigureFile:
    """The file of a figure."""

    dpi: Annotated[
        int,
        count_option(
            "--dpi",
            minimum=30,
            maximum=600,
            text="Dots per inch of a PNG.",
            rich_help_panel=shared.OUTPUT,
        ),
    ] = 150
    out: Annotated[
        str | None,
        option(
            "--out FILE",
            shared.OUTPUT,
            "File to write: .png or .svg, .dot for precedence, .gif for exploded (a film). "
            "Default: TASK-FIGURE.png in the current folder, or FIGURE.png and FIGURE.svg in RUN. "
            "An existing file is replaced.",
        ),
    ] = None


def list_choices() -> dict[str, dict[str, str]]:
    """Return the help lines of all figures, by the title of their list and by name."""
    return {
        "Figures of a task or a result": describe_figures(),
        "Figures of a folder of runs": {name: entry.line for name, entry in RUN_FIGURES.items()},
    }


def _complete(ctx: typer.Context, incomplete: str) -> list[str]:
    names = [name for name in (*list_figure_names(), *RUN_FIGURES) if name.startswith(incomplete)]
    return [*task_files(incomplete), *(names if ctx.params.get("inputs") else [])]


def command(
    ctx: typer.Context,
    inputs: Annotated[
        list[str],
        typer.Argument(
            metavar="TASK|RESULT|RUN... [FIGURE]",
            autocompletion=_complete,
            help=f"A task file; {RESULT_HELP}; or one or several folders of train. Then the "
            "figure, one of those below. Without a figure, all figures of a RUN are drawn.",
            show_default=False,
        ),
    ],
    *,
    reading: shared.ResultReading,
    solving: Solving,
    back_ends: shared.BackEnds,
    limits: shared.CommandLimits,
    states: States = None,
    against: Against = "steps",
    file: FigureFile,
) -> int:
    """Draw FIGURE of TASK, of a stored RESULT, or of a training RUN.

    A TASK is solved first. A RESULT is drawn as stored if the figure shows only its plan;
    otherwise, or with another solver, it is solved again with its task, back ends and options.
    plot verifies a RESULT before it draws it, for at most 10 s, and refuses to draw a wrong one.
    Several RUNs of one task share a figure. Prints the names of the files written.
    """
    from skillplan.records.stored.result_folder import find_run_folders, is_result

    kinds: dict[Mode, str] = {
        plot_task: "a task file",
        plot_result: "a result",
        plot_runs: "a folder of runs",
    }
    sources, figure = _split_inputs(inputs)
    runs, notes = find_run_folders(sources, "plot")
    if runs:
        check_options(ctx, plot_runs, kinds)
        for note in notes:
            tell(f"skillplan: note: {note}")
        return plot_runs(runs, figure, limits, against, file)
    plot = plot_result if is_result(sources[0]) else plot_task
    check_options(ctx, plot, kinds)
    if figure is None:
        raise OptionError(f"Name a figure of the task: {', '.join(list_figure_names())}.")
    if figure in RUN_FIGURES:
        raise OptionError(
            f"Figure {figure!r} is of a folder of runs, which train writes; of a task file there "
            f"are {', '.join(list_figure_names())}."
        )
    if states is not None and figure != "q-values":
        raise OptionError(f"--states is for q-values; {figure} takes none.")
    return plot(ctx, sources[0], figure, reading, solving, back_ends, limits, states, file)


def plot_task(
    ctx: typer.Context,
    path: str,
    figure: str,
    reading: shared.ResultReading,
    solving: Solving,
    back_ends: shared.BackEnds,
    limits: shared.CommandLimits,
    states: States,
    file: FigureFile,
) -> int:
    """Solve a task and draw a figure of it."""
    _check_matplotlib()
    # A search may use the whole time limit; the figure is drawn after it.
    deadline = limits.begin(graceful=True)
    request = _Request(figure, solving, split_names(states or ""), deadline, file)
    return _draw(load_file(path, reading, back_ends), reading.part, back_ends, request)


def plot_result(
    ctx: typer.Context,
    path: str,
    figure: str,
    reading: shared.ResultReading,
    solving: Solving,
    back_ends: shared.BackEnds,
    limits: shared.CommandLimits,
    states: States,
    file: FigureFile,
) -> int:
    """Draw a figure of a stored result: of its plan, or of a new search with its settings."""
    _check_matplotlib()
    deadline = limits.begin(graceful=True)
    loaded = load_result(path, reading, back_ends, solver=solving.solver)
    stored, origin = loaded.stored, loaded.origin
    options = [
        f"{plugin}.{key}={value}"
        for plugin, values in origin.options.items()
        for key, value in values.items()
    ]
    chosen = shared.BackEnds(origin.physics, ",".join(origin.collision) or None, options)
    again = any(is_given(ctx, name) for name in ("solver", "options", "seed"))
    if not again:
        certificate = verify_before_showing(path, reading.task_file, deadline.share_s())
        if not certificate.valid:
            tell(f"skillplan: note: {path}: not verified: {certificate.unconfirmed_words()}.")
    # A result of one task names its part; for a result of a chain the figure chooses.
    part = reading.part or (None if stored.is_chain else origin.part)
    solving = replace(
        solving,
        solver=solving.solver or stored.solver,
        seed=solving.seed if is_given(ctx, "seed") else stored.seed,
    )
    request = _Request(figure, solving, split_names(states or ""), deadline, file)
    return _draw(loaded.problem, part, chosen, request, None if again else loaded)


def plot_runs(
    folders: Sequence[str],
    figure: str | None,
    limits: shared.CommandLimits,
    against: Against,
    file: FigureFile,
) -> int:
    """Draw learning curves of one or several trainings."""
    from skillplan.records.training.run_folder import RunFolder

    deadline = limits.begin(graceful=True)
    runs = [RunFolder(folder) for folder in folders]
    if figure in list_figure_names():
        raise OptionError(
            f"Figure {figure!r} is of a task file; of a folder of runs there are "
            f"{' and '.join(RUN_FIGURES)}."
        )
    _check_matplotlib()
    from skillplan.cli.training_runs.figures import plot_run_folders

    limit_s = deadline.share_s(most_s=_PROOF_S) or _PROOF_S
    return plot_run_folders(runs, figure, against, limit_s, file)


@dataclass(frozen=True, slots=True)
class _Request:
    """A figure of a task, as the command line requests it."""

    figure: str
    solving: Solving
    states: Sequence[str]
    deadline: Deadline
    file: FigureFile


def _draw(
    problem: Problem,
    part: str | None,
    back_ends: shared.BackEnds,
    requested: _Request,
    kept: LoadedResult | None = None,
) -> int:
    """Draw a figure from new searches or from a stored result."""
    from skillplan.cli.output import exit_code
    from skillplan.cli.waiting import stoppable
    from skillplan.records.result import Status
    from skillplan.views.figures.figure_file import DOT, check_path, save_content, save_figure
    from skillplan.views.figures.figure_request import FigureRequest, Outcome

    figure, solving, out = requested.figure, requested.solving, requested.file.out
    module: Any = load_figure_module(figure, problem.kind)
    more = (*((DOT,) if hasattr(module, "dot") else ()), *_list_film_suffixes(module))
    path = check_path(f"{problem.name}-{figure}.png" if out is None else out, more)
    solver = module.SOLVER if solving.solver is None else solving.solver
    options = parse_options(back_ends.options, solver).get(solver, {})
    request = FigureRequest(
        figure,
        problem,
        solver,
        options,
        solving.seed,
        part,
        tuple(requested.states),
        solving.seeds,
        _list_parameters(solver, options, problem.tasks[-1]),
        _make_chart_deriver(problem, part, back_ends),
    )
    outcomes = []
    with stoppable(requested.deadline.share_s(), label=f"{solver} for {figure}") as stop:
        for run in module.runs(request):
            stop.renew()
            answer = _solve(run, request, back_ends, stop, kept)
            if answer.cost is None or answer.interrupted:
                learned = run.may_fail and answer.status is Status.UNSOLVED and answer.trace
                if answer.interrupted or not learned:
                    reason = answer.reason.rstrip(".")
                    tell(f"skillplan: {problem.name}: {answer.status}: {reason}. Nothing drawn.")
                    return exit_code([answer])
            outcomes.append(Outcome(run, answer))
    suffix = path.suffix.lower()
    if suffix == DOT:
        save_content(module.dot(request), path)
    elif suffix in _list_film_suffixes(module):
        _write_film(module.film(request, outcomes), module.FILM_FRAMES_PER_S, path)
    else:
        save_figure(module.draw(request, outcomes), path, requested.file.dpi)
    write_out(f"{path}\n")
    return 0


def _list_parameters(solver: str, options: dict[str, Any], task: Task) -> dict[str, Any]:
    """Return all options of a solver, with values that it derives from the task."""
    from skillplan.pipeline.solving import make_solver

    configured: Any = make_solver(solver, options)
    derived = configured.derived([task]) if hasattr(configured, "derived") else {}
    return {**configured.options.model_dump(), **derived}


def _list_film_suffixes(module: Any) -> tuple[str, ...]:
    """Return the file suffixes of an animated figure."""
    from skillplan.views.video_file import ANIMATIONS

    return ANIMATIONS if hasattr(module, "film") else ()


def _write_film(pictures: Iterable[Any], frames_per_s: float, path: Path) -> None:
    from skillplan.views.video_file import open_video

    with open_video(path, frames_per_s, "--out") as video:
        for picture in pictures:
            video.add(picture)


def _make_chart_deriver(problem: Problem, part: str | None, back_ends: shared.BackEnds) -> Any:
    """Return a function that derives a precedence chart; None if the task has one of its own.

    The detectors of ``--collision`` are queried in any case.
    """
    from skillplan.pipeline.performing import derive_geometric_chart
    from skillplan.pipeline.solving import open_warm_cache

    names = split_names(back_ends.collision or "")
    task = None if problem.is_chain and part is None else problem.part(part)
    if task is None or not task.scene.bodies or (task.chart and not names):
        return None
    return lambda charted: derive_geometric_chart(
        charted, make_setup(back_ends, charted), open_warm_cache()
    )


def _solve(
    run: Any, request: Any, back_ends: shared.BackEnds, stop: Stop, kept: LoadedResult | None
) -> Any:
    """Return the result of a run: the stored one if it has the same settings, else a new one."""
    from skillplan.pipeline.chain import solve_chain
    from skillplan.pipeline.solving import solve

    problem, solver = request.problem, request.solver
    if kept is not None and not run.options and not run.may_fail:
        stored = kept.answer_for(run.task)
        if stored is not None:
            return stored
    options = [f"{solver}.{key}={value}" for key, value in run.options.items()]
    chosen = replace(back_ends, options=[*back_ends.options, *options])
    setup = make_setup(chosen, run.task or problem.tasks[-1], (solver,))
    seed = request.seed + run.seed
    if run.task is None:
        return solve_chain(problem, solver, setup, seed=seed, stop=stop)
    return solve(run.task, solver, setup, seed=seed, stop=stop)


def _split_inputs(inputs: Sequence[str]) -> tuple[list[str], str | None]:
    """Separate the sources and the figure, which is the last word unless a file has its name."""
    *sources, last = inputs
    if not sources or os.path.exists(last):
        return list(inputs), None
    known = [*list_figure_names(), *RUN_FIGURES]
    if last not in known:
        from skillplan.pipeline.registry import missing_words

        hint = missing_words("figure", last) or name_hint(last, known)
        raise OptionError(f"No figure {last!r}. {hint}")
    return sources, last


def _check_matplotlib() -> None:
    try:
        importlib.import_module("matplotlib")
    except ImportError:
        message = "plot needs matplotlib, which is not installed: pip install matplotlib."
        raise OptionError(message) from None
