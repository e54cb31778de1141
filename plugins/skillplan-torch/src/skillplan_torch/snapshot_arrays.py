"""Arrays of a snapshot, checked before they are taken over."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray


def fitting(arrays: Mapping[str, NDArray[Any]], name: str, shape: tuple[int, ...]) -> NDArray[Any]:
    """Return an array of a snapshot, having seen that it is there and of this shape.

    Raises
    ------
    ValueError
        If not.
    """
    if name not in arrays or arrays[name].shape != shape:
        raise ValueError(f"The snapshot's {name} is missing or of another shape.")
    return arrays[name]


def copies(name: str, own: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Return copies of somebody's arrays, to be read by `take_over`.

    Parameters
    ----------
    name
        What their names in the snapshot begin with.
    own
        The arrays, by the rest of their names.
    """
    return {f"{name}.{key}": array.copy() for key, array in own.items()}


def take_over(
    name: str, own: Mapping[str, NDArray[Any]], arrays: Mapping[str, NDArray[Any]]
) -> None:
    """Write into somebody's arrays what `copies` returned of them.

    Raises
    ------
    ValueError
        If one is missing or of another shape.
    """
    for key, array in own.items():
        np.copyto(array, fitting(arrays, f"{name}.{key}", array.shape))
