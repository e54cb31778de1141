"""What an answer of a back end depends on, as a hash.

How a verdict lies on disk: `verdict_file`; finding and dropping it: `verdict_cache`.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any

from skillplan.checks.code_origin import code_origin
from skillplan.task.back_end import BackEnd
from skillplan.task.skill import Skill
from skillplan.task.state import State

# Fields that change no verdict: dwell times.
_IRRELEVANT = ("dwell_s",)


def verdict_key(back_end: BackEnd, skill: Skill) -> str:
    """Return the hash of all that an answer of `back_end` about `skill` depends on.

    Scene, skill, facts, and the back end's name, version, options, basis and code.
    """
    content = {
        "back_end": [
            class_name(back_end),
            back_end.name,
            back_end.version,
        ],
        "code": list(code_origin(type(back_end))),
        "options": back_end.options.model_dump(mode="json"),
        "basis": plain(back_end.basis),
        "facts": list(back_end.task.facts.names),
        "scene": plain(back_end.task.scene),
        "skill": [skill.name, skill.kind, list(skill.agents), dict(skill.parameters)],
        "execution": [plain(skill.motion), str(skill.precondition)],
        "prediction": [str(skill.prediction.add), str(skill.prediction.delete)],
        "cases": [
            plain(case.fact) + plain(case.forbids) + plain(case.outcomes) for case in skill.cases
        ],
        "chart": [[line.before, line.after] for line in back_end.task.chart],
        "operations": dict(back_end.task.operations),
    }
    return content_hash(content)


def content_hash(content: Any) -> str:
    """Return the hash of JSON values, in hexadecimal; the order of keys does not matter."""
    text = json.dumps(content, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


def class_name(back_end: BackEnd) -> str:
    """Return what distinguishes an engine from a detector of the same name."""
    return f"{type(back_end).__module__}.{type(back_end).__qualname__}"


def plain(value: Any) -> Any:
    """Return a data class as JSON values; states become their facts' names."""
    if isinstance(value, State):
        return list(value)
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if hasattr(value, "__dataclass_fields__"):
        names = [name for name in value.__dataclass_fields__ if not name.startswith("_")]
        return {name: plain(getattr(value, name)) for name in names if name not in _IRRELEVANT}
    return value
