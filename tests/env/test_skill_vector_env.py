"""Many places at which one task is done."""

from __future__ import annotations

import dataclasses
import json
import random
from collections.abc import Iterator
from functools import partial

import gymnasium
import numpy as np
import pytest
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from hypothesis import given
from hypothesis import strategies as st

import situations
from board_situations import OPTIMAL
from skillplan.checks import Feasibility
from skillplan.env import Observation, RewardFunction, SkillEnv, SkillVectorEnv
from skillplan.errors import BackEndError, OptionError
from skillplan.model import SkillModel
from skillplan.pipeline import make_model
from skillplan.task import Facts, Outcome, Skill, State, Task, Verdict

COMPLETE, INFEASIBLE, OUT_OF_TIME = 1, 2, 3
LOAD_GRIPPER, LOAD_SCREWDRIVER = 12, 13


@st.composite
def chancy_tasks(draw: st.DrawFn) -> Task:
    """Draw a small task some of whose skills may fail, or do something else."""
    task = draw(situations.small_tasks())
    rng = random.Random(draw(st.integers(0, 2**32)))
    skills = []
    for skill in task.skills:
        (nominal,) = skill.outcomes
        nothing = Outcome(0.25, task.facts.none, task.facts.none)
        other = Outcome(0.25, task.facts.state(rng.getrandbits(2)), task.facts.none)
        outcomes = rng.choice(
            [
                (nominal,),
                (dataclasses.replace(nominal, probability=0.75), nothing),
                (dataclasses.replace(nominal, probability=0.5), nothing, other),
            ]
        )
        skills.append(dataclasses.replace(skill, outcomes=outcomes))
    return task.replace(skills=tuple(skills))


any_task = st.one_of(
    situations.small_assemblies().map(situations.assembly), situations.small_tasks(), chancy_tasks()
)


class Walk:
    """A place as the model has it, step by step: what the environment must agree with."""

    def __init__(self, model: SkillModel, seed: int) -> None:
        self.model = model
        self.reward_function = RewardFunction.of(model.task, "reward")
        self.rng = seeding.np_random(seed)[0]
        self.state, self.steps = model.initial, 0

    def step(self, action: int) -> tuple[State, float, float, int]:
        """Return the state after the step, reward, cost and end; then begin anew if it ended."""
        model, before = self.model, self.state
        skill = model.task.skills[action]
        self.steps += 1
        reward, cost, end = self.reward_function.infeasible, 0.0, INFEASIBLE
        if model.verdict(before, skill).is_feasible:
            transition = model.transition(before, skill)
            cost, self.state = transition.cost, self._drawn(transition.outcomes)
            goal = model.is_goal(self.state)
            late = not goal and self.steps >= model.step_limit
            end = COMPLETE if goal else OUT_OF_TIME if late else 0
            reward = self.reward_function.of_step(
                before, skill.name, cost, goal=goal, out_of_time=late
            )
        after = self.state
        if end:
            self.state, self.steps = model.initial, 0
        return after, reward, cost, end

    def _drawn(self, outcomes: tuple[tuple[float, State], ...]) -> State:
        if len(outcomes) == 1:
            return outcomes[0][1]
        drawn, below = self.rng.random(), 0.0
        for probability, state in outcomes:
            below += probability
            if drawn < below:
                return state
        return outcomes[-1][1]


class CountingModel(SkillModel):
    """A model that notes what verdicts it is asked for: bits of the state and action."""

    def __init__(self, feasibility: Feasibility) -> None:
        super().__init__(feasibility)
        self.asked: list[tuple[int, int]] = []

    def verdict(self, state: State, skill: Skill) -> Verdict:
        self.asked.append((state.bits, self.task.action(skill)))
        return super().verdict(state, skill)


