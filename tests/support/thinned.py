"""Parameters of which only some are in every run."""

from collections.abc import Iterable
from typing import Any

import pytest


def thinned(values: Iterable[Any], *kept: Any, why: str = "two others in every run") -> list[Any]:
    """Return parameters of which only those kept are in every run; a tuple is several values."""
    slow = pytest.mark.slow(reason=why)
    return [
        one
        if one in kept
        else pytest.param(*(one if isinstance(one, tuple) else (one,)), marks=slow)
        for one in values
    ]
