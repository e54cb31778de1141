"""Parts of a STEP file, read by OCCT in a process of its own."""

from __future__ import annotations

import hashlib
import os
import re
import time
import zlib
from collections.abc import Callable, Mapping
from contextlib import closing, suppress
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath, PureWindowsPath
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.numpy import load, save

from skillplan.errors import OptionError
from skillplan.files.atomic_file import write_whole
from skillplan.files.folder import get_cache_folder
from skillplan.files.regular_file import RefusedFile, read_bytes
from skillplan.workers.executor import Answer, Ended, News, Prepare, Worker, pack_content
from skillplan.workers.executor import tell as send_news
from skillplan.workers.local_processes import LocalProcesses
from skillplan.workers.processes import measure_cpu_s_of, measure_resident_bytes_of
from skillplan_cad.product import Points, Triangles, Vector
from skillplan_cad.reading.mending import join
from skillplan_cad.reading.names import decode_file_name, decode_text, mark_foreign_names
from skillplan_cad.reading.raw_part import Instance, Mended, RawProduct, StepContent

_WHAT = "reading STEP"
_REMEDY = "Save it from CAD anew as STEP (AP203, AP214 or AP242)"
_GIB = 1024**3
# Ten times the duration of slow files.
_LEAST_S, _S_A_MEGABYTE = 120.0, 6.0
# Raised whenever the same file is meshed otherwise.
_FORMAT = 1
# Largest number of shapes that may crash OCCT or exceed its limits; each starts it again.
_MOST_STOPS = 8
# Elapsed time per CPU time above which a process counts as stuck.
_MOST_WAITING = 5
Report = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits for reading one file.

    Parameters
    ----------
    seconds
        CPU time from the start of the process to its answer [s]; elapsed time where the system does
        not tell it. Five times as long a time may pass.
    memory_bytes
        Resident size of the process [bytes].
    """

    seconds: float
    memory_bytes: int = 8 * _GIB


class ReadingStopped(OptionError):
    """The process died or was killed; `shape` is the number of the shape at work, or None."""

    def __init__(self, message: str, shape: int | None, reason: str) -> None:
        super().__init__(message)
        self.shape, self.reason = shape, reason


def read_in_process(
    path: Path, prepare: Prepare, content: Any, limits: Limits, report: Report | None = None
) -> Any:
    """Run one job in a process of its own and return the answer.

    Parameters
    ----------
    prepare
        Called in the process with `content`; returns the job. Must be importable.
    content
        Argument of `prepare`.
    limits
        Limits after which the process is killed.
    report
        Called often, with the last news of the process; numbers are those of shapes it begins with.

    Raises
    ------
    ReadingStopped
        If the process dies without an answer, or exceeds a limit.
    """
    shape: int | None = None
    text = "entities"
    with closing(LocalProcesses(1)) as executor:
        if executor.refusal:
            return prepare(content)(None)
        worker = executor.start(prepare, pack_content(content, _WHAT), _WHAT)
        worker.take(None)
        began = time.monotonic()
        spent_s = since_s = 0.0
        while True:
            if executor.first_ready([worker]):
                answer = worker.answer()
                if isinstance(answer, Answer):
                    return answer.content
                if isinstance(answer, Ended):
                    raise _describe_crash(path, worker, answer, shape)
                if isinstance(answer, News) and isinstance(answer.content, int):
                    shape, since_s = answer.content, spent_s
                elif isinstance(answer, News):
                    text = str(answer.content)
            elapsed_s = time.monotonic() - began
            # A busy machine is no fault of the file.
            cpu_s = measure_cpu_s_of(worker.number)
            spent_s = elapsed_s if cpu_s is None else max(cpu_s, elapsed_s / _MOST_WAITING)
            if report is not None:
                report(f"{text}, {elapsed_s:.0f} s")
            if spent_s > limits.seconds:
                # Only a shape that took most of the time is to blame.
                slow = shape if spent_s - since_s > limits.seconds / 2 else None
                raise ReadingStopped(
                    f"{path}: OCCT was still reading after {limits.seconds:.0f} s and was ended. "
                    f"{_REMEDY}, or sub-assemblies one by one.",
                    slow,
                    f"takes OCCT more than {spent_s - since_s:.0f} s",
                )
            if (measure_resident_bytes_of(worker.number) or 0) > limits.memory_bytes:
                limit = f"more than {limits.memory_bytes / _GIB:.3g} GiB of memory"
                raise ReadingStopped(
                    f"{path}: OCCT took {limit} and was ended. {_REMEDY}, or sub-assemblies one "
                    "by one.",
                    shape,
                    f"takes OCCT {limit}",
                )


def _describe_crash(path: Path, worker: Worker, ended: Ended, shape: int | None) -> Exception:
    if not ended.started and not ended.killed:
        return worker.not_started()
    return ReadingStopped(
        f"{path}: OCCT crashed on it ({ended.how}), so it is damaged or beyond OCCT. {_REMEDY}.",
        shape,
        f"crashes OCCT ({ended.how})",
    )


def prepare(
    content: tuple[str, float, list[str], dict[int, str]],
) -> Callable[[None], StepContent | None]:
    """Return the job of the process; its result is None if OCCT refuses the file.

    Parameters
    ----------
    content
        Path of the file, greatest distance of triangles from curved faces [m], names of the files
        that it may refer to, and shapes that are left out with the reason.
    """
    from skillplan_cad.reading.occt_reader import read_document

    path, chord_m, allowed, left_out = content

    def read(_: None) -> StepContent | None:
        try:
            return read_document(Path(path), chord_m, allowed, send_news, left_out, send_news)
        except (RuntimeError, ValueError, MemoryError):
            return None

    return read


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
# Largest share of entities that may be missing.
_MOST_LOST = 0.01
_POINT = re.compile(rb"#(\d+)\s*=\s*CARTESIAN_POINT\s*\(\s*'[^']*'\s*,\s*\(([^()]{0,200})\)")
# Names of files that a file refers to; stand-in for a file that is not read.
_FILE_NAME = re.compile(
    rb"(DOCUMENT_FILE|EXTERNAL_IDENTIFICATION_ASSIGNMENT|IDENTIFIER)(\s*\(\s*)"
    rb"'((?:[^']|''){1,1000})'"
)
_NOWHERE = "left_out.none"
NOT_FINITE = "has coordinates that are not finite"
_PREFIXES = {b".MILLI.": "mm", b".CENTI.": "cm", b".DECI.": "dm", b"$": "m", b".MICRO.": "um"}
# The unit of lengths of a file: inch or foot, or metre with a prefix.
_LENGTH_UNITS = (
    rb"\(\s*CONVERSION_BASED_UNIT\s*\(\s*'[^']*'\s*,\s*#\d+\s*\)\s*LENGTH_UNIT\s*\(\s*\)\s*"
    rb"NAMED_UNIT\s*\(\s*#\d+\s*\)\s*\)",
    rb"\(\s*LENGTH_UNIT\s*\(\s*\)\s*NAMED_UNIT\s*\(\s*\*\s*\)\s*SI_UNIT\s*\(\s*"
    rb"(?:\$|\.[A-Z]{1,9}\.)\s*,\s*\.METRE\.\s*\)\s*\)",
)
_INCHES = {"inch": b"0.0254", "foot": b"0.3048"}
_ASSEMBLE = "Save it from CAD as STEP (AP203, AP214 or AP242)"


def is_step(path: Path) -> bool:
    """Return whether a file name has a STEP suffix."""
    return path.name.lower().endswith(SUFFIXES)


def read_step(
    path: Path, chord_m: float, report: Report | None = None, unit: str | None = None
) -> RawProduct:
    """Read the parts of a STEP file, and of the files beside it that it refers to.

    Parameters
    ----------
    path
        STEP file, optionally compressed by gzip.
    chord_m
        Greatest distance of triangles from curved faces [m].
    report
        Called with progress.
    unit
        Unit of all lengths in place of the stated one; None for that.

    Raises
    ------
    OptionError
        If the file is unreadable, no STEP, cut off, without solids, or crashes OCCT.
    """
    content, notes = _read_content(path)
    stated = _find_unit(path, content)
    files, missing = _gather_references(path, content)
    if unit is not None and unit != stated:
        files = {name: _restate_unit(own, unit) for name, own in files.items()}
    whole = _read_files(path, files, chord_m, report)
    parts, more = _place_instances(whole)
    parts, infinite = _leave_out_infinite(parts, content)
    if not parts:
        reasons = "; ".join([*missing, *more, *infinite])
        raise OptionError(
            f"{path}: holds no solids or surfaces, as a drawing or mere curves do. Save the solids."
            + (f" {reasons[0].upper()}{reasons[1:]}." if reasons else "")
        )
    name = whole.name or decode_file_name(path).partition(".")[0]
    warnings = (*notes, *missing, *more, *infinite)
    return RawProduct(name, tuple(parts), unit or stated, chord_m, whole.notes, warnings)


def _leave_out_infinite(parts: list[Mended], content: bytes) -> tuple[list[Mended], list[str]]:
    """Return the parts with finite coordinates, and notes on the others."""
    kept = [mended for mended in parts if np.isfinite(mended.part.vertices_m).all()]
    remedy = _describe_remedy(NOT_FINITE, content) if len(kept) < len(parts) else ""
    return kept, [
        f"{mended.part.name}: {NOT_FINITE}, and is left out{remedy}"
        for mended in parts
        if not any(mended is other for other in kept)
    ]


# Chords at which a part of a task is meshed [m]; largest number of its corners.
_PART_CHORDS_M, _MOST_CORNERS = (5e-5, 2e-4, 1e-3), 5_000


def mesh_step(content: bytes) -> tuple[Points, Triangles]:
    """Return the closed surface of all solids of a STEP file [m]; the entry point `step`.

    The mesh has at most 5,000 corners if a chord of 1 mm allows that. It is cached on disk.

    Raises
    ------
    OptionError
        If the file is unreadable, or a solid is open.
    """
    key = hashlib.sha256(b"%d" % _FORMAT + content).hexdigest()
    kept = get_cache_folder() / "step" / key
    # A missing or damaged copy is made anew.
    with suppress(OSError, KeyError, SafetensorError):
        stored = load(read_bytes(kept, MOST_BYTES))
        return stored["corners"], stored["faces"]
    with TemporaryDirectory(prefix="skillplan-") as folder:
        path = Path(folder) / "part.step"
        path.write_bytes(content)
        for chord_m in _PART_CHORDS_M:
            try:
                meshes = read_step(path, chord_m).parts
            except OptionError as error:
                raise OptionError(f"It{str(error).removeprefix(f'{path}:')}") from None
            if sum(len(mesh.part.vertices_m) for mesh in meshes) <= _MOST_CORNERS:
                break
    if any(mesh.open_edges for mesh in meshes):
        raise OptionError("It is not closed, a surface; save a solid.")
    whole = join("part", list(meshes)).part
    with suppress(OSError):
        kept.parent.mkdir(parents=True, exist_ok=True)
        write_whole(
            kept,
            save(
                {
                    "corners": np.ascontiguousarray(whole.vertices_m),
                    "faces": np.ascontiguousarray(whole.triangles),
                }
            ),
        )
    return whole.vertices_m, whole.triangles


def hash_step(path: Path) -> str:
    """Return a hash of a file and of the files that it refers to; empty if it is refused."""
    try:
        files, notes = _gather_references(path, _read_content(path)[0])
    except OptionError:
        return ""
    digest = hashlib.sha256("\0".join(notes).encode())
    for name, content in files.items():
        digest.update(name.encode() + b"\0" + hashlib.sha256(content).digest())
    return digest.hexdigest()


def _read_files(
    path: Path, files: Mapping[str, bytes], chord_m: float, report: Report | None
) -> StepContent:
    """Read a file, the first of some, by OCCT in a folder that holds only these."""
    content = next(iter(files.values()))
    size = sum(map(len, files.values()))
    limits = Limits(_LEAST_S + _S_A_MEGABYTE * size / 1e6)
    with TemporaryDirectory(prefix="skillplan-") as folder:
        for name, own in files.items():
            (Path(folder) / name).write_bytes(own)
        main, allowed = str(Path(folder) / next(iter(files))), [*list(files)[1:], _NOWHERE]
        left_out: dict[int, str] = {}
        while True:
            job = (main, chord_m, allowed, left_out)
            try:
                whole = read_in_process(path, prepare, job, limits, report)
            except ReadingStopped as stopped:
                if stopped.shape is None or len(left_out) == _MOST_STOPS:
                    raise
                left_out[stopped.shape] = stopped.reason
                continue
            break
    if whole is None:
        raise OptionError(f"{path}: OCCT cannot read it as STEP. {_REMEDY}.")
    if whole.refused:
        raise OptionError(f"{path}: {whole.refused}{_describe_remedy(whole.refused, content)}.")
    return whole  # type: ignore[no-any-return]


def _gather_references(path: Path, content: bytes) -> tuple[dict[str, bytes], list[str]]:
    """Return a file and the files that it refers to, by name, and a note on each that is missing.

    Files outside its folder are not read; neither is a file twice.
    """
    main = "product.step"
    folder = path.resolve().parent
    files: dict[str, bytes] = {main: content}
    names: dict[Path, str] = {path.resolve(): main}
    places = {main: folder}
    notes: dict[str, None] = {}
    todo = [main]
    left = MOST_BYTES - len(content)
    while todo:
        own = todo.pop(0)
        if b"DOCUMENT_FILE" not in files[own]:
            continue
        head, mark, data = files[own].partition(b"DATA;")
        targets: dict[bytes, bytes] = {}
        for keyword, _, quoted in sorted(set(_FILE_NAME.findall(data))):
            if quoted in targets:
                continue
            name = _decode_text(quoted)
            there, words = _find_reference(name, places[own], folder)
            if there is not None and there not in names:
                read, words = _read_reference(name, there, folder, left)
                if read is not None:
                    left -= len(read)
                    plain = there.name if there.name.isascii() else f"{len(files)}.stp"
                    names[there] = f"{len(files)}_{plain}" if plain in files else plain
                    files[names[there]], places[names[there]] = read, there.parent
                    todo.append(names[there])
            # OCCT would look for a file that is not read elsewhere, and for itself without an end.
            target = _NOWHERE if there is None else names.get(there, _NOWHERE)
            targets[quoted] = (_NOWHERE if target in (main, own) else target).encode()
            # Documents may be drawings.
            if words and (b"EXTERNAL" in keyword or is_step(Path(name))):
                notes.setdefault(words)
        files[own] = head + mark + _rename_references(data, targets)
    return files, list(notes)


def _rename_references(data: bytes, targets: Mapping[bytes, bytes]) -> bytes:
    """Return the data of a file with other names of files."""
    return _FILE_NAME.sub(lambda match: b"%b%b'%b'" % (match[1], match[2], targets[match[3]]), data)


def _find_reference(name: str, place: Path, folder: Path) -> tuple[Path | None, str]:
    """Return the path of a file that another refers to, and a note if it is not there.

    Parameters
    ----------
    place
        Folder of the file that refers to it.
    folder
        Folder of the product; a file elsewhere is looked for by its name in these two.
    """
    relative = PurePosixPath(name.replace("\\", "/"))
    full = Path(os.path.normpath(place / relative))
    inside = full.is_relative_to(folder) and not PureWindowsPath(name).drive
    for candidate in (full, place / relative.name, folder / relative.name):
        if candidate is full and not inside:
            continue
        # Folders are listed, because Windows ignores case in names.
        with suppress(OSError, ValueError):
            entries = sorted(candidate.parent.iterdir())
            exact = [entry for entry in entries if entry.name == candidate.name]
            alike = [entry for entry in entries if entry.name.lower() == candidate.name.lower()]
            for entry in (*exact, *alike):
                return entry, ""
    where = "which is missing beside it" if inside else "which lies outside its folder"
    return None, f"refers to {name!r}, {where}; its parts are left out"


def _read_reference(
    name: str, there: Path, folder: Path, most_bytes: int
) -> tuple[bytes | None, str]:
    """Return the content of a file in a folder; None and a note if it is not read."""
    try:
        content = read_bytes(there, most_bytes, within=folder)
        return _check_content(there, content)[0], ""
    except RefusedFile as refused:
        return None, f"refers to {name!r}, which is left out: {refused.strerror}"
    except OSError as error:
        return None, f"refers to {name!r}, which is left out: {error.strerror or error}"
    except OptionError as error:
        reason = str(error).removeprefix(f"{there}: ").rstrip(".")
        return None, f"refers to {name!r}, which is left out: it {reason}"


def _decode_text(text: bytes) -> str:
    """Return a text of STEP with its control directives replaced."""
    # Lines may be broken anywhere.
    bare = text.replace(b"\n", b"").replace(b"\r", b"")
    plain = bare.replace(b"''", b"'").decode("utf-8", "replace")
    plain = re.sub(
        r"\\X2\\((?:[0-9A-F]{4})*)\\X0\\",
        lambda match: bytes.fromhex(match[1]).decode("utf-16-be", "replace"),
        plain,
    )
    plain = re.sub(r"\\X\\([0-9A-F]{2})", lambda match: chr(int(match[1], 16)), plain)
    return re.sub(r"\\S\\(.)", lambda match: chr(ord(match[1]) + 128), plain)


def _place_instances(whole: StepContent) -> tuple[list[Mended], list[str]]:
    """Return the parts in the product's frame, and notes on those left out and on repairs."""
    parts, notes = [], dict[str, None]()
    for instance in whole.instances:
        shape = whole.shapes[instance.shape]
        if isinstance(shape, str):
            notes.setdefault(f"{instance.name}: {shape}, and is left out")
        else:
            parts.append(_place(shape, instance))
    return parts, list(notes)


