"""Joints and blockings as bytes and back, to the last digit."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from skillplan_cad.blocking.confirmation import Doubt
from skillplan_cad.build_relation import Blocked, Joints
from skillplan_cad.contacts import Contact
from skillplan_cad.relation import Blocking, Fastener, Sensitive


def joints_bytes(joints: Joints) -> bytes:
    """Return joints as a document."""
    return json.dumps(asdict(joints)).encode()


def joints_from(content: bytes) -> Joints:
    """Return the joints that `joints_bytes` wrote."""
    document = json.loads(content)
    return Joints(
        tuple(Contact(**_tuples(one)) for one in document["contacts"]),
        tuple(Fastener(**_tuples(one)) for one in document["fasteners"]),
        tuple(_tuple(one) for one in document["directions"]),
    )


def blocked_bytes(blocked: Blocked) -> bytes:
    """Return blockings as a document."""
    return json.dumps(asdict(blocked)).encode()


def blocked_from(content: bytes) -> Blocked:
    """Return the blockings that `blocked_bytes` wrote."""
    document = json.loads(content)
    return Blocked(
        tuple(Blocking(**_tuples(one)) for one in document["entries"]),
        tuple(Sensitive(**_tuples(one)) for one in document["sensitive"]),
    )


def doubts_bytes(doubts: Sequence[Doubt]) -> bytes:
    """Return doubts as a document."""
    return json.dumps([asdict(one) for one in doubts]).encode()


def doubts_from(content: bytes) -> tuple[Doubt, ...]:
    """Return the doubts that `doubts_bytes` wrote."""
    return tuple(Doubt(**one) for one in json.loads(content))


def _tuples(values: dict[str, Any]) -> dict[str, Any]:
    return {name: _tuple(value) for name, value in values.items()}


def _tuple(value: Any) -> Any:
    return tuple(_tuple(one) for one in value) if isinstance(value, list) else value
