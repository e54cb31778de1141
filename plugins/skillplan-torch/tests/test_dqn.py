"""DQN: what it learns and keeps, that masks hold, that runs stay apart and go on bit for bit."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from deep_learner_suite import DeepLearnerSuite, assert_same, places
from deep_learner_suite import begun as begun_for
from deep_learner_suite import resumed as resumed_for
from example_count import examples
from situations import make_skill, make_task, retry_task, two_roads_task
from skillplan import load_problem
from skillplan.env import GOES_ON, OUT_OF_TIME, Observation
from skillplan.errors import OptionError
from skillplan.pipeline import make_model, solve
from skillplan.records import Choice, Status
from skillplan.solvers import NetworkPolicy, Snapshot
from skillplan.sweep import read_space
from skillplan.task import Facts, Literal
from skillplan.testing import SolverSuite, lid_task
from skillplan_torch import DqnSolver, PpoSolver, ReplayMemory
from thinned import release_case, slow_case

CONFIGS = Path(__file__).parents[3] / "configs"
OPTIMUM_M = 1.86709
SMALL = {"width": 32, "batch": 32, "updates": 0.4, "warm_up": 20}
STEPS = 200
# Networks, memories and observations of every kind.
ADDITIONS = {"branching": 0.9, "imitation": 1.0, "replay": "distinct", "clip_values": True}
KINDS = {
    "usual": {},
    "plans": {"planning": True, **ADDITIONS},
    "additions": ADDITIONS,
    "no-mask": {"mask": "none"},
    "two-layers": {"layers": 2, "gamma": 0.9},
    "small-memory": {"capacity": 60, "epsilon": 0.0},
    "linear-small-memory": {"layers": 0, "capacity": 25, "observation": "paper"},
    "counts": {"exploration": "count", "mask": "none"},
}


def kinds(*chosen):
    """Return all kinds as a parametrization, of which every run has these."""
    rest = pytest.mark.slow(reason="other kinds in every run")
    return [kind if kind in chosen else pytest.param(kind, marks=rest) for kind in KINDS]


@pytest.fixture(scope="module")
def board():
    """The inverter board: 16 actions."""
    return load_problem(CONFIGS / "inverter_board.yaml").task


@pytest.fixture(scope="module")
def motor_drive():
    """More than 32 actions, and no whole number of blocks of them."""
    return load_problem(CONFIGS / "motor_drive.yaml").task


def solver(**options):
    return DqnSolver(DqnSolver.Options(**{**SMALL, **options}))


def begun(learner, seeds, task, steps=STEPS):
    return begun_for(learner, seeds, task, steps)


def resumed(learner, seeds, task, snapshot, steps=STEPS):
    return resumed_for(learner, seeds, task, snapshot, steps)


def assert_same_policy(first, other):
    for mine, theirs in zip(
        first.weights + first.biases, other.weights + other.biases, strict=True
    ):
        assert mine.tobytes() == theirs.tobytes()


def followed(learner, task, policy):
    """Return the cost and end of an episode that follows a policy."""
    env = places(learner, 1, task)
    observed, infos = env.reset(seed=0)
    cost, end = 0.0, 0
    while not end:
        observed, _, _, _, infos = env.step(policy.greedy(observed, infos["action_mask"]))
        cost, end = cost + float(infos["cost"][0]), int(infos["end"][0])
    return cost, end


def nearly_done(task, skills):
    """Return a task that begins where its first skills have been done."""
    state = task.initial
    for action in skills:
        state = task.skills[action].prediction.apply(state)
    return replace(task, initial=state)


def chain_task(**changes):
    """Return a task of three skills in a row, of a cost of 1 each."""
    facts = Facts(("a", "b", "c"))
    skills = [
        make_skill(facts, "one", forbids=("a",), add=("a",)),
        make_skill(facts, "two", requires=("a",), forbids=("b",), add=("b",)),
        make_skill(facts, "three", requires=("b",), add=("c",)),
    ]
    return make_task(facts, skills, goal=("c",), **{"step_limit": 12, **changes})


def chain_values(**options):
    """Return what the three skills of the chain are learned to be worth where they apply."""
    learner, task, steps = solver(updates=1.5, **options), chain_task(), 500
    training = begun(learner, [0], task, steps)
    training.advance(steps)
    observation = Observation.of(task, learner.options.observation)
    states = [task.facts.of(*names) for names in ((), ("a",), ("a", "b"))]
    seen = np.array([observation.encode(state) for state in states])
    return training.learned(0).last.scores(seen).diagonal()


class TestDqnSolver(SolverSuite):
    solver = "dqn"
    options = {"steps": 600, "batch": 32, "width": 128, "planning": True, "imitation": 1.0}  # noqa: RUF012

    @pytest.mark.slow(reason="a training; learners in tables are as honest in every run")
    def test_it_is_honest_where_there_is_no_plan(self):
        super().test_it_is_honest_where_there_is_no_plan()

    @pytest.mark.slow(reason="two trainings; one that goes on bit for bit in every run")
    def test_the_same_seed_gives_the_same_plan(self):
        super().test_the_same_seed_gives_the_same_plan()


class TestAsADeepLearner(DeepLearnerSuite):
    learner = DqnSolver
    small = SMALL
    steps = STEPS
    changes = ({"width": 64}, {"layers": 2}, {"capacity": 5})


class TestLearning:
    @pytest.mark.parametrize("kind", kinds("counts", "linear-small-memory"))
    def test_the_cheaper_of_two_roads_is_learned(self, kind):
        learner = solver(**{**KINDS[kind], "mask": "applicable"})
        training = begun(learner, [0], two_roads_task(), 300)
        training.advance(300)
        assert training.learned(0).best_cost == 3.0

    @pytest.mark.slow(reason="two runs at once; as a solver it does so in every run")
    def test_the_lid_is_screwed_on_at_least_cost(self):
        steps, exact = 1_000, solve(lid_task(), "exact").cost
        learner = DqnSolver(DqnSolver.Options(width=128, batch=32, planning=True, imitation=1.0))
        training = begun(learner, [0, 1], lid_task(), steps)
        training.advance(steps)
        assert [training.learned(run).best_cost for run in (0, 1)] == [pytest.approx(exact)] * 2

    def test_a_skill_that_may_fail_is_tried_again(self):
        assert solve(retry_task(0.5), solver(steps=300)).cost == pytest.approx(4.0)

    def test_values_come_to_the_discounted_returns(self):
        """With 4 for completing, and 3 for as many usual steps as the limit allows."""
        step = 3.0 / 12
        expected = [-step * 1.75 + 4.0 * 0.25, -step * 1.5 + 4.0 * 0.5, -step + 4.0]
        values = chain_values(gamma=0.5, steps_worth=3.0)
        np.testing.assert_allclose(values, expected, atol=0.05)

    @pytest.mark.parametrize(
        "seeds",
        [
            release_case([3], reason="10,000 steps; the lid in the whole suite"),
            release_case([*range(10)], reason="ten runs of 10,000 steps"),
        ],
    )
    @pytest.mark.parametrize(
        ("options", "share", "success"),
        [
            release_case(
                {"mask": "none", "observation": "paper"},
                0.9,
                0.80,
                reason="without a mask; the lid in the whole suite",
            ),
            ({"mask": "applicable", "observation": "markov"}, 1.0, 0.99),
        ],
    )
    def test_seeds_learn_the_board(self, board, options, share, success, seeds):
        """Of the paper's ten, four found the optimum and two never finished a sequence."""
        learner, steps = DqnSolver(DqnSolver.Options(**options)), 10_000
        training = begun(learner, seeds, board, steps)
        episodes = training.advance(steps)
        costs = [training.learned(run).best_cost for run in range(len(seeds))]
        best = [cost for cost in costs if cost is not None and cost < OPTIMUM_M + 1e-4]
        assert len(best) >= share * len(seeds)
        late = [episode for episode in episodes if episode.step > steps - 2_000]
        rates = [
            np.mean([episode.success for episode in late if episode.run == run])
            for run in range(len(seeds))
        ]
        assert np.median(rates) >= success


