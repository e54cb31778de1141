"""Moves of several agents at once: the earliest schedules that a sequence of moves allows.

A plan is a sequence of moves. Two that follow each other and do not clash may as well be made in
the other order, or at once; so every move starts as soon as those before it that are of the same
agent, or clash with it, have ended (the partial-order schedule of a totally ordered plan;
Backstroem, "Computational aspects of reordering plans", 1998).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from skillplan_swarmitfix.multiagent.multi_agent import Move


@dataclass(frozen=True, slots=True)
class TimedMove:
    """A move and when it runs.

    Parameters
    ----------
    move
        What is done.
    step
        The synchronous step in which it is made, from 0.
    start_s
        When it starts where none waits for a step to end [s].

    Raises
    ------
    ValueError
        If it starts before the beginning.
    """

    move: Move
    step: int
    start_s: float

    def __post_init__(self) -> None:
        if self.step < 0 or not self.start_s >= 0:
            raise ValueError(f"A move cannot be made in step {self.step}, at {self.start_s} s.")

    @property
    def end_s(self) -> float:
        """When it ends [s]."""
        return self.start_s + self.move.duration_s


@dataclass(frozen=True, slots=True)
class ParallelSchedule:
    """A sequence of moves, each as early as those that it has to wait for allow.

    Parameters
    ----------
    moves
        In the order of the sequence.

    Raises
    ------
    ValueError
        If two moves of one step clash.
    """

    moves: tuple[TimedMove, ...]

    def __post_init__(self) -> None:
        for step in self.steps():
            for i, one in enumerate(step):
                if any(one.agent == other.agent or one.clashes(other) for other in step[:i]):
                    raise ValueError(f"{one.skill} clashes with another move of its step.")

    @classmethod
    def earliest(cls, moves: Sequence[Move]) -> ParallelSchedule:
        """Return the earliest schedule, in steps and in seconds, of a sequence of moves."""
        timed: list[TimedMove] = []
        for move in moves:
            step, start_s = 0, 0.0
            for before in timed:
                if before.move.agent == move.agent or before.move.clashes(move):
                    step = max(step, before.step + 1)
                    start_s = max(start_s, before.end_s)
            timed.append(TimedMove(move, step, start_s))
        return cls(tuple(timed))

    def steps(self) -> tuple[tuple[Move, ...], ...]:
        """Return the moves of every synchronous step, by agent; they may be made in any order."""
        steps: list[list[Move]] = [[] for _ in range(self.makespan)]
        for timed in self.moves:
            steps[timed.step].append(timed.move)
        return tuple(tuple(sorted(step, key=lambda move: move.agent)) for step in steps)

    @property
    def makespan(self) -> int:
        """Number of synchronous steps."""
        return max((timed.step + 1 for timed in self.moves), default=0)

    @property
    def makespan_s(self) -> float:
        """When the last move ends where none waits for a step to end [s]."""
        return max((timed.end_s for timed in self.moves), default=0.0)
