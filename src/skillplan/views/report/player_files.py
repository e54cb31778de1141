"""The page's style sheet, and the player's bundle where it has been built."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import resources

HOW_TO_GET = "make web builds it from the sources; released packages hold it"


@dataclass(frozen=True, slots=True)
class Player:
    """The player: its script, its style sheet, and the licences of what is bundled."""

    script: str
    style: str
    licences: str


def page_style() -> str:
    """Return the page's own style sheet."""
    return _text("style.css") or ""


def player() -> Player | None:
    """Return the player, or None where it has not been built."""
    script = _text("player", "player.js")
    if script is None:
        return None
    return Player(
        script, _text("player", "player.css") or "", _text("player", "LICENCES.txt") or ""
    )


def _text(*names: str) -> str | None:
    file = resources.files(__package__).joinpath(*names)
    return file.read_text("utf-8") if file.is_file() else None
