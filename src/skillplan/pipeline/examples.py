"""Task files that come with skillplan: in a checkout in ``configs/``, in a wheel in the package."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import skillplan
from skillplan.errors import OptionError, name_hint
from skillplan.files import yaml
from skillplan.files.regular_file import read_bytes

_PACKAGE = Path(skillplan.__file__).parent
CONFIG_FOLDERS = (_PACKAGE / "configs", _PACKAGE.parents[1] / "configs")
"""Folders that may hold them."""


def list_examples() -> dict[str, Path]:
    """Return the task files by their names without suffix, in alphabetical order."""
    paths = (path for folder in CONFIG_FOLDERS for path in folder.glob("*.yaml"))
    return dict(sorted((path.stem, path) for path in paths))


def read_example(name: str) -> tuple[str, dict[str, bytes]]:
    """Return the text of a task file, and the files that it names by their relative paths.

    The figures that tests verify (`expect`) are left out.

    Raises
    ------
    OptionError
        If there is none of this name.
    """
    examples = list_examples()
    if name not in examples:
        raise OptionError(f"There is no example {name!r}. {name_hint(name, examples)}")
    path = examples[name]
    text = yaml.read_text(path, path.name)
    data = yaml.parse(text, path.name).data
    named = {word for word in _list_words(data) if (path.parent / word).is_file()}
    kept, _, _ = text.partition("\nexpect:")
    paths = {word: path.parent / word for word in sorted(named)}
    files = {word: read_bytes(file, file.stat().st_size) for word, file in paths.items()}
    return kept.rstrip() + "\n", files


def _list_words(data: Any) -> Iterator[str]:
    """Yield all texts of a document that may be the name of a file."""
    if isinstance(data, str):
        if data and len(data) < 256 and "\n" not in data:
            yield data
    elif isinstance(data, dict | list):
        for item in data.values() if isinstance(data, dict) else data:
            yield from _list_words(item)
