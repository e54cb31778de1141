"""A folder of training runs as a chapter of a report."""

from __future__ import annotations

from skillplan.cli.training_runs.figures import Drawing, figures_of
from skillplan.cli.writing import tell
from skillplan.errors import OptionError
from skillplan.records.training.run_folder import RunFolder
from skillplan.views.report.markup import Markup
from skillplan.views.report.page import Chapter
from skillplan.views.report.pictures import image
from skillplan.views.report.solver_chapters import training_chapter

_PROOF_S = 10.0


def training_chapter_of(folder: RunFolder, name: str, time_limit_s: float | None) -> Chapter:
    """Return what a folder of runs has come to.

    Parameters
    ----------
    folder
        That train has written.
    name
        Of the chapter.
    time_limit_s
        For proving the optimum where nobody has yet [s]; None for a default.

    Raises
    ------
    OptionError
        If the folder is damaged.
    """
    manifest = folder.manifest
    limit_s = _PROOF_S if time_limit_s is None else time_limit_s
    images: list[Markup] = []
    try:
        for figure_name, figure in figures_of(folder, Drawing("steps", limit_s, 130)).items():
            words = f"Learning curves, {figure_name}: {manifest.task.name}, {manifest.solver}"
            images.append(image(figure, words, f"{words}."))
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
    return training_chapter(entries, folder.result(), images, heading, name)
