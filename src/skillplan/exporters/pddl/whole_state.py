"""States in which of every choice something holds."""

from __future__ import annotations

from skillplan.task.state import State


def whole_state(state: State, forbids: State) -> State:
    """Return a state with a fact more of every choice of which none holds.

    Parameters
    ----------
    state
        Some facts.
    forbids
        Facts that are not chosen.
    """
    for group in state.facts.exclusive:
        members = state.facts.of(*group)
        left = members - forbids
        if not members & state and len(left):
            state |= state.facts.of(next(iter(left)))
    return state
