"""Links of a product: bodies that a screw, or a fit that holds, fixes to each other."""

from __future__ import annotations

from skillplan.task.state import State
from skillplan.task.task import Task


def list_links(task: Task, state: State) -> frozenset[tuple[str, str]]:
    """Return the pairs of bodies that are fixed to each other in a state; holders do not count."""
    links: set[tuple[str, str]] = set()
    for body in task.scene.bodies:
        operation = task.operations.get(body.name)
        if operation is None or operation not in state:
            continue
        links |= {(body.name, other) for other in body.joins}
        links |= {(body.name, fit.into) for fit in body.fits if fit.holds}
    return frozenset(links)
