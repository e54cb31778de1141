"""A training that is gone on with for more steps than it was begun for."""

from __future__ import annotations

from pathlib import Path

from skillplan.errors import OptionError
from skillplan.records.training.run_folder import RunManifest
from skillplan.solvers.learning.learner import STRIDE_STEPS

SCHEDULE = "schedule_steps"


def gone_on_with(was: RunManifest, wanted: RunManifest) -> RunManifest:
    """Return a manifest of the training that is wanted, with the schedules that are there.

    Where nothing is said of schedules, a training that is extended keeps those that it has: they
    spanned its steps, and stay at their ends. So it is the training that these schedules and all
    its steps would have been from the start.

    Parameters
    ----------
    was
        The training that is there.
    wanted
        The same with as many steps, or more.
    """
    if wanted.options.get(SCHEDULE, 0) is not None:
        return wanted
    known = was.options.get(SCHEDULE)
    if known is None and wanted.steps > was.steps:
        known = was.steps
    return wanted.model_copy(update={"options": {**wanted.options, SCHEDULE: known}})


def with_steps(manifest: RunManifest, steps: int) -> RunManifest:
    """Return a manifest of the same training with more steps [-], and schedules as they are."""
    options = {**manifest.options, "steps": steps}
    if SCHEDULE in options and options[SCHEDULE] is None:
        options[SCHEDULE] = manifest.steps
    return manifest.model_copy(update={"steps": steps, "options": options})


def refuse_longer(folder: Path, manifest: RunManifest, steps: int, *, said: bool) -> None:
    """Refuse what would not be the same as if all steps had been asked for from the start.

    Parameters
    ----------
    folder
        Of the training, for the message.
    manifest
        Of the training as it is.
    steps
        How many environment steps it is to have instead, more than now.
    said
        Whether somebody said how many; otherwise they are derived from the task.

    Raises
    ------
    OptionError
        If nobody asked for more, the learner has no schedules of their own length, or the training
        ends between two notes of its figures.
    """
    was = manifest.steps
    if not said:
        raise OptionError(
            f"--resume: the training in {folder} is of {was} steps. Give --steps {was} to go on "
            f"with it, or more to extend it; without --steps it would be {steps}."
        )
    if SCHEDULE not in manifest.options:
        raise OptionError(
            f"--resume --steps {steps}: {manifest.solver} has no option {SCHEDULE}, so that its "
            f"training in {folder} cannot be extended. Train anew in another folder."
        )
    if was % STRIDE_STEPS:
        ends = -(-was // STRIDE_STEPS) * STRIDE_STEPS
        raise OptionError(
            f"--resume --steps {steps}: the training in {folder} has {was} steps, and only whole "
            f"hundreds can be extended. Train anew in another folder, with --steps {ends} for "
            f"example, or at once with -O {manifest.solver}.{SCHEDULE}={was} --steps {steps}."
        )


def extension_words(manifest: RunManifest) -> str:
    """Return what a training is that has been extended to the steps of a manifest."""
    schedule = manifest.options.get(SCHEDULE)
    return (
        f"extended to {manifest.steps:,} steps; schedules stay at their ends, as if begun with "
        f"-O {manifest.solver}.{SCHEDULE}={schedule} --steps {manifest.steps}"
    )