def likely_actions(masks: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return an action for every place: mostly an allowed one, any other now and then."""
    wild = rng.random(len(masks)) < 0.1
    scores = rng.random(masks.shape) + 10 * (masks.astype(bool) & ~wild[:, None])
    return np.argmax(scores, axis=1)


def trace(env: SkillVectorEnv, infos: dict, steps: int, seed: int) -> Iterator[list[np.ndarray]]:
    """Yield everything that steps return, all arrays in a row, under actions of a seed."""
    rng = np.random.default_rng(seed)
    for _ in range(steps):
        obs, rewards, terminated, truncated, infos = env.step(
            likely_actions(infos["action_mask"], rng)
        )
        yield [obs, rewards, terminated, truncated, *rows(infos)]


def rows(infos: dict) -> list[np.ndarray]:
    """Return the infos of every step, in a row; `final_info` repeats some of them."""
    return [array for name, array in infos.items() if name.lstrip("_") != "final_info"]


def same(first: list[np.ndarray], other: list[np.ndarray]) -> bool:
    return all(a.tobytes() == b.tobytes() for a, b in zip(first, other, strict=True))


class TestAgreement:
    @given(
        any_task,
        st.sampled_from(["none", "applicable", "feasible"]),
        st.sampled_from(["paper", "markov", "layout"]),
        st.integers(0, 2**32),
    )
    def test_a_random_walk_is_what_the_model_says_step_by_step(self, task, mask, kind, seed):
        env = SkillVectorEnv(make_model(task), 3, observation=kind, mask=mask)
        reference = make_model(task)
        observation = Observation.of(task, kind)
        walks = [Walk(reference, seed + place) for place in range(3)]
        rng = np.random.default_rng(seed)
        obs, infos = env.reset(seed=seed)
        for _ in range(40):
            actions = likely_actions(infos["action_mask"], rng)
            obs, rewards, terminated, truncated, infos = env.step(actions)
            for place, walk in enumerate(walks):
                after, reward, cost, end = walk.step(int(actions[place]))
                assert (reward, cost, end) == (
                    rewards[place],
                    infos["cost"][place],
                    infos["end"][place],
                )
                assert (end in (COMPLETE, INFEASIBLE)) == terminated[place]
                assert (end == OUT_OF_TIME) == truncated[place]
                assert observation.encode(after).tolist() == infos["final_obs"][place].tolist()
                assert observation.encode(walk.state).tolist() == obs[place].tolist()
                for state, name in ((walk.state, "action_mask"), (after, "final_mask")):
                    expected = allowed(reference, state, mask)
                    assert expected == np.flatnonzero(infos[name][place]).tolist()

    @pytest.mark.slow(reason="many episodes; the suite of environments in every run")
    @given(any_task, st.integers(0, 2**32))
    def test_a_place_is_the_single_environment_of_its_seed(self, task, seed):
        env, single = SkillVectorEnv(make_model(task), 2), SkillEnv(make_model(task))
        obs, infos = env.reset(seed=[seed + 99, seed])
        alone, info = single.reset(seed=seed)
        rng = np.random.default_rng(seed)
        for _ in range(30):
            assert (alone.tolist(), info["action_mask"].tolist()) == (
                obs[1].tolist(),
                infos["action_mask"][1].tolist(),
            )
            actions = likely_actions(infos["action_mask"], rng)
            obs, rewards, terminated, truncated, infos = env.step(actions)
            alone, reward, done, late, info = single.step(int(actions[1]))
            assert (reward, done, late) == (rewards[1], terminated[1], truncated[1])
            assert info["cost"] == infos["cost"][1]
            assert alone.tolist() == infos["final_obs"][1].tolist()
            if done or late:
                alone, info = single.reset()


def allowed(model: SkillModel, state: State, mask: str) -> list[int]:
    if mask == "none":
        return list(range(len(model.task.skills)))
    if mask == "applicable":
        return [model.task.action(skill) for skill in model.applicable(state)]
    steps = () if model.is_goal(state) else model.transitions(state)
    return [model.task.action(step.skill) for step in steps]


class TestRewards:
    """Table II of the paper at several places in one step, each ending in its own way."""

    def test_every_kind_of_ending_pays_its_figure(self, board_task):
        env = SkillVectorEnv(make_model(board_task), 4, mask="none")
        env.reset(seed=0)
        changes = [LOAD_SCREWDRIVER, LOAD_GRIPPER] * 10
        plans = [changes, [0, LOAD_SCREWDRIVER], [*OPTIMAL], [2, 3]]
        paid: list[list[float]] = [[], [], [], []]
        ends = [0, 0, 0, 0]
        for step in range(20):
            actions = [plan[step] if step < len(plan) else 0 for plan in plans]
            _, rewards, terminated, truncated, infos = env.step(np.array(actions))
            for place, plan in enumerate(plans):
                if step < len(plan):
                    paid[place].append(float(rewards[place]))
                    ends[place] = int(infos["end"][place])
                    over = terminated[place] or truncated[place]
                    assert over == (ends[place] > 0)
        distance_m = board_task.skills[0].cost.at(board_task.initial)
        assert [OUT_OF_TIME, INFEASIBLE, COMPLETE, INFEASIBLE] == ends
        assert [-2.5] * 18 + [-10.0] == paid[0][1:]
        assert [-0.1 * distance_m, -10.0] == paid[1][:2]
        assert 10.0 == paid[2][-1]
        assert all(-0.1 < reward < 0 for reward in paid[2][:-1])
        assert -10.0 == paid[3][-1]

    def test_the_objective_cost_adds_up_to_10_minus_the_cost_of_the_plan(self, board_task):
        env = SkillVectorEnv(make_model(board_task), 1, objective="cost")
        env.reset(seed=0)
        rewards, costs = zip(
            *((step[1][0], step[4]["cost"][0]) for step in map(env.step, np.array([OPTIMAL]).T)),
            strict=True,
        )
        assert 10.0 - 1.86709 == pytest.approx(sum(rewards), abs=5e-6)
        assert 1.86709 == pytest.approx(sum(costs), abs=5e-6)


class TestEpisodes:
    def test_the_next_one_begins_in_the_step_that_ends_one(self, board_task):
        env = SkillVectorEnv(make_model(board_task), 2)
        first, started = env.reset(seed=0)
        obs, _, terminated, _, infos = env.step(np.array([0, 1]))
        assert [False, True] == terminated.tolist()
        assert first[1].tolist() == obs[1].tolist() == infos["final_obs"][1].tolist()
        assert first[0].tolist() != obs[0].tolist()
        for action in OPTIMAL:
            obs, _, terminated, _, infos = env.step(np.array([1, action]))
        assert terminated[1]
        assert first[1].tolist() == obs[1].tolist() != infos["final_obs"][1].tolist()
        assert started["action_mask"][1].tolist() == infos["action_mask"][1].tolist()
        assert AutoresetMode.SAME_STEP is env.metadata["autoreset_mode"]

    def test_where_nothing_is_allowed_any_action_ends_it_as_infeasible(self):
        facts = Facts(("stuck", "done"))
        fall = situations.make_skill(facts, "fall", forbids=("stuck",), add=("stuck",))
        task = situations.make_task(facts, [fall], goal=("done",))
        for mask in ("applicable", "feasible"):
            env = SkillVectorEnv(make_model(task), 1, mask=mask)
            env.reset(seed=0)
            *_, infos = env.step(np.array([0]))
            assert not infos["action_mask"].any()
            _, rewards, terminated, _, infos = env.step(np.array([0]))
            assert (-10.0, True, INFEASIBLE) == (rewards[0], terminated[0], infos["end"][0])
            assert infos["action_mask"].any()

    def test_what_was_returned_is_never_changed_later(self, board_task):
        env = SkillVectorEnv(make_model(board_task), 4)
        _, infos = env.reset(seed=0)
        kept = [(arrays, [a.copy() for a in arrays]) for arrays in trace(env, infos, 60, 1)]
        assert all(same(arrays, copies) for arrays, copies in kept)

    def test_ends_are_named_as_gymnasium_names_them(self, board_task):
        """Names, types and figures of `SyncVectorEnv`; `final_obs` has all rows here."""
        ours = SkillVectorEnv(make_model(board_task), 2)
        theirs = SyncVectorEnv(
            [lambda: SkillEnv(make_model(board_task))] * 2, autoreset_mode=AutoresetMode.SAME_STEP
        )
        ours.reset(seed=0), theirs.reset(seed=0)
        for step, action in enumerate(OPTIMAL):
            actions = np.array([action, 1 if step == 3 else action])
            infos, other = ours.step(actions)[4], theirs.step(actions)[4]
            assert infos["action_mask"].tolist() == other["action_mask"].tolist()
            assert infos["action_mask"].dtype == other["action_mask"].dtype
            assert ("final_info" in other) == ("final_info" in infos) == infos["_final_obs"].any()
            if "final_info" not in other:
                continue
            for name in ("_final_obs", "_final_info"):
                assert other[name].tolist() == infos[name].tolist()
            for place in np.flatnonzero(infos["_final_obs"]):
                assert other["final_obs"][place].tolist() == infos["final_obs"][place].tolist()
                for name in ("action_mask", "cost"):
                    mine, yours = infos["final_info"], other["final_info"]
                    assert yours[name].dtype == mine[name].dtype
                    assert yours[name][place].tolist() == mine[name][place].tolist()
                    assert yours[f"_{name}"].tolist() == mine[f"_{name}"].tolist()

    def test_masks_are_those_of_the_infos_and_sample_actions(self, board_task):
        env = SkillVectorEnv(make_model(board_task), 3)
        _, infos = env.reset(seed=0)
        for _ in range(20):
            assert infos["action_mask"].tolist() == env.action_masks().tolist()
            assert {np.dtype(np.int8)} == {
                infos["action_mask"].dtype,
                infos["final_mask"].dtype,
                env.action_masks().dtype,
            }
            actions = env.action_space.sample(mask=tuple(infos["action_mask"]))
            assert infos["action_mask"][np.arange(3), actions].all()
            *_, infos = env.step(actions)

    def test_a_requested_start_counts_for_the_first_episode_of_each_place(self, board_task):
        env, single = SkillVectorEnv(make_model(board_task), 2), SkillEnv(make_model(board_task))
        first, _ = env.reset(seed=0)
        single.reset(seed=0)
        for action in OPTIMAL[:6]:
            *_, info = single.step(action)
        expected, _ = single.reset(options={"start": info["state"]})
        obs, _ = env.reset(options={"start": info["state"]})
        assert [expected.tolist()] * 2 == obs.tolist()
        obs, _, terminated, _, _ = env.step(np.array([OPTIMAL[6], OPTIMAL[0]]))
        assert [False, True] == terminated.tolist()
        assert first[1].tolist() == obs[1].tolist()


class TestIndependence:
    @given(chancy_tasks(), st.integers(1, 6), st.integers(0, 2**32))
    def test_a_place_depends_neither_on_its_neighbours_nor_on_their_number(
        self, task, number, seed
    ):
        alone = SkillVectorEnv(make_model(task), 1, observation="paper")
        among = SkillVectorEnv(make_model(task), number, observation="paper")
        place = seed % number
        seeds = [(seed + 7 * other) % 2**31 for other in range(number)]
        obs, infos = alone.reset(seed=[seeds[place]])
        among.reset(seed=seeds)
        rng, others = np.random.default_rng(seed), np.random.default_rng(seed + 1)
        for _ in range(30):
            mine = likely_actions(infos["action_mask"], rng)
            actions = others.integers(len(task.skills), size=number)
            actions[place] = mine[0]
            obs, rewards, terminated, truncated, infos = alone.step(mine)
            *arrays, beside = among.step(actions)
            expected = [obs, rewards, terminated, truncated, *rows(infos)]
            results = [array[[place]] for array in (*arrays, *rows(beside))]
            assert same(expected, results)

    def test_without_a_seed_a_reset_goes_on_with_the_random_numbers_there_are(self):
        env = SkillVectorEnv(situations.model_of(situations.retry_task(0.5)), 8)
        ways = []
        for seed in (3, None, 3, None):
            env.reset(seed=seed)
            ways.append([env.step(np.zeros(8, dtype=int))[4]["end"].tolist() for _ in range(20)])
        assert ways[0] == ways[2] != ways[1] == ways[3]


class TestRestoring:
    @pytest.mark.slow(reason="trainings that go on in every run")
    @given(chancy_tasks(), st.integers(0, 60), st.integers(0, 2**32))
    def test_it_goes_on_bit_for_bit_also_amid_episodes_and_chance(self, task, steps, seed):
        env = SkillVectorEnv(make_model(task), 4)
        _, infos = env.reset(seed=seed)
        for *_, mask, _, _, _, _, _ in trace(env, infos, steps, seed):
            infos = {"action_mask": mask}
        kept = json.dumps(env.state())
        loads = json.loads(kept)
        fresh = SkillVectorEnv(make_model(task), 4)
        obs, again = fresh.restore(loads)
        assert infos["action_mask"].tolist() == again["action_mask"].tolist()
        assert not again["cost"].any()
        assert not again["end"].any()
        assert again["final_obs"].tolist() == obs.tolist()
        onwards = trace(env, infos, 60, seed + 1), trace(fresh, again, 60, seed + 1)
        assert all(same(*pair) for pair in zip(*onwards, strict=True))
        assert kept == json.dumps(loads)
        assert env.state() == fresh.state()

    def test_a_family_goes_on_with_the_boards_it_would_have_drawn(self):
        models = [
            situations.model_of(situations.two_roads_task().replace(name=name))
            for name in ("one", "other")
        ]
        env, fresh = SkillVectorEnv(models, 5), SkillVectorEnv(models, 5)
        _, infos = env.reset(seed=1)
        for *_, mask, _, _, _, _, _ in trace(env, infos, 17, 0):
            infos = {"action_mask": mask}
        _, again = fresh.restore(env.state())
        for _ in zip(trace(env, infos, 50, 2), trace(fresh, again, 50, 2), strict=True):
            assert env.state() == fresh.state()

    def test_facts_beyond_64_bits_are_kept(self):
        facts = Facts(tuple(f"f{i}" for i in range(100)))
        skills = [
            situations.make_skill(facts, "end", add=("f99",)),
            situations.make_skill(facts, "go", add=("f0",)),
        ]
        task = situations.make_task(facts, skills, initial=("f70",), goal=("f99",))
        env = SkillVectorEnv(make_model(task), 1)
        env.reset(seed=0)
        env.step(np.array([1]))
        assert hex(1 << 70 | 1) == env.state()["places"][0]["facts"]
        obs, _ = env.restore(env.state())
        assert [0, 70] == np.flatnonzero(obs[0]).tolist()

    @pytest.mark.parametrize(
        ("change", "message"),
        [
            (lambda state: state["places"].pop(), "no state of an environment of 2 places"),
            (lambda state: state.pop("places"), "no state of an environment of 2 places"),
            (lambda state: state["places"].__setitem__(0, None), "no state of a place"),
            (lambda state: state["places"][1].pop("steps"), "no state of a place: KeyError"),
            (lambda state: state["places"][1].update(facts="0xg"), "no state of a place"),
            (lambda state: state["places"][1].update(facts="0xffffffff"), "outside the 3 facts"),
            (lambda state: state["places"][1].update(model=1), "of other tasks"),
            (lambda state: state["places"][1].update(steps=20), "of other tasks"),
            (
                lambda state: state["places"][1]["generator"].update(state=hex(2**128)),
                "no state of a place",
            ),
        ],
    )
    def test_what_is_no_such_state_is_refused_and_changes_nothing(self, change, message):
        env = SkillVectorEnv(situations.model_of(situations.two_roads_task()), 2)
        env.reset(seed=0)
        before, broken = env.state(), env.state()
        change(broken)
        with pytest.raises(ValueError, match=message):
            env.restore(broken)
        assert before == env.state()


class TestLaziness:
    def test_the_model_is_asked_once_about_a_skill_in_a_state(self, board_task):
        """However often and at however many places it is tried."""
        model = CountingModel(make_model(board_task).feasibility)
        env = SkillVectorEnv(model, 32)
        _, infos = env.reset(seed=0)
        tried = set()
        rng = np.random.default_rng(0)
        for _ in range(300):
            before = [int(place["facts"], 16) for place in env.state()["places"]]
            actions = likely_actions(infos["action_mask"], rng)
            tried |= set(zip(before, actions.tolist(), strict=True))
            *_, infos = env.step(actions)
        assert len(model.asked) == len(set(model.asked))
        assert tried == set(model.asked)
        assert len(tried) > 500

    def test_back_ends_are_asked_only_about_what_is_tried(self):
        task = situations.two_roads_task()
        back_end = situations.fake_back_end(task)
        env = SkillVectorEnv(situations.model_of(task, back_end), 3)
        env.reset(seed=0)
        assert [] == back_end.asked
        env.step(np.array([0, 0, 0]))
        assert ["to_a"] == [skill for skill, _ in back_end.asked]

    def test_the_mask_of_the_feasible_asks_once_about_all_that_is_applicable(self, board_task):
        """In every state that was entered, but not in the goal; without trying any of it."""
        model = CountingModel(make_model(board_task).feasibility)
        env = SkillVectorEnv(model, 16, mask="feasible")
        _, infos = env.reset(seed=0)
        rng = np.random.default_rng(0)
        queries, completed = [], False
        for _ in range(300):
            queries = model.asked[:]
            states = [board_task.facts.state(int(p["facts"], 16)) for p in env.state()["places"]]
            for state, mask in zip(states, infos["action_mask"], strict=True):
                skills = {(state.bits, board_task.action(s)) for s in model.applicable(state)}
                assert (
                    {(state.bits, int(a)) for a in np.flatnonzero(mask)} <= skills <= set(queries)
                )
            masks = infos["action_mask"]
            *_, infos = env.step(np.argmax(rng.random(masks.shape) * masks, axis=1))
            completed = completed or COMPLETE in infos["end"]
        assert completed
        assert len(queries) == len(set(queries))
        assert not any(model.is_goal(board_task.facts.state(bits)) for bits, _ in queries)


class TestFamily:
    def test_every_episode_draws_one_of_the_models(self):
        models = [
            situations.model_of(situations.two_roads_task().replace(name=name))
            for name in ("a", "b", "c")
        ]
        env = SkillVectorEnv(models, 2)
        env.reset(seed=0)
        drawn = []
        for _ in range(200):
            env.step(np.array([0, 0]))
            drawn += [place["model"] for place in env.state()["places"]]
        counts = np.bincount(drawn, minlength=3)
        assert counts.min() > 90

    def test_boards_of_other_layouts_tell_themselves_apart_by_their_costs(self):
        content = situations.config_content("inverter_board")
        content.pop("expect")
        boards = []
        for shift_m in (0.0, 0.01):
            content["parts"]["clock"]["start_m"][0] += shift_m
            boards.append(situations.assembly(content))
        env = SkillVectorEnv([make_model(board) for board in boards], 20, observation="layout")
        obs, _ = env.reset(seed=0)
        assert 2 == len(np.unique(obs, axis=0))
        blind = SkillVectorEnv(env.models, 20, observation="markov")
        assert 1 == len(np.unique(blind.reset(seed=0)[0], axis=0))

    def test_models_that_do_not_fit_each_other_are_refused(self, board_task):
        two_roads = situations.two_roads_task()
        renamed = [dataclasses.replace(two_roads.skills[0], name="up"), *two_roads.skills[1:]]
        others = {
            "facts": board_task,
            "skills": two_roads.replace(skills=tuple(renamed)),
            "observations": two_roads.replace(
                observation=Observation.of(two_roads, "paper").literals[:1]
            ),
        }
        for what, other in others.items():
            with pytest.raises(OptionError, match=f"cannot be learned together: their {what} diff"):
                SkillVectorEnv([situations.model_of(two_roads), make_model(other)], 1)


class TestMisuse:
    def test_something_must_be_done_somewhere(self):
        with pytest.raises(ValueError, match="at least one model and one place"):
            SkillVectorEnv([], 1)
        with pytest.raises(ValueError, match="at least one model and one place"):
            SkillVectorEnv(situations.model_of(situations.two_roads_task()), 0)

    def test_nothing_goes_before_the_first_reset(self):
        env = SkillVectorEnv(situations.model_of(situations.two_roads_task()), 1)
        with pytest.raises(gymnasium.error.ResetNeeded, match="must be reset"):
            env.step(np.array([0]))
        with pytest.raises(gymnasium.error.ResetNeeded, match="must be reset"):
            env.state()

    def test_nothing_goes_after_it_was_closed(self, board_task):
        envs = SkillVectorEnv(make_model(board_task), 2)
        envs.reset(seed=0)
        state = envs.state()
        envs.close()
        uses = (
            envs.reset,
            envs.state,
            envs.action_masks,
            partial(envs.step, np.zeros(2, dtype=np.int64)),
            partial(envs.restore, state),
        )
        for use in uses:
            with pytest.raises(gymnasium.error.ClosedEnvironmentError, match="make a new one"):
                use()

    def test_there_is_one_seed_for_every_place(self):
        env = SkillVectorEnv(situations.model_of(situations.two_roads_task()), 2)
        with pytest.raises(ValueError, match="2 places, but 3 seeds"):
            env.reset(seed=[1, 2, 3])

    @pytest.mark.parametrize("actions", [[0], [0, 4], [-1, 0], [0.0, 1.0], [[0, 1]]])
    def test_there_is_one_existing_action_for_every_place(self, actions):
        env = SkillVectorEnv(situations.model_of(situations.two_roads_task()), 2)
        env.reset(seed=0)
        before = env.state()
        with pytest.raises(gymnasium.error.InvalidAction):
            env.step(np.array(actions))
        assert before == env.state()

    def test_a_back_end_that_fails_leaves_every_place_where_it_was(self):
        def answer(skill, state):
            if skill.name == "to_b":
                raise OSError("no answer")
            return Verdict.feasible(state.facts.none, state.facts.none)

        task = situations.two_roads_task()
        env = SkillVectorEnv(situations.model_of(task, situations.fake_back_end(task, answer)), 2)
        env.reset(seed=0)
        before = env.state()
        with pytest.raises(BackEndError, match="no answer"):
            env.step(np.array([0, 2]))
        assert before == env.state()
        env.step(np.array([0, 0]))
