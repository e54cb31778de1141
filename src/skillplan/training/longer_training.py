"""A training that is gone on with for more steps than it was begun for."""

from __future__ import annotations

from pathlib import Path

from skillplan.errors import OptionError
from skillplan.records.training.run_folder import RunManifest
from skillplan.solvers.learning.learner import STRIDE_STEPS


def with_steps(manifest: RunManifest, steps: int) -> RunManifest:
    """Return a manifest of the same training with another number of steps [-]."""
    return manifest.model_copy(
        update={"steps": steps, "options": {**manifest.options, "steps": steps}}
    )


def refuse_longer(folder: Path, manifest: RunManifest, steps: int) -> None:
    """Refuse what would not be the same as if all steps had been asked for from the start.

    Parameters
    ----------
    folder
        Of the training, for the message.
    manifest
        Of the training as it is.
    steps
        How many environment steps it is to have instead, more than now.

    Raises
    ------
    OptionError
        If its schedules end with its steps, or it ends between two notes of its figures.
    """
    was = manifest.steps
    again = f"-O {manifest.solver}.schedule_steps={was} --steps {steps}"
    if manifest.options.get("schedule_steps") is None:
        raise OptionError(
            f"--resume --steps {steps}: the schedules of the training in {folder} end with its "
            f"{was} steps, so that one of {steps} differs from the first step on. Train anew in "
            f"another folder with {again}; that one can be extended."
        )
    if was % STRIDE_STEPS:
        raise OptionError(
            f"--resume --steps {steps}: the training in {folder} has {was} steps, and only whole "
            f"hundreds can be extended. Train anew in another folder with {again}."
        )
