"""What YAML files hold, read once and by the library that is written in C."""

from functools import cache
from pathlib import Path
from typing import Any

import yaml

LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


def yaml_text(text: str) -> Any:
    """Return what a text holds; nothing but data is made of it."""
    return yaml.load(text, Loader=LOADER)


@cache
def yaml_data(path: Path) -> Any:
    """Return what a file holds: the same object for whoever asks, so that none may change it."""
    return yaml_text(path.read_text("utf-8"))
