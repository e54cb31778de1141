"""Where a result comes from: what has to be known to make the same model again."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Origin:
    """The task file and how it was read.

    Parameters
    ----------
    file
        Its path as the user gave it.
    part
        The task meant, of a file that describes a chain; None for the only one or all.
    changes
        Key path to YAML value: what the file was read as if it held.
    physics, collision
        Names of the back ends that the user chose; None and empty for the file's choice.
    options
        Plugin name to option values that the user gave.
    screening
        Whether geometry was asked before anything was executed.
    """

    file: str
    part: str | None = None
    changes: Mapping[str, str] = field(default_factory=dict)
    physics: str | None = None
    collision: tuple[str, ...] = ()
    options: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    screening: bool = False

    def given(self) -> list[str]:
        """Return the options that changed how the file was read, as on a command line."""
        return [
            *(f"--set {key}={value}" for key, value in self.changes.items()),
            *([] if self.part is None else [f"--part {self.part}"]),
            *([] if self.physics is None else [f"--physics {self.physics}"]),
            *([f"--collision {','.join(self.collision)}"] if self.collision else []),
            *(
                f"-O {plugin}.{key}={value}"
                for plugin, values in self.options.items()
                for key, value in values.items()
            ),
        ]

    def document(self) -> dict[str, Any]:
        """Return the origin as JSON values."""
        return {
            "file": self.file,
            "part": self.part,
            "set": dict(self.changes),
            "physics": self.physics,
            "collision": list(self.collision),
            "options": {plugin: dict(values) for plugin, values in self.options.items()},
            "screening": self.screening,
        }
