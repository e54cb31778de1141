"""One task as a Gymnasium environment."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from board_situations import OPTIMAL, state_after
from situations import CONFIGS, fake_back_end, graph_of, model_of, retry_task, two_roads_task
from skillplan.env import Observation, RewardFunction, SkillEnv, SkillVectorEnv
from skillplan.errors import OptionError
from skillplan.pipeline import make_model
from skillplan.task import DistanceReward, Task, Verdict
from swarm_situations import base_task
from thinned import slow_case

NAME = "skillplan.env:skillplan/Task-v0"
LOAD_GRIPPER, LOAD_SCREWDRIVER = 12, 13


@pytest.fixture
def board(board_task):
    env = SkillEnv(make_model(board_task))
    env.reset(seed=0)
    return env


@pytest.mark.parametrize("mask", ["none", "applicable", "feasible"])
@pytest.mark.parametrize("observation", ["paper", "markov", "layout"])
@pytest.mark.parametrize("chance", [False, True], ids=["board", "under chance"])
def test_gymnasium_has_nothing_to_say_against_it(board_task, chance, observation, mask):
    """Its checker passes without a warning, which would be an error here."""
    task = retry_task(0.5) if chance else board_task
    env = gymnasium.make(NAME, task=task, observation=observation, mask=mask)
    check_env(env.unwrapped)


class TestRewards:
    """Table II of the paper, one kind of ending after the other."""

    def test_a_successful_skill_pays_minus_a_tenth_of_its_distance(self, board):
        _, reward, terminated, truncated, info = board.step(0)
        distance_m = board.model.task.skills[0].cost.at(board.model.initial)
        assert (distance_m, -0.1 * distance_m) == (info["cost"], reward)
        assert 0 < distance_m
        assert (False, False) == (terminated, truncated)

    def test_completing_pays_10_and_ends_it(self, board):
        steps = [board.step(action) for action in OPTIMAL]
        assert [False] * 14 + [True] == [step[2] for step in steps]
        assert 10.0 == steps[-1][1]
        assert 1.86709 == pytest.approx(sum(step[4]["cost"] for step in steps), abs=5e-6)
        assert not any(step[3] for step in steps)

    @pytest.mark.parametrize(
        ("actions", "stage"),
        [((1,), "precondition"), ((2, 3), "precedence")],
        ids=["inapplicable", "infeasible"],
    )
    def test_what_cannot_be_executed_pays_minus_10_and_ends_it_where_it_is(
        self, board, actions, stage
    ):
        before, *_ = board.reset()
        for action in actions[:-1]:
            before, *_ = board.step(action)
        after, reward, terminated, truncated, info = board.step(actions[-1])
        assert (-10.0, True, False, 0.0) == (reward, terminated, truncated, info["cost"])
        assert stage == info["stage"]
        assert before.tolist() == after.tolist()

    def test_a_repeated_tool_change_pays_minus_2_5(self, board):
        assert -2.5 != board.step(LOAD_SCREWDRIVER)[1]
        assert -2.5 == board.step(LOAD_GRIPPER)[1]

    def test_the_20th_step_pays_minus_10_and_truncates(self, board):
        """Also where it would be a repeated tool change."""
        changes = [LOAD_SCREWDRIVER, LOAD_GRIPPER] * 10
        steps = [board.step(action) for action in changes]
        assert [False] * 19 + [True] == [step[3] for step in steps]
        assert -10.0 == steps[-1][1]
        assert not any(step[2] for step in steps)

    def test_the_step_that_completes_it_is_never_too_late(self, board_task):
        env = SkillEnv(make_model(board_task.replace(step_limit=len(OPTIMAL))))
        env.reset()
        *_, last = (env.step(action) for action in OPTIMAL)
        assert (10.0, True, False) == last[1:4]


class TestInfo:
    def test_it_carries_the_verdict_its_reason_and_its_facts(self, board):
        *_, info = board.step(1)
        assert {
            "skill": "place(pcb)",
            "verdict": "infeasible",
            "stage": "precondition",
            "reason": "needs held(pcb)",
            "facts": ["not held(pcb)"],
        }.items() <= info.items()

    def test_of_a_feasible_skill_there_is_no_reason(self, board):
        *_, info = board.step(0)
        assert ("feasible", "") == (info["verdict"], info["reason"])
        assert ["at_start(pcb)", "tool(gripper)", "hand_free"] == info["facts"]
        assert "held(pcb)" in info["state"]

    def test_what_no_back_end_can_decide_is_not_executed(self):
        task = two_roads_task()
        env = SkillEnv(model_of(task, fake_back_end(task, Verdict.unknown("too dark to see"))))
        env.reset()
        _, reward, terminated, _, info = env.step(0)
        assert ("unknown", "too dark to see") == (info["verdict"], info["reason"])
        assert (-10.0, True) == (reward, terminated)

    def test_its_mask_is_what_the_action_space_samples_by(self, board):
        _, info = board.reset(seed=3)
        allowed = set(np.flatnonzero(info["action_mask"]).tolist())
        board.action_space.seed(0)
        drawn = {int(board.action_space.sample(info["action_mask"])) for _ in range(200)}
        assert {0, 2, 4, 6, 8, 10, LOAD_SCREWDRIVER} == allowed == drawn


class TestMasks:
    @pytest.mark.parametrize("mask", ["none", "applicable", "feasible"])
    def test_they_say_what_the_model_says(self, board_task, mask):
        env, model = SkillEnv(make_model(board_task), mask=mask), make_model(board_task)
        _, info = env.reset()
        state = model.initial
        for action in OPTIMAL[:-1]:
            expected = {
                "none": list(board_task.skills),
                "applicable": model.applicable(state),
                "feasible": [step.skill for step in model.transitions(state)],
            }[mask]
            allowed = [board_task.skills[i] for i in np.flatnonzero(info["action_mask"])]
            assert expected == allowed
            *_, info = env.step(action)
            state = board_task.skills[action].prediction.apply(state)

    @pytest.mark.parametrize(("mask", "queries"), [("applicable", 0), ("feasible", 2)])
    def test_only_that_of_the_feasible_asks_back_ends(self, mask, queries):
        task = two_roads_task()
        back_end = fake_back_end(task)
        SkillEnv(model_of(task, back_end), mask=mask).reset()
        assert queries == len(back_end.asked)

    def test_an_unknown_one_is_refused(self, board_task):
        with pytest.raises(OptionError, match=r"Unknown mask 'feasable'\. Did you mean 'feasible'"):
            SkillEnv(make_model(board_task), mask="feasable")

    def test_they_are_a_method_too_as_sb3_contrib_looks_for_it(self, board):
        for action in OPTIMAL[:5]:
            *_, info = board.step(action)
            mask = board.action_masks()
            assert (np.int8, info["action_mask"].tolist()) == (mask.dtype, mask.tolist())


class TestStart:
    def test_an_episode_begins_in_the_state_that_an_info_lists(self, board):
        for action in OPTIMAL[:6]:
            obs, *_, info = board.step(action)
        again, first = board.reset(options={"start": info["state"]})
        assert (info["state"], obs.tolist()) == (first["state"], again.tolist())
        rewards = [board.step(action)[1] for action in OPTIMAL[6:]]
        assert 10.0 == rewards[-1]
        assert list(board.model.initial) == board.reset(options={})[1]["state"]

    def test_a_place_is_named_as_on_the_command_line(self):
        env = gymnasium.make(NAME, task=CONFIGS / "swarmitfix_polygonal.yaml", part="base-1")
        _, info = env.reset(options={"start": "C20"})
        assert "at(C20)" in info["state"]

    @pytest.mark.parametrize(
        ("options", "message"),
        [
            ({"strat": "C20"}, "Unknown option 'strat' of reset. Did you mean 'start'"),
            ({"start": "placed(brase)"}, r"Did you mean 'placed\(brace\)'"),
            ({"start": ["placed(brase)"]}, r"Did you mean 'placed\(brace\)'"),
            ({"start": 3}, "start 3: is neither a name nor a list of facts"),
            ({"start": ""}, "names no fact and no place"),
        ],
    )
    def test_what_is_no_start_is_refused_and_changes_nothing(self, board_task, options, message):
        env = SkillEnv(make_model(board_task))
        envs = SkillVectorEnv(make_model(board_task), 2)
        for refusing in (env, envs):
            with pytest.raises(OptionError, match=message):
                refusing.reset(options=options)
            with pytest.raises(gymnasium.error.ResetNeeded):
                refusing.step(np.zeros(2, dtype=int))

    def test_a_state_that_completes_the_task_is_refused(self):
        with pytest.raises(OptionError, match="already completes the task"):
            SkillEnv(model_of(two_roads_task())).reset(options={"start": "done"})


class TestChance:
    def test_a_seed_gives_the_same_outcomes_again(self):
        env = SkillEnv(model_of(retry_task(0.3)))

        def lengths() -> list[int]:
            results = []
            for episode in range(20):
                env.reset(seed=11 if episode == 0 else None)
                steps = 1
                while not any(env.step(0)[2:4]):
                    steps += 1
                results.append(steps)
            return results

        first = lengths()
        assert lengths() == first
        assert 5 < len(set(first))

    def test_outcomes_come_as_often_as_they_are_probable(self):
        env = SkillEnv(model_of(retry_task(0.3)))
        env.reset(seed=5)
        done = 0
        for _ in range(2000):
            done += env.step(0)[2]
            env.reset()
        assert 0.3 == pytest.approx(done / 2000, abs=0.035)


class TestMisuse:
    def test_a_step_before_the_first_reset_is_refused(self, board_task):
        with pytest.raises(gymnasium.error.ResetNeeded, match="no running episode"):
            SkillEnv(make_model(board_task)).step(0)

    def test_a_step_beyond_the_end_is_refused(self, board):
        board.step(1)
        with pytest.raises(gymnasium.error.ResetNeeded, match="no running episode"):
            board.step(0)

    @pytest.mark.parametrize("action", [-1, 16, 0.0, "pick(pcb)"])
    def test_an_action_that_does_not_exist_is_refused(self, board, action):
        with pytest.raises(gymnasium.error.InvalidAction, match="Actions are 0 to 15"):
            board.step(action)


def test_it_is_rendered_as_one_line(board_task):
    env = SkillEnv(make_model(board_task), render_mode="ansi")
    env.reset()
    env.step(0)
    env.step(0)
    line = env.render()
    assert line is not None
    assert line.startswith("step 2, 0.03800 m; pick(pcb): needs at_start(pcb), hand_free; {held(pc")
    assert "\n" not in line
    assert SkillEnv(make_model(board_task)).render() is None


# What an environment pays.


def paid(reward_function: RewardFunction, task: Task, **ended: bool) -> float:
    ends = {"goal": False, "out_of_time": False, **ended}
    return reward_function.of_step(task.initial, task.skills[0].name, 3.0, **ends)


def test_by_default_the_scheme_is_paid_to_the_letter(board_task):
    reward_function = RewardFunction.of(board_task, "reward")
    assert board_task.reward is reward_function.scheme
    assert -0.1 * 3.0 == pytest.approx(paid(reward_function, board_task))
    assert 10.0 == paid(reward_function, board_task, goal=True)
    assert -10.0 == paid(reward_function, board_task, out_of_time=True)
    assert -10.0 == reward_function.infeasible


def test_the_objective_cost_pays_minus_every_cost_and_the_ends_beside_it(board_task):
    reward_function = RewardFunction.of(board_task, "cost")
    assert -3.0 == paid(reward_function, board_task)
    assert 10.0 - 3.0 == paid(reward_function, board_task, goal=True)
    assert -10.0 - 3.0 == paid(reward_function, board_task, out_of_time=True)
    assert -10.0 == reward_function.infeasible


@pytest.mark.parametrize("objective", ["reward", "cost"])
def test_without_a_scheme_costs_are_paid_and_10_or_minus_10_at_the_end(objective):
    task = two_roads_task()
    reward_function = RewardFunction.of(task, objective)
    assert [-3.0, 7.0, -13.0] == [
        paid(reward_function, task),
        paid(reward_function, task, goal=True),
        paid(reward_function, task, out_of_time=True),
    ]
    assert -10.0 == reward_function.infeasible


def test_a_scheme_without_a_figure_for_time_takes_that_of_the_infeasible():
    task = two_roads_task()
    reward = DistanceReward({task.facts.bit("a"): 1.0}, complete=1.0, infeasible=-4.0)
    reward_function = RewardFunction.of(task.replace(reward=reward), "cost")
    assert (-4.0, 1.0, -4.0) == (
        reward_function.infeasible,
        reward_function.complete,
        reward_function.out_of_time,
    )


def test_an_unknown_objective_is_refused_with_the_nearest(board_task):
    with pytest.raises(OptionError, match=r"Unknown objective 'costs'\. Did you mean 'cost'"):
        RewardFunction.of(board_task, "costs")


# What a learner sees of a state.


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
