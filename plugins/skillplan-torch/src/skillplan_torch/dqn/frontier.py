"""Going back to where episodes got to, until a run has completed the task.

Random episodes of a board end after a few skills, as most of what can be begun leads nowhere. So
the observation that is farthest on and has something untried is returned to, by the actions that
led there, and explored from: Ecoffet et al., "First return, then explore" (2021). Returning takes
steps like any other. How far on something is, is counted in actions that were never seen to be
undone: a change of tools is, a part that was placed is not. What was seen to fail, or to lead only
to what fails, is not taken again. Nothing is known but what the run has observed; the task must be
deterministic, and always begin alike.
"""

from __future__ import annotations

import heapq
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skillplan_torch.observation_counts import ObservationCounts

Arrays = dict[str, NDArray[Any]]
# Columns of what is kept of it.
_PATHS, _STEPS, _FAILED = 5, 4, 3


class Frontier:
    """What every run knows of how it got where, and of what leads nowhere.

    Parameters
    ----------
    generators
        One for every run.
    counts
        Of what every run has tried.
    step_limit
        Most skills of an episode.
    """

    def __init__(
        self,
        generators: Sequence[np.random.Generator],
        counts: ObservationCounts,
        step_limit: int,
    ) -> None:
        self._generators, self._counts, self._limit = generators, counts, step_limit
        self._runs = [_Known() for _ in generators]

    def begin_episode(self, run: int) -> None:
        """Choose where the episode that begins returns to: the farthest with something untried."""
        known = self._runs[run]
        known.plan = []
        while known.farthest:
            at = -known.farthest[0][2]
            current = known.farthest[0] == known.rank(at)
            if current and at not in known.dead and self._untried(run, at):
                known.plan = known.path_to(at)
                return
            heapq.heappop(known.farthest)

    def action(self, run: int, at: int) -> int | None:
        """Return the way back, or something untried; None where all is known to lead nowhere.

        Parameters
        ----------
        run
            Whose.
        at
            Index of what it observes.
        """
        known, at = self._runs[run], self._observed(run, at)
        if not known.paths:
            known.add(at, 0, -1, -1)
        if known.plan:
            return known.plan.pop()
        choices = self._untried(run, at) or self._not_in(run, at, known.failed)
        if not choices:
            return None
        # What was seen to be undone brings nothing by itself.
        choices = [one for one in choices if one not in known.undone] or choices
        return choices[int(self._generators[run].integers(len(choices)))]

    def stepped(self, run: int, before: int, action: int, after: int | None) -> None:
        """Take in what a step led to.

        Parameters
        ----------
        run
            Whose.
        before
            Index of what was observed before.
        action
            The action.
        after
            Index of what was observed after; None where the action could not be executed.
        """
        known, before = self._runs[run], self._observed(run, before)
        if action in known.tried.get(before, ()):
            return
        known.tried.setdefault(before, set()).add(action)
        if after is None:
            self._fail(run, before, action)
            return
        after = self._observed(run, after)
        known.into.setdefault(after, []).append((before, action))
        known.note_undone(before, action, after)
        if after in known.dead:
            self._fail(run, before, action)
        elif before in known.paths:
            depth = known.paths[before][0] + 1
            if depth < min(self._limit, known.paths.get(after, (self._limit,))[0]):
                known.add(after, depth, before, action)

    def _fail(self, run: int, before: int, action: int) -> None:
        """Note that an action leads nowhere, and what follows from that for those before."""
        known, waiting = self._runs[run], [(before, action)]
        while waiting:
            at, taken = waiting.pop()
            failed = known.failed.setdefault(at, set())
            if taken in failed:
                continue
            failed.add(taken)
            if at not in known.dead and self._all_failed(run, at):
                known.dead.add(at)
                waiting += known.into.get(at, [])

    def _all_failed(self, run: int, at: int) -> bool:
        return not self._not_in(run, at, self._runs[run].failed)

    def _untried(self, run: int, at: int) -> list[int]:
        return self._not_in(run, at, self._runs[run].tried)

    def _not_in(self, run: int, at: int, actions: Mapping[int, set[int]]) -> list[int]:
        """Return the actions that are allowed somewhere, but for those listed."""
        known, left_out = self._runs[run], actions.get(at, ())
        if at not in known.allowed:
            known.allowed[at] = np.flatnonzero(self._counts.masks[run, at]).tolist()
        return [action for action in known.allowed[at] if action not in left_out]

    def _observed(self, run: int, index: int) -> int:
        """Return the first index of what is observed, whatever was done before it."""
        known, seen = self._runs[run], self._counts
        for new in range(len(known.first), index + 1):
            content = seen.observations[run, new].tobytes() + seen.masks[run, new].tobytes()
            known.first.append(known.by_content.setdefault(content, new))
        return known.first[index]

    def plans(self) -> list[list[int]]:
        """Return what every run has still to do to get back, the next action last."""
        return [list(one.plan) for one in self._runs]

    def arrays(self, name: str) -> Arrays:
        """Return all that is known, to be read by `read`."""
        paths = [(r, i, *p) for r, one in enumerate(self._runs) for i, p in one.paths.items()]
        steps = [
            (r, after, before, action)
            for r, one in enumerate(self._runs)
            for after, all_before in one.into.items()
            for before, action in all_before
        ]
        failed = [
            (r, at, action)
            for r, one in enumerate(self._runs)
            for at, actions in one.failed.items()
            for action in sorted(actions)
        ]
        return {
            f"{name}.paths": np.array(paths, dtype=np.int64).reshape(-1, _PATHS),
            f"{name}.steps": np.array(steps, dtype=np.int64).reshape(-1, _STEPS),
            f"{name}.failed": np.array(failed, dtype=np.int64).reshape(-1, _FAILED),
        }

    def read(self, name: str, arrays: Mapping[str, NDArray[Any]], plans: Sequence[Any]) -> None:
        """Take over what `arrays` and `plans` returned; the counts have been read before.

        Raises
        ------
        ValueError
            If it is of another shape.
        """
        rows = {}
        for key, width in (("paths", _PATHS), ("steps", _STEPS), ("failed", _FAILED)):
            array = arrays.get(f"{name}.{key}")
            if array is None or array.ndim != 2 or array.shape[1] != width:
                raise ValueError(f"The array {name}.{key} is missing or of another shape.")
            rows[key] = array.tolist()
        if len(plans) != len(self._runs):
            raise ValueError(f"There are {len(plans)} ways back for {len(self._runs)} runs.")
        self._runs = [_Known() for _ in self._generators]
        for run, after, before, action in rows["steps"]:
            self._runs[run].into.setdefault(after, []).append((before, action))
            self._runs[run].note_undone(before, action, after)
            self._runs[run].tried.setdefault(before, set()).add(action)
        for run, at, action in rows["failed"]:
            self._runs[run].failed.setdefault(at, set()).add(action)
            self._runs[run].tried.setdefault(at, set()).add(action)
        for run, index, depth, before, action in rows["paths"]:
            self._runs[run].add(index, depth, before, action)
        for run, (known, plan) in enumerate(zip(self._runs, plans, strict=True)):
            known.dead = {at for at in known.failed if self._all_failed(run, at)}
            known.plan = [int(action) for action in plan]


