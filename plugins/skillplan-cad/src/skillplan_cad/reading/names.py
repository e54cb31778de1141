"""Names of parts: encodings, control characters, names without meaning, common beginnings."""

from __future__ import annotations

import os
import re
import unicodedata
from collections.abc import Callable, Sequence
from pathlib import Path

# Labels that exporters give to instances without a name; Onshape's end in ``:V``, CATIA's begin
# with ``*``.
_LABEL = re.compile(
    r"(NAUO|nauo)?\d*|=>\[[\d:]*\]|NEXT_ASSEMBLY_USAGE_OCCURRENCE\d*|.{0,5}:V|\*[A-Z]{1,5}\d+",
    re.DOTALL,
)
# Names that any part could have, with the numbers that CAD adds.
_GENERIC = re.compile(
    r"((manifold[ _]*)?solid([ _]*(body|brep))?|bod(y|ies)|compound|shell|brep|parts?|component|"
    r"product|document|shape|object|mesh|volume|step|stl|unnamed|untitled|none|default|"
    r"(volumen|fest)?körper|bauteil|teil|"
    r"pièce|piece|corps|sólido|solido|cuerpo|corpo|pieza|実体|部品|实体|零件|open cascade.*)"
    r"[ _.:#<>()\[\]\d-]*",
    re.IGNORECASE,
)
# Ends of the common beginning of file names: the assembly's name of SolidWorks, and others, which
# two files may have in common by accident.
_DASH = " - "
_BREAK = re.compile(r"[ _.-]+")
_LEAST_FILES = 3
_MOST_CHARACTERS = 200
# OCCT drops names of instances without a plain character; this one is added, and removed again.
_MARK = "\u2060."
_FOREIGN = re.compile(rb"'((?:\\X2\\[0-9A-Fa-f]*\\X0\\|[\x80-\xff ])+)'")


def mark_foreign_names(content: bytes) -> bytes:
    """Return a STEP file in which each text has a plain character; `clean_name` removes it."""
    return _FOREIGN.sub(rb"'\1%b'" % _MARK.encode(), content)


def clean_name(text: str) -> str:
    """Return a name without characters that are not printable."""
    text = text.removesuffix(_MARK)
    if not text.isprintable():
        # Control characters, line separators, surrogates and private characters.
        text = "".join(
            "_" if unicodedata.category(letter) in ("Cc", "Cs", "Co", "Cn", "Zl", "Zp") else letter
            for letter in text
        )
    return text.strip()[:_MOST_CHARACTERS]


def is_label(name: str) -> bool:
    """Return whether a name is empty or a number of the exporter."""
    return _LABEL.fullmatch(name) is not None


def says_nothing(name: str) -> bool:
    """Return whether any part could have this name, such as ``SOLID`` or ``Part 1``."""
    return is_label(name) or _GENERIC.fullmatch(name) is not None


def find_common_beginning(names: Sequence[str]) -> str:
    """Return the assembly's name that CAD puts before all file names; empty if there is none.

    It ends in `` - ``, or at a word's end if three or more names go on with a letter.
    """
    if len(names) < 2:
        return ""
    first, last = min(names), max(names)
    length = next((n for n in range(len(first)) if last[n : n + 1] != first[n]), len(first))
    common = first[:length]
    end = common.rfind(_DASH)
    if end >= 0 and all(len(name) > end + len(_DASH) for name in names):
        return common[: end + len(_DASH)]
    if len(names) < _LEAST_FILES:
        return ""
    for gap in reversed(list(_BREAK.finditer(common))):
        rests = [name[gap.end() :] for name in names]
        if gap.start() and all(rest[:1].isalpha() and len(rest) > 1 for rest in rests):
            return common[: gap.end()]
    return ""


def decode_text(content: bytes) -> tuple[str, str]:
    """Return text of unknown encoding, and the encoding; that of most common letters if no UTF-8.

    Old CAD writes names in the code page of its machine, and no file states it.
    """
    try:
        return content.decode(), "UTF-8"
    except UnicodeDecodeError:
        pass
    best, text, encoding = -1.0, "", ""
    for candidate, is_common in _CODE_PAGES.items():
        try:
            decoded = content.decode(candidate)
        except UnicodeDecodeError:
            continue
        places = [place for place, letter in enumerate(decoded) if letter > "\x7f"]
        common = sum(is_common(decoded, place) for place in places)
        if common / len(places) > best:
            best, text, encoding = common / len(places), decoded, candidate
    if best <= 0:
        return content.decode("cp1252", "replace"), "cp1252"
    return text, encoding


def decode_file_name(path: Path) -> str:
    """Return the name of a file; other encodings than UTF-8 are recognised."""
    try:
        path.name.encode()
        return path.name
    except UnicodeEncodeError:
        return clean_name(decode_text(os.fsencode(path.name))[0])


def _has_lead(encoding: str, low: int, high: int) -> Callable[[str, int], bool]:
    """Return a test for the double bytes of the common letters of an encoding."""

    def is_common(text: str, place: int) -> bool:
        code = text[place].encode(encoding)
        return len(code) == 2 and low <= code[0] <= high and (encoding != "gbk" or code[1] > 0xA0)

    return is_common


def _is_accented(text: str, place: int) -> bool:
    """Return whether a letter is Latin next to a plain one, or a sign of drawings."""
    if text[place] in "\u00d8\u00b0\u00b1\u00b2\u00b3\u00b5":
        return True
    beside = text[max(place - 1, 0) : place] + text[place + 1 : place + 2]
    return text[place].isalpha() and any(letter.isascii() and letter.isalpha() for letter in beside)


def _is_kana_or_kanji(text: str, place: int) -> bool:
    return "\u3040" <= text[place] <= "\u30ff" or _IS_KANJI(text, place)


_IS_KANJI = _has_lead("cp932", 0x88, 0x97)
# Tests for common letters; the first of equally probable encodings is taken.
_CODE_PAGES: dict[str, Callable[[str, int], bool]] = {
    "gbk": _has_lead("gbk", 0xB0, 0xD7),
    "cp932": _is_kana_or_kanji,
    "big5": _has_lead("big5", 0xA4, 0xC6),
    "cp949": lambda text, place: "\uac00" <= text[place] <= "\ud7a3",
    "cp1252": _is_accented,
    "cp1251": lambda text, place: "\u0410" <= text[place] <= "\u044f",
}
