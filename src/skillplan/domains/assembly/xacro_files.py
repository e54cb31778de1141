"""Expansion of xacro by the library of that name, with guards against hostile files.

xacro evaluates Python expressions. Names and attributes with a leading underscore are refused, and
so are powers of large numbers; files are read only from a task's folder and from packages; the
number of evaluated expressions is limited.
"""

from __future__ import annotations

import ast
import contextlib
import importlib.util
import io
import os
import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from threading import Lock
from typing import Any, Final, Protocol

from skillplan.files.regular_file import CompanionFileError, find_companion, read_companion
from skillplan.robots.urdf import UrdfError

_MOST_FILES: Final = 300
_MOST_EXPRESSIONS: Final = 200_000
_MOST_ELEMENTS: Final = 200_000
# Greatest exponent and greatest length of a repeated list or text in an expression.
_MOST_POWER: Final = 64
_LOCK = Lock()


class PackageFolders(Protocol):
    """Folders from which xacro may read."""

    def find_package(self, package: str) -> Path:
        """Return the folder of a package."""

    def list_allowed(self) -> list[Path]:
        """Return all folders that may be read."""


def expand_xacro(
    path: Path,
    packages: PackageFolders,
    arguments: Mapping[str, str],
    first_use: tuple[int, str] | None,
    most_bytes: int,
) -> bytes:
    """Return a xacro file in expanded form.

    Parameters
    ----------
    first_use
        Line and text of the first use of xacro in the file, for messages.
    most_bytes
        Greatest size of every file, and of the result [B].

    Raises
    ------
    UrdfError
        If the library is not installed, or the file is at fault.
    """
    line, text = first_use or (1, "the file")
    if importlib.util.find_spec("xacro") is None:
        raise UrdfError(
            f"{text} is xacro, a language of macros: pip install 'skillplan[urdf]', or expand it "
            "first: xacro arm.urdf.xacro > arm.urdf",
            line=line,
        )
    import xacro

    guard = _Guard(path, packages, most_bytes)
    try:
        with _LOCK, guard.installed(xacro), contextlib.redirect_stderr(io.StringIO()):
            document = xacro.process_file(str(path), mappings=dict(arguments))
            expanded: bytes = document.toxml().encode()
    except _Refusal as refusal:
        raise UrdfError(str(refusal), line=line) from None
    except RecursionError:
        raise UrdfError("its macros call themselves without end", line=line) from None
    except Exception as error:
        # xacro raises any exception of an expression, with its text.
        refusal_of_guard = _find_refusal(error)
        words = str(refusal_of_guard or error) or type(error).__name__
        missing = re.search(r"Undefined substitution argument (\w+)", words)
        hint = f"; give 'robot.xacro_args: {{{missing[1]}: ...}}'" if missing else ""
        shown = " ".join(words.split())[:300]
        raise UrdfError(f"xacro cannot expand it: {shown}{hint}", line=line) from None
    if len(expanded) > most_bytes:
        raise UrdfError(
            f"it expands to more than {most_bytes // 1024**2} MiB; keep the arm alone", line=line
        )
    return expanded


class _Refusal(Exception):
    """The guard refuses a file or an expression."""


def _find_refusal(error: BaseException | None) -> _Refusal | None:
    """Return the guard's refusal that an exception of xacro wraps, if any."""
    for _ in range(20):
        if error is None or isinstance(error, _Refusal):
            return error
        error = getattr(error, "exc", None) or error.__context__
    return None


