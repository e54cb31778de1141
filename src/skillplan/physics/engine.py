"""The base class of physics engines."""

from __future__ import annotations

from skillplan.task.back_end import BackEnd


class Engine(BackEnd):
    """Executes a skill's motion and compares the result with the prediction.

    The verdict is infeasible if the robot cannot follow the motion, or if the world differs from
    ``scene.at(next_state)`` by more than the tolerance; the evidence has the figure.
    """
