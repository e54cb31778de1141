"""The decorator of kernels: numba compiles them once per machine.

The compiled code is kept beside the source where that folder can be written to, else in the
user's cache folder (numba's rule; ``NUMBA_CACHE_DIR`` names another). Where neither can be
written to, every process compiles again.
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

    It leaves the interpreter alone while it runs, so that threads may run several at once.

    Arguments are arrays and numbers, and tuples of them. numba does not notice when a function
    changes that a kernel of another file calls: keep those that call each other in one file.
    """
    try:
        return cast(Callable[P, R], njit(cache=True, nogil=True)(function))
    except RuntimeError as error:
        if "cache" not in str(error):
            raise
        return cast(Callable[P, R], njit(nogil=True)(function))


class _CompilationListener(event.Listener):
    """Reports every kernel of this project that numba compiles."""

    def on_start(self, event: event.Event) -> None:
        """Report a kernel before it is compiled."""
        function = event.data["dispatcher"].py_func
        if function.__module__.startswith("skillplan"):
            compilation.notify(f"{function.__module__}.{function.__qualname__}")

    def on_end(self, event: event.Event) -> None:
        """Report nothing."""


event.register("numba:compile", _CompilationListener())  # type: ignore[no-untyped-call]
