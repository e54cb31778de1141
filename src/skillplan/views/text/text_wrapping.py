"""Text in lines of a given width: broken between words, else where a list or a name allows it."""

from __future__ import annotations

import re
from collections.abc import Sequence

from rich.cells import cell_len, chop_cells

from skillplan.views.text.escaping import escaped

# A line may end after these; a sequence of actions, a path and a sum of facts have no blanks.
_AFTER_LIST = re.compile(r"(?<=[,;/+|])")
_AFTER_NAME = re.compile(r"(?<=[,;/+|_.:=-])|(?=[(\[])")
_NOTE_LABEL = re.compile(r"\S{1,24}( \S+)?\s{2,}")


def printable(text: str) -> str:
    """Return a text as `escaped` has it; a tab becomes a space."""
    return escaped(text.replace("\t", " "))


def text_width(text: str) -> int:
    """Return how many columns of a terminal the widest line of a text takes."""
    return max(cell_len(line) for line in text.split("\n"))


def longest_piece(text: str, *, break_names: bool) -> int:
    """Return how wide a column must be for a text, if its lines may end only where it reads well.

    Parameters
    ----------
    text
        Of one cell.
    break_names
        Whether a line may also end within a name, as after the hyphen of ``monte-carlo``.
    """
    return max((cell_len(p) for p in _pieces(text, break_names=break_names)), default=0)


def wrapped(text: str, width: int, hang: int = 0) -> list[str]:
    """Return a text in lines.

    Parameters
    ----------
    text
        With line breaks where there must be some.
    width
        The most columns of a line, >= 1.
    hang
        How many blanks the second and every further line begins with; fewer where the width is
        too small for them.
    """
    hang = min(hang, width // 2)
    lines: list[str] = []
    for line in text.split("\n"):
        if cell_len(line) <= (width if not lines else width - hang):
            lines.append(line if not lines else " " * hang + line)
        else:
            lines += _broken(line, width, hang, first=not lines)
    return lines


def wrapped_note(note: str, width: int) -> list[str]:
    """Return a note in lines that hang under its text, which begins behind a label."""
    label = _NOTE_LABEL.match(note)
    margin = len(note) - len(note.lstrip(" "))
    return wrapped(note, width, label.end() if label else margin or 2)


def _broken(line: str, width: int, hang: int, *, first: bool) -> list[str]:
    """Return a line that is too wide as several."""
    body = line.lstrip(" ")
    start = line[: len(line) - len(body)][: width // 2] if first else " " * hang
    lines, current, begun = [], start, False
    for word in _words(body, width - max(hang, len(start))):
        room = width - cell_len(current)
        space = " " if begun and not word.glued else ""
        if cell_len(word.text) + len(space) <= room:
            current += space + word.text
        else:
            lines.append(current.rstrip(" "))
            current = " " * hang + word.text
        begun = True
    return [*lines, current.rstrip(" ")]


class _Word:
    """A piece of a line, and whether it follows the one before without a space."""

    __slots__ = ("glued", "text")

    def __init__(self, text: str, *, glued: bool) -> None:
        self.text, self.glued = text, glued


def _words(body: str, room: int) -> list[_Word]:
    """Return the pieces of a line, none wider than the room for it.

    Blanks between words are kept, but for one.
    """
    words: list[_Word] = []
    for gap, word in re.findall(r"( *)([^ ]+)", body):
        pieces = _fitting(word, room)
        if words and len(gap) > 1 and len(gap) + cell_len(pieces[0]) <= room:
            pieces[0] = gap[1:] + pieces[0]
        words.append(_Word(pieces[0], glued=not gap))
        words += [_Word(piece, glued=True) for piece in pieces[1:]]
    return words


def _fitting(word: str, room: int) -> list[str]:
    """Return a word in pieces that fit: whole, else broken in lists, in names, or anywhere."""
    if cell_len(word) <= room:
        return [word]
    for breaks in (_AFTER_LIST, _AFTER_NAME):
        pieces = [piece for piece in breaks.split(word) if piece]
        if all(cell_len(piece) <= room for piece in pieces):
            return pieces
    return [cut for piece in pieces for cut in chop_cells(piece, max(1, room))]


def _pieces(text: str, *, break_names: bool) -> Sequence[str]:
    breaks = _AFTER_NAME if break_names else _AFTER_LIST
    return [piece for word in text.split() for piece in breaks.split(word)]