class _Known:
    """What one run knows."""

    def __init__(self) -> None:
        # Of an observation: after how many skills it was met first, from which, by which action.
        self.paths: dict[int, tuple[int, int, int]] = {}
        self.into: dict[int, list[tuple[int, int]]] = {}
        self.tried: dict[int, set[int]] = {}
        self.failed: dict[int, set[int]] = {}
        self.allowed: dict[int, list[int]] = {}
        # Of every index the first one of the same content.
        self.first: list[int] = []
        self.by_content: dict[bytes, int] = {}
        self.dead: set[int] = set()
        self.plan: list[int] = []
        # Actions that another one was seen to undo, or that changed nothing.
        self.undone: set[int] = set()
        # The farthest first, of equals the nearest, then the newest. What has nothing untried, or
        # another rank meanwhile, goes when it is met.
        self.farthest: list[tuple[int, int, int]] = []

    def add(self, index: int, depth: int, before: int, action: int) -> None:
        """Note an observation that was not met before, or not by so few skills."""
        self.paths[index] = depth, before, action
        heapq.heappush(self.farthest, self.rank(index))

    def rank(self, index: int) -> tuple[int, int, int]:
        """Return by what the observation to go back to is chosen, the least first."""
        far, at = 0, index
        while self.paths[at][1] >= 0:
            far += self.paths[at][2] not in self.undone
            at = self.paths[at][1]
        return -far, self.paths[index][0], -index

    def note_undone(self, before: int, action: int, after: int) -> None:
        """See whether a step undoes another one."""
        back = {one for at, one in self.into.get(before, ()) if at == after}
        if before == after:
            back = {action}
        elif back:
            back.add(action)
        if back - self.undone:
            self.undone |= back
            self.farthest = [self.rank(index) for index in self.paths]
            heapq.heapify(self.farthest)

    def path_to(self, index: int) -> list[int]:
        """Return the actions that lead to an observation, the first one last."""
        found = []
        while self.paths[index][1] >= 0:
            _, before, action = self.paths[index]
            found.append(action)
            index = before
        return found
