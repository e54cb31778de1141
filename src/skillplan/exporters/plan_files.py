"""Plans read from files: lists, tables, JSON, plans of PDDL planners, behaviour trees.

The content selects the format. Files are never executed, XML entities never expanded, and files
that are too large are refused before reading.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable, Iterator
from typing import Any, Final

from skillplan.errors import OptionError
from skillplan.exporters.behaviour_tree import unescape_text
from skillplan.exporters.plan_table import read_cell
from skillplan.files.json_file import parse_json
from skillplan.files.regular_file import read_bytes
from skillplan.task.skill import Skill
from skillplan.task.task import Task
from skillplan.xml_tree import Element, XmlError, parse_xml

MAX_BYTES: Final = 16 * 1024 * 1024
MOST_SKILLS: Final = 100_000
FORMATS = (
    "action numbers or skill names separated by commas, a CSV table with a column skill or action, "
    "JSON of skillplan, a plan of a PDDL planner, or a behaviour tree in XML"
)
# Nodes that may execute only some of their children.
_CHOICES = ("Fallback", "Parallel", "Switch", "IfThenElse", "WhileDoElse", "ReactiveFallback")

Entry = tuple[int, str]
"""Line in the file, and name or number of a skill."""


def read_plan(path: str, task: Task, skill_of: Callable[[str], str | None]) -> tuple[Skill, ...]:
    """Return the skills of a plan in a file.

    Parameters
    ----------
    skill_of
        Returns the skill of a PDDL action; called only for plans of planners.

    Raises
    ------
    OptionError
        If the file is unreadable, too large or in an unknown format, or names an unknown skill; the
        message has the line.
    """
    try:
        content = read_bytes(path, MAX_BYTES)
    except OSError as error:
        raise OptionError(f"{path}: cannot be read: {error.strerror}.") from None
    start = content.removeprefix(b"\xef\xbb\xbf").lstrip()[:1]
    skills: list[Skill] = []
    if start == b"<":
        entries = _read_tree(path, content)
    else:
        try:
            text = content.decode("utf-8-sig")
        except UnicodeDecodeError as error:
            line = content.count(b"\n", 0, error.start) + 1
            raise OptionError(f"{path}:{line}: is not UTF-8. Give {FORMATS}.") from None
        if start in (b"{", b"["):
            entries = _read_json(path, text, task)
        elif start in (b"(", b";"):
            entries = _read_planner(path, text, skill_of)
        else:
            entries = _read_list(text) if _has_skill_first(text, task) else _read_table(path, text)
    for line, name in entries:
        if len(skills) == MOST_SKILLS:
            raise OptionError(f"{path}:{line}: has more than {MOST_SKILLS:,} skills.")
        try:
            skills.append(task.skill(name))
        except OptionError as error:
            raise OptionError(f"{path}:{line}: {error}") from None
    if not skills:
        raise OptionError(f"{path}:1: holds no plan. Give {FORMATS}.")
    return tuple(skills)


def _has_skill_first(text: str, task: Task) -> bool:
    """Return True if the first word of a text is a skill and not the header of a column."""
    first = next(_read_list(text), None)
    if first is None:
        return False
    try:
        task.skill(first[1])
    except OptionError:
        return False
    return True


def _read_list(text: str) -> Iterator[Entry]:
    """Yield the entries of a list as for --sequence, on any number of lines."""
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.split(",") if "," in line else line.split()
        yield from ((number, word.strip()) for word in words if word.strip())


def _read_table(path: str, text: str) -> Iterator[Entry]:
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    try:
        header = [cell.strip() for cell in next(reader, [])]
        column = next((header.index(name) for name in ("skill", "action") if name in header), None)
        if column is None:
            raise OptionError(f"{path}:1: is in no known format. Give {FORMATS}.")
        for row in reader:
            if not row:
                continue
            if len(row) <= column:
                raise OptionError(
                    f"{path}:{reader.line_num}: has {len(row)} cells, and the plan stands in cell "
                    f"{column + 1}."
                )
            yield reader.line_num, read_cell(row[column])
    except csv.Error as error:
        raise OptionError(f"{path}:{reader.line_num}: is no CSV: {error}.") from None


def _read_json(path: str, text: str, task: Task) -> Iterator[Entry]:
    try:
        document: Any = parse_json(text)
    except ValueError as error:
        line = getattr(error, "lineno", 1)
        raise OptionError(f"{path}:{line}: is no JSON: {error}.") from None
    if isinstance(document, dict):
        parts = [document, *(document.get("stages") or []), *(document.get("sequences") or [])]
        named = [part for part in parts if isinstance(part, dict) and part.get("name") == task.name]
        document = (named or [document])[0].get("skills")
    if not isinstance(document, list) or not all(
        isinstance(entry, str | int) for entry in document
    ):
        raise OptionError(
            f"{path}:1: holds no plan of {task.name}: a list of skills, or a document with the key "
            "skills, is wanted."
        )
    # Begin of the plan, since steps contain the same names.
    at = max(0, text.find('"skills"'))
    for entry in document:
        written = entry if isinstance(entry, int) else json.dumps(entry, ensure_ascii=False)
        position = text.find(str(written), at)
        at = at if position < 0 else position + 1
        yield 1 + text.count("\n", 0, at), str(entry)


def _read_planner(path: str, text: str, skill_of: Callable[[str], str | None]) -> Iterator[Entry]:
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.partition(";")[0].strip()
        if not words:
            continue
        if words[:1] != "(" or words[-1:] != ")" or not words[1:-1].split():
            raise OptionError(
                f"{path}:{number}: is no action in brackets, such as (pick_pcb location_home)."
            )
        action = words[1:-1].split()[0]
        name = skill_of(action)
        if name is None:
            raise OptionError(
                f"{path}:{number}: no action {action[:80]!r} is exported for this task; 'skillplan "
                "export --to pddl' writes them."
            )
        yield number, name


def _read_tree(path: str, content: bytes) -> Iterator[Entry]:
    try:
        root = parse_xml(content, "keep the plan alone")
    except XmlError as error:
        line = "" if error.line is None else f":{error.line}"
        raise OptionError(f"{path}{line}: {error}.") from None
    trees = {tree.attributes.get("ID", ""): tree for tree in root.all("BehaviorTree")}
    main = root.attributes.get("main_tree_to_execute", "plan")
    if main not in trees:
        if len(trees) != 1:
            raise OptionError(
                f"{path}:{root.line}: has no behaviour tree {main[:80]!r}; name the main one by "
                "main_tree_to_execute."
            )
        main = next(iter(trees))
    yield from _read_node(path, trees[main], trees, (main,))


def _read_node(
    path: str, node: Element, trees: dict[str, Element], within: tuple[str, ...]
) -> Iterator[Entry]:
    skill = node.attributes.get("skill", "{")
    if not skill.startswith("{"):
        yield node.line, unescape_text(skill)
        return
    name = node.attributes.get("ID", "")
    if node.tag == "SubTree" and name in trees:
        if name in within:
            raise OptionError(f"{path}:{node.line}: the tree {name[:80]!r} holds itself.")
        yield from _read_node(path, trees[name], trees, (*within, name))
        return
    entries = [entry for child in node.children for entry in _read_node(path, child, trees, within)]
    if len(entries) > 1 and node.tag.startswith(_CHOICES):
        raise OptionError(
            f"{path}:{node.line}: {node.tag} leaves open which of {len(entries)} skills are done; "
            "a plan is a sequence."
        )
    yield from entries
