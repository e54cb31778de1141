"""Learning curves of training runs: for ``skillplan plot``, and as a chapter of a report."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from matplotlib.figure import Figure

from skillplan.cli.waiting import stoppable
from skillplan.cli.writing import tell, write_out
from skillplan.errors import OptionError, TaskError, exit_code
from skillplan.pipeline.setup import CHART, Setup, load_problem
from skillplan.pipeline.solving import open_warm_cache
from skillplan.records.training.method_comparison import compare_methods
from skillplan.records.training.published_runs import SUCCESS_RATE, get_published_runs
from skillplan.records.training.run_folder import RunFolder
from skillplan.task.task import Task
from skillplan.training.policies import prove_optimum
from skillplan.views.figures.catalogue import RUN_FIGURES
from skillplan.views.figures.figure_file import SUFFIXES, check_path, save_figure
from skillplan.views.figures.figure_style import Heading
from skillplan.views.figures.profile_figure import draw_profile
from skillplan.views.figures.training_figures import (
    RunCurve,
    draw_distances,
    draw_distances_of_trainings,
    draw_success,
    draw_success_of_trainings,
    run_curve,
)
from skillplan.views.report.markup import Markup
from skillplan.views.report.page import Chapter
from skillplan.views.report.pictures import embed_figure
from skillplan.views.report.solver_chapters import build_training_chapter

if TYPE_CHECKING:
    from skillplan.cli.commands.plot import FigureFile

_PROOF_S = 10.0


def plot_run_folders(
    folders: Sequence[RunFolder],
    figure: str | None,
    against: str,
    time_limit_s: float,
    file: FigureFile,
) -> int:
    """Draw the curves of one or several trainings, print the files and return the exit code.

    Parameters
    ----------
    figure
        One of `RUN_FIGURES`; None for all of them.
    against
        Horizontal axis: ``steps`` or ``episodes``.
    time_limit_s
        Time limit for proving an optimum that is not stored [s].

    Raises
    ------
    OptionError
        If there is nothing to draw, the trainings are of different tasks, or a file cannot be
        written.
    """
    if file.out is not None and figure is None:
        raise OptionError(f"--out is for one figure; name it: {' or '.join(RUN_FIGURES)}.")
    # Paths are checked before anything expensive.
    targets = {
        name: [check_path(path) for path in _list_paths(folders, name, file.out)]
        for name in (RUN_FIGURES if figure is None else [figure])
    }
    lines = []
    profile = targets.pop("profile", None)
    if profile is not None:
        lines += _plot_profile(folders, profile, file.dpi, needed=figure is not None)
    trainings = [_Training(folder, time_limit_s) for folder in (folders if targets else ())]
    for training in trainings[1:]:
        _check_same_task(training, trainings[0])
    for name, paths in targets.items():
        completed = any(training.any_success for training in trainings)
        if figure is None and name == "distances" and not completed:
            place = f"{folders[0].path}: " if len(folders) == 1 else ""
            tell(f"skillplan: {place}distances: no run has completed the task yet. Not drawn.")
            continue
        drawn = (
            _draw_training(trainings[0], name, against)
            if len(trainings) == 1
            else _draw_trainings(trainings, name, against)
        )
        for path in paths:
            save_figure(drawn, path, file.dpi)
            lines.append(f"{path}\n")
    write_out("".join(lines))
    return exit_code()


def _plot_profile(
    folders: Sequence[RunFolder], paths: Sequence[Path], dpi: int, *, needed: bool
) -> list[str]:
    """Draw the performance profile of finished trainings and return the lines to print.

    Raises
    ------
    OptionError
        If there is none and it is needed.
    """
    try:
        names = _shorten_paths([folder.path for folder in folders])
        documents = [_read_finished(folder) for folder in folders]
        comparison = compare_methods(
            [{**each, "run_dir": name} for each, name in zip(documents, names, strict=True)]
        )
    except (KeyError, TypeError, ValueError) as error:
        fault = f"result.json is damaged: {type(error).__name__} {error}".rstrip(". ")
        raise OptionError(f"{', '.join(str(f.path) for f in folders)}: {fault}.") from None
    except OptionError:
        if needed:
            raise
        return []
    if comparison is None:
        if needed:
            raise OptionError("No optimum is proved, which the scores of a profile refer to.")
        return []
    tasks = list(dict.fromkeys(folder.manifest.task.name for folder in folders))
    heading = Heading(
        f"Performance profile: {', '.join(tasks)}",
        "a run that does not complete scores 0,  bands and bars 95 % of the bootstrap",
    )
    drawn = draw_profile(comparison, heading)
    for path in paths:
        save_figure(drawn, path, dpi)
    return [f"{path}\n" for path in paths]


def _read_finished(folder: RunFolder) -> dict[str, Any]:
    """Return the document of a finished training; raises OptionError if it is not finished."""
    document = folder.result()
    if document is None or "runs" not in document:
        raise OptionError(f"{folder.path}: has no result yet; train --resume goes on.")
    return document


def make_training_chapter(folder: RunFolder, name: str, time_limit_s: float | None) -> Chapter:
    """Return the chapter of a report about a training.

    Parameters
    ----------
    name
        Name of the chapter.
    time_limit_s
        Time limit for proving an optimum that is not stored [s]. Default: 10 s.

    Raises
    ------
    OptionError
        If the folder is damaged.
    """
    manifest = folder.manifest
    images: list[Markup] = []
    try:
        training = _Training(folder, _PROOF_S if time_limit_s is None else time_limit_s)
        for figure in ("success", "distances"):
            if figure != "distances" or training.any_success:
                words = f"Learning curves, {figure}: {manifest.task.name}, {manifest.solver}"
                images.append(
                    embed_figure(_draw_training(training, figure, "steps"), words, f"{words}.")
                )
    except OptionError as error:
        tell(f"skillplan: note: {error}")
    entries: list[tuple[str, object]] = [
        ("Task", manifest.task.name),
        ("Hash of the task", manifest.task.sha256),
        ("Solver", manifest.solver),
        ("Runs", len(manifest.seeds)),
        ("Steps of each", f"{manifest.steps:,}"),
        ("First seed", manifest.seed),
        ("Physics", manifest.physics),
        ("Collision", ", ".join(manifest.collision)),
        ("Options", ", ".join(f"{key} = {value}" for key, value in manifest.options.items())),
        ("Versions", ", ".join(f"{key} {value}" for key, value in manifest.versions.items())),
        ("Folder", folder.path),
    ]
    heading = f"{manifest.task.name}, learned by {manifest.solver}"
    return build_training_chapter(entries, folder.result(), images, heading, name)


class _Training:
    """The learning curves of a folder, with its task and optimum."""

    def __init__(self, folder: RunFolder, time_limit_s: float) -> None:
        self.folder = folder
        self._time_limit_s = time_limit_s
        runs = folder.runs()
        for run in runs:
            if run.failure:
                tell(f"skillplan: {folder.path}: run {run.run}: {run.failure}")
        self.curves: list[RunCurve] = [
            run_curve(run.run, run.seed, run.episodes, run.steps) for run in runs if run.episodes
        ]
        if not self.curves:
            raise OptionError(f"{folder.path}: no run has ended an episode yet: nothing to draw.")
        self.runs = len(runs)

    @property
    def any_success(self) -> bool:
        """True if any episode completed the task."""
        return any(curve.success.any() for curve in self.curves)

    @cached_property
    def task(self) -> Task:
        """The task as it was learned."""
        manifest = self.folder.manifest
        queried = {"physics": [manifest.physics], "collision": list(manifest.collision)}
        problem = None
        # The user's file may have changed or be damaged; the copy has not changed.
        with suppress(TaskError, OptionError):
            problem = load_problem(self.folder.source, queried, manifest.task.changes)
        if problem is None or problem.sha256 != manifest.task.sha256:
            copy = str(self.folder.checked_copy())
            problem = load_problem(copy, queried, manifest.task.changes)
        return problem.part(manifest.task.part)

    @cached_property
    def optimum(self) -> float | None:
        """The stored optimum, or else a new proof; None if the proof fails."""
        task, manifest, result = self.task, self.folder.manifest, self.folder.result()
        if result is not None and isinstance(result.get("optimum"), int | float):
            return float(result["optimum"])
        setup = Setup(
            manifest.physics,
            tuple(manifest.collision),
            manifest.back_end_options,
            manifest.screening,
            with_chart=CHART in manifest.collision,
        )
        with stoppable(self._time_limit_s, label="proving the optimum") as stop:
            return prove_optimum(task, setup, open_warm_cache(), stop).cost


def _draw_training(training: _Training, name: str, against: Any) -> Figure:
    task, optimum = training.task, training.optimum
    if name == "success":
        published = SUCCESS_RATE if get_published_runs(task, optimum) else None
        heading = _make_heading(training, "Success of training")
        return draw_success(training.curves, heading, against=against, published=published)
    if not training.any_success:
        raise OptionError(
            f"{training.folder.path}: no run has completed the task: nothing to draw."
        )
    heading = _make_heading(
        training,
        "Completed sequences of training",
        "points single sequences",
        "lines means of the last 100",
    )
    return draw_distances(
        training.curves,
        task.metric,
        heading,
        against=against,
        optimum=optimum,
        chance=not task.deterministic,
    )


def _draw_trainings(trainings: Sequence[_Training], name: str, against: Any) -> Figure:
    curves = {
        label: training.curves for label, training in zip(_label(trainings), trainings, strict=True)
    }
    first = trainings[0]
    title = f"{len(curves)} trainings: {first.folder.manifest.task.name}"
    if name == "success":
        heading = Heading(
            f"Success of {title}", "lines means of the runs,  bands one standard deviation"
        )
        return draw_success_of_trainings(curves, heading, against=against)
    if not any(training.any_success for training in trainings):
        raise OptionError("No run of any folder has completed the task: nothing to draw.")
    metric, optimum = first.task.metric, first.optimum
    heading = Heading(
        f"Completed sequences of {title}",
        "lines means of the last 100 of a run"
        + ("" if optimum is None else f",  dashed {metric.text(optimum)}"),
    )
    return draw_distances_of_trainings(curves, metric, heading, against=against, optimum=optimum)


def _list_paths(folders: Sequence[RunFolder], name: str, out: str | None) -> list[str]:
    if out is not None:
        return [out]
    if len(folders) > 1:
        return [f"{folders[0].manifest.task.name}-{name}.png"]
    return [str(folders[0].path / f"{name}{suffix}") for suffix in SUFFIXES]


def _check_same_task(training: _Training, first: _Training) -> None:
    task, other = training.folder.manifest.task, first.folder.manifest.task
    if (task.sha256, task.part) != (other.sha256, other.part):
        raise OptionError(
            f"{training.folder.path} is of another task, {task.name!r}, than "
            f"{first.folder.path}, {other.name!r}: they have no axis in common."
        )


def _label(trainings: Sequence[_Training]) -> list[str]:
    """Return distinct legend entries: folder and solver."""
    shown = _shorten_paths([training.folder.path for training in trainings])
    solvers = [training.folder.manifest.solver for training in trainings]
    return [f"{name}: {solver}" for name, solver in zip(shown, solvers, strict=True)]


def _shorten_paths(paths: Sequence[Path]) -> list[str]:
    """Return the names of folders, or their paths if names are not unique."""
    names = [path.name for path in paths]
    return names if len(set(names)) == len(names) else list(map(str, paths))


def _make_heading(training: _Training, title: str, *more: str) -> Heading:
    manifest = training.folder.manifest
    runs = f"{training.runs} run" if training.runs == 1 else f"{training.runs} runs"
    details = [f"task {manifest.task.name}", f"solver {manifest.solver}", runs]
    details += [f"{manifest.steps:,} steps each", f"seeds from {manifest.seed}"]
    details += [f"{key} {manifest.options[key]}" for key in ("observation", "mask")]
    details += more
    return Heading(f"{title}: {manifest.task.name}", ",  ".join(details))
