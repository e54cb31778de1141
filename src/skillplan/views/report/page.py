"""The page: one file without network access, whose policy allows only its own content."""

from __future__ import annotations

import base64
import hashlib
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from typing import Any

from skillplan import __version__
from skillplan.views.report.markup import Markup, join, tag

HOW_TO_GET = "make web builds it from the sources; released packages hold it"


@dataclass(frozen=True, slots=True)
class Player:
    """The player: script, style sheet, and licences of bundled libraries."""

    script: str
    style: str
    licences: str


def read_page_style() -> str:
    """Return the page's own style sheet."""
    return _read_text("style.css") or ""


def load_player() -> Player | None:
    """Return the player, or None if it has not been built."""
    script = _read_text("player", "player.js")
    if script is None:
        return None
    return Player(
        script, _read_text("player", "player.css") or "", _read_text("player", "LICENCES.txt") or ""
    )


def _read_text(*names: str) -> str | None:
    file = resources.files(__package__).joinpath(*names)
    return file.read_text("utf-8") if file.is_file() else None


_CLOSING = re.compile(r"</(?=script)", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class Section:
    """A section of a chapter: anchor, heading and content."""

    name: str
    heading: str
    content: Markup


@dataclass(frozen=True, slots=True)
class Chapter:
    """The chapter on one input.

    Parameters
    ----------
    name
        Prefix of anchors, unique in the page.
    lead
        Summary in a sentence or two, with figures.
    """

    name: str
    heading: str
    lead: Markup
    sections: Sequence[Section]


def render_page(
    title: str,
    chapters: Sequence[Chapter],
    playback: Mapping[str, Any] | None = None,
    player: Player | None = None,
) -> str:
    """Return the page.

    Parameters
    ----------
    playback
        Document ``skillplan.playback/1``; None for none.
    player
        The player; None if it has not been built.
    """
    style = read_page_style() + ("" if player is None else player.style)
    script = "" if player is None or playback is None else _escape_script(player.script)
    scripts = [_compute_digest(script)] if script else []
    policy = "; ".join(
        [
            "default-src 'none'",
            f"script-src {' '.join(scripts) or chr(39) + 'none' + chr(39)}",
            f"style-src {_compute_digest(style)}",
            "img-src data:",
            "base-uri 'none'",
            "form-action 'none'",
        ]
    )
    head = tag(
        "head",
        {},
        tag("meta", {"charset": "utf-8"}),
        tag("meta", {"http-equiv": "Content-Security-Policy", "content": policy}),
        tag("meta", {"name": "viewport", "content": "width=device-width, initial-scale=1"}),
        tag("meta", {"name": "color-scheme", "content": "light dark"}),
        tag("meta", {"name": "generator", "content": f"skillplan {__version__}"}),
        tag("title", {}, title),
        tag("style", {}, Markup(style)),
    )
    data = Markup("")
    if playback is not None and player is not None:
        attributes = {"type": "application/json", "id": "playback"}
        data = tag("script", attributes, Markup(embed_json(playback)))
        data = join([data, tag("script", {}, Markup(script))])
    body = tag(
        "body",
        {},
        _build_skip_link(),
        _build_header(title, chapters),
        _build_main(chapters),
        _build_footer(player),
        data,
    )
    return f"<!doctype html>\n{tag('html', {'lang': 'en'}, head, body)}\n"


def embed_json(document: Mapping[str, Any]) -> str:
    """Return a document as JSON that is safe within HTML.

    Raises
    ------
    ValueError
        If a number is not finite.
    """
    text = json.dumps(document, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _escape_script(script: str) -> str:
    """Return a script with closing tags escaped, which keeps the meaning of its strings."""
    return _CLOSING.sub(r"<\\/", script).replace("<!--", "<\\!--")


def _compute_digest(content: str) -> str:
    digest = base64.b64encode(hashlib.sha256(content.encode()).digest()).decode("ascii")
    return f"'sha256-{digest}'"


def _build_skip_link() -> Markup:
    return tag("a", {"class": "skip", "href": "#content"}, "Skip to the content")


def _build_header(title: str, chapters: Sequence[Chapter]) -> Markup:
    links = [
        tag("li", {}, tag("a", {"href": f"#{chapter.name}-{section.name}"}, section.heading))
        for chapter in chapters
        for section in chapter.sections
    ]
    if len(chapters) > 1:
        links = [
            tag("li", {}, tag("a", {"href": f"#{chapter.name}"}, chapter.heading))
            for chapter in chapters
        ]
    nav = tag("nav", {"aria-label": "Contents"}, tag("ul", {}, *links))
    brand = tag("p", {"class": "brand"}, "skillplan report")
    return tag("header", {"class": "top"}, brand, tag("h1", {}, title), nav)


def _build_main(chapters: Sequence[Chapter]) -> Markup:
    articles = []
    several = len(chapters) > 1
    for chapter in chapters:
        inner: list[Markup] = []
        if several:
            inner.append(tag("h2", {}, chapter.heading))
        inner.append(chapter.lead)
        for section in chapter.sections:
            name = f"{chapter.name}-{section.name}"
            heading = tag("h3" if several else "h2", {"id": f"{name}-h"}, section.heading)
            attributes = {"id": name, "aria-labelledby": f"{name}-h", "class": "card"}
            inner.append(tag("section", attributes, heading, section.content))
        articles.append(tag("article", {"id": chapter.name}, *inner))
    return tag("main", {"id": "content"}, *articles)


def _build_footer(player: Player | None) -> Markup:
    words = tag(
        "p",
        {},
        f"Written by skillplan {__version__}. The page is complete: it needs no network and loads "
        "nothing.",
    )
    if player is None or not player.licences:
        return tag("footer", {}, words)
    licences = tag(
        "details", {}, tag("summary", {}, "Licences of the player"), tag("pre", {}, player.licences)
    )
    return tag("footer", {}, words, licences)
