"""Episodes that are planned with what a run has learned, until nothing better is in sight.

Plans are optimistic: what is not known to fail succeeds, and what was never seen costs little, so
that a plan either comes off or teaches something (R-max: Brafman and Tennenholtz, 2002; with
learned schemas: Walsh and Littman, 2008). Until the task was completed they seek as much progress
as can be; then cheaper orders. At last it is tried whether the goal needs all that held in the end.
Steps of planned episodes count like any other. The task must be deterministic, always begin alike,
and be observed in bits.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skillplan_torch.observation_counts import ObservationCounts
from skillplan_torch.planned.beam_kernel import Search, beam_search
from skillplan_torch.planned.conditions import Words
from skillplan_torch.planned.task_model import TaskModel
from skillplan_torch.snapshot_arrays import fitting

Arrays = dict[str, NDArray[Any]]

# What progress is worth, in costs; and what is left of it after a step that may fail.
_WORTH, _LEFT = 1e6, 0.5
# Of an action that never succeeded, in progress.
_TRIAL = 1.5
# So many plans may go against what conjunctions of literals say.
_MOST_AGAINST = 300
# Costs that differ by less are the same.
_TOLERANCE = 1e-9


@dataclass(frozen=True)
class _Stage:
    """How is planned: width of the search, hope for costs, and whether conjunctions are trusted."""

    width: int
    hope: float
    conjunctions: bool = True


class PlannedEpisodes:
    """Plans the episodes of every run.

    Parameters
    ----------
    generators
        One for every run, from which is drawn how cheap it hopes things to be.
    counts
        Of what every run has tried, with what it observed.
    step_limit
        Most skills of an episode.
    width
        How many plans a search goes on with at first.
    """

    def __init__(
        self,
        generators: Sequence[np.random.Generator],
        counts: ObservationCounts,
        step_limit: int,
        width: int,
    ) -> None:
        self._counts, self._limit = counts, step_limit
        # How widely is searched, and how cheap what was never seen may be.
        self._stages = (
            _Stage(width, 1.0),
            _Stage(width, 0.5),
            _Stage(2 * width, 0.25),
            _Stage(4 * width, 0.0),
            _Stage(width, 0.5, conjunctions=False),
            _Stage(16 * width, 0.5),
        )
        features, actions = counts.observations.shape[2], counts.masks.shape[2]
        self._runs = [_Run(TaskModel(features, actions, one)) for one in generators]

    def settled(self, run: int) -> bool:
        """Whether nothing better is in sight."""
        return self._runs[run].settled

    def begin_episode(self, run: int) -> None:
        """Plan the episode that begins, where a plan was executed or taught something."""
        one = self._runs[run]
        one.plan, one.cost = [], 0.0
        if one.settled or not one.model.completed:
            return
        self._seek(one)
        if not one.plan and one.learned:
            # What was learned meanwhile may bring something into sight.
            one.learned, one.stage = False, 0
            self._seek(one)
        one.settled = not one.plan

    def _seek(self, one: _Run) -> None:
        """Plan what would be better than the best so far, or try what the goal needs."""
        while one.stage < len(self._stages):
            conjunctions = self._stages[one.stage].conjunctions
            if conjunctions or one.against < _MOST_AGAINST:
                one.plan = self._cheaper(one, one.model.goal)
            if one.plan and one.plan != one.planned:
                one.planned = list(one.plan)
                one.against += not conjunctions
                one.learned = True
                return
            # Nothing is in sight, or what is cannot be carried out, and taught nothing.
            one.plan = []
            one.stage += 1
        one.stage = 0
        for doubt in one.model.doubts():
            one.plan = self._cheaper(one, one.model.goal & ~doubt)
            # Either the task is completed without it, which shows, or it is needed.
            one.model.confirm(doubt)
            if one.plan:
                one.learned = True
                return

    def action(self, run: int, at: int, last: int, length: int) -> int | None:
        """Return the next action; None where nothing can be planned.

        Parameters
        ----------
        run
            Whose.
        at
            Index of what it observes.
        last
            The action before; -1 where there was none.
        length
            How many skills the episode has had.
        """
        one = self._runs[run]
        bits = self._seen(run, at)
        allowed = self._counts.masks[run, at]
        if one.plan and not allowed[one.plan[-1]]:
            # What was known of it has been explained otherwise since.
            one.model.forbid(bits, one.plan[-1])
            one.plan = []
        if not one.plan:
            one.plan = self._plan(one, bits, last, self._limit - length)
        return one.plan.pop() if one.plan and allowed[one.plan[-1]] else None

    def stepped(
        self,
        run: int,
        before: int,
        last: int,
        action: int,
        after: int | None,
        *,
        cost: float,
        complete: bool,
    ) -> None:
        """Take in what a step led to.

        Parameters
        ----------
        run
            Whose.
        before, after
            Index of what was observed before and after; None where the action failed.
        last, action
            The action before, -1 where there was none, and the action.
        cost
            Of it.
        complete
            Whether the task is completed by it.
        """
        one = self._runs[run]
        one.cost += cost
        if complete and one.cost < one.best - _TOLERANCE:
            one.best, one.stage = one.cost, 0
        if one.settled and self._counts.visits[run, before, action] > 1:
            return
        bits = self._seen(run, before)
        if last < 0:
            one.start = bits
        if after is None:
            one.model.fail(bits, action)
            return
        following = self._seen(run, after)
        if one.model.surprised(bits, action, following):
            # What was planned does not hold; something better may be in sight.
            one.plan = []
            if one.settled:
                one.settled, one.stage = False, 0
        one.model.succeed(bits, last, action, following, cost, complete=complete)

    def _seen(self, run: int, index: int) -> Words:
        """Return what was observed, having learned from what is allowed there."""
        one = self._runs[run]
        while len(one.bits) <= index:
            new = len(one.bits)
            bits = one.model.bits(self._counts.observations[run, new])
            one.bits.append(bits)
            one.model.observe(bits, self._counts.masks[run, new])
        return one.bits[index]

    def _cheaper(self, one: _Run, goal: Words) -> list[int]:
        """Return a plan from the start that would cost less than the best so far."""
        stage = self._stages[one.stage]
        rules = one.model.rules(stage.hope, stage.conjunctions)
        counted, weights = one.model.progress(rules.costs)
        search = Search(goal, counted, weights, 1.0, 0.0, 0.0, one.best - _TOLERANCE)
        assert one.start is not None
        actions, _, _ = beam_search(rules, search, one.start, -1, self._limit, stage.width)
        return [int(action) for action in actions[::-1]]

    def _plan(self, one: _Run, bits: Words, last: int, most: int) -> list[int]:
        """Return what to do in the midst of an episode."""
        stage = self._stages[0]
        rules = one.model.rules(stage.hope)
        counted, weights = one.model.progress(rules.costs)
        if one.model.completed:
            search = Search(one.model.goal, counted, weights, 1.0, 0.0, 0.0, np.inf)
        else:
            nothing = np.zeros_like(counted)
            search = Search(nothing, counted, weights, _LEFT, _WORTH, _TRIAL, np.inf)
        actions, _, _ = beam_search(rules, search, bits, last, most, stage.width)
        return [int(action) for action in actions[::-1]]

    def notes(self) -> list[dict[str, Any]]:
        """Return how far every run is, as JSON values."""
        return [
            {
                "plan": list(one.plan),
                "planned": list(one.planned),
                "stage": one.stage,
                "settled": one.settled,
                "against": one.against,
                "learned": one.learned,
                "cost": one.cost,
                "best": one.best if np.isfinite(one.best) else None,
                "known": len(one.bits),
                "begun": one.start is not None,
            }
            for one in self._runs
        ]

    def arrays(self, name: str) -> Arrays:
        """Return all that is known, to be read by `read`."""
        found: Arrays = {}
        for run, one in enumerate(self._runs):
            found |= one.model.arrays(f"{name}.{run}")
            if one.start is not None:
                found[f"{name}.{run}.start"] = one.start.copy()
        return found

    def read(
        self, name: str, arrays: Mapping[str, NDArray[Any]], notes: Sequence[Mapping[str, Any]]
    ) -> None:
        """Take over what `arrays` and `notes` returned; the counts have been read before.

        Raises
        ------
        ValueError
            If it is of another shape.
        """
        if len(notes) != len(self._runs):
            raise ValueError(f"There are plans of {len(notes)} runs, not {len(self._runs)}.")
        for run, (one, noted) in enumerate(zip(self._runs, notes, strict=True)):
            one.model.read(f"{name}.{run}", arrays)
            one.plan = [int(action) for action in noted["plan"]]
            one.planned = [int(action) for action in noted["planned"]]
            one.stage, one.settled = int(noted["stage"]), bool(noted["settled"])
            one.learned = bool(noted["learned"])
            one.against = int(noted["against"])
            one.cost = float(noted["cost"])
            one.best = np.inf if noted["best"] is None else float(noted["best"])
            one.bits = [
                one.model.bits(self._counts.observations[run, index])
                for index in range(int(noted["known"]))
            ]
            one.start = None
            if noted["begun"]:
                one.start = fitting(arrays, f"{name}.{run}.start", (one.model.words,)).copy()


class _Run:
    """What one run knows, and has in mind."""

    def __init__(self, model: TaskModel) -> None:
        self.model = model
        # Of every index, what is observed there.
        self.bits: list[Words] = []
        self.start: Words | None = None
        # What is still to be done, the next action last.
        self.plan: list[int] = []
        # What was planned for an episode last.
        self.planned: list[int] = []
        # What the episode has cost, and the cheapest that completed the task.
        self.cost, self.best = 0.0, np.inf
        self.stage, self.settled = 0, False
        # How many plans went against what conjunctions say.
        self.against = 0
        # Whether anything was tried since all stages were gone through.
        self.learned = False
