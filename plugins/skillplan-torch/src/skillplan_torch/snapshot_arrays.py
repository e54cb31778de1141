"""Arrays of a snapshot, checked before they are taken over."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

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
