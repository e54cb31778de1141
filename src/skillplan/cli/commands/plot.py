"""``skillplan plot``."""

from __future__ import annotations

import importlib
import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from skillplan.cli.options.completion import task_files
from skillplan.cli.options.fit import given, refuse_given
from skillplan.cli.options.limits import CommandLimits
from skillplan.cli.options.panels import OUTPUT, SOLVER
from skillplan.cli.options.shared import BackEnds, PartReading
from skillplan.cli.options.single import Seed, solver_option
from skillplan.cli.options.values import count_option, one_of, parse_options, split_names
from skillplan.cli.result_input import RESULT_HELP, load, verify_before_showing
from skillplan.cli.writing import tell, write_out
from skillplan.errors import OptionError, name_hint
from skillplan.views.figures.catalogue import (
    RUN_FIGURES,
    figure_lines,
    figure_module,
    figure_names,
)

if TYPE_CHECKING:  # --help pays for no imports
    from pathlib import Path

    from skillplan.cli.deadline import Deadline
    from skillplan.domains.load import Problem
    from skillplan.pipeline.restoration import LoadedResult
    from skillplan.solvers.stop import Stop

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


def list_choices() -> dict[str, dict[str, str]]:
    """Return the lines of all figures, by the title of their list and by name."""
    return {
        "Figures of a task or a result": figure_lines(),
        "Figures of a folder of runs": {name: one.line for name, one in RUN_FIGURES.items()},
    }


def _figure(name: str) -> str:
    known = [*figure_names(), *RUN_FIGURES]
    if name not in known:
        from skillplan.pipeline.registry import missing_words

        hint = missing_words("figure", name) or name_hint(name, known)
        raise OptionError(f"No figure {name!r}. {hint}")
    return name


def _complete(ctx: typer.Context, incomplete: str) -> list[str]:
    figures = [one for one in (*figure_names(), *RUN_FIGURES) if one.startswith(incomplete)]
    return [*task_files(incomplete), *(figures if ctx.params.get("inputs") else [])]


