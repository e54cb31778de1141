"""Listeners to the compilation of kernels; there are none unless a program adds one.

It imports nothing, so that a program can listen before it knows whether it needs numba.
"""

from __future__ import annotations

from collections.abc import Callable

_listeners: list[Callable[[str], None]] = []


def on_compilation(listener: Callable[[str], None]) -> Callable[[], None]:
    """Call a listener with the name of every kernel that is about to be compiled.

    A kernel that is loaded from the cache is not reported.

    Parameters
    ----------
    listener
        It may be called on any thread.

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
