"""Who is told when kernels have to be compiled: nobody, unless a program wants to be.

It imports nothing, so that a program can ask to be told before it knows whether it needs numba.
"""

from __future__ import annotations

from collections.abc import Callable

_listeners: list[Callable[[str], None]] = []


def on_compilation(listener: Callable[[str], None]) -> Callable[[], None]:
    """Have a listener called with the name of every kernel that is about to be compiled.

    One that is kept from an earlier time is loaded, not compiled, and not told of.

    Parameters
    ----------
    listener
        It may be called on any thread.

    Returns
    -------
    callable
        Ends it.
    """
    _listeners.append(listener)
    return lambda: _listeners.remove(listener)


def tell(kernel: str) -> None:
    """Tell all listeners that a kernel is about to be compiled."""
    for listener in list(_listeners):
        listener(kernel)
