"""Names as identifiers of another language: unique, always the same ones, and reversible."""

from __future__ import annotations

import json
import re
from collections.abc import Collection, Iterable, Iterator

_LONGEST = 60


class Identifiers:
    """Names with an identifier each: small letters, digits and single underscores.

    They depend on the names and their order alone, so that whoever knows the names can tell them
    from the identifiers again.

    Parameters
    ----------
    names
        Distinct ones; any text.
    reserved
        Words of the language, in small letters, that no identifier may be.
    prefix
        What every identifier begins with.
    """

    def __init__(
        self, names: Iterable[str], reserved: Collection[str] = (), prefix: str = ""
    ) -> None:
        self._by_name: dict[str, str] = {}
        self._by_identifier: dict[str, str] = {}
        for name in names:
            plain = prefix + _plain(name)
            found, number = plain, 1
            while found in self._by_identifier or found in reserved:
                number += 1
                found = f"{plain}_{number}"
            self._by_name[name] = found
            self._by_identifier[found] = name

    def __getitem__(self, name: str) -> str:
        return self._by_name[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._by_name)

    def name_of(self, identifier: str) -> str | None:
        """Return the name of an identifier, however its letters are; None of an unknown one."""
        return self._by_identifier.get(identifier.lower())

    def lines(self) -> list[str]:
        """Return for a comment which identifier stands for which name: ``pick_pcb = "..."``."""
        return [f"{identifier} = {quoted(name)}" for name, identifier in self._by_name.items()]


def quoted(text: str) -> str:
    """Return a text as JSON in plain ASCII on one line, which no comment's end can hide in."""
    return json.dumps(text).replace("*", "\\u002a").replace("\x7f", "\\u007f")


def _plain(name: str) -> str:
    plain = re.sub(r"[^a-z0-9]+", "_", name.lower())[:_LONGEST].strip("_")
    # The word of a name without any letter or digit of ASCII.
    return plain if plain[:1].isalpha() else f"x_{plain}".rstrip("_")