def _place(shape: Mended, instance: Instance) -> Mended:
    """Return a shape at its place in the product."""
    turn, move = instance.pose[:3, :3], instance.pose[:3, 3]
    scale = float(np.linalg.det(turn))
    part = shape.part
    triangles = part.triangles[:, ::-1] if scale < 0 else part.triangles
    size = abs(scale) ** (1 / 3)
    faces = tuple(
        replace(
            face,
            origin_m=_vector(turn @ np.asarray(face.origin_m) + move),
            axis=_vector(turn @ np.asarray(face.axis) / size),
            radius_m=face.radius_m * size,
            minor_radius_m=face.minor_radius_m * size,
        )
        for face in part.faces
    )
    placed = replace(
        part,
        name=instance.name,
        design=instance.design,
        path=instance.path,
        vertices_m=part.vertices_m @ turn.T + move,
        triangles=triangles,
        faces=faces,
    )
    measures = tuple(
        replace(
            measure,
            volume_m3=measure.volume_m3 * abs(scale),
            centre_m=_vector(turn @ np.asarray(measure.centre_m) + move),
        )
        for measure in shape.measures
    )
    gap_point = turn @ shape.gap_point_m + move
    notes = tuple(note.replace(f"{part.name}: ", f"{instance.name}: ", 1) for note in shape.notes)
    return replace(shape, part=placed, measures=measures, gap_point_m=gap_point, notes=notes)


