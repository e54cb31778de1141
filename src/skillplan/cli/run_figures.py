"""``skillplan plot`` of a folder of training runs."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

from skillplan.errors import OptionError
from skillplan.views.figures.catalogue import RUN_FIGURES

if TYPE_CHECKING:  # --help pays for no imports
    from matplotlib.figure import Figure

    from skillplan.records.training.run_folder import RunFolder
    from skillplan.task.task import Task
    from skillplan.views.figures.figure_style import Heading


def plot_run_folder(
    folder: RunFolder,
    figure: str | None,
    out: str | None,
    against: str,
    time_limit_s: float,
    dpi: int,
) -> int:
    """Draw figures of a folder of runs and print their paths; return the exit code.

    Parameters
    ----------
    folder
        The runs.
    figure
        Which one; None for all, as PNG and SVG, into the folder.
    out
        Where to, of one figure.
    against
        ``steps`` or ``episodes``.
    time_limit_s
        For proving the optimum where nobody has yet [s].
    dpi
        Dots per inch of a PNG.

    Raises
    ------
    OptionError
        If the folder holds nothing to draw, or a file cannot be written.
    """
    from skillplan.cli.writing import write_out
    from skillplan.errors import EXIT_SOLVED
    from skillplan.views.figures.figure_file import SUFFIXES, checked_path, save_figure

    if out is not None and figure is None:
        raise OptionError(f"--out is for one figure; name it: {' or '.join(RUN_FIGURES)}.")
    names = list(RUN_FIGURES) if figure is None else [figure]
    if out is not None:
        paths = [checked_path(out)]
    else:
        paths = [checked_path(str(folder.path / f"{names[0]}{suffix}")) for suffix in SUFFIXES]
    drawn = _Drawn(folder, against, time_limit_s)
    written = []
    for name in names:
        if figure is None and name == "distances" and not drawn.any_success:
            # One figure of two is better than none; which is missing is said.
            drawn.say("distances: no run has completed the task yet. Not drawn.")
            continue
        made = drawn.figure(name)
        for one in paths:
            target = one if out is not None else one.with_stem(name)
            save_figure(made, target, dpi)
            written.append(target)
    write_out("".join(f"{one}\n" for one in written))
    return EXIT_SOLVED


class _Drawn:
    """The runs of a folder, and what figures of them need beside."""

    def __init__(self, folder: RunFolder, against: str, time_limit_s: float) -> None:
        from skillplan.views.figures.training.run_curve import run_curve

        self._folder, self._against, self._time_limit_s = folder, against, time_limit_s
        runs = folder.runs()
        for one in (one for one in runs if one.failure):
            self.say(f"run {one.run}: {one.failure}")
        self._curves = [
            run_curve(one.run, one.seed, one.episodes, one.steps) for one in runs if one.episodes
        ]
        if not self._curves:
            raise OptionError(f"{folder.path}: no run has ended an episode yet: nothing to draw.")
        self._runs = len(runs)
        self._known: tuple[Task, float | None] | None = None

    @property
    def any_success(self) -> bool:
        """Whether any episode completed the task."""
        return any(curve.success.any() for curve in self._curves)

    def say(self, text: str) -> None:
        """Tell on stderr what is not drawn."""
        print(f"skillplan: {self._folder.path}: {text}", file=sys.stderr)

    def figure(self, name: str) -> Figure:
        """Return a figure by name."""
        from skillplan.records.training.published_runs import SUCCESS_RATE, published_runs
        from skillplan.views.figures.training.distances_figure import distances_figure
        from skillplan.views.figures.training.success_figure import success_figure

        task, optimum = self._task()
        against: Any = self._against
        if name == "success":
            published = SUCCESS_RATE if published_runs(task, optimum) else None
            heading = self._heading("Success of training")
            return success_figure(self._curves, heading, against=against, published=published)
        if not self.any_success:
            raise OptionError(
                f"{self._folder.path}: no run has completed the task: nothing to draw."
            )
        heading = self._heading(
            "Completed sequences of training",
            "points single sequences",
            "lines means of the last 100",
        )
        return distances_figure(
            self._curves,
            task.metric,
            heading,
            against=against,
            optimum=optimum,
            chance=not task.deterministic,
        )

    def _heading(self, title: str, *more: str) -> Heading:
        from skillplan.views.figures.figure_style import Heading

        manifest = self._folder.manifest
        runs = f"{self._runs} run" if self._runs == 1 else f"{self._runs} runs"
        details = [f"task {manifest.task.name}", f"solver {manifest.solver}", runs]
        details += [f"{manifest.steps:,} steps each", f"seeds from {manifest.seed}"]
        details += [f"{key} {manifest.options[key]}" for key in ("observation", "mask")]
        details += more
        return Heading(f"{title}: {manifest.task.name}", ",  ".join(details))

    def _task(self) -> tuple[Task, float | None]:
        """Return the task as it was learned, and its optimum: as noted, or else proved now."""
        if self._known is None:
            self._known = self._found()
        return self._known

    def _found(self) -> tuple[Task, float | None]:
        from skillplan.cli.waiting import stoppable
        from skillplan.pipeline.run import warm_cache
        from skillplan.pipeline.setup import Setup, load_problem
        from skillplan.training.policy_roll_out import prove_optimum

        manifest = self._folder.manifest
        detectors = manifest.collision
        asked = {"physics": [manifest.physics], "collision": list(detectors)}
        source = self._folder.source
        problem = load_problem(source, asked, manifest.task.changes)
        if problem.sha256 != manifest.task.sha256:
            source = str(self._folder.task_copy)
            problem = load_problem(source, asked, manifest.task.changes)
        task = problem.part(manifest.task.part)
        result = self._folder.result()
        if result is not None and isinstance(result.get("optimum"), int | float):
            return task, float(result["optimum"])
        setup = Setup(manifest.physics, tuple(detectors), manifest.back_end_options)
        with stoppable(self._time_limit_s, label="proving the optimum") as stop:
            return task, prove_optimum(task, setup, warm_cache(), stop).cost