class _Guard:
    """Replacements of the library's functions that read files and evaluate expressions."""

    def __init__(self, path: Path, packages: PackageFolders, most_bytes: int) -> None:
        self.packages, self.most_bytes = packages, most_bytes
        self.allowed = [Path(os.path.realpath(folder)) for folder in packages.list_allowed()]
        self.packages_read: list[Path] = []
        self.files = self.expressions = self.elements = 0

    @contextlib.contextmanager
    def installed(self, xacro: Any) -> Iterator[None]:
        """Use this guard in the library until the context ends."""
        from xacro import substitution_args

        evaluate, evaluate_all = xacro.safe_eval, xacro.eval_all
        known = dict(substitution_args._eval_dict)
        replaced: list[tuple[Any, str, Any]] = [
            (xacro, "open", self.open),
            (xacro, "safe_eval", self._limit(evaluate)),
            (xacro, "eval_all", self._count(evaluate_all)),
            (xacro, "verbosity", 0),
            (substitution_args, "_eval_find", self.find),
            (substitution_args, "_eval_env", _refuse_environment),
            (substitution_args, "_eval_optenv", lambda name, default="": default),
        ]
        before = [(module, name, getattr(module, name, None)) for module, name, _ in replaced]
        for module, name, value in replaced:
            setattr(module, name, value)
        substitution_args._eval_dict.update(
            find=self.find, env=_refuse_environment, optenv=lambda name, default="": default
        )
        own_eval = substitution_args._eval
        substitution_args._eval = lambda text, context: own_eval(_check(text), context)
        try:
            yield
        finally:
            for module, name, value in before:
                if value is None:
                    delattr(module, name)
                else:
                    setattr(module, name, value)
            substitution_args._eval_dict.clear()
            substitution_args._eval_dict.update(known)
            substitution_args._eval = own_eval

    def open(self, name: str, *_: Any, **__: Any) -> io.StringIO:
        """Return the text of a file in an allowed folder."""
        self.files += 1
        if self.files > _MOST_FILES:
            raise _Refusal(f"it includes more than {_MOST_FILES} files")
        real = Path(os.path.realpath(name))
        for folder in (*self.allowed, *self.packages_read):
            if real.is_relative_to(folder):
                break
        else:
            raise _Refusal(
                f"it includes {str(name)[-200:]!r}, which lies outside the task file's folder and "
                "of its packages; give 'robot.packages'"
            )
        try:
            place = find_companion(folder, real.relative_to(folder).as_posix())
            content = read_companion(place, self.most_bytes, "text")
        except CompanionFileError as error:
            words = str(error)
            raise _Refusal(
                f"{str(name)[-200:]!r}: {words[:1].lower()}{words[1:]}".rstrip(".")
            ) from None
        if b"<!DOCTYPE" in content or b"<!ENTITY" in content:
            raise _Refusal(f"{str(name)[-200:]!r} declares a document type, which is not read")
        return io.StringIO(content.decode("utf-8", "replace"))

    def find(self, package: str) -> str:
        """Return the folder of a package."""
        try:
            folder = self.packages.find_package(package)
        except CompanionFileError as error:
            raise _Refusal(str(error).rstrip(".")) from None
        self.packages_read.append(Path(os.path.realpath(folder)))
        return str(folder)

    def _limit(self, evaluate: Callable[..., Any]) -> Callable[..., Any]:
        def limited(expression: str, *scopes: Any) -> Any:
            self.expressions += 1
            if self.expressions > _MOST_EXPRESSIONS:
                raise _Refusal(f"it has more than {_MOST_EXPRESSIONS:,} expressions")
            return evaluate(_check(expression), *scopes)

        return limited

    def _count(self, evaluate_all: Callable[..., Any]) -> Callable[..., Any]:
        def counted(node: Any, *scopes: Any) -> Any:
            self.elements += 1
            if self.elements > _MOST_ELEMENTS:
                raise _Refusal(f"it expands to more than {_MOST_ELEMENTS:,} elements")
            return evaluate_all(node, *scopes)

        return counted


def _refuse_environment(name: str) -> str:
    raise _Refusal(f"it reads the environment variable {name[:60]!r}; give a value instead")


def _check(expression: str) -> str:
    """Return an expression without private names, and without powers and loops that may not end."""
    try:
        tree = ast.parse(expression.strip(), mode="eval")
    except (SyntaxError, ValueError, MemoryError):
        # The library reports it.
        return expression
    for node in ast.walk(tree):
        name = getattr(node, "attr", None) or getattr(node, "id", None) or ""
        if isinstance(name, str) and (name.startswith("_") or name in ("format", "format_map")):
            raise _Refusal(f"its expression {expression[:60]!r} uses {name!r}")
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow | ast.LShift):
            exponent = node.right
            small = isinstance(exponent, ast.Constant) and isinstance(exponent.value, int | float)
            if not small or exponent.value > _MOST_POWER:  # type: ignore[attr-defined]
                raise _Refusal(f"its expression {expression[:60]!r} has a power without bound")
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") in ("range", "pow"):
            values = [item.value for item in node.args if isinstance(item, ast.Constant)]
            if any(isinstance(value, int) and abs(value) > 10_000 for value in values):
                raise _Refusal(f"its expression {expression[:60]!r} counts too far")
    return expression
