"""YAML as plain data with positions of all values.

PyYAML's loader keeps the last of two equal keys, expands alias bombs and forgets positions. Here
its node graph is converted under limits, with a position for every key and value. Scalars follow
the YAML 1.2 core schema, in which ``1e-3`` is a number and ``no`` is a string.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import yaml

from skillplan.errors import Issue, TaskError, nearest
from skillplan.files.regular_file import RefusedFile, read_bytes

# Fragments of parser messages, and advice.
_HINTS = (
    ("expected ',' or ']'", "Close the bracket, or put a comma between its entries."),
    ("expected ',' or '}'", "Close the brace, or put a comma between its entries."),
    ("unexpected end of stream", "Close the quote."),
    ("unexpected document indicator", "Close the quote."),
    ("violates indentation", "Indent with spaces, not tabs."),
    ("values are not allowed", "Indent the line like its siblings; put text with ': ' in quotes."),
    ("expected key", "Indent the entries of one mapping alike, each as 'key: value'."),
    ("expected '-' indicator", "Indent the entries of one list alike, each with '- '."),
    ("expected ':'", "Write 'key: value'."),
    ("undefined alias", "Name it with '&' before; put text that begins with '*' in quotes."),
    ("anchor stands twice", "Give each '&' another name."),
    ("incompatible YAML", "Write '%YAML 1.2', or leave the line out."),
    ("directive", "Leave the line out."),
    ("escape character", "Use single quotes, in which a backslash means itself."),
)


def describe_syntax_error(error: yaml.YAMLError, text: str) -> Issue:
    """Return the issue for a syntax error, with its position and advice."""
    mark: Any = getattr(error, "problem_mark", None)
    start: Any = getattr(error, "context_mark", None)
    mark = mark or start
    problem = getattr(error, "problem", None) or getattr(error, "reason", None) or "bad syntax"
    context = getattr(error, "context", None)
    line, column = (1, 1) if mark is None else (mark.line + 1, mark.column + 1)
    words = str(problem)
    if context and start is not None and "duplicate anchor" in context:
        words = f"an anchor stands twice, first in line {start.line + 1}"
    elif context:
        elsewhere = start is not None and start.line + 1 != line
        since = f" that starts in line {start.line + 1}" if elsewhere else ""
        words = f"{problem} ({context}{since})"
    hint = next((f" {hint}" for fragment, hint in _HINTS if fragment in words), "")
    if "cannot start any token" in words:
        tab = "\t" in _line_of(text, line)[:column]
        hint = " Indent with spaces, not tabs." if tab else " Put the text in quotes."
    return Issue(f"is not valid YAML: {words}.{hint}", (), line, column)


def _line_of(text: str, line: int) -> str:
    lines = text.splitlines()
    return lines[line - 1] if line <= len(lines) else ""


YAML_SUFFIXES = (".yaml", ".yml")
MAX_BYTES = 1_048_576
MAX_DEPTH = 32
MAX_VALUES = 100_000
MAX_ISSUES = 1000

Path_ = tuple[str | int, ...]
Position = tuple[int, int]

_LOADER: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_INT = re.compile(r"[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_NOT_FINITE = re.compile(r"[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)")
_UNPRINTABLE = re.compile("[^\t\n\r\x20-\x7e\x85\xa0-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
_WORDS = {"": None, "~": None, "null": None, "Null": None, "NULL": None} | {
    word: word.lower() == "true" for word in ("true", "True", "TRUE", "false", "False", "FALSE")
}


@dataclass(frozen=True)
class Document:
    """The content of one YAML file.

    Parameters
    ----------
    source
        The file as given by the user.
    data
        Mappings, lists, strings, numbers, booleans and None.
    values, keys
        Line and column, from 1, of the value at a path, and of its key.
    issues
        Faults that leave the rest readable, such as repeated keys; `data` has None for unreadable
        values.
    given
        Paths of values that are not in the file.
    written_from
        The document before its shorthands were written out; None if it has none.
    sources
        Path in that document of each entry that was written out, by the path here.
    """

    source: str
    data: Any
    values: dict[Path_, Position] = field(repr=False)
    keys: dict[Path_, Position] = field(repr=False)
    issues: tuple[Issue, ...] = ()
    given: tuple[Path_, ...] = ()
    written_from: Document | None = field(default=None, repr=False)
    sources: Mapping[Path_, Path_] = field(default_factory=dict, repr=False)

    def locate(self, issue: Issue) -> Issue:
        """Return the issue with the position of the nearest existing part of its path.

        If the value starts in a later line, this is the position of its key. Values that are not in
        the file have none.
        """
        path, at_key = issue.path, issue.at_key
        if any(path[: len(given)] == given for given in self.given):
            return replace(issue, message=f"{issue.message} That is what --set says.")
        while path and path not in self.values:
            path, at_key = path[:-1], True
        value = self.values.get(path, (1, 1))
        key = self.keys.get(path, value)
        line, column = key if at_key or key[0] < value[0] else value
        return replace(issue, line=line, column=column)

    def error(self, issues: Iterable[Issue]) -> TaskError:
        """Return the error with these issues, located, and the document's own issues.

        A fault of an entry that stands for several is listed once.
        """
        listed: dict[tuple[int, int, str], Issue] = {}
        for issue in (*self.issues, *map(self.locate, issues)):
            key = (issue.line, issue.column, issue.message)
            listed.setdefault(key if issue.line else (0, len(listed), issue.message), issue)
        return TaskError(self.source, list(listed.values()))


def read_text(path: Path, source: str, max_bytes: int = MAX_BYTES) -> str:
    """Return the text of a task file.

    Parameters
    ----------
    source
        The file as given by the user.

    Raises
    ------
    TaskError
        If it cannot be read, is not a regular file, is too large or not UTF-8.
    """

    def fail(message: str, line: int = 0, column: int = 0) -> TaskError:
        return TaskError(source, [Issue(message, (), line, column)])

    if not source:
        raise TaskError("''", [Issue("is not a path. Give the path of a task file.")])
    try:
        raw = read_bytes(path, max_bytes)
    except FileNotFoundError:
        raise fail(f"no such file. {_neighbour_hint(path)}") from None
    except RefusedFile as refused:
        if refused.why == "large":
            message = f"is larger than the {max_bytes:,} bytes that a task file may have."
            raise fail(message) from None
        what = "a folder" if refused.why == "folder" else "not a regular file"
        raise fail(f"is {what}. Give the path of a task file.") from None
    except OSError as error:
        raise fail(f"cannot be read: {error.strerror}.") from None
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        before = raw[: error.start]
        line = before.count(b"\n") + 1
        column = len(before[before.rfind(b"\n") + 1 :].decode("utf-8-sig")) + 1
        message = f"byte 0x{raw[error.start]:02x} is not UTF-8. Save the file as UTF-8."
        raise fail(message, line, column) from None


def parse(text: str, source: str) -> Document:
    """Return the document in `text`.

    Repeated keys, keys that are not strings, tags, and numbers that are not finite become issues of
    the document, to be reported with other faults.

    Raises
    ------
    TaskError
        If it is not YAML, empty, too large, nested too deep, or has several documents or endless
        aliases.
    """
    unprintable = _UNPRINTABLE.search(text)
    if unprintable:
        before = text[: unprintable.start()]
        place = (before.count("\n") + 1, len(before) - before.rfind("\n"))
        message = f"character U+{ord(unprintable[0]):04X} is not allowed in YAML. Remove it."
        raise TaskError(source, [Issue(message, (), *place)])
    try:
        tags = _guard(text, source)
        root = yaml.compose(text, Loader=_LOADER)
    except yaml.YAMLError as error:
        raise TaskError(source, [describe_syntax_error(error, text)]) from None
    if root is None:
        raise TaskError(source, [Issue("is empty. Start it with 'kind:'.", (), 1, 1)])
    reader = _Reader(source)
    data = reader.read(root, (), 0)
    return Document(source, data, reader.values, reader.keys, (*tags, *reader.issues))


def _guard(text: str, source: str) -> list[Issue]:
    """Check the flat event stream, so that composing cannot recurse too deep or take too long.

    Returns an issue for every explicit tag, up to `MAX_ISSUES`.
    """
    depth = documents = nodes = 0
    tags: list[Issue] = []
    for event in yaml.parse(text, Loader=_LOADER):
        tag = getattr(event, "tag", None)
        if tag is not None and len(tags) < MAX_ISSUES:
            written = tag.replace("tag:yaml.org,2002:", "!!", 1)
            tags.append(
                Issue(f"tag {_short(written)} is not allowed. Leave it out.", (), *_mark(event))
            )
        if isinstance(event, yaml.NodeEvent):
            nodes += 1
            if nodes > 2 * MAX_VALUES:  # a key and its value are two
                raise _refusal(source, f"holds more than {MAX_VALUES:,} values.", event)
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
    """Converts nodes to data, and collects issues."""

    def __init__(self, source: str) -> None:
        self.source = source
        self.issues: list[Issue] = []
        self.values: dict[Path_, Position] = {}
        self.keys: dict[Path_, Position] = {}
        self._open: set[int] = set()

    def issue(self, message: str, path: Path_, node: yaml.Node) -> None:
        if len(self.issues) < MAX_ISSUES:
            self.issues.append(Issue(message, path, *_position(node)))

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
        if isinstance(node, yaml.ScalarNode):
            return self._scalar(node, path)
        if id(node) in self._open:
            line, _ = _position(node)
            message = f"what starts in line {line} contains itself by an alias. Write it out."
            raise TaskError(self.source, [Issue(message, path, *_position(node))])
        self._open.add(id(node))
        data: Any
        if isinstance(node, yaml.MappingNode):
            data = self._mapping(node, path, depth)
        else:
            items = enumerate(node.value)
            data = [self.read(item, (*path, i), depth + 1) for i, item in items]
        self._open.remove(id(node))
        return data

    def _mapping(self, node: yaml.MappingNode, path: Path_, depth: int) -> dict[str, Any]:
        data: dict[str, Any] = {}
        first: dict[str, Position] = {}
        for key_node, value_node in node.value:
            if not isinstance(key_node, yaml.ScalarNode):
                self.issue("a key must be a name, not a list or mapping.", path, key_node)
                continue
            key = key_node.value
            if not key_node.style and key == "<<":
                self.issue("merging with '<<' is not supported. Write it out.", path, key_node)
                continue
            if not key_node.style and not _is_text(key):
                self.issue(f"key {_short(key)} must be a name. Put it in quotes.", path, key_node)
                continue
            if key in first:
                message = (
                    f"key {_short(key)} stands twice, first in line {first[key][0]}. Keep one."
                )
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
    """Return the value of a plain scalar in the YAML 1.2 core schema."""
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


def _is_text(text: str) -> bool:
    try:
        return isinstance(_resolve(text), str)
    except ValueError:
        return False


def _position(node: yaml.Node) -> Position:
    return node.start_mark.line + 1, node.start_mark.column + 1


def _short(text: str, most: int = 40) -> str:
    return repr(text if len(text) <= most else text[: most - 3] + "...")


def _neighbour_hint(path: Path) -> str:
    """Return the most similar task file in the folder of a missing path."""
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
    stems = {Path(name).stem: name for name in names}
    near = nearest(path.stem, stems)
    if near is not None:
        return f"Did you mean {stems[near]!r}?"
    rest = f" and {len(names) - 12} more" if len(names) > 12 else ""
    return f"There are {', '.join(sorted(names)[:12])}{rest}."
