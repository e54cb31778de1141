"""Why runs of a learner do not complete a task, from the episodes that they have noted.

Nothing is asked of back ends: what is known of a skill in a state is what came of it there. Whoever
reads it learns how far the runs got, where they ended, and what to try next.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

from skillplan.task.state import State
from skillplan.task.task import Task

if TYPE_CHECKING:  # a table of results needs no environment
    from skillplan.solvers.learning.learner import Episode

Cause = Literal["steps", "exploration", "policy"]
# Where progress came in so much of the end of a training, more steps may bring more.
_RECENT_SHARE = 0.25
_MORE = 4
# A learner that plans its episodes with what it has learned.
_PLANNING = "dqn"


@dataclass(frozen=True, slots=True)
class Shortfall:
    """How far the runs that do not complete a task got, and what ended them.

    Parameters
    ----------
    runs
        Numbers of these runs, at least one.
    episodes, completed
        Their episodes while they learned, and how many of these completed the task.
    goals, most_goals
        How many facts the goal requires, and how many of these held at the same time at most.
    missing
        Facts of the goal that never held, in the order of the task.
    never
        Skills that were never executed, in the order of the task.
    last_progress_step
        After how many environment steps of its run the most goals were reached first, or None
        where none was.
    out_of_time
        How many episodes reached the step limit.
    failed
        Skills that could not be executed when they were tried, with how often; the most frequent
        first.
    dead_states, dead_ends
        States from which every applicable skill was seen to fail or to lead into such a state,
        and how many episodes entered one.
    hidden, skills
        How many skills preconditions hid in a state that was met, on average, and how many
        there are. None where nothing is hidden.
    cause
        ``policy``: the task was completed, but what was learned does not do so. ``steps``: there
        was progress to the end. ``exploration``: nothing new was met for long.
    advice
        What to try, as a sentence.
    """

    runs: tuple[int, ...]
    episodes: int
    completed: int
    goals: int
    most_goals: int
    missing: tuple[str, ...]
    never: tuple[str, ...]
    last_progress_step: int | None
    out_of_time: int
    failed: tuple[tuple[str, int], ...]
    dead_states: int
    dead_ends: int
    hidden: float | None
    skills: int
    cause: Cause
    advice: str

    def document(self) -> dict[str, Any]:
        """Return it as JSON values."""
        return {
            "runs": list(self.runs),
            "episodes": self.episodes,
            "completed_episodes": self.completed,
            "goals": self.goals,
            "most_goals_reached": self.most_goals,
            "goals_never_reached": list(self.missing),
            "skills_never_executed": list(self.never),
            "last_progress_step": self.last_progress_step,
            "out_of_time": self.out_of_time,
            "failed_skills": [{"skill": name, "times": times} for name, times in self.failed],
            "dead_states": self.dead_states,
            "dead_ends_entered": self.dead_ends,
            "skills_hidden_mean": self.hidden,
            "skills": self.skills,
            "cause": self.cause,
            "advice": self.advice,
        }


def shortfall_of(
    task: Task,
    solver: str,
    options: Mapping[str, Any],
    steps: int,
    episodes: Mapping[int, Sequence[Episode]],
) -> Shortfall | None:
    """Return why runs do not complete a task; None of no run, or where chance rules.

    Parameters
    ----------
    task
        What was learned.
    solver, options
        Who learned, and all its options.
    steps
        Environment steps that every run was to do.
    episodes
        Of each run that does not complete the task, by its number.
    """
    if not episodes or not task.deterministic:
        return None
    seen = _Episodes(task)
    for run in sorted(episodes):
        for episode in episodes[run]:
            seen.add(episode)
    dead = seen.dead()
    completed = sum(one.success for run in episodes.values() for one in run)
    cause = _cause(completed, seen.progress_step, steps)
    mask = str(options.get("mask", "none"))
    goal = task.goal.requires
    return Shortfall(
        runs=tuple(sorted(episodes)),
        episodes=sum(len(one) for one in episodes.values()),
        completed=completed,
        goals=goal.bits.bit_count(),
        most_goals=seen.most_goals,
        missing=tuple(task.facts.names_of(goal.bits & ~seen.held)),
        never=tuple(
            skill.name for action, skill in enumerate(task.skills) if action not in seen.executed
        ),
        last_progress_step=seen.progress_step,
        out_of_time=sum(one.end == "out-of-time" for run in episodes.values() for one in run),
        failed=tuple(
            (task.skills[action].name, times)
            for action, times in sorted(seen.failed.items(), key=lambda item: (-item[1], item[0]))
        ),
        dead_states=len(dead),
        dead_ends=sum(
            bool(dead.intersection(seen.path(one))) for run in episodes.values() for one in run
        ),
        hidden=None if mask == "none" else seen.hidden(),
        skills=len(task.skills),
        cause=cause,
        advice=_advice(cause, solver, options, steps),
    )


def _cause(completed: int, progress_step: int | None, steps: int) -> Cause:
    if completed:
        return "policy"
    if progress_step is not None and progress_step > (1 - _RECENT_SHARE) * steps:
        return "steps"
    return "exploration"


def _advice(cause: Cause, solver: str, options: Mapping[str, Any], steps: int) -> str:
    more = f"--steps {_MORE * steps}"
    if cause == "policy":
        return f"{more}: the task was completed while learning, and values had not settled."
    if cause == "steps":
        return f"{more}: the runs were still getting further when they ended."
    mask = str(options.get("mask", "none"))
    if mask == "none":
        return f"-O {solver}.mask=applicable: no choice of what cannot begin at all."
    exact = "search-optimal, which needs no learning"
    if not options.get("planning", solver == _PLANNING):
        if solver == _PLANNING:
            costs_seen = options.get("observation") == "layout"
            plans = "observation=markov" if costs_seen else "planning=true"
            return f"-O {solver}.{plans}, with which episodes are planned; or {more}; or {exact}."
        return (
            f"--solver {_PLANNING}, which plans its episodes with what it has learned; or "
            f"{more}; or {exact}."
        )
    if mask == "applicable":
        asks = f"-O {solver}.mask=feasible, which asks back ends before a choice"
        return f"{more}; or {asks}; or {exact}."
    return f"{more}; or {exact}: each choice is feasible, but most lead nowhere."


@dataclass
class _Episodes:
    """What episodes have met: states by their bits, and what came of skills there."""

    task: Task
    most_goals: int = 0
    progress_step: int | None = None
    held: int = 0
    executed: set[int] = field(default_factory=set)
    failed: Counter[int] = field(default_factory=Counter)
    _visits: Counter[int] = field(default_factory=Counter)
    _after: dict[tuple[int, int], int] = field(default_factory=dict)
    _fails: dict[int, set[int]] = field(default_factory=dict)
    _applicable: dict[int, frozenset[int]] = field(default_factory=dict)

    def add(self, episode: Episode) -> None:
        """Take in what an episode did."""
        goal = self.task.goal.requires.bits
        path, actions = self.path(episode), episode.actions
        self._visits.update(path)
        self.executed.update(actions[: len(path) - 1])
        if episode.end == "infeasible":
            self.failed[actions[-1]] += 1
            self._fails.setdefault(path[-1], set()).add(actions[-1])
        for bits in path:
            self.held |= bits
            reached = (bits & goal).bit_count()
            if reached > self.most_goals:
                self.most_goals, self.progress_step = reached, episode.step

    def path(self, episode: Episode) -> list[int]:
        """Return the states that an episode met, the first one included, by their bits."""
        done = episode.actions[:-1] if episode.end == "infeasible" else episode.actions
        path = [self.task.initial.bits]
        for action in done:
            path.append(self._follow(path[-1], action))
        return path

    def dead(self) -> set[int]:
        """Return the states from which all that is applicable has failed, or leads to such."""
        facts = self.task.facts
        found: set[int] = set()
        # A goal ends an episode: nothing was to be tried there.
        open_states = {
            bits for bits in self._visits if not self.task.goal.holds(State(bits, facts))
        }
        while True:
            more = {
                bits
                for bits in open_states
                if all(
                    action in self._fails.get(bits, ())
                    or self._after.get((bits, action), -1) in found
                    for action in self._applicable_in(bits)
                )
            }
            if not more:
                return found
            found |= more
            open_states -= more

    def hidden(self) -> float:
        """Return how many skills are not applicable in a state that was met, on average."""
        total = sum(self._visits.values())
        allowed = sum(
            times * len(self._applicable_in(bits)) for bits, times in self._visits.items()
        )
        return len(self.task.skills) - allowed / total

    def _follow(self, bits: int, action: int) -> int:
        key = (bits, action)
        if key not in self._after:
            state = State(bits, self.task.facts)
            outcome = self.task.skills[action].prediction_in(state)
            self._after[key] = outcome.apply(state).bits
        return self._after[key]

    def _applicable_in(self, bits: int) -> frozenset[int]:
        if bits not in self._applicable:
            state = State(bits, self.task.facts)
            self._applicable[bits] = frozenset(
                action for action, skill in enumerate(self.task.skills) if skill.applicable(state)
            )
        return self._applicable[bits]
