"""Where the player stands in the page, and what stands there without it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from skillplan.views.report.markup import Markup, join, note, tag
from skillplan.views.report.page import Section


def playback_section(
    playback: Mapping[str, Any] | None, still: Markup | None, missing: str = ""
) -> Section:
    """Return the section of the player.

    Parameters
    ----------
    playback
        A document ``skillplan.playback/1``; None where there is none.
    still
        A picture that stands there until the player has started.
    missing
        Why there is no playback, in words.
    """
    if playback is None:
        return Section("playback", "Playback", note(f"There is no playback: {missing}."))
    words = "Playing it in 3-D needs JavaScript and WebGL; all else on this page does not."
    inner = [still] if still is not None else []
    inner.append(tag("noscript", {}, note(words)))
    root = tag("div", {"id": "playback-root", "aria-label": playback["title"]}, *inner)
    said = str(playback.get("note") or "")
    if "not simulated" in said:
        # Also where no player says it.
        root = join([root, note(f"The motion is {said}.")])
    return Section("playback", "Playback", root)
