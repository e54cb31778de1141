"""The base class of physics engines."""

from __future__ import annotations

from skillplan.task.back_end import BackEnd


class Engine(BackEnd):
    """Executes a skill's motion and checks whether it brings about what is predicted.

    The verdict is infeasible where the robot cannot follow the motion or the world afterwards
    is not ``scene.at(next_state)`` within tolerance; the evidence holds the figure.
    """
