"""The greedy policy of a relational network on the model of any task that it can see."""

from __future__ import annotations

import numpy as np

from skillplan.model.skill_model import SkillModel
from skillplan.solvers.relational.element_order import ElementOrder
from skillplan.solvers.relational.element_paths import ElementPaths
from skillplan.solvers.relational.element_view import ElementView
from skillplan.solvers.relational.relational_network import RelationalNetwork
from skillplan.task.skill import Skill
from skillplan.task.state import State


class ElementChoice:
    """Goes to the element of the best score, by the first skill of the way there.

    A skill's score is the best score of the elements that it leads to. Only applicable skills
    count; of equals the first. Back ends are queried for the precedence only, here and never
    again.

    Parameters
    ----------
    network
        What scores.
    model
        Of the task.

    Raises
    ------
    OptionError
        If the task has no elements that could be scored.
    BackEndError
        If a back end fails.
    """

    def __init__(self, network: RelationalNetwork, model: SkillModel) -> None:
        self._network, self._model = network, model
        paths = ElementPaths(model.task)
        self.view = ElementView(paths, ElementOrder.of(model))

    def scores(self, state: State) -> dict[str, float]:
        """Return the score of every applicable skill; minus infinity of one that leads nowhere."""
        found = {skill.name: -np.inf for skill in self._model.applicable(state)}
        sight = self.view(state)
        if not len(sight.elements):
            return found
        for way, score in zip(sight.ways, self._network.scores(sight).tolist(), strict=True):
            if way is not None and way.first in found:
                found[way.first] = max(found[way.first], score)
        return found

    def __call__(self, state: State) -> Skill:
        """Return the skill that is taken in a state; the task's first where none is applicable."""
        applicable = self._model.applicable(state)
        if len(applicable) == 1:
            return applicable[0]
        scores = self.scores(state)
        if not scores:
            return self._model.task.skills[0]
        return self._model.task.skill(max(scores, key=scores.__getitem__))