def _vector(numbers: Any) -> Vector:
    x, y, z = (float(number) for number in numbers)
    return x, y, z


def _read_content(path: Path) -> tuple[bytes, list[str]]:
    """Return the content of a file in UTF-8, and warnings."""
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
    return _check_content(path, content)


def _check_content(path: Path, content: bytes) -> tuple[bytes, list[str]]:
    """Return content in UTF-8, and warnings; refuse what is no STEP or OCCT would misread."""
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
    warnings = []
    if not content.isascii():
        text, encoding = decode_text(content)
        if encoding != "UTF-8":
            content = text.encode()
            warnings.append(f"names are read as {encoding}, as the file is not in UTF-8")
    if not content.isascii() or b"\\X2\\" in content:
        content = mark_foreign_names(content)
    bare = _strip_texts(content)
    warnings += _check_references(path, bare)
    _refuse_numbers(path, bare)
    return content, warnings


def _strip_texts(content: bytes) -> bytes:
    """Return content without texts and comments."""
    return _TEXT.sub(b"", content) if b"/*" in content else b"".join(content.split(b"'")[::2])


def _refuse_numbers(path: Path, bare: bytes) -> None:
    """Refuse numbers that are not finite.

    Parameters
    ----------
    bare
        File content without texts and comments.
    """
    upper = bare.upper()
    text = np.frombuffer(upper, np.uint8)
    after = text[1:][text[:-1] == ord("E")]
    has_exponents = ((after == ord("+")) | (after - np.uint8(ord("0")) < 10)).any()
    if not (b"NAN" in upper or b"INF" in upper or has_exponents):
        return
    number = _NOT_FINITE.search(bare)
    if number is None:
        return
    *_, entity = re.findall(rb"#([0-9]+)\s*=", bare[: number.start()]) or [b""]
    holder = f"#{entity.decode()}" if entity else "its header"
    raise OptionError(
        f"{path}: {holder} has {number[1][:40].decode()!r}, which is not finite. Correct it in CAD."
    )


