"""A line on stderr where kernels are compiled: it says once why the user has to wait."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager

from skillplan.cli.writing import tell
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
    announced: list[str] = []

    def announce(kernel: str) -> None:
        if not announced:
            tell(NOTICE)
        announced.append(kernel)

    done = on_compilation(announce)
    try:
        yield
    finally:
        done()
