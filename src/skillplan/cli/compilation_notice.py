"""A line on stderr where kernels are compiled: a user who waits is told why, once."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager

from skillplan.solvers.compilation import on_compilation

NOTICE = (
    "skillplan: compiling kernels, once on this machine: up to half a minute "
    "('skillplan warm-up' compiles them all ahead)"
)


@contextmanager
def compilation_announced() -> Iterator[None]:
    """Announce on a terminal the first kernel that is compiled meanwhile."""
    if not sys.stderr.isatty():
        yield
        return
    told: list[str] = []

    def announce(kernel: str) -> None:
        if not told:
            print(NOTICE, file=sys.stderr)
        told.append(kernel)

    done = on_compilation(announce)
    try:
        yield
    finally:
        done()