class TestMasks:
    @pytest.mark.parametrize("epsilon", [0.0, 1.0])
    def test_what_does_not_apply_is_never_tried(self, epsilon):
        task = lid_task()
        model = make_model(task)
        learner = solver(epsilon=epsilon, epsilon_end=epsilon)
        episodes = begun(learner, [0, 1], task).advance(STEPS)
        assert len(episodes) > 20
        for episode in episodes:
            state = model.initial
            for action in episode.actions:
                assert task.skills[action].applicable(state)
                state = task.skills[action].prediction.apply(state)

    def test_what_back_ends_forbid_is_never_tried_either_where_they_are_asked(self):
        episodes = begun(solver(mask="feasible"), [0, 1], lid_task()).advance(STEPS)
        assert len(episodes) > 20
        # A state that allows nothing ends the episode at its next step, whatever is done.
        model, task = make_model(lid_task()), lid_task()
        for episode in episodes:
            state = model.initial
            for action in episode.actions:
                allowed = [
                    skill
                    for skill in model.applicable(state)
                    if model.verdict(state, skill).is_feasible
                ]
                assert not allowed or task.skills[action].name in {item.name for item in allowed}
                state = task.skills[action].prediction.apply(state)

    @pytest.mark.parametrize(
        ("kind", "worth"),
        [
            ("usual", 1e6),
            ("additions", -1e6),
            *(
                slow_case(*row, reason="two others in every run")
                for row in (
                    ("usual", -1e6),
                    ("two-layers", 1e6),
                    ("two-layers", -1e6),
                    ("additions", 1e6),
                )
            ),
        ],
    )
    def test_what_a_barred_action_seems_worth_changes_nothing(self, kind, worth):
        """Neither what is done nor what values of actions before it are drawn to."""
        facts = Facts(("a", "b", "done", "never"))
        skills = [
            make_skill(facts, "to_a", forbids=("a", "b", "done"), add=("a",), cost=1.0),
            make_skill(facts, "a_to_b", requires=("a",), add=("b",), delete=("a",), cost=1.0),
            make_skill(facts, "barred", requires=("never",), add=("done",), cost=0.1),
            make_skill(facts, "to_b", forbids=("a", "b", "done"), add=("b",), cost=3.0),
            make_skill(facts, "finish", requires=("b",), add=("done",), delete=("b",), cost=1.0),
        ]
        task = make_task(facts, skills, goal=("done",))
        learner = solver(**KINDS[kind])
        training = begun(learner, [0, 1], task)
        training.advance(100)
        snapshot = training.snapshot()
        changed = {name: array.copy() for name, array in snapshot.arrays.items()}
        last = max(int(n.split(".")[1]) for n in changed if n.startswith("network."))
        for name in (f"network.{last}", f"target.{last}"):
            changed[name][..., 2] = worth
        changed = Snapshot(changed, snapshot.notes)
        other, same = (resumed(learner, [0, 1], task, item) for item in (changed, snapshot))
        assert other.advance(STEPS - 100) == same.advance(STEPS - 100)
        assert other.figures() == same.figures()
        ours, theirs = other.snapshot().arrays, same.snapshot().arrays
        for name, array in ours.items():
            same_there = array == theirs[name]
            if name in (f"network.{last}", f"target.{last}"):
                assert not same_there[..., 2].any()
                same_there[..., 2] = True
            assert (same_there | (np.isnan(array) & np.isnan(theirs[name]))).all(), name

    def test_masks_that_the_observation_does_not_tell_hold_where_a_policy_is_kept(self):
        """What is observed is always the same; what is allowed is not."""
        facts = Facts(("one", "two", "three", "done"))
        names = ("one", "two", "three")
        turn = [
            make_skill(
                facts, f"turn_{i}", requires=names[:i], forbids=names[i:], add=names[i : i + 1]
            )
            for i in range(3)
        ]
        finish = make_skill(facts, "finish", requires=names, add=("done",))
        task = make_task(
            facts, [*turn, finish], goal=("done",), observation=(Literal("done"),), step_limit=8
        )
        learner = solver(observation="paper")
        training = begun(learner, [0], task)
        assert all(episode.success for episode in training.advance(STEPS))
        learned = training.learned(0)
        assert followed(learner, task, learned.last) == (4.0, 1)
        assert learned.best_cost == 4.0


