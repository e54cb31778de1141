"""Relational policies as files: weights as safetensors, what they are for as JSON; neither is code.

They lie in a folder of their own, ``relational.json`` last: a folder without it was not finished.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from skillplan.errors import OptionError
from skillplan.files.atomic_file import write_whole
from skillplan.files.json_file import json_text, read_checked
from skillplan.files.safetensors_file import read_safetensors
from skillplan.records import schemas
from skillplan.records.stored.result_folder import RELATIONAL
from skillplan.solvers.learning.family_learner import FamilyLearner, FamilyPolicy

WEIGHTS = "relational.safetensors"

_REMEDY = "Train again, into a new folder"
_MOST_BYTES = 64 * 1024 * 1024


class StoredSize(BaseModel):
    """Dimensions of the network."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    width: int = Field(ge=1, le=4096)
    heads: int = Field(ge=1, le=64)
    layers: int = Field(ge=1, le=64)
    pair_width: int = Field(ge=1, le=4096)


class FamilyTrial(BaseModel):
    """What became of the policy on boards of its family that it has not learned on."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    boards: int = Field(ge=0, description="how many were tried")
    completed: int = Field(ge=0, description="on how many it reached the goal")
    proved: int = Field(ge=0, description="of how many of those the optimum was proved")
    median_deviation: float | None = Field(description="of those from the optimum, as a fraction")
    greatest_deviation: float | None = Field(description="of those, as a fraction")


class RelationalContent(BaseModel):
    """What the JSON file says: who learned the network, on what, and what it sees."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    solver: str
    options: dict[str, Any]
    family: str = Field(description="the boards that were learned on, such as generated:6-12")
    boards: int = Field(ge=1, description="how many of them")
    seed: int = Field(ge=0)
    size: StoredSize
    element_features: list[str] = Field(description="what is seen of every element, in order")
    pair_features: list[str] = Field(description="what is seen of every pair, in order")
    trace: dict[str, Any] = Field(description="figures of the learning")
    trial: FamilyTrial | None = Field(description="null where it was interrupted before")
    wall_s: float = Field(ge=0)
    sha256: str = Field(description="hash of the file of weights beside it")


@dataclass(frozen=True)
class StoredRelational:
    """A relational policy as read from its files.

    Parameters
    ----------
    policy
        The policy.
    content
        The JSON document beside it.
    """

    policy: FamilyPolicy
    content: RelationalContent


def write_relational(folder: Path, policy: FamilyPolicy, **content: Any) -> RelationalContent:
    """Write a policy to a folder; the JSON document, which holds the hash, comes last.

    Parameters
    ----------
    folder
        Existing folder.
    policy
        The policy.
    content
        Fields of `RelationalContent` that do not follow from the policy.

    Raises
    ------
    OSError
        If a file cannot be written.
    """
    from safetensors.numpy import save

    arrays = {name: np.ascontiguousarray(array) for name, array in sorted(policy.weights.items())}
    data = save(arrays)
    document = RelationalContent(
        **content,
        size=StoredSize(**policy.dimensions),
        element_features=list(policy.element_features),
        pair_features=list(policy.pair_features),
        sha256=hashlib.sha256(data).hexdigest(),
    )
    write_whole(folder / WEIGHTS, data, within=folder)
    text = json_text(schemas.RELATIONAL_POLICY, document)
    write_whole(folder / RELATIONAL, text, within=folder)
    return document


def read_relational(
    folder: Path, learner_of: Callable[[str], type[FamilyLearner]]
) -> StoredRelational:
    """Return the policy in a folder.

    Parameters
    ----------
    folder
        Folder of the policy.
    learner_of
        Returns the class of a solver by its name.

    Raises
    ------
    OptionError
        If a file cannot be read or is damaged, the two files do not belong together, or the
        policy has other features than the installed solver.
    PluginError
        If the solver that learned the policy is missing or broken.
    """
    path, weights = folder / RELATIONAL, folder / WEIGHTS
    content = read_checked(
        path, schemas.RELATIONAL_POLICY, RelationalContent, _REMEDY, within=folder
    )
    plugin = learner_of(content.solver).Policy
    features = (list(plugin.element_features), list(plugin.pair_features))
    if features != (content.element_features, content.pair_features):
        raise OptionError(f"{path}: sees other features than this skillplan shows. {_REMEDY}.")
    try:
        data, _ = read_safetensors(weights, _MOST_BYTES, within=folder)
    except OSError as error:
        raise OptionError(f"{weights}: cannot be read: {error.strerror}. {_REMEDY}.") from None
    except ValueError as error:
        raise OptionError(f"{weights}: is damaged: {error}. {_REMEDY}.") from None
    if hashlib.sha256(data).hexdigest() != content.sha256:
        raise OptionError(f"{weights}: is damaged: it is not what {path} vouches for. {_REMEDY}.")
    try:
        policy = _load_policy(data, content.size, plugin)
    except ValueError as error:
        raise OptionError(f"{weights}: is damaged: {str(error).rstrip('.')}. {_REMEDY}.") from None
    return StoredRelational(policy, content)


def _load_policy(data: bytes, size: StoredSize, plugin: type[FamilyPolicy]) -> FamilyPolicy:
    from safetensors import SafetensorError
    from safetensors.numpy import load

    try:
        return plugin.build(size.model_dump(), load(data))
    except SafetensorError as error:
        raise ValueError(str(error)) from None
