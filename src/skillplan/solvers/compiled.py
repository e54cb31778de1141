"""The decorator of functions that are compiled, once per machine.

What is compiled is kept beside the source where that can be written to, else in the user's cache
folder (numba's rule; ``NUMBA_CACHE_DIR`` names another). Where neither can be, it is compiled
anew in every process rather than not at all.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import ParamSpec, TypeVar, cast

from numba import njit
from numba.core import event

from skillplan.solvers import compilation

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


class _Teller(event.Listener):
    """Tells of every kernel of this project that numba compiles."""

    def on_start(self, event: event.Event) -> None:
        """Tell of a kernel before it is compiled."""
        function = event.data["dispatcher"].py_func
        if function.__module__.startswith("skillplan"):
            compilation.tell(f"{function.__module__}.{function.__qualname__}")

    def on_end(self, event: event.Event) -> None:
        """Say nothing more."""


event.register("numba:compile", _Teller())  # type: ignore[no-untyped-call]
