"""Parts of a STEP file, read by OCCT through cascadio."""

from __future__ import annotations

import re
import zlib
from pathlib import Path

from skillplan.errors import OptionError
from skillplan.files.regular_file import RefusedFile, read_bytes
from skillplan_cad.reading.glb import parts_of
from skillplan_cad.reading.occt import tessellated
from skillplan_cad.reading.raw_part import RawProduct

SUFFIXES = (".step", ".stp", ".step.gz", ".stp.gz", ".stpz")
MOST_BYTES = 128 * 1024 * 1024
_BEGINS, _ENDS = b"ISO-10303-21;", b"END-ISO-10303-21;"
_ASSEMBLE = "Save it from CAD as STEP (AP203, AP214 or AP242)"


def is_step(path: Path) -> bool:
    """Whether a file is one of STEP by its name."""
    return path.name.lower().endswith(SUFFIXES)


def read_step(path: Path, chord_m: float) -> RawProduct:
    """Return the parts of a STEP file.

    Parameters
    ----------
    path
        The file; it may be compressed by gzip.
    chord_m
        How far triangles may lie from curved faces.

    Raises
    ------
    OptionError
        If it cannot be read, is no STEP file, is cut off, or holds no solids; or if OCCT
        crashes on it.
    """
    content = _content(path)
    unit = _unit(content)
    name, parts = parts_of(tessellated(path, content, chord_m))
    if not parts:
        raise OptionError(
            f"{path}: holds no solids or surfaces, as a drawing or mere curves do. Save the solids."
        )
    return RawProduct(name or path.name.partition(".")[0], tuple(parts), unit, chord_m)


def _content(path: Path) -> bytes:
    try:
        content = read_bytes(path, MOST_BYTES)
        if content[:2] == b"\x1f\x8b":
            content = _unpacked(path, content)
    except RefusedFile as refused:
        remedy = (
            ". Save sub-assemblies one by one, or without what is not assembled"
            if refused.why == "large"
            else ""
        )
        raise OptionError(f"{path}: cannot be read: {refused.strerror}{remedy}.") from None
    except OSError as error:
        raise OptionError(f"{path}: cannot be read: {error.strerror or error}.") from None
    if content[:2] == b"PK":
        raise OptionError(f"{path}: is a ZIP archive, whatever its name says. Unpack it first.")
    if not content.strip():
        raise OptionError(f"{path}: is empty. {_ASSEMBLE}.")
    if _BEGINS not in content[:1024]:
        raise OptionError(f"{path}: is no STEP file: it lacks {_BEGINS.decode()!r}. {_ASSEMBLE}.")
    if _ENDS not in content[-1024:]:
        raise OptionError(
            f"{path}: is cut off: {_ENDS.decode()!r} is missing at its end. Save or copy it anew."
        )
    lost = _lost(content)
    if lost:
        entities = "entity" if len(lost) == 1 else "entities"
        raise OptionError(
            f"{path}: is damaged: it refers to {len(lost)} {entities} that it lacks, such as "
            f"#{min(lost)}; parts would be missing. Save or copy it anew."
        )
    return content


def _lost(content: bytes) -> set[int]:
    """Return the entities that are referred to and not there: OCCT leaves out what needs them."""
    bare = re.sub(rb"'[^']*'|/\*.*?\*/", b"", content, flags=re.DOTALL)
    defined = {int(one) for one in re.findall(rb"#(\d+)\s*=", bare)}
    return {int(one) for one in re.findall(rb"#(\d+)", bare)} - defined


def _unpacked(path: Path, content: bytes) -> bytes:
    unpacker = zlib.decompressobj(wbits=zlib.MAX_WBITS | 16)
    try:
        whole = unpacker.decompress(content, MOST_BYTES + 1)
    except zlib.error:
        raise OptionError(f"{path}: is damaged: gzip cannot unpack it. Copy it anew.") from None
    if len(whole) > MOST_BYTES:
        raise RefusedFile("large", path, MOST_BYTES)
    if not unpacker.eof:
        raise OptionError(f"{path}: is cut off: its gzip stream does not end. Copy it anew.")
    return whole


def _unit(content: bytes) -> str:
    """Return the unit of lengths that the file states; OCCT converts by it."""
    if re.search(rb"CONVERSION_BASED_UNIT\s*\(\s*'INCH'", content, re.IGNORECASE):
        return "inch"
    found = re.search(rb"SI_UNIT\s*\(\s*(\$|\.[A-Z]+\.)\s*,\s*\.METRE\.\s*\)", content)
    prefixes = {b".MILLI.": "mm", b".CENTI.": "cm", b"$": "m", b".MICRO.": "um"}
    return prefixes.get(found[1], "mm") if found else "mm"
