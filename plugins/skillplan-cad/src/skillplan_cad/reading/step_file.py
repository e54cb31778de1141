"""Parts of a STEP file, read by OCCT through cascadio."""

from __future__ import annotations

import os
import re
import sys
import time
import zlib
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from skillplan.errors import OptionError
from skillplan.files.regular_file import RefusedFile, read_bytes
from skillplan.workers.executor import Answer, Ended, Prepare, Worker, pack_content
from skillplan.workers.local_processes import LocalProcesses
from skillplan.workers.processes import measure_resident_bytes_of
from skillplan_cad.reading.glb import NOT_FINITE, read_parts
from skillplan_cad.reading.raw_part import RawProduct

_WHAT = "reading STEP"
# Largest angle between chords [rad]; chord_m bounds their distance from the surface.
_TURN_RAD = 0.5
_REMEDY = "Save it from CAD anew as STEP (AP203, AP214 or AP242)"
_GIB = 1024**3
# Ten times the duration of slow files.
_LEAST_S, _S_A_MEGABYTE = 120.0, 6.0


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits for reading one file.

    Parameters
    ----------
    seconds
        Time from the start of the process to its answer [s].
    memory_bytes
        Resident size of the process [bytes].
    """

    seconds: float
    memory_bytes: int = 8 * _GIB


def tessellate(path: Path, content: bytes, chord_m: float) -> bytes:
    """Return the GLB that OCCT creates from a STEP file.

    Parameters
    ----------
    chord_m
        Greatest distance of triangles from curved faces [m].

    Raises
    ------
    OptionError
        If OCCT refuses the file, crashes, or exceeds a limit.
    """
    limits = Limits(_LEAST_S + _S_A_MEGABYTE * len(content) / 1e6)
    glb = read_in_process(path, prepare, (content, chord_m), limits)
    if not isinstance(glb, bytes) or not glb:
        raise OptionError(f"{path}: OCCT cannot read it as STEP. {_REMEDY}.")
    return glb


def read_in_process(path: Path, prepare: Prepare, content: Any, limits: Limits) -> Any:
    """Run one job in a process of its own and return the answer.

    Parameters
    ----------
    prepare
        Called in the process with `content`; returns the job. Must be importable.
    content
        Argument of `prepare`.
    limits
        Limits after which the process is killed.

    Raises
    ------
    OptionError
        If the process dies without an answer, or exceeds a limit.
    """
    with closing(LocalProcesses(1)) as executor:
        if executor.refusal:
            return prepare(content)(None)
        worker = executor.start(prepare, pack_content(content, _WHAT), _WHAT)
        worker.take(None)
        until = time.monotonic() + limits.seconds
        while True:
            if executor.first_ready([worker]):
                answer = worker.answer()
                if isinstance(answer, Answer):
                    return answer.content
                if isinstance(answer, Ended):
                    raise _describe_crash(path, worker, answer)
            if time.monotonic() > until:
                raise OptionError(
                    f"{path}: OCCT was still reading after {limits.seconds:.0f} s and was ended. "
                    f"{_REMEDY}, or sub-assemblies one by one."
                )
            if (measure_resident_bytes_of(worker.number) or 0) > limits.memory_bytes:
                raise OptionError(
                    f"{path}: OCCT took more than {limits.memory_bytes / _GIB:.3g} GiB of memory "
                    f"and was ended. {_REMEDY}, or sub-assemblies one by one."
                )


def _describe_crash(path: Path, worker: Worker, ended: Ended) -> Exception:
    if not ended.started and not ended.killed:
        return worker.not_started()
    return OptionError(
        f"{path}: OCCT crashed on it ({ended.how}), so it is damaged or beyond OCCT. {_REMEDY}."
    )


def prepare(content: tuple[bytes, float]) -> Callable[[None], bytes | None]:
    """Return the job of the process; its result is None if OCCT refuses the file."""

    def read(_: None) -> bytes | None:
        try:
            return _read(*content)
        except (RuntimeError, ValueError, MemoryError):
            return None

    return read


def _read(content: bytes, chord_m: float) -> bytes:
    import cascadio

    with _silence_output():
        glb: bytes = cascadio.load(
            content,
            "step",
            tol_linear=chord_m * 1000,
            tol_angular=_TURN_RAD,
            merge_primitives=True,
            use_parallel=False,
            include_brep=True,
        )
    return glb


@contextmanager
def _silence_output() -> Iterator[None]:
    """Discard the output of OCCT; stdout belongs to the command."""
    sys.stdout.flush()
    sys.stderr.flush()
    kept = {}
    for descriptor in (1, 2):
        try:
            kept[descriptor] = os.dup(descriptor)
        except OSError:
            # The descriptor is closed.
            continue
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        for descriptor in kept:
            os.dup2(nowhere, descriptor)
        yield
    finally:
        for descriptor, copy in kept.items():
            os.dup2(copy, descriptor)
            os.close(copy)
        os.close(nowhere)


SUFFIXES = (".step", ".stp", ".step.gz", ".stp.gz", ".stpz")
MOST_BYTES = 128 * 1024 * 1024
_BEGINS, _ENDS = b"ISO-10303-21;", b"END-ISO-10303-21;"
# Texts and comments, in linear time; an unterminated one extends to the end of the file.
_TEXT = re.compile(rb"'[^']*(?:'|\Z)|/\*.*?(?:\*/|\Z)", re.DOTALL)
# OCCT keeps the number of an entity in 32 bits, and mistakes a larger one for another.
_MOST_NUMBER = 2**31 - 1
# Numbers outside the range of doubles: OCCT drops them, or does not end.
_NOT_FINITE = re.compile(
    rb"[(,]\s*([+-]?(?:NAN|INF(?:INITY)?)|[+-]?[0-9.]{1,40}E\+?0*"
    rb"(?:30[89]|3[1-9][0-9]|[4-9][0-9]{2}|[0-9]{4,}))\s*(?=[,)])",
    re.IGNORECASE,
)
_POINT = re.compile(rb"#(\d+)\s*=\s*CARTESIAN_POINT\s*\(\s*'[^']*'\s*,\s*\(([^()]{0,200})\)")
_PREFIXES = {b".MILLI.": "mm", b".CENTI.": "cm", b".DECI.": "dm", b"$": "m", b".MICRO.": "um"}
_ASSEMBLE = "Save it from CAD as STEP (AP203, AP214 or AP242)"


def is_step(path: Path) -> bool:
    """Return whether a file name has a STEP suffix."""
    return path.name.lower().endswith(SUFFIXES)


def read_step(path: Path, chord_m: float) -> RawProduct:
    """Read the parts of a STEP file.

    Parameters
    ----------
    path
        STEP file, optionally compressed by gzip.
    chord_m
        Greatest distance of triangles from curved faces [m].

    Raises
    ------
    OptionError
        If the file is unreadable, no STEP, cut off, without solids, or crashes OCCT.
    """
    content = _read_content(path)
    unit = _find_unit(path, content)
    glb = tessellate(path, content, chord_m)
    try:
        name, parts = read_parts(glb)
    except ValueError as error:
        raise OptionError(f"{path}: {error}{_describe_remedy(str(error), content)}.") from None
    if not parts:
        raise OptionError(
            f"{path}: holds no solids or surfaces, as a drawing or mere curves do. Save the solids."
        )
    return RawProduct(name or path.name.partition(".")[0], tuple(parts), unit, chord_m)


def _read_content(path: Path) -> bytes:
    try:
        content = read_bytes(path, MOST_BYTES)
        if content[:2] == b"\x1f\x8b":
            content = _unpack(path, content)
    except RefusedFile as refused:
        remedy = (
            ". Save sub-assemblies one by one, or without fixtures and references"
            if refused.why == "large"
            else ""
        )
        raise OptionError(f"{path}: cannot be read: {refused.strerror}{remedy}.") from None
    except OSError as error:
        raise OptionError(f"{path}: cannot be read: {error.strerror or error}.") from None
    if content[:2] == b"PK":
        raise OptionError(f"{path}: is a ZIP archive despite its name. Unpack it first.")
    if not content.strip():
        raise OptionError(f"{path}: is empty. {_ASSEMBLE}.")
    if _BEGINS not in content[:1024]:
        raise OptionError(
            f"{path}: is not a STEP file: it lacks {_BEGINS.decode()!r}. {_ASSEMBLE}."
        )
    if _ENDS not in content[-1024:]:
        raise OptionError(
            f"{path}: is cut off: {_ENDS.decode()!r} is missing at its end. Save or copy it anew."
        )
    bare = _TEXT.sub(b"", content)
    _refuse_references(path, bare)
    _refuse_numbers(path, bare)
    return content


def _refuse_numbers(path: Path, bare: bytes) -> None:
    """Refuse numbers that are not finite.

    Parameters
    ----------
    bare
        File content without texts and comments.
    """
    number = _NOT_FINITE.search(bare)
    if number is None:
        return
    *_, entity = re.findall(rb"#([0-9]+)\s*=", bare[: number.start()]) or [b""]
    holder = f"#{entity.decode()}" if entity else "its header"
    raise OptionError(
        f"{path}: {holder} has {number[1][:40].decode()!r}, which is not finite. Correct it in CAD."
    )


def _refuse_references(path: Path, bare: bytes) -> None:
    """Refuse references to missing entities, which OCCT drops silently, or to huge numbers."""
    named = _find_numbers(rb"#([0-9]+)", bare)
    largest = max(named, key=lambda digits: (len(digits), digits), default=b"0")
    if len(largest) > 10 or int(largest) > _MOST_NUMBER:
        digits = largest.decode()
        raise OptionError(
            f"{path}: numbers an entity #{digits[:20]}{'...' if digits[20:] else ''}, of "
            f"{len(digits)} digits; OCCT reads up to #{_MOST_NUMBER}. {_ASSEMBLE}, numbered anew."
        )
    lost = named - _find_numbers(rb"#([0-9]+)\s*=", bare)
    if lost:
        entities = "entity" if len(lost) == 1 else "entities"
        raise OptionError(
            f"{path}: is damaged: it refers to {len(lost)} {entities} that it lacks, such as "
            f"#{min(map(int, lost))}; parts would be missing. Save or copy it anew."
        )


def _find_numbers(pattern: bytes, bare: bytes) -> set[bytes]:
    """Return the distinct entity numbers, without leading zeros."""
    return {digits.lstrip(b"0") or b"0" for digits in re.findall(pattern, bare)}


def _describe_remedy(words: str, content: bytes) -> str:
    """Return the end of a message about a product that OCCT created."""
    if words != NOT_FINITE:
        return ". Save sub-assemblies one by one"
    for point in _POINT.finditer(content):
        for coordinate in point[2].split(b","):
            if not _is_length(coordinate):
                text = coordinate.strip()[:40].decode("ascii", "replace")
                return f": point #{point[1].decode()} has {text!r}. Correct it in CAD"
    return f". {_ASSEMBLE}"


def _is_length(text: bytes) -> bool:
    """Return whether a text is a valid coordinate."""
    try:
        return abs(float(text)) < 1e30
    except ValueError:
        return False


def _unpack(path: Path, content: bytes) -> bytes:
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


def _find_unit(path: Path, content: bytes) -> str:
    """Return the length unit of the file, by which OCCT converts.

    Raises
    ------
    OptionError
        If the unit is not one of those used for products.
    """
    if re.search(rb"CONVERSION_BASED_UNIT\s*\(\s*'INCH'", content, re.IGNORECASE):
        return "inch"
    stated = re.search(rb"SI_UNIT\s*\(\s*(\$|\.[A-Z]{1,9}\.)\s*,\s*\.METRE\.\s*\)", content)
    if stated is None:
        return "mm"
    if stated[1] not in _PREFIXES:
        raise OptionError(
            f"{path}: states lengths in {stated[1].decode()}METRE; save it in mm, cm, m or inch."
        )
    return _PREFIXES[stated[1]]
