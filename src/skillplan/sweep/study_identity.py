"""What makes a study this one: runs that were done under anything else do not belong to it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from skillplan import __version__
from skillplan.plugins.installed import registered
from skillplan.records.sweep.plan import SweepPlan, same

# What a study may differ in from the one that is resumed, in words.
_WORDS = {
    "task": "the task",
    "step_limit": "the step limit",
    "solver": "the solver",
    "physics": "the physics engine",
    "collision": "the collision detectors",
    "warm": "--warm",
    "design": "the design",
    "axes": "the values of the options",
    "space": "the ranges of the options",
    "minimise": "what is minimised",
    "sampler": "the sampler",
    "sampler_options": "the options of the sampler",
    "centre": "the centre",
    "fixed": "the fixed options",
    "starts": "the starts",
    "seeds": "the seeds",
    "versions": "a version",
}


def identity(plan: SweepPlan) -> dict[str, Any]:
    """Return what has to be the same for runs to belong together."""
    versions = {"skillplan": __version__}
    for entry in registered("solver").select(name=plan.solver):
        if entry.dist is not None:
            versions[entry.dist.name] = entry.dist.version
    # The optima are proved again, which may take longer than the limit.
    starts = [start.name for start in plan.starts]
    return {**plan.document(), "starts": starts, "versions": versions}


def difference(was: Mapping[str, Any], now: Mapping[str, Any]) -> str | None:
    """Return in what two identities differ, in words; None where they are the same."""
    for key, words in _WORDS.items():
        if not same(was.get(key), now.get(key)):
            there, here = _differing(was.get(key), now.get(key))
            return f"in {words}: {there} there, {here} now"
    return None


def _differing(was: Any, now: Any, most: int = 60) -> tuple[str, str]:
    """Return the first things in which two JSON values differ, as texts of bounded length."""
    while type(was) is type(now):
        if isinstance(was, dict) and was.keys() == now.keys():
            key = next(key for key in was if not same(was[key], now[key]))
            was, now = was[key], now[key]
        elif isinstance(was, list) and len(was) == len(now):
            was, now = next((a, b) for a, b in zip(was, now, strict=True) if not same(a, b))
        else:
            break
    texts = (json.dumps(was), json.dumps(now))
    return tuple(text if len(text) <= most else f"{text[:most]}..." for text in texts)  # type: ignore[return-value]