def command(
    ctx: typer.Context,
    inputs: Annotated[
        list[str],
        typer.Argument(
            metavar="TASK|RESULT|RUN... [FIGURE]",
            autocompletion=_complete,
            help=f"A task file; {RESULT_HELP}; or one or several folders that train has written. "
            "Then the figure, one of those below; of a RUN by default all.",
            show_default=False,
        ),
    ],
    *,
    reading: PartReading,
    solver: Annotated[
        str | None,
        solver_option(
            "Solver whose answer is drawn. Default: that of RESULT; for TASK the figure's own, "
            "such as sarsa for learning, auto for rewards and exact for most."
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
    limits: CommandLimits,
    states: Annotated[
        str | None,
        typer.Option(
            "--states",
            metavar="NAMES",
            help="For q-values: places such as --states C66,C13, or facts "
            "that hold in one state each, such as --states 'held(pcb)'; default: where the path "
            "starts, and where it goes on.",
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
            help="Where to, .png or .svg, of precedence also .dot, of exploded also .gif, a film; "
            "default: TASK-FIGURE.png in the current folder, after the task's name, or FIGURE.png "
            "and FIGURE.svg in RUN. What was there is replaced.",
            rich_help_panel=OUTPUT,
        ),
    ] = None,
) -> int:
    """Draw FIGURE of TASK, which is solved first, or of RESULT, or draw what a RUN has learned.

    Prints the files that are written. RESULT is drawn as it is stored where its plan is all that
    the figure shows; what is to be seen of the search, or with another solver, is solved again
    with the task, the back ends and the options of the result. A RESULT is verified first, for
    10 s at most, and one that is refuted is not drawn. The curves of several RUNs stand
    in one figure.
    """
    from skillplan.records.stored.result_folder import is_result, run_folder

    # A search may take all its time; the figure is drawn after it.
    deadline = limits.begin(graceful=True)
    sources, figure = _split(inputs)
    folders = [run_folder(one) for one in sources]
    if len(sources) > 1 and None in folders:
        odd = sources[folders.index(None)]
        raise OptionError(f"{odd} is no folder of training runs; of others plot takes one.")
    if folders[0] is not None:
        from skillplan.cli.training_runs.figures import Drawing, plot_run_folders
        from skillplan.records.training.run_folder import RunFolder

        runs = [RunFolder(one) for one in folders if one is not None]
        refuse_given(ctx, _OF_TASK, "is for a task file, not for a folder of runs")
        if figure in figure_names():
            raise OptionError(
                f"Figure {figure!r} is of a task file; of a folder of runs there are "
                f"{' and '.join(RUN_FIGURES)}."
            )
        _check_matplotlib()
        limit_s = deadline.share_s(most_s=_PROOF_S) or _PROOF_S
        return plot_run_folders(runs, figure, out, Drawing(against, limit_s, dpi))
    refuse_given(ctx, ("against",), "is for a folder of runs, not for a task file")
    if figure is None:
        raise OptionError(f"Name a figure of the task: {', '.join(figure_names())}.")
    if figure in RUN_FIGURES:
        raise OptionError(
            f"Figure {figure!r} is of a folder of runs, which train writes; of a task file there "
            f"are {', '.join(figure_names())}."
        )
    if states is not None and figure != "q-values":
        raise OptionError(f"--states is for q-values; {figure} takes none.")
    wanted = _Wanted(figure, solver, seed, seeds, split_names(states or ""), deadline, dpi, out)
    _check_matplotlib()
    if not is_result(sources[0]):
        problem = reading.problem(sources[0], back_ends)
        return _plot(problem, reading.part, back_ends, wanted)
    return _plot_result(ctx, sources[0], reading, back_ends, wanted)


@dataclass(frozen=True, slots=True)
class _Wanted:
    """What is drawn, and how."""

    figure: str
    solver: str | None
    seed: int
    seeds: int
    states: Sequence[str]
    deadline: Deadline
    dpi: int
    out: str | None


def _plot_result(
    ctx: typer.Context, path: str, reading: PartReading, back_ends: BackEnds, wanted: _Wanted
) -> int:
    """Draw a figure of a stored result: of its plan, or with its solver, options and seed."""
    loaded = load(path, reading, back_ends, solver=wanted.solver)
    stored, origin = loaded.stored, loaded.origin
    own = [
        f"{plugin}.{key}={value}"
        for plugin, values in origin.options.items()
        for key, value in values.items()
    ]
    chosen = BackEnds(origin.physics, ",".join(origin.collision) or None, own)
    again = any(given(ctx, name) for name in ("solver", "options", "seed"))
    solver = wanted.solver or stored.solver
    seed = wanted.seed if given(ctx, "seed") else stored.seed
    kept = None if again else loaded
    if kept is not None:
        certificate = verify_before_showing(path, wanted.deadline.share_s())
        if not certificate.valid:
            tell(f"skillplan: note: {path}: not verified: {certificate.unconfirmed_words()}.")
    # Of a result of one task the part is known, of that of a chain the figure chooses.
    part = reading.part or (None if stored.is_chain else origin.part)
    return _plot(loaded.problem, part, chosen, replace(wanted, solver=solver, seed=seed), kept)


def _plot(
    problem: Problem,
    part: str | None,
    back_ends: BackEnds,
    wanted: _Wanted,
    kept: LoadedResult | None = None,
) -> int:
    """Solve what a figure needs, or take it from a result, and draw it."""
    from skillplan.cli.output import exit_code
    from skillplan.cli.waiting import stoppable
    from skillplan.pipeline.registry import load, make_options
    from skillplan.records.result import Status
    from skillplan.views.figures.figure_file import DOT, checked_path, save_content, save_figure
    from skillplan.views.figures.figure_request import FigureRequest, Outcome

    figure = wanted.figure
    module: Any = figure_module(figure, problem.kind)
    more = (*((DOT,) if hasattr(module, "dot") else ()), *_film_suffixes(module))
    path = checked_path(f"{problem.name}-{figure}.png" if wanted.out is None else wanted.out, more)
    name = module.SOLVER if wanted.solver is None else wanted.solver
    given = parse_options(back_ends.options, name).get(name, {})
    request = FigureRequest(
        figure,
        problem,
        name,
        given,
        wanted.seed,
        part,
        tuple(wanted.states),
        wanted.seeds,
        make_options("solver", name, load("solver", name), given).model_dump(),
        _deriver(problem, part, back_ends),
    )
    outcomes = []
    with stoppable(wanted.deadline.share_s(), label=f"{name} for {figure}") as stop:
        for run in module.runs(request):
            stop.renew()
            answer = _answer(run, request, back_ends, stop, kept)
            if answer.cost is None or answer.interrupted:
                learned = run.may_fail and answer.status is Status.UNSOLVED and answer.trace
                if answer.interrupted or not learned:
                    _say_why(problem.name, answer)
                    return exit_code([answer])
            outcomes.append(Outcome(run, answer))
    suffix = path.suffix.lower()
    if suffix == DOT:
        save_content(module.dot(request), path)
    elif suffix in _film_suffixes(module):
        _film(module.film(request, outcomes), module.FILM_FRAMES_PER_S, path)
    else:
        save_figure(module.draw(request, outcomes), path, wanted.dpi)
    write_out(f"{path}\n")
    return 0


def _film_suffixes(module: Any) -> tuple[str, ...]:
    """Return what a figure that moves is saved as."""
    from skillplan.views.video_file import ANIMATIONS

    return ANIMATIONS if hasattr(module, "film") else ()


def _film(pictures: Iterable[Any], frames_per_s: float, path: Path) -> None:
    from skillplan.views.video_file import video_file

    with video_file(path, frames_per_s, "--out") as video:
        for picture in pictures:
            video.add(picture)


def _deriver(problem: Problem, part: str | None, back_ends: BackEnds) -> Any:
    """Return what derives a precedence relation; None where there is a hand-made one to show.

    Detectors that the command line names are asked in any case.
    """
    from skillplan.pipeline.presentation.geometric_chart import geometric_chart
    from skillplan.pipeline.solving import warm_cache

    names = split_names(back_ends.collision or "")
    task = None if problem.is_chain and part is None else problem.part(part)
    if task is None or not task.scene.bodies or (task.chart and not names):
        return None
    return lambda one: geometric_chart(one, back_ends.setup(one), warm_cache())


def _answer(
    run: Any, request: Any, back_ends: BackEnds, stop: Stop, kept: LoadedResult | None
) -> Any:
    """Return what comes of a run: what a result holds of it, or else a search."""
    from skillplan.pipeline.chain import solve_chain
    from skillplan.pipeline.solving import solve

    problem, name = request.problem, request.solver
    if kept is not None and not run.options and not run.may_fail:
        held = kept.answer_for(run.task)
        if held is not None:
            return held
    own = [f"{name}.{key}={value}" for key, value in run.options.items()]
    chosen = replace(back_ends, options=[*back_ends.options, *own])
    setup = chosen.setup(run.task or problem.tasks[-1], (name,))
    seed = request.seed + run.seed
    if run.task is None:
        return solve_chain(problem, name, setup, seed=seed, stop=stop)
    return solve(run.task, name, setup, seed=seed, stop=stop)


def _split(inputs: Sequence[str]) -> tuple[list[str], str | None]:
    """Return what is drawn of, and the figure; the last word is one unless there is such a file."""
    *sources, last = inputs
    if not sources or os.path.exists(last):
        return list(inputs), None
    return sources, _figure(last)


def _say_why(name: str, answer: Any) -> None:
    reason = answer.reason.rstrip(".")
    tell(f"skillplan: {name}: {answer.status}: {reason}. Nothing drawn.")


def _check_matplotlib() -> None:
    try:
        importlib.import_module("matplotlib")
    except ImportError:
        message = "plot needs matplotlib, which is not installed: pip install matplotlib."
        raise OptionError(message) from None
