"""What a learner sees of a state."""

from __future__ import annotations

import numpy as np
import pytest

from board_situations import OPTIMAL, state_after
from situations import graph_of, model_of
from skillplan.env import Observation
from skillplan.errors import OptionError
from skillplan.pipeline import make_model
from skillplan.task import Task
from swarm_situations import base_task
from thinned import slow_case

FIG_5 = [1, 0, 1, 0, 1, 0, 1, 0, 1, 0, 1, 0, 0, 0, 0, 0, 0]


def observations_of_all_states(task: Task, kind: str) -> list[bytes]:
    observation = Observation.of(task, kind)
    return [observation.encode(state).tobytes() for state in graph_of(make_model(task))]


class TestPaper:
    def test_it_is_the_17_bits_of_figure_5(self, board_task):
        observation = Observation.of(board_task, "paper")
        encoded = observation.encode(board_task.initial)
        assert 17 == observation.width == len(observation.features)
        assert ("at_start(pcb)", "placed(pcb)") == observation.features[:2]
        assert ("tool(screwdriver)", "not hand_free", "changed_tool") == observation.features[-3:]
        assert FIG_5 == encoded.tolist()
        assert np.float32 == encoded.dtype

    def test_the_320_states_of_the_board_look_like_268(self, board_task):
        seen = observations_of_all_states(board_task, "paper")
        assert (320, 268) == (len(seen), len(set(seen)))

    def test_of_a_task_that_lists_none_it_is_all_facts(self, lid_task):
        observation = Observation.of(lid_task.replace(observation=()), "paper")
        assert lid_task.facts.names == observation.features
        held = np.flatnonzero(observation.encode(lid_task.initial))
        assert list(lid_task.initial) == [observation.features[i] for i in held]


class TestMarkov:
    def test_it_adds_where_the_arm_stands(self, board_task):
        paper, markov = (Observation.of(board_task, kind) for kind in ("paper", "markov"))
        places = [name for name in board_task.facts.names if name.startswith("at(")]
        assert (*paper.features, *places) == markov.features
        state = state_after(board_task, OPTIMAL[:3])
        (there,) = np.flatnonzero(markov.encode(state)[17:])
        assert "at(switch_1.start)" == markov.features[17 + there]

    def test_it_tells_all_states_of_the_board_apart(self, board_task):
        seen = observations_of_all_states(board_task, "markov")
        assert (320, 320) == (len(seen), len(set(seen)))

    def test_what_is_observed_already_is_not_observed_twice(self, board_task):
        blind = board_task.replace(observation=())
        assert blind.facts.names == Observation.of(blind, "markov").features

    def test_where_a_base_walks_to_counts_as_its_place(self):
        task = base_task(37, 1)
        assert set(task.places) <= set(Observation.of(task, "markov").features)


class TestLayout:
    def test_it_adds_what_every_skill_would_cost_from_here(self, board_task):
        markov, layout = (Observation.of(board_task, kind) for kind in ("markov", "layout"))
        assert (*markov.features, *(f"cost({skill.name})" for skill in board_task.skills)) == (
            layout.features
        )
        for taken in range(len(OPTIMAL)):
            state = state_after(board_task, OPTIMAL[:taken])
            encoded = layout.encode(state)
            assert markov.encode(state).tolist() == encoded[: markov.width].tolist()
            for skill, cost in zip(board_task.skills, encoded[markov.width :], strict=True):
                if not skill.name.startswith("load"):
                    assert np.float32(skill.cost.at(state)) == cost > 0 or not skill.cost.at(state)

    def test_a_cost_that_the_state_does_not_define_is_observed_as_0(self, board_task):
        """As of loading a tool that is attached: there is no way from its holder to itself."""
        state, observation = board_task.initial, Observation.of(board_task, "layout")
        load = board_task.skill("load(gripper)")
        with pytest.raises(ValueError, match="No route"):
            load.cost.at(state)
        assert 0.0 == observation.encode(state)[observation.features.index(f"cost({load.name})")]


@pytest.mark.parametrize(
    "kind", ["paper", "markov", slow_case("layout", reason="two other kinds in every run")]
)
def test_every_state_lies_in_the_space(board_task, kind):
    observation = Observation.of(board_task, kind)
    assert (observation.width,) == observation.space.shape
    for state in graph_of(model_of(board_task), feasible_only=False):
        assert observation.space.contains(observation.encode(state))


def test_an_unknown_kind_is_refused_with_the_nearest(board_task):
    with pytest.raises(OptionError, match=r"Unknown observation 'markow'\. Did you mean 'markov'"):
        Observation.of(board_task, "markow")


def test_something_must_be_observed():
    with pytest.raises(ValueError, match="at least one feature"):
        Observation("paper", ())
