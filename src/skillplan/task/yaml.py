"""YAML as plain data that remembers where everything stood.

PyYAML's loader keeps the last of two equal keys, expands alias bombs and forgets positions;
here the composed node graph is turned into data under limits, with a position for every key
and value. Scalars follow the YAML 1.2 core schema, in which ``1e-3`` is a number and ``no`` is
a string.
"""

from __future__ import annotations

import math
import re
import stat
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from skillplan.errors import Issue, TaskError, name_hint

MAX_BYTES = 1_048_576
MAX_DEPTH = 32
MAX_VALUES = 100_000

Path_ = tuple[str | int, ...]
Position = tuple[int, int]

_LOADER: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_INT = re.compile(r"[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_NOT_FINITE = re.compile(r"[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)")
_WORDS = {"": None, "~": None, "null": None, "Null": None, "NULL": None} | {
    word: word.lower() == "true" for word in ("true", "True", "TRUE", "false", "False", "FALSE")
}


@dataclass(frozen=True)
class Document:
    """The content of one YAML file.

    Parameters
    ----------
    source
        The file as the user named it.
    data
        Mappings, lists, strings, numbers, booleans and None.
    values, keys
        Line and column, from 1, of the value at a path and of the key that names it.
    """

    source: str
    data: Any
    values: dict[Path_, Position] = field(repr=False)
    keys: dict[Path_, Position] = field(repr=False)

    def locate(self, issue: Issue, *, key: bool = False) -> Issue:
        """Return the issue with the position of the nearest part of its path that exists.

        Parameters
        ----------
        issue
            An issue with a path.
        key
            Point at the key rather than at its value.
        """
        path = issue.path
        while path and path not in self.values:
            path, key = path[:-1], True
        table = self.keys if key and path in self.keys else self.values
        line, column = table.get(path, (1, 1))
        return Issue(issue.message, issue.path, line, column)

    def error(self, issues: list[Issue]) -> TaskError:
        """Return the error that carries these issues, located."""
        return TaskError(self.source, [self.locate(issue) for issue in issues])


def read_text(path: Path, source: str) -> str:
    """Return the text of a task file.

    Raises
    ------
    TaskError
        If it cannot be read, is no regular file, is too large or not UTF-8.
    """

    def fail(message: str, line: int = 0, column: int = 0) -> TaskError:
        return TaskError(source, [Issue(message, (), line, column)])

    try:
        if not stat.S_ISREG(path.stat().st_mode):
            what = "a folder" if path.is_dir() else "not a regular file"
            raise fail(f"is {what}. Give the path of a task file.")
        with path.open("rb") as file:
            raw = file.read(MAX_BYTES + 1)
    except FileNotFoundError:
        raise fail(f"no such file. {_neighbour_hint(path)}") from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise fail(f"cannot be read: {reason}.") from None
    if len(raw) > MAX_BYTES:
        raise fail(f"is larger than the {MAX_BYTES:,} bytes that a task file may have.")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        before = raw[: error.start]
        line = before.count(b"\n") + 1
        column = error.start - (before.rfind(b"\n") + 1) + 1
        message = f"byte 0x{raw[error.start]:02x} is not UTF-8. Save the file as UTF-8."
        raise fail(message, line, column) from None


def parse(text: str, source: str) -> Document:
    """Return the document in `text`.

    Raises
    ------
    TaskError
        If it is not YAML, is empty, has several documents, or holds duplicate keys, keys that
        are not strings, tags, endless aliases, too much nesting or numbers that are not finite.
    """
    try:
        tags = _guard(text, source)
        root = yaml.compose(text, Loader=_LOADER)
    except yaml.YAMLError as error:
        raise TaskError(source, [_syntax_issue(error)]) from None
    if root is None:
        raise TaskError(source, [Issue("is empty. Start it with 'kind:'.", (), 1, 1)])
    reader = _Reader(source)
    data = reader.read(root, (), 0)
    if tags or reader.issues:
        raise TaskError(source, [*tags, *reader.issues])
    return Document(source, data, reader.values, reader.keys)


def _guard(text: str, source: str) -> list[Issue]:
    """Walk the flat event stream first, so that composing cannot recurse too deep.

    Returns an issue for every explicit tag.
    """
    depth = documents = 0
    tags = []
    for event in yaml.parse(text, Loader=_LOADER):
        tag = getattr(event, "tag", None)
        if tag is not None:
            tags.append(
                Issue(f"tag {_short(tag)} is not allowed. Leave it out.", (), *_mark(event))
            )
        if isinstance(event, yaml.DocumentStartEvent):
            documents += 1
            if documents > 1:
                raise _refusal(source, "holds more than one document. Keep one.", event)
        elif isinstance(event, yaml.CollectionStartEvent):
            depth += 1
            if depth > MAX_DEPTH:
                raise _refusal(source, f"is nested deeper than {MAX_DEPTH} levels.", event)
        elif isinstance(event, yaml.CollectionEndEvent):
            depth -= 1
    return tags


def _refusal(source: str, message: str, event: yaml.Event) -> TaskError:
    return TaskError(source, [Issue(message, (), *_mark(event))])


def _mark(event: yaml.Event) -> Position:
    mark: Any = event.start_mark
    return mark.line + 1, mark.column + 1


class _Reader:
    """Turns nodes into data, collecting every issue on the way."""

    def __init__(self, source: str) -> None:
        self.source = source
        self.issues: list[Issue] = []
        self.values: dict[Path_, Position] = {}
        self.keys: dict[Path_, Position] = {}

    def issue(self, message: str, path: Path_, node: yaml.Node) -> None:
        line, column = _position(node)
        self.issues.append(Issue(message, path, line, column))

    def read(self, node: yaml.Node, path: Path_, depth: int) -> Any:
        if depth > MAX_DEPTH or len(self.values) >= MAX_VALUES:
            what = "deep" if depth > MAX_DEPTH else "large"
            message = (
                f"grows too {what} once its aliases are expanded (at most {MAX_DEPTH} levels "
                f"and {MAX_VALUES:,} values)."
            )
            line, column = _position(node)
            raise TaskError(self.source, [Issue(message, (), line, column)])
        self.values[path] = _position(node)
        if isinstance(node, yaml.MappingNode):
            return self._mapping(node, path, depth)
        if isinstance(node, yaml.SequenceNode):
            return [self.read(item, (*path, i), depth + 1) for i, item in enumerate(node.value)]
        assert isinstance(node, yaml.ScalarNode)
        return self._scalar(node, path)

    def _mapping(self, node: yaml.MappingNode, path: Path_, depth: int) -> dict[str, Any]:
        data: dict[str, Any] = {}
        first: dict[str, Position] = {}
        for key_node, value_node in node.value:
            if not isinstance(key_node, yaml.ScalarNode):
                self.issue("a key must be a name, not a list or mapping.", path, key_node)
                continue
            key = key_node.value
            if not key_node.style and key != "<<" and not isinstance(_resolve(key), str):
                self.issue(f"key {_short(key)} must be a name. Put it in quotes.", path, key_node)
                continue
            if key in first:
                message = f"key {_short(key)} stands twice; first in line {first[key][0]}."
                self.issue(message, (*path, key), key_node)
                continue
            first[key] = _position(key_node)
            self.keys[(*path, key)] = first[key]
            data[key] = self.read(value_node, (*path, key), depth + 1)
        return data

    def _scalar(self, node: yaml.ScalarNode, path: Path_) -> Any:
        if node.style:
            return node.value
        try:
            return _resolve(node.value)
        except ValueError as error:
            self.issue(str(error), path, node)
            return None


def _resolve(text: str) -> Any:
    """Return what a plain scalar means in the YAML 1.2 core schema."""
    if text in _WORDS:
        return _WORDS[text]
    if _INT.fullmatch(text):
        if len(text) > 32:
            raise ValueError(f"number {_short(text)} has too many digits.")
        bases = {"0o": 8, "0x": 16}
        return int(text, bases.get(text[:2], 10))
    if _FLOAT.fullmatch(text):
        value = float(text)
        if not math.isfinite(value):
            raise ValueError(f"number {_short(text)} is too large.")
        return value
    if _NOT_FINITE.fullmatch(text):
        raise ValueError(f"must be a finite number, not {text}.")
    return text


def _position(node: yaml.Node) -> Position:
    return node.start_mark.line + 1, node.start_mark.column + 1


def _short(text: str, most: int = 40) -> str:
    return repr(text if len(text) <= most else text[: most - 3] + "...")


def _syntax_issue(error: yaml.YAMLError) -> Issue:
    """Return the position and words of a syntax error."""
    mark = getattr(error, "problem_mark", None) or getattr(error, "context_mark", None)
    problem = getattr(error, "problem", None) or getattr(error, "reason", None) or "bad syntax"
    context = getattr(error, "context", None)
    words = f"{problem} ({context})" if context else str(problem)
    message = f"is not valid YAML: {words}."
    if mark is None:
        return Issue(message, (), 1, 1)
    return Issue(message, (), mark.line + 1, mark.column + 1)


def _neighbour_hint(path: Path) -> str:
    """Return the nearest task file of the same folder, for a path that does not exist."""
    try:
        names = [
            entry.name
            for entry in path.parent.iterdir()
            if entry.suffix in {".yaml", ".yml", ".sop"}
        ]
    except OSError:
        return f"There is no folder {str(path.parent)!r}."
    if not names:
        return f"There is no task file in {str(path.parent)!r}."
    return name_hint(path.name, names)


def scalar(text: str) -> Any:
    """Return what a word on the command line means: a number, true or false, nothing, or text."""
    try:
        return _resolve(text)
    except ValueError:
        return text