class TestRewards:
    @pytest.mark.parametrize(
        "transformed",
        [
            slow_case({}, reason="other rewards in every run"),
            slow_case(
                {"complete": 100.0, "failure": 0.1, "step_floor": 1.0},
                reason="a training; of costs in every run",
            ),
        ],
    )
    def test_an_episode_s_reward_is_the_environment_s(self, board, transformed):
        """Table II to the letter, whatever the agent makes of it."""
        board = nearly_done(board, [0, 1, 2, 3, 4, 5, 8, 9, 10, 11, 6, 7])
        model = make_model(board)
        seldom = {"updates": 0.05, **transformed}
        episodes = begun(solver(mask="none", **seldom), [0, 1], board).advance(STEPS)
        episodes += begun(solver(**seldom), [0, 1], board).advance(2 * STEPS)
        assert {episode.end for episode in episodes} == {"complete", "infeasible", "out-of-time"}
        for episode in episodes:
            state, reward, cost = model.initial, 0.0, 0.0
            for number, action in enumerate(episode.actions, 1):
                skill = board.skills[action]
                if not model.verdict(state, skill).is_feasible:
                    assert number == len(episode.actions)
                    assert episode.end == "infeasible"
                    reward += board.reward.infeasible
                    continue
                following, paid = skill.prediction.apply(state), skill.cost.at(state)
                goal, late = model.is_goal(following), number == board.step_limit
                assert goal == (episode.success and number == len(episode.actions))
                reward += board.reward.of_step(
                    state, skill.name, paid, goal=goal, out_of_time=late and not goal
                )
                cost, state = cost + paid, following
            assert (episode.reward, episode.cost) == (reward, cost)

    def test_by_cost_it_is_minus_the_costs_and_what_ends_pay(self):
        episodes = begun(solver(objective="cost"), [0], two_roads_task()).advance(STEPS)
        assert episodes
        assert all(episode.reward == pytest.approx(10.0 - episode.cost) for episode in episodes)


