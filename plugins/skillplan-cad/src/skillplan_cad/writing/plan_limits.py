"""What one arm cannot do of a plan, part by part, in words."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from skillplan_cad.planning.assembly_plan import AssemblyPlan
from skillplan_cad.product import Product, Vector
from skillplan_cad.relation import Relation

# Cosine of what still counts as level.
_LEVEL = 1e-6


def not_straight(plan: AssemblyPlan) -> dict[str, str]:
    """Return the parts that no straight move of a single part brings, with why, after the name."""
    found: dict[str, str] = {}
    for step in plan.steps:
        for part in step.parts:
            if len(step.parts) > 1:
                others = ", ".join(name for name in step.parts if name != part)
                found[part] = f"comes as one with {others}, put together apart before"
            elif step.path:
                found[part] = f"comes by {len(step.path)} moves, not by a straight one"
    return found


def from_below(relation: Relation, up: Vector) -> dict[str, str]:
    """Return the screws and nuts that are driven from below, with why, after the name."""
    words = "is driven from below: the product has to be turned over, or held up by a fixture"
    return {
        one.part: words
        for one in relation.fasteners
        if one.part in relation.driven and float(np.dot(one.axis, up)) < -_LEVEL
    }


def plan_limits(product: Product, plan: AssemblyPlan, up: Vector) -> Iterator[tuple[str, str]]:
    """Yield names of parts, each with what stands against it; `up` is what the task points up."""
    for step in plan.steps:
        for part in step.parts:
            if step.up != up:
                yield part, "comes after the product was turned over"
    for name in (one.name for one in product):
        numbers = [number for number, step in enumerate(plan.steps) if name in step.held]
        if numbers:
            first, after = plan.steps[numbers[0]], plan.steps[numbers[-1] + 1 :]
            since = "it" if name in first.parts else " with ".join(first.parts)
            until = f"until {' with '.join(after[0].parts)} is" if after else "to the end"
            yield name, f"must be held once {since} is placed, {until}"
    for stuck in plan.stuck:
        yield stuck.part, f"cannot be taken out: {stuck.search.outcome}"
