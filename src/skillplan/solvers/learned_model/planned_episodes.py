"""Episodes planned with learned action schemas, until no better plan is found.

Plans are optimistic: an action that is not known to fail succeeds, and unseen costs are low, so a
plan either comes off or teaches something (R-max: Brafman and Tennenholtz, 2002; with learned
schemas: Walsh and Littman, 2008). Before the first completion plans seek progress, then lower
cost. Finally each literal of the goal is dropped once, to see if the goal needs it.

The task must be deterministic, begin in one state, and be observed in bits. If the effects of an
action differ between states, no schema fits it, and the run stops planning.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skillplan.solvers.learned_model.action_model import ActionModel
from skillplan.solvers.learned_model.plan_search import Search, Words, beam_search
from skillplan.solvers.learning.episode_training import Arrays, read_array
from skillplan.solvers.learning.observation_counts import ObservationCounts

# Worth of progress in units of cost, and its factor after a step that may fail.
_WORTH, _HOPE = 1e6, 0.5
# Worth of an action that never succeeded, in literals of progress.
_TRIAL = 1.5
# Most plans against the learned conjunctions.
_MOST_AGAINST = 300
# Costs that differ by less are equal.
_TOLERANCE = 1e-9


@dataclass(frozen=True)
class _Stage:
    """Width of a search, factor on unseen costs, and whether conjunctions are trusted."""

    width: int
    hope: float
    conjunctions: bool = True


@dataclass
class _Planner:
    """Planning state of one run.

    Parameters
    ----------
    model
        Learned schemas.
    bits
        Observed bits by index of the observation.
    start
        Bits at the start of an episode; None before the first step.
    plan
        Remaining actions, the next one last.
    planned
        Latest plan for a whole episode, in the same order.
    cost, best
        Cost of the current episode, and of the cheapest completed one.
    stage
        Index of the current stage.
    settled
        True if no better plan is found.
    against
        Number of plans against the learned conjunctions.
    learned
        True if a plan was executed since the stages began anew.
    """

    model: ActionModel
    bits: list[Words] = field(default_factory=list)
    start: Words | None = None
    plan: list[int] = field(default_factory=list)
    planned: list[int] = field(default_factory=list)
    cost: float = 0.0
    best: float = np.inf
    stage: int = 0
    settled: bool = False
    against: int = 0
    learned: bool = False


class PlannedEpisodes:
    """Plans the episodes of every run.

    Parameters
    ----------
    generators
        One for every run; draws how much cheaper unseen costs may be.
    counts
        Observations of every run, and visits.
    step_limit
        Most skills of an episode.
    width
        Plans that the first search expands at equal progress, >= 1.
    """

    def __init__(
        self,
        generators: Sequence[np.random.Generator],
        counts: ObservationCounts,
        step_limit: int,
        width: int,
    ) -> None:
        self._counts, self._limit = counts, step_limit
        self._stages = (
            _Stage(width, 1.0),
            _Stage(width, 0.5),
            _Stage(2 * width, 0.25),
            _Stage(4 * width, 0.0),
            _Stage(width, 0.5, conjunctions=False),
            _Stage(16 * width, 0.5),
        )
        features, actions = counts.observations.shape[2], counts.masks.shape[2]
        self._planners = [
            _Planner(ActionModel(features, actions, generator)) for generator in generators
        ]

    def is_settled(self, run: int) -> bool:
        """Return whether a run plans no more: no better plan is found, or no schema fits."""
        planner = self._planners[run]
        return planner.settled or bool(planner.model.contradicted.any())

    def contradicted(self, run: int) -> list[int]:
        """Return the actions whose effects differed between states."""
        return np.flatnonzero(self._planners[run].model.contradicted).tolist()

    def begin_episode(self, run: int) -> None:
        """Plan the next episode of a run, unless it has settled or never completed the task."""
        planner = self._planners[run]
        planner.plan, planner.cost = [], 0.0
        if self.is_settled(run) or not planner.model.completed:
            return
        self._seek(planner)
        if not planner.plan and planner.learned:
            # The steps since the last round may have brought a better plan into sight.
            planner.learned, planner.stage = False, 0
            self._seek(planner)
        planner.settled = not planner.plan

    def action(self, run: int, index: int, last: int, length: int) -> int | None:
        """Return the next action; None without a plan.

        Parameters
        ----------
        run
            Index of the run.
        index
            Index of its observation.
        last
            Latest action; -1 at the start.
        length
            Steps of the episode so far.
        """
        planner = self._planners[run]
        bits = self._bits(run, index)
        allowed = self._counts.masks[run, index]
        if planner.plan and not allowed[planner.plan[-1]]:
            # A later step has changed the explanation of an earlier failure.
            planner.model.forbid(bits, planner.plan[-1])
            planner.plan = []
        if not planner.plan:
            planner.plan = self._plan_on(planner, bits, last, self._limit - length)
        return planner.plan.pop() if planner.plan and allowed[planner.plan[-1]] else None

    def learn_step(
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
        """Learn from a step.

        Parameters
        ----------
        run
            Index of the run.
        before, after
            Index of the observation before and after the step; None after a failure.
        last, action
            Action before the step, -1 at the start, and its own.
        cost
            Its cost.
        complete
            True if it completed the task.
        """
        planner = self._planners[run]
        if planner.model.contradicted.any():
            return
        planner.cost += cost
        if complete and planner.cost < planner.best - _TOLERANCE:
            planner.best, planner.stage = planner.cost, 0
        if planner.settled and self._counts.visits[run, before, action] > 1:
            return
        bits = self._bits(run, before)
        if last < 0:
            planner.start = bits
        if after is None:
            planner.model.fail(bits, action)
            return
        following = self._bits(run, after)
        if planner.model.is_surprised(bits, action, following):
            # The plan does not hold, and a better one may exist.
            planner.plan = []
            if planner.settled:
                planner.settled, planner.stage = False, 0
        planner.model.succeed(bits, last, action, following, cost, complete=complete)

    def _bits(self, run: int, index: int) -> Words:
        """Return the bits of an observation, after learning from new masks."""
        planner = self._planners[run]
        while len(planner.bits) <= index:
            new = len(planner.bits)
            bits = planner.model.bits(self._counts.observations[run, new])
            planner.bits.append(bits)
            planner.model.observe(bits, self._counts.masks[run, new])
        return planner.bits[index]

    def _seek(self, planner: _Planner) -> None:
        """Plan a cheaper episode, or an episode that tests the goal."""
        while planner.stage < len(self._stages):
            conjunctions = self._stages[planner.stage].conjunctions
            if conjunctions or planner.against < _MOST_AGAINST:
                planner.plan = self._plan_cheaper(planner, planner.model.goal)
            if planner.plan and planner.plan != planner.planned:
                planner.planned = list(planner.plan)
                planner.against += not conjunctions
                planner.learned = True
                return
            # No plan was found, or the previous one, which taught nothing.
            planner.plan = []
            planner.stage += 1
        planner.stage = 0
        for doubt in planner.model.doubts():
            planner.plan = self._plan_cheaper(planner, planner.model.goal & ~doubt)
            # If the episode completes without these literals, the goal drops them.
            planner.model.confirm(doubt)
            if planner.plan:
                planner.learned = True
                return

    def _plan_cheaper(self, planner: _Planner, goal: Words) -> list[int]:
        """Return a plan from the start that costs less than the best episode."""
        stage = self._stages[planner.stage]
        rules = planner.model.rules(stage.hope, stage.conjunctions)
        counted, weights = planner.model.progress(rules.costs)
        search = Search(goal, counted, weights, 1.0, 0.0, 0.0, planner.best - _TOLERANCE)
        assert planner.start is not None
        actions, _, _ = beam_search(rules, search, planner.start, -1, self._limit, stage.width)
        return [int(action) for action in actions[::-1]]

    def _plan_on(self, planner: _Planner, bits: Words, last: int, most: int) -> list[int]:
        """Return a plan from within an episode."""
        stage = self._stages[0]
        rules = planner.model.rules(stage.hope)
        counted, weights = planner.model.progress(rules.costs)
        if planner.model.completed:
            search = Search(planner.model.goal, counted, weights, 1.0, 0.0, 0.0, np.inf)
        else:
            no_goal = np.zeros_like(counted)
            search = Search(no_goal, counted, weights, _HOPE, _WORTH, _TRIAL, np.inf)
        actions, _, _ = beam_search(rules, search, bits, last, most, stage.width)
        return [int(action) for action in actions[::-1]]

    def notes(self) -> list[dict[str, Any]]:
        """Return the planning state of every run as JSON values for `read`."""
        return [
            {
                "plan": list(planner.plan),
                "planned": list(planner.planned),
                "stage": planner.stage,
                "settled": planner.settled,
                "against": planner.against,
                "learned": planner.learned,
                "cost": planner.cost,
                "best": planner.best if np.isfinite(planner.best) else None,
                "known": len(planner.bits),
                "begun": planner.start is not None,
            }
            for planner in self._planners
        ]

    def arrays(self, name: str) -> Arrays:
        """Return copies of all arrays for `read`."""
        arrays: Arrays = {}
        for run, planner in enumerate(self._planners):
            arrays |= planner.model.arrays(f"{name}.{run}")
            if planner.start is not None:
                arrays[f"{name}.{run}.start"] = planner.start.copy()
        return arrays

    def read(
        self, name: str, arrays: Mapping[str, NDArray[Any]], notes: Sequence[Mapping[str, Any]]
    ) -> None:
        """Restore what `arrays` and `notes` returned; the counts must be restored before.

        Raises
        ------
        ValueError
            If it has another shape.
        """
        if len(notes) != len(self._planners):
            raise ValueError(f"There are plans of {len(notes)} runs, not {len(self._planners)}.")
        for run, (planner, note) in enumerate(zip(self._planners, notes, strict=True)):
            planner.model.read(f"{name}.{run}", arrays)
            planner.plan = [int(action) for action in note["plan"]]
            planner.planned = [int(action) for action in note["planned"]]
            planner.stage, planner.settled = int(note["stage"]), bool(note["settled"])
            planner.learned = bool(note["learned"])
            planner.against = int(note["against"])
            planner.cost = float(note["cost"])
            planner.best = np.inf if note["best"] is None else float(note["best"])
            planner.bits = [
                planner.model.bits(self._counts.observations[run, index])
                for index in range(int(note["known"]))
            ]
            planner.start = None
            if note["begun"]:
                shape = (planner.model.words,)
                planner.start = read_array(arrays, f"{name}.{run}.start", shape).copy()