@pytest.mark.slow(reason="trainings; those of its suite in every run")
class TestPoliciesFollowed:
    @pytest.mark.parametrize("planning", [False, True])
    def test_only_episodes_that_follow_the_policy_throughout_are_greedy(self, planning):
        """Of a network that is not changed meanwhile."""
        task, result = two_roads_task(), set()
        learner = solver(planning=planning, warm_up=1_000, branching=0.3)
        training = begun(learner, [0, 1], task)
        episodes = training.advance(STEPS)
        observation = Observation.of(task, "markov")
        for episode in episodes:
            policy, state, same = training.learned(episode.run).last, task.initial, True
            for action in episode.actions:
                mask = np.array([[skill.applicable(state) for skill in task.skills]])
                same &= int(policy.greedy(observation.encode(state)[None], mask)[0]) == action
                state = task.skills[action].prediction.apply(state)
            assert episode.greedy == same
            result.add(same)
        assert result == {True, False}

    def test_without_exploration_every_episode_is(self):
        learner = solver(epsilon=0.0, epsilon_end=0.0, branching=0.0)
        episodes = begun(learner, [0], lid_task()).advance(STEPS)
        assert all(episode.greedy for episode in episodes)

    @pytest.mark.parametrize("kind", kinds("usual"))
    @pytest.mark.parametrize(
        "which", [slow_case("two roads", reason="the board in every run"), "board"]
    )
    def test_the_best_policy_costs_what_it_was_kept_for(self, board, kind, which):
        late = nearly_done(board, [0, 1, 2, 3, 4, 5, 8, 9, 10, 11])
        task = {"two roads": two_roads_task(), "board": late}[which]
        learner, seeds, steps = solver(**{**KINDS[kind], "mask": "applicable"}), range(3), 300
        training = begun(learner, seeds, task, steps)
        episodes, count = training.advance(steps), 0
        for run in seeds:
            learned = training.learned(run)
            if learned.best is None:
                continue
            count += 1
            assert followed(learner, task, learned.best) == (learned.best_cost, 1)
            assert learned.best_cost in {e.cost for e in episodes if e.run == run and e.success}
            assert any(e.step == learned.best_step and e.run == run for e in episodes)
        assert count


@pytest.mark.slow(reason="trainings; one that goes on bit for bit in every run")
class TestRunsSideBySide:
    SEEDS = (5, 3, 8, 0, 21)

    def held_alone(self, learner, task, seeds, chosen, steps=STEPS):
        together = begun(learner, seeds, task, steps)
        episodes, figures = together.advance(steps), together.figures()
        for run in chosen:
            alone = begun(learner, [seeds[run]], task, steps)
            mine = [replace(episode, run=0) for episode in episodes if episode.run == run]
            assert alone.advance(steps) == mine
            assert alone.figures() == [figures[run]]
            assert_same_policy(alone.learned(0).last, together.learned(run).last)
            assert alone.learned(0).best_cost == together.learned(run).best_cost

    @pytest.mark.parametrize("kind", kinds("small-memory"))
    def test_a_run_is_the_same_alone_and_among_five(self, kind):
        self.held_alone(solver(**KINDS[kind]), lid_task(), self.SEEDS, [1, 4], 150)

    @pytest.mark.parametrize(
        "kind", ["usual", slow_case("two-layers", reason="another kind in every run")]
    )
    def test_with_few_actions_and_under_chance_too(self, kind):
        for task in (two_roads_task(), retry_task(0.5)):
            self.held_alone(solver(**KINDS[kind]), task, self.SEEDS, [2], 100)

    def test_on_the_board_too_with_networks_as_large_as_usual(self, board):
        learner = solver(width=256, batch=64, updates=0.5)
        self.held_alone(learner, board, self.SEEDS, [0, 3], 60)

    @pytest.mark.parametrize(
        "kind", ["additions", slow_case("usual", reason="another kind in every run")]
    )
    def test_of_more_actions_than_a_block_too(self, motor_drive, kind):
        assert len(motor_drive.skills) > 32
        self.held_alone(solver(**KINDS[kind]), motor_drive, self.SEEDS, [3], 100)


