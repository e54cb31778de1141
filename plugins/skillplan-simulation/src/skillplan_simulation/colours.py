"""What colours bodies have in pictures: those of a task in turn, so that each keeps its own."""

from __future__ import annotations

from skillplan.task.scene import Scene

Colour = tuple[float, float, float, float]

PALETTE: tuple[Colour, ...] = (
    (0.16, 0.45, 0.24, 1.0),
    (0.85, 0.55, 0.20, 1.0),
    (0.80, 0.72, 0.30, 1.0),
    (0.55, 0.35, 0.65, 1.0),
    (0.75, 0.30, 0.25, 1.0),
    (0.35, 0.50, 0.75, 1.0),
    (0.45, 0.45, 0.48, 1.0),
    (0.20, 0.65, 0.65, 1.0),
    (0.90, 0.60, 0.65, 1.0),
    (0.55, 0.75, 0.30, 1.0),
    (0.20, 0.25, 0.55, 1.0),
    (0.55, 0.38, 0.22, 1.0),
    (0.70, 0.80, 0.92, 1.0),
    (0.25, 0.22, 0.22, 1.0),
)
TABLE_COLOUR: Colour = (0.83, 0.82, 0.79, 1.0)
ARM_COLOUR: Colour = (0.93, 0.93, 0.94, 1.0)
HAND_COLOUR: Colour = (0.36, 0.37, 0.40, 1.0)
# What is on the table where parts are taken, and tools.
FEEDER_COLOUR: Colour = (0.60, 0.66, 0.74, 1.0)
DOCK_COLOUR: Colour = (0.42, 0.46, 0.52, 1.0)
# Of two bodies that touch the first is red and the other orange; all else is pale then.
ALARMS: tuple[Colour, Colour] = ((0.90, 0.10, 0.10, 1.0), (1.0, 0.55, 0.05, 1.0))
PALE: Colour = (0.80, 0.80, 0.80, 1.0)


def colour_number(scene: Scene, name: str) -> int:
    """Return the number of a body's colour, the same in every picture; tools come after parts."""
    names = [body.name for body in scene.bodies]
    names += [tool.name for robot in scene.robots for tool in robot.tools]
    return names.index(name)
