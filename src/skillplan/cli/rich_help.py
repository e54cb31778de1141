"""Typer's printing of help by rich, loaded without what our help never shows.

``typer.rich_utils`` imports rich's Markdown and traceback, with all of markdown-it and pygments:
more than half of the time of ``skillplan --help``. Our help is rich markup, and our errors are
reported by `skillplan.cli.error_report`, so that neither is ever called.
"""

from __future__ import annotations

import importlib
import sys
from types import ModuleType
from typing import Any

MODULE = "typer.rich_utils"
# Module to the one class that Typer takes from it.
UNUSED = {"rich.markdown": "Markdown", "rich.traceback": "Traceback"}


class _Unloaded(ModuleType):
    """Stands for a module while another imports a class of it that is never called."""

    def __getattr__(self, name: str) -> Any:
        if name == UNUSED[self.__name__]:
            return type(name, (), {})
        if name.startswith("__"):
            raise AttributeError(name)
        sys.modules.pop(self.__name__, None)
        return getattr(importlib.import_module(self.__name__), name)


def load() -> ModuleType:
    """Return Typer's module; whoever imports `UNUSED` afterwards gets the real ones."""
    if MODULE in sys.modules:
        return sys.modules[MODULE]
    placed = {name: _Unloaded(name) for name in UNUSED if name not in sys.modules}
    sys.modules.update(placed)
    try:
        return importlib.import_module(MODULE)
    finally:
        for name, module in placed.items():
            if sys.modules.get(name) is module:
                del sys.modules[name]
