"""What a task costs at least, and who has proved it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Optimum:
    """What the task costs at least.

    Parameters
    ----------
    cost
        In the task's metric, under chance expected; None where nothing was proved.
    actions
        A sequence of that cost, by number; empty under chance, or where nothing was proved.
    solver
        Who proved it.
    reason
        Why it is not proved; empty where it is.
    wall_s
        How long that took [s].
    not_checked
        What the back ends of the proof left unchecked, in sentences.

    Raises
    ------
    ValueError
        If there is a cost and a reason against it, or neither.
    """

    cost: float | None = None
    actions: tuple[int, ...] = ()
    solver: str = "auto"
    reason: str = ""
    wall_s: float | None = None
    not_checked: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if (self.cost is None) != bool(self.reason):
            raise ValueError("An optimum is either proved, or there is a reason.")