class TestFailures:
    @pytest.mark.parametrize(
        ("kind", "name", "wrong"),
        [
            ("usual", "network.0", np.nan),
            *(
                slow_case(kind, *wrong, reason="another break in every run")
                for kind in ("usual", "counts", "additions")
                for wrong in (("network.0", np.nan), ("target.1", np.inf), ("adam.0.mean", -np.inf))
                if (kind, wrong[0]) != ("usual", "network.0")
            ),
        ],
    )
    def test_a_run_that_breaks_is_named_and_the_others_go_on(self, kind, name, wrong):
        learner, task = solver(**KINDS[kind]), lid_task()
        training = begun(learner, [0, 1, 2], task)
        training.advance(100)
        training.figures()
        snapshot = training.snapshot()
        snapshot.arrays[name][1] = wrong
        broken = resumed(learner, [0, 1, 2], task, snapshot)
        episodes, whole = broken.advance(STEPS - 100), training.advance(STEPS - 100)
        assert list(broken.failed) == [1]
        assert "no longer finite" in broken.failed[1]
        assert "learning_rate" in broken.failed[1]
        for run in (0, 2):
            assert [e for e in episodes if e.run == run] == [e for e in whole if e.run == run]
            assert_same_policy(broken.learned(run).last, training.learned(run).last)
        assert len([e for e in episodes if e.run == 1]) < len([e for e in whole if e.run == 1])
        ours, theirs = broken.figures(), training.figures()
        assert (ours[0], ours[2]) == (theirs[0], theirs[2])
        assert "loss" not in ours[1]

    def test_values_that_overflow_break_a_run_without_a_warning(self):
        learner, task = solver(), lid_task()
        training = begun(learner, [0, 1], task)
        training.advance(100)
        snapshot = training.snapshot()
        snapshot.arrays["network.0"][1] = 1e38
        broken = resumed(learner, [0, 1], task, snapshot)
        broken.advance(STEPS - 100)
        assert list(broken.failed) == [1]

    def test_a_run_stays_failed_where_it_is_gone_on_with(self):
        learner, task = solver(), lid_task()
        training = begun(learner, [0, 1], task)
        training.advance(100)
        snapshot = training.snapshot()
        snapshot.arrays["network.1"][0] = np.nan
        broken = resumed(learner, [0, 1], task, snapshot)
        broken.advance(50)
        again = resumed(learner, [0, 1], task, broken.snapshot())
        assert again.failed == broken.failed
        assert {episode.run for episode in again.advance(50)} == {1}

    def test_the_solver_says_why_it_has_no_policy(self):
        class Breaking(DqnSolver):
            def begin(self, env, seeds, steps):
                training = super().begin(env, seeds, steps)
                snapshot = training.snapshot()
                snapshot.arrays["network.1"][:] = np.nan
                training.restore(snapshot)
                return training

        result = solve(two_roads_task(), Breaking(DqnSolver.Options(**SMALL, steps=150)))
        assert result.status is Status.UNSOLVED
        assert "no longer finite" in result.reason


class TestGoingOn:
    @settings(max_examples=examples(8, fewest=2))
    @given(
        st.lists(st.integers(0, STEPS), max_size=3),
        st.sampled_from(sorted(KINDS)),
        st.sampled_from([lid_task(), two_roads_task(), retry_task(0.5)]),
    )
    def test_a_training_that_was_interrupted_goes_on_bit_for_bit(self, cuts, kind, task):
        """Wherever, in the middle of episodes, too."""
        assume(kind != "plans" or task.deterministic)
        learner = solver(**KINDS[kind])
        whole, other = (begun(learner, [0, 1], task) for _ in range(2))
        for cut in [*sorted(cuts), STEPS]:
            episodes = whole.advance(cut - whole.steps)
            assert other.advance(cut - other.steps) == episodes
            assert other.figures() == whole.figures()
            other = resumed(learner, [0, 1], task, other.snapshot())
        assert_same(other, whole)

    @pytest.mark.parametrize(
        "cut", [1, *(slow_case(cut, reason="another cut in every run") for cut in (77, 150))]
    )
    def test_on_the_board_too(self, board, cut):
        learner = solver(mask="none", observation="paper", width=256, batch=64)
        steps = 120 if cut < 120 else STEPS
        whole, other = (begun(learner, [0, 1], board) for _ in range(2))
        episodes = whole.advance(steps)
        theirs = other.advance(cut)
        other = resumed(learner, [0, 1], board, other.snapshot())
        assert theirs + other.advance(steps - cut) == episodes
        assert_same(other, whole)

    def test_figures_since_the_last_time_are_gone_on_with(self):
        learner, task = solver(), lid_task()
        training = begun(learner, [0, 1], task)
        training.advance(100)
        other = resumed(learner, [0, 1], task, training.snapshot())
        for item in (training, other):
            item.advance(50)
        assert other.figures() == training.figures()

    def test_a_snapshot_of_another_solver_is_refused(self):
        other = PpoSolver(PpoSolver.Options(rollout=96, batch=32, width=32))
        training = begun(other, [0], lid_task())
        training.advance(100)
        with pytest.raises(ValueError, match="snapshot"):
            resumed(solver(), [0], lid_task(), training.snapshot())


