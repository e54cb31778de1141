"""Silences what C code prints."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def quiet_output() -> Iterator[None]:
    """Send what is written to file descriptors 1 and 2, also by C code, nowhere."""
    sys.stdout.flush()
    sys.stderr.flush()
    kept = {}
    for descriptor in (1, 2):
        try:
            kept[descriptor] = os.dup(descriptor)
        except OSError:
            # It is closed: there is nothing to be kept clean.
            continue
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        for descriptor in kept:
            os.dup2(nowhere, descriptor)
        yield
    finally:
        for descriptor, copy in kept.items():
            os.dup2(copy, descriptor)
            os.close(copy)
        os.close(nowhere)
