"""Jaws that hold a part still: what friction does is done by a bond, and pads press only."""

from __future__ import annotations

from skillplan_mujoco.simulator.world import World
from skillplan_simulation.simulator import FINGERS
from skillplan_simulation.static_friction import HoldingArm, StaticFriction


class SmoothPads(StaticFriction):
    """Holds a part still in the jaws while friction can; see `StaticFriction`.

    Contacts with friction would hold it as well, yet not where it was: a step leads an arm along
    the tangent of its way, and contacts let stand by how much it ends beside it, 0.2 mm in a lift
    by 0.25 m. They would draw at the bond with all that they have.

    Parameters
    ----------
    world, arm
        Where, and whose jaws.
    name
        Of the part.
    """

    world: World

    def __init__(self, world: World, arm: HoldingArm, name: str) -> None:
        super().__init__(world, arm, name)
        if self.constraint is not None:
            world.smooth(FINGERS)

    def let_go(self) -> None:
        """Leave the part to its contacts."""
        if self.constraint is not None:
            self.world.roughen(FINGERS)
        super().let_go()
