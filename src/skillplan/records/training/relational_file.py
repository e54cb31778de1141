"""Relational policies as files: weights as safetensors, what they are for as JSON; neither is code.

They lie in a folder of their own, ``relational.json`` last: a folder without it was not finished.
"""

from __future__ import annotations

import hashlib
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
from skillplan.solvers.relational.element_view import ELEMENT_FEATURES, PAIR_FEATURES
from skillplan.solvers.relational.relational_network import NetworkSize, RelationalNetwork

WEIGHTS = "relational.safetensors"

_REMEDY = "Train again, into a new folder"
_MOST_BYTES = 64 * 1024 * 1024


class StoredSize(BaseModel):
    """How large the network is; see `NetworkSize`."""

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
    network
        What acts.
    content
        What it is for.
    """

    network: RelationalNetwork
    content: RelationalContent


def write_relational(folder: Path, network: RelationalNetwork, **content: Any) -> RelationalContent:
    """Write a policy into a folder; the JSON, which vouches for the weights, comes last.

    Parameters
    ----------
    folder
        Where to; it must be there.
    network
        What acts.
    content
        Fields of `RelationalContent`, but for those that follow from the network.

    Raises
    ------
    OSError
        If a file cannot be written.
    """
    from safetensors.numpy import save

    arrays = {name: np.ascontiguousarray(one) for name, one in sorted(network.arrays.items())}
    data = save(arrays)
    size = network.size
    said = RelationalContent(
        **content,
        size=StoredSize(
            width=size.width, heads=size.heads, layers=size.layers, pair_width=size.pair_width
        ),
        element_features=list(ELEMENT_FEATURES),
        pair_features=list(PAIR_FEATURES),
        sha256=hashlib.sha256(data).hexdigest(),
    )
    write_whole(folder / WEIGHTS, data, within=folder)
    text = json_text(schemas.RELATIONAL_POLICY, said)
    write_whole(folder / RELATIONAL, text, within=folder)
    return said


def read_relational(folder: Path) -> StoredRelational:
    """Return the policy in a folder.

    Raises
    ------
    OptionError
        If a file cannot be read, is none that `write_relational` wrote, does not fit the other,
        or the policy sees other features than this skillplan shows.
    """
    path, weights = folder / RELATIONAL, folder / WEIGHTS
    said = read_checked(path, schemas.RELATIONAL_POLICY, RelationalContent, _REMEDY, within=folder)
    seen = (said.element_features, said.pair_features)
    if seen != (list(ELEMENT_FEATURES), list(PAIR_FEATURES)):
        raise OptionError(f"{path}: sees other features than this skillplan shows. {_REMEDY}.")
    try:
        data, _ = read_safetensors(weights, _MOST_BYTES, within=folder)
    except OSError as error:
        raise OptionError(f"{weights}: cannot be read: {error.strerror}. {_REMEDY}.") from None
    except ValueError as error:
        raise OptionError(f"{weights}: is damaged: {error}. {_REMEDY}.") from None
    if hashlib.sha256(data).hexdigest() != said.sha256:
        raise OptionError(f"{weights}: is damaged: it is not what {path} vouches for. {_REMEDY}.")
    try:
        network = _network(data, NetworkSize(**said.size.model_dump()))
    except ValueError as error:
        raise OptionError(f"{weights}: is damaged: {str(error).rstrip('.')}. {_REMEDY}.") from None
    return StoredRelational(network, said)


def _network(data: bytes, size: NetworkSize) -> RelationalNetwork:
    from safetensors import SafetensorError
    from safetensors.numpy import load

    try:
        return RelationalNetwork(size, load(data))
    except SafetensorError as error:
        raise ValueError(str(error)) from None
