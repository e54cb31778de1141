"""A plan and its replay as bytes and back, to the last digit."""

from __future__ import annotations

from pydantic import TypeAdapter

from skillplan_cad.planning.assembly_plan import AssemblyPlan
from skillplan_cad.planning.replay import Replay

_PLAN, _REPLAY = TypeAdapter(AssemblyPlan), TypeAdapter(Replay)


def plan_bytes(plan: AssemblyPlan) -> bytes:
    """Return a plan as a document."""
    return _PLAN.dump_json(plan)


def plan_from(content: bytes) -> AssemblyPlan:
    """Return the plan that `plan_bytes` wrote."""
    return _PLAN.validate_json(content)


def replay_bytes(again: Replay) -> bytes:
    """Return a replay as a document."""
    return _REPLAY.dump_json(again)


def replay_from(content: bytes) -> Replay:
    """Return the replay that `replay_bytes` wrote."""
    return _REPLAY.validate_json(content)
