"""Analysis of runs that do not complete a task, from their recorded episodes.

It queries no back end: it uses the recorded outcome of a skill in a state.
It shows the progress of the runs, their ends, and advice on the next step.
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
# If progress came in this last share of a training, more steps may bring more.
_RECENT_SHARE = 0.25
_MORE = 4
# The learner that plans its episodes with a learned model.
_PLANNING = "learned-model"


@dataclass(frozen=True, slots=True)
class Shortfall:
    """Progress of the runs that do not complete a task, and what ended their episodes.

    Parameters
    ----------
    episodes, completed
        Number of their training episodes, and number of successes.
    goals, most_goals
        Number of facts that the goal requires, and the largest number that held together.
    missing
        Goal facts that never held, in the order of the task.
    never
        Skills that were never executed, in the order of the task.
    last_progress_step
        Environment step at which a run first reached the most goals; None without progress.
    out_of_time
        Number of episodes that reached the step limit.
    failed
        Skills that failed when tried, with their counts; the most frequent first.
    dead_states, dead_ends
        Number of states from which every applicable skill fails or leads to such a state, and of
        episodes that entered one.
    hidden, skills
        Mean number of skills that preconditions hid in a visited state, and the number of skills.
        None without a mask.
    cause
        ``policy``: the task was completed, but not by the policy. ``steps``: there was progress
        until the end. ``exploration``: nothing new was found for long.
    advice
        Next thing to try, as a sentence.
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
        """Return the JSON values."""
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


def analyse_shortfall(
    task: Task,
    solver: str,
    options: Mapping[str, Any],
    steps: int,
    episodes: Mapping[int, Sequence[Episode]],
) -> Shortfall | None:
    """Analyse runs that do not complete a task; return None without such runs, or under chance.

    Parameters
    ----------
    episodes
        Episodes of each run that does not complete the task, by run number.
    """
    if not episodes or not task.deterministic:
        return None
    recorded = [episode for run in sorted(episodes) for episode in episodes[run]]
    seen = _Episodes(task)
    for episode in recorded:
        seen.add(episode)
    dead = seen.dead()
    completed = sum(episode.success for episode in recorded)
    cause = _find_cause(completed, seen.progress_step, steps)
    mask = str(options.get("mask", "none"))
    goal = task.goal.requires
    return Shortfall(
        runs=tuple(sorted(episodes)),
        episodes=len(recorded),
        completed=completed,
        goals=goal.bits.bit_count(),
        most_goals=seen.most_goals,
        missing=tuple(task.facts.names_of(goal.bits & ~seen.held)),
        never=tuple(
            skill.name for action, skill in enumerate(task.skills) if action not in seen.executed
        ),
        last_progress_step=seen.progress_step,
        out_of_time=sum(episode.end == "out-of-time" for episode in recorded),
        failed=tuple(
            (task.skills[action].name, times)
            for action, times in sorted(seen.failed.items(), key=lambda item: (-item[1], item[0]))
        ),
        dead_states=len(dead),
        dead_ends=sum(bool(dead.intersection(seen.path(episode))) for episode in recorded),
        hidden=None if mask == "none" else seen.hidden(),
        skills=len(task.skills),
        cause=cause,
        advice=_give_advice(cause, solver, options, steps),
    )


def _find_cause(completed: int, progress_step: int | None, steps: int) -> Cause:
    if completed:
        return "policy"
    if progress_step is not None and progress_step > (1 - _RECENT_SHARE) * steps:
        return "steps"
    return "exploration"


def _give_advice(cause: Cause, solver: str, options: Mapping[str, Any], steps: int) -> str:
    more = f"--steps {_MORE * steps}"
    if cause == "policy":
        return f"{more}: the task was completed while learning, and values had not settled."
    if cause == "steps":
        return f"{more}: the runs were still getting further when they ended."
    mask = str(options.get("mask", "none"))
    if mask == "none":
        return f"-O {solver}.mask=applicable: skills that cannot begin are never chosen."
    exact = "search-optimal, which needs no learning"
    if solver != _PLANNING and not options.get("planning"):
        return (
            f"--solver {_PLANNING}, which plans with action schemas that it learns; or {more}; or "
            f"{exact}."
        )
    if mask == "applicable":
        feasible = f"-O {solver}.mask=feasible, which queries back ends before a choice"
        return f"{more}; or {feasible}; or {exact}."
    return f"{more}; or {exact}: each choice is feasible, but most lead nowhere."


@dataclass
class _Episodes:
    """States that the episodes visited, as bits, and the outcomes of skills there."""

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
        """Add an episode."""
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
        """Return the states of an episode as bits, including the first."""
        done = episode.actions[:-1] if episode.end == "infeasible" else episode.actions
        path = [self.task.initial.bits]
        for action in done:
            path.append(self._follow(path[-1], action))
        return path

    def dead(self) -> set[int]:
        """Return the states from which every applicable skill fails or leads to such a state."""
        facts = self.task.facts
        dead: set[int] = set()
        # A goal ends an episode, so it has no skills to try.
        open_states = {
            bits for bits in self._visits if not self.task.goal.holds(State(bits, facts))
        }
        while True:
            more = {
                bits
                for bits in open_states
                if all(
                    action in self._fails.get(bits, ())
                    or self._after.get((bits, action), -1) in dead
                    for action in self._applicable_in(bits)
                )
            }
            if not more:
                return dead
            dead |= more
            open_states -= more

    def hidden(self) -> float:
        """Return the mean number of skills that are not applicable in a visited state."""
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
