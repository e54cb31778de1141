"""Networks that act, as files: their weights as safetensors, what they are for as JSON.

Neither is code: whoever loads one runs nothing that it holds.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from skillplan.env.observation import Observation
from skillplan.errors import OptionError
from skillplan.files.atomic_file import write_whole
from skillplan.files.json_file import json_text, read_checked
from skillplan.files.safetensors_file import read_safetensors
from skillplan.records import schemas
from skillplan.solvers.learning.network_policy import NetworkPolicy
from skillplan.task.task import Task

_REMEDY = "Train again, or go on with --resume, which writes it again"
_MOST_BYTES = 1024 * 1024 * 1024


class LearnedTask(BaseModel):
    """The task that a policy was learned on."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    name: str
    kind: str
    sha256: str = Field(description="hash of the file's content")
    fingerprint: str = Field(description="hash of facts, goal and what skills bring about")


class NetworkPolicyContent(BaseModel):
    """What the JSON file says: who learned the network, on what, and what goes in and out."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    features: list[str] = Field(min_length=1, description="what every input means")
    actions: list[str] = Field(min_length=1, description="the skill that every output scores")
    observation: str
    mask: str
    objective: str
    solver: str
    options: dict[str, Any]
    task: LearnedTask
    seed: int = Field(ge=0)
    step: int = Field(ge=0, description="environment steps after which it was kept")
    cost: float | None = Field(ge=0, description="what its episode cost when it was kept")
    kept: Literal["best", "last"]
    layers: list[tuple[int, int]] = Field(min_length=1, description="inputs and outputs of each")
    sha256: str = Field(description="hash of the file of weights beside it")


@dataclass(frozen=True)
class StoredNetwork:
    """A network as read from its files.

    Parameters
    ----------
    network
        What acts.
    content
        What it is for.
    """

    network: NetworkPolicy
    content: NetworkPolicyContent

    @property
    def kept(self) -> Literal["best", "last"]:
        """Whether it is the best that was seen or the last that was learned."""
        return self.content.kept

    def misfit(self, task: Task, observation: Observation) -> str | None:
        """Return why it cannot act on a task at all; None where it can.

        Parameters
        ----------
        task
            The task.
        observation
            Of its states, of the kind that the network observes.
        """
        for what, mine, there in (
            ("actions", self.content.actions, [skill.name for skill in task.skills]),
            ("features", self.content.features, list(observation.features)),
        ):
            if mine != there:
                pairs = zip(mine, there, strict=False)
                first = next(((one, other) for one, other in pairs if one != other), None)
                found = f"{len(mine)} {what}, not {len(there)}"
                if first is not None:
                    found = f"other {what}: {first[0]} where the task has {first[1]}"
                return f"it was learned on {found}"
        return None


def write_network(
    folder: Path,
    stem: str,
    network: NetworkPolicy,
    *,
    within: Path | None = None,
    **content: Any,
) -> None:
    """Write a network into two files; the JSON, which vouches for the other one, comes last.

    Parameters
    ----------
    folder, stem
        Where to: ``stem.safetensors`` and ``stem.json``.
    network
        What acts.
    within
        A folder that the files must lie in, with no link on the way to them; None for anywhere.
    content
        Fields of `NetworkPolicyContent`, but for ``layers`` and ``sha256``.

    Raises
    ------
    OSError
        If a file cannot be written.
    """
    from safetensors.numpy import save

    arrays: dict[str, NDArray[Any]] = {}
    for index, (weight, bias) in enumerate(zip(network.weights, network.biases, strict=True)):
        arrays[f"weight_{index}"] = np.ascontiguousarray(weight, dtype=np.float32)
        arrays[f"bias_{index}"] = np.ascontiguousarray(bias, dtype=np.float32)
    data = save(arrays)
    network_policy_content = NetworkPolicyContent(
        **content,
        layers=[(weight.shape[0], weight.shape[1]) for weight in network.weights],
        sha256=hashlib.sha256(data).hexdigest(),
    )
    write_whole(folder / f"{stem}.safetensors", data, within=within)
    write_whole(
        folder / f"{stem}.json",
        json_text(schemas.NETWORK_POLICY, network_policy_content),
        within=within,
    )


def read_network(path: Path, *, within: Path | None = None) -> StoredNetwork:
    """Return the network whose JSON file is named.

    Parameters
    ----------
    path
        A ``policy.json`` or ``last.json``; the weights lie beside it.
    within
        A folder that both must lie in, with no link on the way to them; None for anywhere.

    Raises
    ------
    OptionError
        If a file cannot be read, is none that `write_network` wrote, or does not fit the other.
    """
    checked = read_checked(
        path, schemas.NETWORK_POLICY, NetworkPolicyContent, _REMEDY, within=within
    )
    weights = path.with_suffix(".safetensors")
    try:
        data, _ = read_safetensors(weights, _MOST_BYTES, within=within)
    except OSError as error:
        raise OptionError(f"{weights}: cannot be read: {error.strerror}. {_REMEDY}.") from None
    except ValueError as error:
        raise OptionError(f"{weights}: is damaged: {error}. {_REMEDY}.") from None
    if hashlib.sha256(data).hexdigest() != checked.sha256:
        raise OptionError(f"{weights}: is damaged: it is not what {path} vouches for. {_REMEDY}.")
    try:
        network = _network(data, checked)
    except (ValueError, KeyError) as error:
        reason = f"has no {error}" if isinstance(error, KeyError) else str(error).rstrip(".")
        raise OptionError(f"{weights}: is damaged: {reason}. {_REMEDY}.") from None
    return StoredNetwork(network, checked)


def _network(data: bytes, said: NetworkPolicyContent) -> NetworkPolicy:
    from safetensors import SafetensorError
    from safetensors.numpy import load

    try:
        arrays = load(data)
    except SafetensorError as error:
        raise ValueError(str(error)) from None
    indices = range(len(said.layers))
    if len(arrays) != 2 * len(said.layers):
        raise ValueError(f"it holds {len(arrays)} arrays, not {2 * len(said.layers)}")
    weights = tuple(arrays[f"weight_{index}"] for index in indices)
    biases = tuple(arrays[f"bias_{index}"] for index in indices)
    if any(one.dtype != np.float32 for one in (*weights, *biases)):
        raise ValueError("its figures are no float32")
    if [weight.shape for weight in weights] != list(said.layers):
        raise ValueError("its layers have other sizes")
    network = NetworkPolicy(weights, biases)
    if (network.inputs, network.actions) != (len(said.features), len(said.actions)):
        raise ValueError("its first or last layer does not fit the features or actions")
    return network
