"""Sequences of moves, run as early as they allow."""

from __future__ import annotations

import pytest

from skillplan_swarmitfix import Move, ParallelSchedule, TimedMove


def move(agent: int, occupies: int, duration_s: float = 1.0) -> Move:
    return Move(0, agent, 0, 1, 1 << 2 * agent, 2 << 2 * agent, "go", 0, occupies, 1.0, duration_s)


def steps_of(*moves: Move) -> list[int]:
    return [timed.step for timed in ParallelSchedule.earliest(moves).moves]


def test_moves_that_do_not_clash_are_made_at_once():
    assert steps_of(move(0, 0b01), move(1, 0b10)) == [0, 0]


def test_moves_of_one_agent_follow_each_other():
    assert steps_of(move(0, 0b01), move(0, 0b10)) == [0, 1]


def test_moves_that_clash_keep_their_order():
    assert steps_of(move(0, 0b01), move(1, 0b11), move(2, 0b10)) == [0, 1, 2]


def test_seconds_do_not_wait_for_a_step_to_end():
    """The second agent's second move starts while the first agent's long one runs."""
    schedule = ParallelSchedule.earliest(
        [move(0, 0b001, 9.0), move(1, 0b010, 2.0), move(1, 0b010, 3.0), move(2, 0b001, 1.0)]
    )
    assert [timed.start_s for timed in schedule.moves] == [0.0, 0.0, 2.0, 9.0]
    assert schedule.makespan_s == 10.0
    assert schedule.makespan == 2
    assert [len(step) for step in schedule.steps()] == [2, 2]


def test_nothing_takes_no_time():
    nothing = ParallelSchedule.earliest(())
    assert (nothing.makespan, nothing.makespan_s, nothing.steps()) == (0, 0.0, ())


def test_a_step_with_a_clash_is_refused():
    with pytest.raises(ValueError, match="go clashes with another move of its step"):
        ParallelSchedule((TimedMove(move(0, 1), 0, 0.0), TimedMove(move(1, 1), 0, 0.0)))


@pytest.mark.parametrize(("step", "start_s"), [(-1, 0.0), (0, -1.0)])
def test_nothing_starts_before_the_beginning(step, start_s):
    with pytest.raises(ValueError, match="A move cannot be made"):
        TimedMove(move(0, 1), step, start_s)
