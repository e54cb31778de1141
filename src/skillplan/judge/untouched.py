"""A task as it was before a solver saw it: solvers work in this process and could change it."""

from __future__ import annotations

import pickle
from dataclasses import fields

from skillplan.task.task import Task


class Untouched:
    """Remembers a task, and undoes what was done to it.

    Parameters
    ----------
    task
        Before any solver has seen it. One that cannot be pickled, as a script may make it, cannot
        be remembered.
    """

    def __init__(self, task: Task) -> None:
        self._task = task
        self._before = _pickled(task)

    def restore(self) -> bool:
        """Undo whatever was done to the task since; return whether there was anything.

        The object stays the same. All that it holds is made anew, so that back ends that were
        constructed for it serve no longer.
        """
        if self._before is None or _pickled(self._task) == self._before:
            return False
        original: Task = pickle.loads(self._before)
        for one in fields(original):
            object.__setattr__(self._task, one.name, getattr(original, one.name))
        return True


def _pickled(task: Task) -> bytes | None:
    try:
        return pickle.dumps(task)
    except Exception:
        return None