class TestOptions:
    @pytest.mark.parametrize(
        ("name", "values"), [("exploration", ("epsilon", "count")), ("planning", (False, True))]
    )
    def test_a_study_takes_all_values_of_an_option_that_may_be_null(self, name, values):
        assert read_space("dqn", [(name, "*")]).dimensions == (Choice(name, values),)

    @pytest.mark.parametrize(
        ("option", "wrong"),
        [
            ("exploration", "curiosity"),
            ("epsilon", 1.01),
            ("epsilon_end", -0.01),
            ("explore_until", 0.0),
            ("branching", 1.5),
            ("capacity", 0),
            ("width", 33),
            ("width", 0),
            ("layers", -1),
            ("layers", 9),
            ("batch", 16),
            ("batch", 100),
            ("updates", 0.0),
            ("warm_up", 0),
            ("learning_rate", 0.0),
            ("learning_rate", 1.5),
            ("learning_rate_end", 0.0),
            ("decay_from", 1.0),
            ("target_rate", 0.0),
            ("gamma", 1.01),
            ("complete", -1.0),
            ("failure", -1.0),
            ("steps_worth", -1.0),
            ("step_floor", 0.5),
            ("steps", 0),
            ("observation", "all"),
            ("mask", "some"),
            ("objective", "profit"),
            ("learning_rate", float("nan")),
            ("complete", float("inf")),
        ],
    )
    def test_what_is_out_of_range_is_refused(self, option, wrong):
        with pytest.raises(ValidationError) as refused:
            DqnSolver.Options(**{option: wrong})
        assert [error["loc"] for error in refused.value.errors()] == [(option,)]

    @pytest.mark.parametrize(
        ("config", "options", "expected"),
        [
            ("inverter_board", {}, (5_000, 0.5)),
            ("inverter_board", {"mask": "none"}, (5_000, 0.5)),
            ("inverter_board", {"observation": "layout"}, (5_000, 0.5)),
            ("inverter_grasps", {}, (41_000, 1.0)),
        ],
    )
    def test_what_is_null_is_chosen_by_the_task(self, config, options, expected):
        learner = DqnSolver(DqnSolver.Options(**options))
        derived = learner.derived([load_problem(CONFIGS / f"{config}.yaml").task])
        assert dict(zip(("steps", "updates"), expected, strict=True)) == derived

    @pytest.mark.parametrize(
        ("config", "observation"), [("inverter_grasps", "markov"), ("inverter_board", "layout")]
    )
    @pytest.mark.parametrize("learner", [DqnSolver, PpoSolver])
    def test_plans_that_cannot_be_are_refused(self, learner, config, observation):
        options = learner.Options(planning=True, observation=observation)
        with pytest.raises(OptionError, match="planning=true: plans need one task without chance"):
            learner(options).derived([load_problem(CONFIGS / f"{config}.yaml").task])

    @pytest.mark.parametrize("learner", [DqnSolver, PpoSolver])
    def test_imitation_under_chance_is_refused(self, learner):
        """Its cheapest episode was lucky, and is not imitated; the manifest would say otherwise."""
        task = load_problem(CONFIGS / "inverter_grasps.yaml").task
        with pytest.raises(OptionError, match=r"imitation=1: .* Leave imitation out"):
            learner(learner.Options(imitation=1.0)).derived([task])

    @pytest.mark.parametrize(
        ("learner", "rule"), [(DqnSolver, ("epsilon-greedy", 0.01)), (PpoSolver, ("softmax", 1.0))]
    )
    def test_a_policy_acts_as_at_the_end_of_its_training(self, learner, rule):
        assert rule == (learner().own_rule.kind, learner().own_rule.value)

    @pytest.mark.parametrize(
        ("learner", "legacy"),
        [
            (DqnSolver, {"replay": "distinct", "clip_values": True}),
            (PpoSolver, {"scale_by_success": True}),
        ],
    )
    def test_a_training_of_version_0_2_keeps_what_it_did(self, learner, legacy):
        """Its manifest lists all options but those that say so."""
        stored = learner.Options().model_dump() | {"planning": True}
        stored = {name: value for name, value in stored.items() if name not in legacy}
        assert stored | legacy == learner.Options(**stored).model_dump()
        assert stored | legacy == learner.Options.upgrade(stored)
        given = {"planning": True}
        assert given == learner.Options.upgrade(given)

    def test_a_training_before_the_release_of_0_3_0_keeps_what_it_did(self):
        options = DqnSolver.Options().model_dump()
        added = {"loss", "limit_is_failure"}
        for lacking in (added, added | {"replay", "clip_values"}):
            stored = {name: value for name, value in options.items() if name not in lacking}
            upgraded = DqnSolver.Options.upgrade(stored)
            assert (upgraded["loss"], upgraded["limit_is_failure"]) == ("huber", False)
            assert upgraded["clip_values"] == ("clip_values" in lacking)

    @pytest.mark.parametrize("fails", [False, True])
    def test_the_step_limit_is_a_failure_only_if_the_option_says_so(self, board, fails):
        options = {"limit_is_failure": fails, "count_last_cost": False, "warm_up": 10_000}
        training = begun(solver(epsilon=1.0, **options), [0], replace(board, step_limit=2))
        late = [e for e in training.advance(STEPS) if e.end == "out-of-time"]
        assert late
        arrays = training.snapshot().arrays
        stored = arrays["memory.end"][0, [episode.step - 1 for episode in late]]
        assert set(stored) == {OUT_OF_TIME if fails else GOES_ON}
        rewards = arrays["memory.reward"][0, [episode.step - 1 for episode in late]]
        assert (rewards == 0.0).all() == fails

    def test_what_is_given_is_kept(self):
        given = {"steps": 100, "planning": True, "exploration": "count", "updates": 2.0}
        assert DqnSolver(DqnSolver.Options(**given)).derived([lid_task()]) == {}

    def test_every_default_is_in_its_range(self):
        options = DqnSolver.Options()
        assert DqnSolver.Options(**options.model_dump()) == options


