"""Modules of this repository as syntax trees, parsed once a process."""

import ast
import gc
from functools import cache
from pathlib import Path


@cache
def parsed(path: Path) -> ast.Module:
    """Return the tree of a module."""
    # Trees are kept, so collections would only visit ever more nodes.
    gc.disable()
    try:
        return ast.parse(path.read_text("utf-8"))
    finally:
        gc.enable()


@cache
def statements(path: Path) -> list[ast.AST]:
    """Return all statements of a module, however deep; imports and definitions are statements."""
    listed: list[ast.AST] = [*parsed(path).body]
    for node in listed:
        for block in ("body", "orelse", "finalbody", "handlers", "cases"):
            listed += getattr(node, block, ())
    return listed
