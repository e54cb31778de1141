"""The decorator of functions that are compiled, once per machine.

What is compiled is kept beside the source where that can be written to, else in the user's cache
folder (numba's rule; ``NUMBA_CACHE_DIR`` names another). Where neither can be, it is compiled
anew in every process rather than not at all.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import ParamSpec, TypeVar, cast

from numba import njit

P = ParamSpec("P")
R = TypeVar("R")


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """Return the function compiled on its first call, from the cache if it has it.

    Arguments are arrays and numbers, and tuples of them. A change of a function in one file is
    not noticed by what was compiled of another: what calls each other stands together.
    """
    try:
        return cast(Callable[P, R], njit(cache=True)(function))
    except RuntimeError as error:
        if "cache" not in str(error):
            raise
        return cast(Callable[P, R], njit(function))
