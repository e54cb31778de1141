"""Relational policies as files: weights as safetensors, metadata as JSON. Neither contains code.

A policy has a folder of its own. ``relational.json`` is written last: a folder without it is not
finished.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from skillplan.errors import OptionError
from skillplan.files.atomic_file import write_whole
from skillplan.files.json_file import format_document, read_checked
from skillplan.files.safetensors_file import build_from_weights
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
    """Results of the policy on boards of its family that it was not trained on."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    boards: int = Field(ge=0, description="number of boards")
    completed: int = Field(ge=0, description="number of boards on which it reached the goal")
    proved: int = Field(ge=0, description="number of these whose optimum is proved")
    median_deviation: float | None = Field(description="deviation from the optimum, as a fraction")
    greatest_deviation: float | None = Field(description="as a fraction")


class RelationalContent(BaseModel):
    """Metadata of a policy: its learner, its boards, its features."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    solver: str
    options: dict[str, Any]
    family: str = Field(description="the training boards, such as generated:6-12")
    boards: int = Field(ge=1, description="number of training boards")
    seed: int = Field(ge=0)
    size: StoredSize
    element_features: list[str] = Field(description="features of every element, in order")
    pair_features: list[str] = Field(description="features of every pair, in order")
    trace: dict[str, Any] = Field(description="figures of the learning")
    trial: FamilyTrial | None = Field(description="null if the training was interrupted")
    wall_s: float = Field(ge=0)
    sha256: str = Field(description="hash of the file of weights")


@dataclass(frozen=True)
class StoredRelational:
    """A relational policy with its metadata."""

    policy: FamilyPolicy
    content: RelationalContent


def write_relational(folder: Path, policy: FamilyPolicy, **content: Any) -> RelationalContent:
    """Write a policy to a folder; the JSON document, which holds the hash, comes last.

    Parameters
    ----------
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
    text = format_document(schemas.RELATIONAL_POLICY, document)
    write_whole(folder / RELATIONAL, text, within=folder)
    return document


def read_relational(
    folder: Path, learner_of: Callable[[str], type[FamilyLearner]]
) -> StoredRelational:
    """Read the policy in a folder.

    Parameters
    ----------
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
    path = folder / RELATIONAL
    content = read_checked(
        path, schemas.RELATIONAL_POLICY, RelationalContent, _REMEDY, within=folder
    )
    plugin = learner_of(content.solver).Policy
    features = (list(plugin.element_features), list(plugin.pair_features))
    if features != (content.element_features, content.pair_features):
        raise OptionError(f"{path}: has other features than this skillplan. {_REMEDY}.")
    policy = build_from_weights(
        folder / WEIGHTS,
        _MOST_BYTES,
        content.sha256,
        partial(plugin.build, content.size.model_dump()),
        document=path,
        remedy=_REMEDY,
        within=folder,
    )
    return StoredRelational(policy, content)
