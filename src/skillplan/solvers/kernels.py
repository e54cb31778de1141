"""Compiled kernels: the decorator that compiles them once per machine, and its listeners.

numba keeps the compiled code beside the source, or in the user's cache folder if it cannot write
there (``NUMBA_CACHE_DIR`` names another). If it can write to neither, every process compiles
again. This module imports numba with the first kernel only, so that programs can listen without it.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import ParamSpec, TypeVar, cast

P = ParamSpec("P")
R = TypeVar("R")

_listeners: list[Callable[[str], None]] = []


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """Return a function that is compiled, or loaded from the cache, on its first call.

    It releases the interpreter while it runs, so threads may run several kernels at once.
    Arguments are arrays, numbers and tuples of them. numba does not notice a change of a kernel
    in another file: keep kernels that call each other in one file.
    """
    from numba import njit

    _report_compilations()
    try:
        return cast(Callable[P, R], njit(cache=True, nogil=True)(function))
    except RuntimeError as error:
        if "cache" not in str(error):
            raise
        return cast(Callable[P, R], njit(nogil=True)(function))


def on_compilation(listener: Callable[[str], None]) -> Callable[[], None]:
    """Call a listener with the name of every kernel before it is compiled.

    Parameters
    ----------
    listener
        Called on any thread. Kernels from the cache are not reported.

    Returns
    -------
    callable
        Removes the listener.
    """
    _listeners.append(listener)
    return lambda: _listeners.remove(listener)


def notify(kernel: str) -> None:
    """Report to all listeners that a kernel is about to be compiled."""
    for listener in list(_listeners):
        listener(kernel)


@cache
def _report_compilations() -> None:
    """Have numba report the kernels of this project that it compiles."""
    from numba.core import event

    class CompilationListener(event.Listener):
        def on_start(self, event: event.Event) -> None:
            function = event.data["dispatcher"].py_func
            if function.__module__.startswith("skillplan"):
                notify(f"{function.__module__}.{function.__qualname__}")

        def on_end(self, event: event.Event) -> None:
            pass

    event.register("numba:compile", CompilationListener())  # type: ignore[no-untyped-call]
