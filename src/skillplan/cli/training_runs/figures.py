"""``skillplan plot`` of a folder of training runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from skillplan.cli.writing import tell, write_out
from skillplan.errors import OptionError, TaskError, exit_code
from skillplan.views.figures.catalogue import RUN_FIGURES

if TYPE_CHECKING:  # --help pays for no imports
    from matplotlib.figure import Figure

    from skillplan.records.training.run_folder import RunFolder
    from skillplan.task.task import Task
    from skillplan.views.figures.figure_style import Heading


@dataclass(frozen=True, slots=True)
class Drawing:
    """How figures of training runs are drawn.

    Parameters
    ----------
    against
        ``steps`` or ``episodes``.
    time_limit_s
        For proving the optimum where nobody has yet [s].
    dpi
        Dots per inch of a PNG.
    """

    against: str
    time_limit_s: float
    dpi: int


def plot_run_folders(
    folders: Sequence[RunFolder], figure: str | None, out: str | None, drawing: Drawing
) -> int:
    """Draw figures of folders of runs and print their paths; return the exit code.

    Parameters
    ----------
    folders
        At least one; several are drawn together, into the current folder.
    figure
        Which one; None for all, of one folder as PNG and SVG into it.
    out
        Where to, of one figure.
    drawing
        How.

    Raises
    ------
    OptionError
        If a folder holds nothing to draw, several are not of the same task, or a file cannot be
        written.
    """
    from skillplan.views.figures.figure_file import checked_path, save_figure

    if out is not None and figure is None:
        raise OptionError(f"--out is for one figure; name it: {' or '.join(RUN_FIGURES)}.")
    names = list(RUN_FIGURES) if figure is None else [figure]
    # Whether a file can be written shows before anything expensive is done.
    targets = {
        name: [checked_path(path) for path in ([out] if out is not None else _paths(folders, name))]
        for name in names
    }
    every = [_Drawn(folder, drawing) for folder in folders]
    drawn: _Drawn | _Compared = every[0] if len(every) == 1 else _Compared(every, drawing)
    written = []
    for name, paths in targets.items():
        if figure is None and name == "distances" and not drawn.any_success:
            # One figure of two is better than none; which is missing is said.
            drawn.say("distances: no run has completed the task yet. Not drawn.")
            continue
        made = drawn.figure(name)
        for path in paths:
            save_figure(made, path, drawing.dpi)
            written.append(path)
    write_out("".join(f"{one}\n" for one in written))
    return exit_code()


def figures_of(folder: RunFolder, drawing: Drawing) -> dict[str, Figure]:
    """Return the figures of a folder of runs by name, as far as there is something to draw.

    Raises
    ------
    OptionError
        If no run has ended an episode yet.
    """
    drawn = _Drawn(folder, drawing)
    names = [name for name in RUN_FIGURES if name != "distances" or drawn.any_success]
    return {name: drawn.figure(name) for name in names}


def _paths(folders: Sequence[RunFolder], name: str) -> list[str]:
    """Return where a figure goes that the user names no file for."""
    from skillplan.views.figures.figure_file import SUFFIXES

    if len(folders) > 1:
        return [f"{folders[0].manifest.task.name}-{name}.png"]
    return [str(folders[0].path / f"{name}{suffix}") for suffix in SUFFIXES]


class _Compared:
    """Several trainings of one task, in one figure."""

    def __init__(self, every: Sequence[_Drawn], drawing: Drawing) -> None:
        first = every[0].folder.manifest.task
        for one in every[1:]:
            task = one.folder.manifest.task
            if (task.sha256, task.part) != (first.sha256, first.part):
                raise OptionError(
                    f"{one.folder.path} is of another task, {task.name!r}, than "
                    f"{every[0].folder.path}, {first.name!r}: they have no axis in common."
                )
        self._every, self._against = every, drawing.against

    @property
    def any_success(self) -> bool:
        """Whether any episode completed the task."""
        return any(one.any_success for one in self._every)

    def say(self, text: str) -> None:
        """Print on stderr what is not drawn."""
        tell(f"skillplan: {text}")

    def figure(self, name: str) -> Figure:
        """Return a figure by name."""
        from skillplan.views.figures.figure_style import Heading
        from skillplan.views.figures.training_figures import (
            distances_of_trainings,
            success_of_trainings,
        )

        against: Any = self._against
        trainings = {
            label: one.curves for label, one in zip(self._labels(), self._every, strict=True)
        }
        task_name = self._every[0].folder.manifest.task.name
        if name == "success":
            heading = Heading(
                f"Success of {len(trainings)} trainings: {task_name}",
                "lines means of the runs,  bands one standard deviation",
            )
            return success_of_trainings(trainings, heading, against=against)
        if not self.any_success:
            raise OptionError("No run of any folder has completed the task: nothing to draw.")
        task, optimum = self._every[0].task()
        heading = Heading(
            f"Completed sequences of {len(trainings)} trainings: {task_name}",
            "lines means of the last 100 of a run"
            + ("" if optimum is None else f",  dashed {task.metric.text(optimum)}"),
        )
        return distances_of_trainings(
            trainings, task.metric, heading, against=against, optimum=optimum
        )

    def _labels(self) -> list[str]:
        """Return what the legend says of each: its solver and folder, of which none is twice."""
        paths = [one.folder.path for one in self._every]
        names = [path.name for path in paths]
        shown = names if len(set(names)) == len(names) else list(map(str, paths))
        solvers = [one.folder.manifest.solver for one in self._every]
        return [f"{name}: {solver}" for name, solver in zip(shown, solvers, strict=True)]


class _Drawn:
    """The runs of a folder, and what figures of them need beside."""

    def __init__(self, folder: RunFolder, drawing: Drawing) -> None:
        from skillplan.views.figures.training_figures import run_curve

        self.folder = folder
        self._against, self._time_limit_s = drawing.against, drawing.time_limit_s
        runs = folder.runs()
        for one in (one for one in runs if one.failure):
            self.say(f"run {one.run}: {one.failure}")
        self.curves = [
            run_curve(one.run, one.seed, one.episodes, one.steps) for one in runs if one.episodes
        ]
        if not self.curves:
            raise OptionError(f"{folder.path}: no run has ended an episode yet: nothing to draw.")
        self._runs = len(runs)
        self._known: tuple[Task, float | None] | None = None

    @property
    def any_success(self) -> bool:
        """Whether any episode completed the task."""
        return any(curve.success.any() for curve in self.curves)

    def say(self, text: str) -> None:
        """Print on stderr what is not drawn."""
        tell(f"skillplan: {self.folder.path}: {text}")

    def figure(self, name: str) -> Figure:
        """Return a figure by name."""
        from skillplan.records.training.published_runs import SUCCESS_RATE, published_runs
        from skillplan.views.figures.training_figures import distances_figure, success_figure

        task, optimum = self.task()
        against: Any = self._against
        if name == "success":
            published = SUCCESS_RATE if published_runs(task, optimum) else None
            heading = self._heading("Success of training")
            return success_figure(self.curves, heading, against=against, published=published)
        if not self.any_success:
            raise OptionError(
                f"{self.folder.path}: no run has completed the task: nothing to draw."
            )
        heading = self._heading(
            "Completed sequences of training",
            "points single sequences",
            "lines means of the last 100",
        )
        return distances_figure(
            self.curves,
            task.metric,
            heading,
            against=against,
            optimum=optimum,
            chance=not task.deterministic,
        )

    def _heading(self, title: str, *more: str) -> Heading:
        from skillplan.views.figures.figure_style import Heading

        manifest = self.folder.manifest
        runs = f"{self._runs} run" if self._runs == 1 else f"{self._runs} runs"
        details = [f"task {manifest.task.name}", f"solver {manifest.solver}", runs]
        details += [f"{manifest.steps:,} steps each", f"seeds from {manifest.seed}"]
        details += [f"{key} {manifest.options[key]}" for key in ("observation", "mask")]
        details += more
        return Heading(f"{title}: {manifest.task.name}", ",  ".join(details))

    def task(self) -> tuple[Task, float | None]:
        """Return the task as it was learned, and its optimum: as noted, or else proved now."""
        if self._known is None:
            self._known = self._found()
        return self._known

    def _found(self) -> tuple[Task, float | None]:
        from contextlib import suppress

        from skillplan.cli.waiting import stoppable
        from skillplan.pipeline.setup import CHART, Setup, load_problem
        from skillplan.pipeline.solving import warm_cache
        from skillplan.training.policies import prove_optimum

        manifest = self.folder.manifest
        detectors = manifest.collision
        queried = {"physics": [manifest.physics], "collision": list(detectors)}
        problem = None
        # The user's file may have changed, or be none of a task any more; the copy is as it was.
        with suppress(TaskError, OptionError):
            problem = load_problem(self.folder.source, queried, manifest.task.changes)
        if problem is None or problem.sha256 != manifest.task.sha256:
            copy = str(self.folder.checked_copy())
            problem = load_problem(copy, queried, manifest.task.changes)
        task = problem.part(manifest.task.part)
        result = self.folder.result()
        if result is not None and isinstance(result.get("optimum"), int | float):
            return task, float(result["optimum"])
        options, screening = manifest.back_end_options, manifest.screening
        with_chart = CHART in detectors
        setup = Setup(manifest.physics, tuple(detectors), options, screening, with_chart=with_chart)
        with stoppable(self._time_limit_s, label="proving the optimum") as stop:
            return task, prove_optimum(task, setup, warm_cache(), stop).cost
