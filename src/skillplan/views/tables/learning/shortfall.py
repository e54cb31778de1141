"""Why runs of a learner do not complete a task, as notes below their table."""

from __future__ import annotations

from collections.abc import Sequence

from skillplan.records.training.result import TrainingResult
from skillplan.records.training.shortfall import Shortfall
from skillplan.views.text.wording import count

_MOST_NAMED = 5
_CAUSES = {
    "policy": "the task was completed, but what was learned does not do so",
    "steps": "the steps ended it",
    "exploration": "exploration ended it",
}


def shortfall_notes(result: TrainingResult) -> list[str]:
    """Return how far the runs got, what they ran into, and what to try; nothing where all is well.

    Parameters
    ----------
    result
        The runs.
    """
    short = result.shortfall
    if short is None:
        return []
    whom = count(len(short.runs), "run")
    note = f"short      {whom} reached at most {short.most_goals} of {count(short.goals, 'goal')}"
    if short.last_progress_step is not None:
        note += f", first at step {short.last_progress_step:,}"
    notes = [note]
    if short.missing:
        notes.append(f"never      {_listed(short.missing)} of the goal held in no episode")
    if short.never:
        notes.append(f"skills     never executed: {_listed(short.never)}")
    notes += _ends(short)
    if short.hidden is not None:
        notes.append(
            f"mask       {result.options['mask']}: preconditions hid {short.hidden:.1f} of "
            f"{count(short.skills, 'skill')} on average"
        )
    return [*notes, f"cause      {_CAUSES[short.cause]}", f"try        {short.advice}"]


def _ends(short: Shortfall) -> list[str]:
    notes = []
    episodes = count(short.episodes, "episode")
    if short.dead_states:
        states = "the state" if short.dead_states == 1 else f"one of {short.dead_states:,} states"
        notes.append(
            f"dead ends  {short.dead_ends:,} of {episodes} entered {states} from which all that "
            "was applicable failed"
        )
    if short.failed:
        worst = _listed([f"{name} ({times:,})" for name, times in short.failed])
        notes.append(f"failed     {worst}")
    if short.out_of_time:
        notes.append(f"time       {short.out_of_time:,} of {episodes} reached the step limit")
    return notes


def _listed(names: Sequence[str]) -> str:
    more = len(names) - _MOST_NAMED
    shown = ", ".join(names[:_MOST_NAMED])
    return shown if more <= 0 else f"{shown} and {more} more"
