"""Networks of an earlier training that a new one begins with: ``train --from RUN``."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from skillplan.env.observation import Observation
from skillplan.errors import OptionError
from skillplan.records.stored.result_folder import is_relational
from skillplan.records.training.network_policy_file import StoredNetwork
from skillplan.records.training.run_folder import RunFolder, WarmStartRecord
from skillplan.solvers.learning.carried_over import NamedNetwork
from skillplan.solvers.learning.learner import Learner
from skillplan.solvers.learning.network_policy import NetworkPolicy
from skillplan.task.task import Task


@dataclass(frozen=True)
class WarmStart:
    """What a training begins with; can be sent to another process.

    Parameters
    ----------
    record
        Where it is from, and how much of it the task knows.
    networks
        One for every run, with inputs and outputs of the task.
    """

    record: WarmStartRecord
    networks: tuple[NetworkPolicy, ...]


def warm_start(
    path: str, solver: str, learner: Learner, options: Mapping[str, Any], task: Task, runs: int
) -> WarmStart:
    """Return the networks of earlier runs, made to fit a task.

    The runs take those of the earlier runs in turn: of the runs that have completed their task,
    or else of all that have learned something.

    Parameters
    ----------
    path
        The folder of the earlier training, as the user named it.
    solver, learner, options
        Who learns, and its options.
    task
        What is learned now.
    runs
        How many runs there will be, >= 1.

    Raises
    ------
    OptionError
        If nothing there fits the solver and the task.
    """
    if is_relational(path):
        raise OptionError(
            f"--from {path}: is a policy for any board; 'skillplan evaluate {path} --task FILE' "
            "tries it without training."
        )
    try:
        folder = RunFolder(path)
    except OptionError as error:
        raise OptionError(f"--from {error}") from None
    earlier = folder.manifest
    if learner.hidden_layers is None:
        raise OptionError(f"--from: the solver {solver!r} begins with no networks of others.")
    if earlier.solver != solver:
        raise OptionError(
            f"--from {path}: has networks of {earlier.solver}, not of {solver}. Add "
            f"--solver {earlier.solver}, or name another folder."
        )
    found = [(run, kept) for run, kept in _policies(folder) if kept.kept == "best"]
    found = found or _policies(folder)
    if not found:
        raise OptionError(f"--from {path}: none of its runs has a policy yet.")
    _check_layers(path, solver, learner, found)
    features = Observation.of(task, str(options["observation"])).features
    actions = [skill.name for skill in task.skills]
    chosen = [found[at % len(found)] for at in range(runs)]
    content = chosen[0][1].content
    known_features = sum(name in set(content.features) for name in features)
    known_skills = sum(name in set(content.actions) for name in actions)
    if not known_features or not known_skills:
        what = "no skill" if not known_skills else "nothing that is observed"
        raise OptionError(
            f"--from {path}: {what} of {earlier.task.name} has a name of {task.name}, so there is "
            "nothing to begin with."
        )
    networks = tuple(
        NamedNetwork(
            one.network, tuple(one.content.features), tuple(one.content.actions)
        ).carried_over(features, actions)
        for _, one in chosen
    )
    record = WarmStartRecord(
        run_dir=path,
        task=earlier.task.name,
        runs=tuple(run for run, _ in chosen),
        skills=len(actions),
        skills_known=known_skills,
        features=len(features),
        features_known=known_features,
        sha256=_digest(networks),
    )
    return WarmStart(record, networks)


def _policies(folder: RunFolder) -> list[tuple[int, StoredNetwork]]:
    return [(one.run, one.policy) for one in folder.runs() if one.policy is not None]


def _check_layers(
    path: str, solver: str, learner: Learner, found: Sequence[tuple[int, StoredNetwork]]
) -> None:
    """See that hidden layers are those of the learner.

    Raises
    ------
    OptionError
        If they are not.
    """
    wanted = learner.hidden_layers
    for _, one in found:
        there = tuple(outputs for _, outputs in one.content.layers[:-1])
        if there != wanted:
            raise OptionError(
                f"--from {path}: its networks have hidden layers of {_units(there)} units, those "
                f"of {solver} here {_units(wanted or ())}. Give {solver} the options it had there: "
                f"{Path(path) / 'manifest.json'} lists them."
            )


def _units(layers: Sequence[int]) -> str:
    return ", ".join(map(str, layers)) or "no"


def _digest(networks: Sequence[NetworkPolicy]) -> str:
    digest = hashlib.sha256()
    for network in networks:
        for array in (*network.weights, *network.biases):
            digest.update(repr(array.shape).encode())
            digest.update(array.tobytes())
    return digest.hexdigest()
