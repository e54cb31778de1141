"""Sphinx extension: the public names are documented as ``skillplan.NAME``, wherever they live.

A line ``<!-- generated: public-names -->`` is replaced by an autodoc directive for each of
``skillplan.__all__``. A reference in a docstring to the module where a name lives leads there.
"""

from __future__ import annotations

import importlib
import inspect
from typing import Any

import skillplan
from skillplan import errors


def page() -> str:
    """Return a heading and an autodoc directive for every public name."""
    pieces = []
    for name in sorted(skillplan.__all__, key=str.lower):
        is_class = inspect.isclass(getattr(skillplan, name))
        pieces += [f"### {name}", "", "```{eval-rst}"]
        pieces.append(f".. {'autoclass' if is_class else 'autofunction'}:: skillplan.{name}")
        pieces += ["   :members:", "   :exclude-members: Options"] * is_class + ["```", ""]
    return "\n".join(pieces)


def errors_page() -> str:
    """Return an autodoc directive for every error that is no public name."""
    found = [
        name
        for name, value in vars(errors).items()
        if inspect.isclass(value)
        and issubclass(value, (errors.SkillplanError, errors.SearchStopped))
        and name not in skillplan.__all__
    ]
    lines = [f".. autoexception:: skillplan.errors.{name}" for name in found]
    return "\n".join(["```{eval-rst}", *lines, "```"])


def homes() -> dict[str, str]:
    """Return the public name by the full name of where it lives."""
    values = {name: getattr(skillplan, name) for name in skillplan.__all__}
    return {
        f"{value.__module__}.{value.__qualname__}": f"skillplan.{name}"
        for name, value in values.items()
        if hasattr(value, "__qualname__")
    }


def setup(app: Any) -> dict[str, Any]:
    """Resolve references to where a public name lives; others of this package become plain text."""
    known = homes()

    def resolve(app: Any, env: Any, node: Any, content: Any) -> Any:
        if node.get("refdomain") != "py":
            return None
        target = node.get("reftarget", "")
        public = known.get(target)
        if public is None and target in skillplan.__all__:
            public = f"skillplan.{target}"
        if public is None and hasattr(errors, target):
            public = f"skillplan.errors.{target}"
        if public is not None:
            domain = env.get_domain("py")
            found = domain.resolve_xref(
                env, node["refdoc"], app.builder, "obj", public, node, content
            )
            if found is not None:
                return found
        # Types of other packages, and types that are not public, stay readable text.
        return content if _exists(target) or node.get("reftype") == "class" else None

    app.connect("missing-reference", resolve)
    return {"version": "1", "parallel_read_safe": True}


def _exists(target: str) -> bool:
    """Whether a dotted name of this package leads to something."""
    parts = target.split(".")
    for cut in range(len(parts), 0, -1):
        try:
            value: Any = importlib.import_module(".".join(parts[:cut]))
        except ImportError:
            continue
        for part in parts[cut:]:
            if not hasattr(value, part):
                return False
            value = getattr(value, part)
        return True
    return False