def test_a_policy_has_as_many_scores_as_there_are_actions(motor_drive):
    training = begun(solver(), [0], motor_drive, 40)
    training.advance(40)
    policy = training.learned(0).last
    assert isinstance(policy, NetworkPolicy)
    assert policy.actions == len(motor_drive.skills)
    assert policy.inputs == Observation.of(motor_drive, "markov").width


# What is remembered, held against a memory in plain Python that is slow and obvious.


TRANSITIONS = st.tuples(
    st.integers(0, 2),  # observation
    st.integers(0, 1),  # action
    st.integers(0, 2),  # next_observation
    st.sampled_from([0, 0, 1]),  # end
    st.sampled_from([-1.0, -0.5, -0.25]),  # reward
)
HAPPENINGS = st.lists(st.tuples(st.integers(0, 1), TRANSITIONS), max_size=60)


class Uniforms:
    """A generator that gives what it was told."""

    def __init__(self, values):
        self._values = np.array(values)

    def random(self, count):
        assert count == len(self._values)
        return self._values


class PlainMemory:
    """One run's transitions in a list, the oldest first."""

    def __init__(self, capacity):
        self.capacity, self.kept = capacity, []

    def add(self, observation, action, following, end, reward):
        key = (observation, action, following, end)
        same = [entry for entry in self.kept if entry["key"] == key]
        if same:
            (item,) = same
        else:
            if len(self.kept) == self.capacity:
                self.kept.pop(0)
            item = {"key": key, "seen": 0, "reward": 0.0}
            self.kept.append(item)
        item["seen"] += 1
        # On average.
        item["reward"] = ((item["seen"] - 1) * item["reward"] + reward) / item["seen"]

    def tried(self, first):
        return sum(other["seen"] for other in self.kept if other["key"][:2] == first["key"][:2])


def remembered(memory, run):
    """Return all that a run remembers, in no order."""
    names = ("observation", "action", "next_observation", "end", "reward", "seen")
    return sorted(
        tuple(float(getattr(memory, name)[run, slot]) for name in names)
        for slot in range(memory.size(run))
    )


def expected(plain):
    """Return the same of a plain memory."""
    kept = sorted(
        (*map(float, item["key"]), item["reward"], float(item["seen"])) for item in plain.kept
    )
    return [(*key, pytest.approx(reward), seen) for *key, reward, seen in kept]


def rebuilt(memory, runs, capacity):
    other = ReplayMemory(runs, capacity, distinct=True)
    other.read("m", memory.arrays("m"))
    return other


class TestWhatIsRemembered:
    @settings(max_examples=examples(150))
    @given(HAPPENINGS, st.integers(1, 12), st.integers(0, 60))
    def test_it_is_what_a_list_would_hold(self, happenings, capacity, cut):
        memory = ReplayMemory(2, capacity, distinct=True)
        plain = [PlainMemory(capacity) for _ in range(2)]
        for i, (run, (observation, action, following, end, reward)) in enumerate(happenings):
            if i == cut:
                memory = rebuilt(memory, 2, capacity)
            memory.add(run, observation, action, reward, end, following)
            plain[run].add(observation, action, following, end, reward)
            for which in (0, 1):
                assert memory.size(which) == len(plain[which].kept)
                assert remembered(memory, which) == expected(plain[which])
                assert sorted(memory.tried[which, : memory.size(which)].tolist()) == sorted(
                    plain[which].tried(kept) for kept in plain[which].kept
                )

    def test_there_is_room_for_more_than_at_first(self):
        memory = ReplayMemory(2, 100_000, distinct=True)
        for i in range(5_000):
            memory.add(0, i, i % 7, -float(i), 0, i + 1)
        memory.add(1, 4, 2, -1.0, 1, 0)
        again = rebuilt(memory, 2, 100_000)
        for item in (memory, again):
            assert (item.size(0), item.size(1)) == (5_000, 1)
            assert (item.observation[0, :5_000] == np.arange(5_000)).all()
            assert (item.reward[0, :5_000] == -np.arange(5_000.0)).all()
            item.add(0, 17, 3, -1.0, 0, 18)
            assert (item.size(0), item.seen[0, 17]) == (5_000, 2)


