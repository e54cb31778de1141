"""Network policies as files: weights as safetensors, metadata as JSON. Neither contains code."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from skillplan.env.observation import Observation
from skillplan.files.atomic_file import write_whole
from skillplan.files.json_file import format_document, read_checked
from skillplan.files.safetensors_file import build_from_weights
from skillplan.records import schemas
from skillplan.solvers.learning.network_policy import ActionRule, NetworkPolicy
from skillplan.task.task import Task

_REMEDY = "Train again, or go on with --resume, which writes it again"
_MOST_BYTES = 1024 * 1024 * 1024


class LearnedTask(BaseModel):
    """The task that a policy was learned on."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    name: str
    kind: str
    sha256: str = Field(description="hash of the file's content")
    fingerprint: str = Field(description="hash of facts, goal and effects of skills")


class StoredRule(BaseModel):
    """How the policy drew its actions at the end of its training."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    kind: Literal["softmax", "epsilon-greedy"]
    value: float = Field(ge=0, description="temperature, or epsilon [-]")


class NetworkPolicyContent(BaseModel):
    """Metadata of a network: its learner, its task, its inputs and outputs."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    features: list[str] = Field(min_length=1, description="the feature of every input")
    actions: list[str] = Field(min_length=1, description="the skill that every output scores")
    observation: str
    mask: str
    objective: str
    solver: str
    options: dict[str, Any]
    task: LearnedTask
    seed: int = Field(ge=0)
    step: int = Field(ge=0, description="environment step at which it was kept")
    cost: float | None = Field(ge=0, description="cost of its episode when it was kept")
    kept: Literal["best", "last"]
    layers: list[tuple[int, int]] = Field(min_length=1, description="inputs and outputs of each")
    sha256: str = Field(description="hash of the file of weights")
    own_rule: StoredRule | None = Field(
        default=None, description="how actions are drawn from scores; null before version 0.4"
    )


@dataclass(frozen=True)
class StoredNetwork:
    """A network with its metadata."""

    network: NetworkPolicy
    content: NetworkPolicyContent

    @property
    def own_rule(self) -> ActionRule:
        """How the policy drew its actions at the end of its training."""
        rule, options = self.content.own_rule, self.content.options
        if rule is not None:
            return ActionRule(rule.kind, rule.value)
        # Version 0.3 did not store the rule. Of its learners, only ppo sampled by probability.
        if self.content.solver == "ppo":
            return ActionRule("softmax", 1.0)
        counts = options.get("exploration") == "count"
        epsilon = 0.0 if counts else options.get("epsilon_end", 0.0)
        return ActionRule("epsilon-greedy", float(epsilon))

    @property
    def kept(self) -> Literal["best", "last"]:
        """Kind of the policy: the best of its run, or the last."""
        return self.content.kept

    def misfit(self, task: Task, observation: Observation) -> str | None:
        """Explain why the network cannot act on a task; None if it can.

        Parameters
        ----------
        observation
            Observation of the task, of the network's kind.
        """
        for what, own, there in (
            ("actions", self.content.actions, [skill.name for skill in task.skills]),
            ("features", self.content.features, list(observation.features)),
        ):
            if own != there:
                pairs = zip(own, there, strict=False)
                first = next(((own, other) for own, other in pairs if own != other), None)
                difference = f"{len(own)} {what}, not {len(there)}"
                if first is not None:
                    difference = f"other {what}: {first[0]} where the task has {first[1]}"
                return f"it was learned on {difference}"
        return None


def write_network(
    folder: Path, stem: str, network: NetworkPolicy, *, within: Path | None = None, **content: Any
) -> None:
    """Write a network into two files; the JSON, which holds the hash of the weights, comes last.

    Parameters
    ----------
    folder, stem
        The files are ``stem.safetensors`` and ``stem.json`` in the folder.
    within
        Folder that the files must be in, with no link on the way. Default: any folder.
    content
        Fields of `NetworkPolicyContent`, except ``layers`` and ``sha256``.

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
    document = NetworkPolicyContent(
        **content,
        layers=[(weight.shape[0], weight.shape[1]) for weight in network.weights],
        sha256=hashlib.sha256(data).hexdigest(),
    )
    write_whole(folder / f"{stem}.safetensors", data, within=within)
    write_whole(
        folder / f"{stem}.json", format_document(schemas.NETWORK_POLICY, document), within=within
    )


def read_network(path: Path, *, within: Path | None = None) -> StoredNetwork:
    """Read a network.

    Parameters
    ----------
    path
        A ``policy.json`` or ``last.json``; the weights are in the same folder.
    within
        Folder that both files must be in, with no link on the way. Default: any folder.

    Raises
    ------
    OptionError
        If a file cannot be read, is damaged, or does not fit the other.
    """
    checked = read_checked(
        path, schemas.NETWORK_POLICY, NetworkPolicyContent, _REMEDY, within=within
    )
    network = build_from_weights(
        path.with_suffix(".safetensors"),
        _MOST_BYTES,
        checked.sha256,
        partial(_build_network, checked),
        document=path,
        remedy=_REMEDY,
        within=within,
    )
    return StoredNetwork(network, checked)


def _build_network(
    content: NetworkPolicyContent, arrays: Mapping[str, NDArray[Any]]
) -> NetworkPolicy:
    indices = range(len(content.layers))
    if len(arrays) != 2 * len(content.layers):
        raise ValueError(f"it holds {len(arrays)} arrays, not {2 * len(content.layers)}")
    weights = tuple(arrays[f"weight_{index}"] for index in indices)
    biases = tuple(arrays[f"bias_{index}"] for index in indices)
    if any(array.dtype != np.float32 for array in (*weights, *biases)):
        raise ValueError("its numbers are not float32")
    if [weight.shape for weight in weights] != list(content.layers):
        raise ValueError("its layers have other sizes")
    network = NetworkPolicy(weights, biases)
    if (network.inputs, network.actions) != (len(content.features), len(content.actions)):
        raise ValueError("its first or last layer does not fit the features or actions")
    return network
