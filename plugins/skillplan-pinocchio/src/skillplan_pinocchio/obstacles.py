"""Obstacles: every body at every place where it can be, by the fact that puts it there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from skillplan.task.scene import WORLD, Scene
from skillplan_pinocchio.shapes import ConvexPiece, standing_pieces_of, table

TABLE: Final = "the table"


@dataclass(frozen=True, slots=True)
class Obstacle:
    """A body where a fact puts it.

    Parameters
    ----------
    body
        Its name.
    fact
        Holds while it is there; None for what is always there.
    pieces
        In the world.
    """

    body: str
    fact: str | None
    pieces: tuple[ConvexPiece, ...]

    @property
    def top_m(self) -> float:
        """Height of its highest point [m]."""
        return max(piece.high[2] for piece in self.pieces)


def obstacles_of(scene: Scene) -> tuple[Obstacle, ...]:
    """Return the table, then every place at which something can touch a body."""
    return (
        Obstacle(TABLE, None, (table(),)),
        *(
            Obstacle(body.name, placement.fact, standing_pieces_of(body, placement.pose))
            for body in scene.bodies
            for placement in body.placements
            if placement.solid and placement.frame == WORLD
        ),
    )
