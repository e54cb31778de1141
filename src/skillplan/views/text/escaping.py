r"""Characters that a terminal would obey, or that nobody sees, written out as ``\x1b``."""

from __future__ import annotations

import re
import unicodedata
from functools import cache

# Control, format (bidirectional, zero-width), lone surrogates, line and paragraph separators.
_CATEGORIES = frozenset(("Cc", "Cf", "Cs", "Zl", "Zp"))
# Letters and marks without ink, and what Unicode reserves for more of them (DerivedCoreProperties,
# Default_Ignorable_Code_Point); the selectors of emoji and of Han variants among them are kept.
_INVISIBLE = frozenset((0x34F, 0x115F, 0x1160, 0x17B4, 0x17B5, 0x3164, 0xFFA0, 0x2065))
_UNUSUAL = re.compile(r"[^\n\t\x20-\x7e]")


def escaped(text: str) -> str:
    """Return a text that says what it holds, and moves, colours, reverses and hides nothing.

    Line breaks and tabs stay.

    Parameters
    ----------
    text
        From a document, a file name, an exception, a verdict: from anybody.
    """
    return _UNUSUAL.sub(lambda found: _shown(found.group()), text)


@cache
def _shown(character: str) -> str:
    code = ord(character)
    tag = 0xE0000 <= code <= 0xE00FF or 0xE01F0 <= code <= 0xE0FFF
    reserved = 0xFFF0 <= code <= 0xFFF8
    invisible = tag or reserved or code in _INVISIBLE
    if not invisible and unicodedata.category(character) not in _CATEGORIES:
        return character
    if code < 0x100:
        return f"\\x{code:02x}"
    return f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:08x}"
