"""Options that say when a search ends by itself, beside its time limit."""

from __future__ import annotations

import re
from typing import Any

import click

from skillplan.cli.options import PositiveSeconds

_LEAST_BYTES = 64 * 1024**2
_UNITS = {
    "": 1,
    "B": 1,
    "KB": 10**3,
    "MB": 10**6,
    "GB": 10**9,
    "TB": 10**12,
    "KIB": 2**10,
    "MIB": 2**20,
    "GIB": 2**30,
    "TIB": 2**40,
}
_SIZE = re.compile(r"(\d+(?:\.\d+)?) ?([A-Za-z]*)", re.ASCII)


class MemorySize(click.ParamType[int]):
    """A size of memory in bytes, or with a unit such as GiB or MB; 64MiB at least."""

    name = "size"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int:
        """Return the bytes."""
        if isinstance(value, int):
            return value
        found = _SIZE.fullmatch(value)
        factor = None if found is None else _UNITS.get(found[2].upper())
        if found is None or factor is None:
            self.fail(
                f"{value!r} is no size of memory. Write it as 2GiB, 512MiB, 1.5GB or in bytes.",
                param,
                ctx,
            )
        if len(found[1]) > 24:
            self.fail("is more memory than any machine has.", param, ctx)
        size = int(float(found[1]) * factor)
        if size < _LEAST_BYTES:
            self.fail(f"must be at least 64MiB, not {value}.", param, ctx)
        return size


stall_option = click.option(
    "--stall",
    "stall_s",
    type=PositiveSeconds(),
    metavar="S",
    help="Stop once there is a plan and neither cost nor bound has improved for S seconds.",
)

memory_limit_option = click.option(
    "--memory-limit",
    "memory_limit_bytes",
    type=MemorySize(),
    metavar="SIZE",
    help="Stop with the best plan, its bound and its gap before the process, and those that "
    "search beside it, hold more memory than this, such as 2GiB or 512MiB; 64MiB at least.",
)