class TestWhatIsDrawn:
    def test_every_transition_is_as_likely_however_often_it_was_seen(self):
        memory = ReplayMemory(2, 10, distinct=True)
        for i in (0, 1, 1, 1, 2, 3):
            memory.add(0, i, 0, 0.0, 0, 0)
        memory.add(1, 0, 0, 0.0, 0, 0)
        uniforms = Uniforms([0.0, 0.24, 0.26, 0.5, 0.74, 0.76, 1 - 2**-53])
        slots, weights = memory.draw([uniforms, uniforms], 7)
        assert slots.tolist() == [[0, 0, 1, 2, 2, 3, 3], [0] * 7]
        assert (weights == 1.0).all()

    def test_outcomes_of_a_choice_count_as_often_as_they_were_seen(self):
        memory = ReplayMemory(1, 10, distinct=True)
        for following in (5, 5, 6, 5):
            memory.add(0, 1, 2, 0.0, 0, following)
        memory.add(0, 1, 3, 0.0, 0, 5)
        slots, weights = memory.draw([Uniforms([0.1, 0.5, 0.9])], 3)
        assert slots.tolist() == [[0, 1, 2]]
        assert weights.tolist() == [[0.75, 0.25, 1.0]]

    def test_what_was_forgotten_no_longer_counts(self):
        memory = ReplayMemory(1, 2, distinct=True)
        for following in (5, 6, 7):
            memory.add(0, 1, 2, 0.0, 0, following)
        slots, weights = memory.draw([Uniforms([0.1, 0.9])], 2)
        assert memory.next_observation[0, slots[0]].tolist() == [7, 6]
        assert weights.tolist() == [[0.5, 0.5]]


class TestReplayGoingOn:
    def test_what_was_read_draws_and_forgets_alike(self):
        memory, generator = ReplayMemory(2, 30, distinct=True), np.random.default_rng(0)

        def happens(first, seed):
            chance = np.random.default_rng(seed)
            for _ in range(25):
                run, observation, action, following = chance.integers([2, 6, 2, 6]).tolist()
                first.add(run, observation, action, -float(chance.random()), 0, following)
            first.add(0, 0, 0, 0.0, 0, 0)
            first.add(1, 0, 0, 0.0, 0, 0)
            slots, weights = first.draw([np.random.default_rng([seed, run]) for run in (0, 1)], 16)
            return slots.tobytes() + weights.tobytes()

        happens(memory, generator.integers(99))
        for seed in range(8):
            other = rebuilt(memory, 2, 30)
            assert happens(memory, seed) == happens(other, seed)
            mine, theirs = memory.arrays("m"), other.arrays("m")
            assert all(mine[name].tobytes() == theirs[name].tobytes() for name in mine)

    def test_arrays_of_others_are_refused(self):
        memory = ReplayMemory(2, 30)
        with pytest.raises(ValueError, match="missing or of another shape"):
            ReplayMemory(3, 30).read("m", memory.arrays("m"))


class TestFirstInFirstOut:
    def test_every_transition_is_stored_and_the_oldest_are_overwritten(self):
        memory = ReplayMemory(1, 4)
        for reward in (-1.0, -2.0, -3.0, -4.0, -5.0):
            memory.add(0, 1, 2, reward, 0, 3)
        assert memory.size(0) == 4
        assert sorted(memory.reward[0, :4].tolist()) == [-5.0, -4.0, -3.0, -2.0]
        slots, weights = memory.draw([Uniforms([0.0, 0.3, 0.6, 0.9])], 4)
        assert slots.tolist() == [[0, 1, 2, 3]]
        assert weights.tolist() == [[1.0] * 4]

    def test_it_resumes_from_its_arrays(self):
        memory, other = ReplayMemory(2, 4), ReplayMemory(2, 4)
        for step in range(6):
            memory.add(step % 2, step, 0, -float(step), 0, step + 1)
        other.read("m", memory.arrays("m"))
        for one in (memory, other):
            one.add(0, 9, 1, -9.0, 1, 9)
        mine, theirs = memory.arrays("m"), other.arrays("m")
        assert all(mine[name].tobytes() == theirs[name].tobytes() for name in mine)
