"""How many steps a task of walking takes at least, from every place to its goal."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence

from skillplan.task.state import State
from skillplan.task.task import Task


class WalkSteps:
    """The places of a task with one robot, and what leads from one to another.

    Only preconditions and predictions count; no back end is queried.

    Parameters
    ----------
    task
        A task of walking: its skills change the place and nothing else that matters.
    goal
        The fact of the place where it leads.
    """

    def __init__(self, task: Task, goal: str) -> None:
        facts = task.facts
        placeless = task.initial - facts.of(*task.places)
        self.successors: Mapping[str, Sequence[str]] = {
            fact: _ends(task, placeless | facts.of(fact)) for fact in task.places
        }
        """Where the skills lead from every place, in their order; staying is one of them."""
        self.fewest: Mapping[str, int] = self._search(goal)
        """Fewest steps to the goal, by place; places from which it is not reached are missing."""

    def _search(self, goal: str) -> dict[str, int]:
        """Return the fewest steps to the goal by place; breadth-first from the goal."""
        before: dict[str, list[str]] = {}
        for start, ends in self.successors.items():
            for end in ends:
                before.setdefault(end, []).append(start)
        fewest, frontier = {goal: 0}, deque([goal])
        while frontier:
            end = frontier.popleft()
            for start in before.get(end, ()):
                if start not in fewest:
                    fewest[start] = fewest[end] + 1
                    frontier.append(start)
        return fewest


def _ends(task: Task, state: State) -> list[str]:
    """Return the facts of the places where skills that begin in a state end."""
    ends = []
    for skill in task.skills:
        if skill.applicable(state):
            after = skill.prediction_in(state).apply(state)
            ends += [fact for fact in after if fact in task.places]
    return ends