def _check_references(path: Path, bare: bytes) -> list[str]:
    """Return a warning if a few entities are missing, which OCCT drops silently.

    Raises
    ------
    OptionError
        If more are missing, or an entity has a huge number.
    """
    numbers, defined = _find_numbers(bare)
    if len(numbers) and numbers.max() > _MOST_NUMBER:
        texts = (digits.lstrip(b"0") for digits in re.findall(rb"#([0-9]+)", bare))
        digits = max(texts, key=lambda text: (len(text), text)).decode()
        raise OptionError(
            f"{path}: numbers an entity #{digits[:20]}{'...' if digits[20:] else ''}, of "
            f"{len(digits)} digits; OCCT reads up to #{_MOST_NUMBER}. {_ASSEMBLE}, numbered anew."
        )
    entities = numbers[defined]
    lost = np.unique(numbers[~np.isin(numbers, entities)])
    if not len(lost):
        return []
    missing = (
        f"it refers to {len(lost)} {'entity' if len(lost) == 1 else 'entities'} that it lacks, "
        f"such as #{lost[0]}"
    )
    if len(lost) > _MOST_LOST * len(entities):
        raise OptionError(
            f"{path}: is damaged: {missing}; parts would be missing. Save or copy it anew."
        )
    return [f"the file is damaged: {missing}; what depends on them is missing"]


