"""Why runs of a learner do not complete a task, as notes below their table."""

from __future__ import annotations

from collections.abc import Sequence

from skillplan.records.training.result import TrainingResult
from skillplan.records.training.shortfall import Shortfall
from skillplan.views.text.wording import count

_MOST_NAMED = 5


def cause_words(cause: str, progress_step: int | None, steps: int | None) -> str:
    """Return what ended runs that do not complete a task, in words.

    Parameters
    ----------
    cause
        That of a `Shortfall`.
    progress_step
        After how many steps of its run the most goals were reached first; None for none.
    steps
        How many steps a run was to do; None where that is not known.
    """
    if cause == "policy":
        return "policy: the task was completed, but what was learned does not do so"
    if cause == "steps":
        return "steps: the runs were still getting further when they ended"
    if progress_step is None:
        return "exploration: no goal was reached at all"
    of = "" if steps is None else f" of {steps:,}"
    return f"exploration: nothing further was reached after step {progress_step:,}{of}"


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
    goals = count(short.goals, "goal")
    note = f"short      {whom} had at most {short.most_goals} of {goals} at the same time"
    if short.last_progress_step is not None:
        note += f", first at step {short.last_progress_step:,} of {result.steps:,}"
    notes = [note]
    if short.missing:
        notes.append(f"never      reached: {_listed(short.missing)}")
    if short.never:
        notes.append(f"skills     never executed: {_listed(short.never)}")
    notes += _ends(short)
    if short.hidden is not None:
        notes.append(
            f"mask       {result.options['mask']}: preconditions hid {short.hidden:.1f} of "
            f"{count(short.skills, 'skill')} on average, and left {short.skills - short.hidden:.1f}"
        )
    cause = cause_words(short.cause, short.last_progress_step, result.steps)
    return [*notes, f"cause      {cause}", f"try        {short.advice}"]


def _ends(short: Shortfall) -> list[str]:
    notes = []
    episodes = count(short.episodes, "episode")
    if short.dead_states:
        states = count(short.dead_states, "state")
        notes.append(
            f"dead ends  {short.dead_ends:,} of {episodes} entered one: {states} in which every "
            "applicable skill failed, or led to such a state"
        )
    if short.failed:
        worst = _listed([f"{name} {times:,} times" for name, times in short.failed])
        notes.append(f"failed     {worst}")
    if short.out_of_time:
        notes.append(f"time       {short.out_of_time:,} of {episodes} reached the step limit")
    return notes


def _listed(names: Sequence[str]) -> str:
    more = len(names) - _MOST_NAMED
    shown = ", ".join(names[:_MOST_NAMED])
    return shown if more <= 0 else f"{shown} and {more} more"
