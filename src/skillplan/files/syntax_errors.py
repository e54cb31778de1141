"""What a YAML parser found wrong, in words for the author of a task file."""

from __future__ import annotations

from typing import Any

import yaml

from skillplan.errors import Issue

# What the parser says, and what to do about it.
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


def syntax_issue(error: yaml.YAMLError, text: str) -> Issue:
    """Return the position and words of a syntax error, and what to do about it."""
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