def _find_numbers(bare: bytes) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Return the numbers after ``#``, up to 12 digits of each, and whether each is a definition."""
    text = np.frombuffer(bare + b"  ", np.uint8)
    end = np.flatnonzero(text == ord("#")) + 1
    numbers, is_number = np.zeros(len(end), dtype=np.int64), np.zeros(len(end), dtype=np.bool_)
    for _ in range(12):
        # Other characters wrap to more than 9.
        digit = text[end] - np.uint8(ord("0"))
        more = digit < 10
        numbers = np.where(more, numbers * 10 + digit, numbers)
        is_number |= more
        end = np.minimum(end + more, len(text) - 1)
    spaces = np.isin(text, np.frombuffer(b" \t\r\n", np.uint8))
    spaces[-1] = False
    while (blank := spaces[end]).any():
        end = end + blank
    return numbers[is_number], (text[end] == ord("="))[is_number]


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


def _restate_unit(content: bytes, unit: str) -> bytes:
    """Return a file with the same numbers in another unit of length."""
    si = {name: prefix for prefix, name in _PREFIXES.items()}
    if unit in si:
        entity, more = b"(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(%s,.METRE.))" % si[unit], b""
    else:
        free = 1 + max((int(number) for number in re.findall(rb"#(\d+)\s*=", content)), default=0)
        entity = b"(CONVERSION_BASED_UNIT('%s',#%d)LENGTH_UNIT()NAMED_UNIT(#%d))" % (
            unit.upper().encode(),
            free,
            free + 2,
        )
        more = (
            b"#%d=LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(%s),#%d);\n"
            b"#%d=(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT($,.METRE.));\n"
            b"#%d=DIMENSIONAL_EXPONENTS(1.,0.,0.,0.,0.,0.,0.);\n"
        ) % (free, _INCHES[unit], free + 1, free + 1, free + 2)
    # Inches and feet come first, because their definitions contain metres.
    for stated in _LENGTH_UNITS:
        restated, count = re.subn(stated, lambda match: entity, content)
        if count:
            head, end, tail = restated.rpartition(b"ENDSEC;")
            return head + more + end + tail
    return content


def _find_unit(path: Path, content: bytes) -> str:
    """Return the length unit of the file, by which OCCT converts.

    Raises
    ------
    OptionError
        If the unit is not one of those used for products.
    """
    if re.search(rb"CONVERSION_BASED_UNIT\s*\(\s*'(?i:INCH)'", content):
        return "inch"
    stated = re.search(rb"SI_UNIT\s*\(\s*(\$|\.[A-Z]{1,9}\.)\s*,\s*\.METRE\.\s*\)", content)
    if stated is None:
        return "mm"
    if stated[1] not in _PREFIXES:
        raise OptionError(
            f"{path}: states lengths in {stated[1].decode()}METRE; save it in mm, cm, m or inch."
        )
    return _PREFIXES[stated[1]]
