"""What one arm cannot do of a plan, part by part, in words."""

from __future__ import annotations

from collections.abc import Iterator

from skillplan_cad.planning.assembly_plan import AssemblyPlan
from skillplan_cad.product import Product


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


def plan_limits(
    product: Product, plan: AssemblyPlan, up: tuple[float, float, float]
) -> Iterator[tuple[str, str]]:
    """Yield names of parts, each with what stands against it; `up` is what the task points up."""
    for step in plan.steps:
        for part in step.parts:
            if step.up != up:
                yield part, "comes after the product was turned over"
    for name in (one.name for one in product):
        steps = [step for step in plan.steps if name in step.held]
        if steps:
            words = [" with ".join(step.parts) for step in (steps[0], steps[-1])]
            until = f" until that of {words[1]}" if len(steps) > 1 else ""
            yield name, f"must be held from the step of {words[0]}{until}"
    for stuck in plan.stuck:
        yield stuck.part, f"cannot be taken out: {stuck.search.outcome}"
