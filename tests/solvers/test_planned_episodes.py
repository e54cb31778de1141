"""Episodes planned with what a run has learned of its task."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from skillplan.domains.assembly import BoardGenerator
from skillplan.env import COMPLETE, GOES_ON, INFEASIBLE, SkillVectorEnv
from skillplan.pipeline import load_problem, make_model, make_solver, solve
from skillplan.solvers import ObservationCounts, PlannedEpisodes, allowing

CONFIGS = Path(__file__).parents[2] / "configs"
WIDTH = 32


class Run:
    """Planned episodes in an environment, without any network."""

    def __init__(
        self, path: Path, *, observation: str = "markov", mask: str = "applicable"
    ) -> None:
        self.task = make_model(load_problem(str(path)).task)
        self.env = SkillVectorEnv(self.task, 1, observation=observation, mask=mask)
        seen, infos = self.env.reset(seed=0)
        features, actions = seen.shape[1], len(self.task.task.skills)
        self.counts = ObservationCounts(1, features, actions)
        self.planned = self.plans()
        self.best, self.steps, self.tried = np.inf, 0, list[int]()
        self.last, self.length, self.cost = -1, 0, 0.0
        self.at = self.index(seen, infos["action_mask"])
        self.planned.begin_episode(0)

    def plans(self) -> PlannedEpisodes:
        """Return plans of a run that knows nothing yet."""
        limit = self.task.task.step_limit
        return PlannedEpisodes([np.random.default_rng(0)], self.counts, limit, WIDTH)

    def index(self, seen: np.ndarray, mask: np.ndarray) -> int:
        """Return the index of what is observed."""
        return int(self.counts.indices(seen, allowing(mask))[0])

    def go(self, most: int) -> None:
        """Take steps until nothing better is in sight, or so many were taken."""
        while self.steps < most and not self.planned.is_settled(0):
            action = self.planned.action(0, self.at, self.last, self.length)
            if action is None:
                action = int(np.flatnonzero(self.counts.masks[0, self.at])[0])
            self.tried.append(action)
            seen, _, _, _, infos = self.env.step(np.array([action]))
            end, cost = int(infos["end"][0]), float(infos["cost"][0])
            before, self.last = self.last, action
            after = self.index(infos["final_obs"], infos["final_mask"])
            self.planned.learn_step(
                0,
                self.at,
                before,
                action,
                None if end == INFEASIBLE else after,
                cost=cost,
                complete=end == COMPLETE,
            )
            self.steps, self.length, self.cost = self.steps + 1, self.length + 1, self.cost + cost
            if end == COMPLETE:
                self.best = min(self.best, self.cost)
            if end != GOES_ON:
                self.last, self.length, self.cost = -1, 0, 0.0
                self.planned.begin_episode(0)
            self.at = self.index(seen, infos["action_mask"])


@pytest.mark.parametrize(
    ("config", "optimum"), [("inverter_board", 1.86709), ("relay_rail", 4.66386)]
)
def test_they_find_the_optimum_and_then_see_nothing_better(config, optimum):
    run = Run(CONFIGS / f"{config}.yaml")
    run.go(5_000)
    assert run.planned.is_settled(0)
    assert run.best == pytest.approx(optimum, abs=5e-6)


def test_they_find_it_without_a_mask_from_what_the_paper_observes():
    run = Run(CONFIGS / "inverter_board.yaml", observation="paper", mask="none")
    run.go(1_000)
    assert run.best == pytest.approx(1.86709, abs=5e-6)


def test_what_no_conjunction_describes_is_tried_all_the_same():
    """The drawer goes in before the lid, or before the panel."""
    run = Run(CONFIGS / "drawer_module.yaml")
    run.go(5_000)
    assert run.best == pytest.approx(5.12203, abs=5e-6)


def test_a_board_with_dead_ends_is_completed(tmp_path):
    """Of 3,000 episodes at random none completes such a board."""
    path = tmp_path / "board.yaml"
    path.write_text(BoardGenerator(16, 0.4, 3, 5).text(), encoding="utf-8")
    run = Run(path)
    while run.best > 1.02 * 14.59182:
        assert run.steps < 2_500
        run.go(run.steps + 100)


def test_a_learned_model_predicts_what_happens():
    """After the board was explored, every step of a completed episode is as predicted."""
    run = Run(CONFIGS / "inverter_board.yaml")
    run.go(5_000)
    model, seen = run.planned._planners[0].model, []
    observed, _ = run.env.reset(seed=0)
    for action in (0, 1, 2, 3, 4, 5, 8, 9, 10, 11, 6, 7, 13, 14):
        before = model.bits(observed[0])
        observed = run.env.step(np.array([action]))[4]["final_obs"]
        seen.append(model.bits(observed[0]).tolist() == model.predict(before, action).tolist())
    assert all(seen)


def test_they_go_on_from_what_was_kept_as_if_nothing_had_happened():
    whole, halves = (Run(CONFIGS / "mini_pc.yaml") for _ in range(2))
    whole.go(300)
    halves.go(150)
    arrays = halves.planned.arrays("planned")
    notes = json.loads(json.dumps(halves.planned.notes()))
    halves.planned = halves.plans()
    halves.planned.read("planned", arrays, notes)
    halves.go(300)
    assert halves.tried == whole.tried


@pytest.mark.slow(
    reason="trains on a board of eight parts; boards are completed without networks in every run"
)
@pytest.mark.parametrize("solver", ["dqn", "ppo"])
def test_a_learner_follows_what_its_plans_have_found(solver, tmp_path):
    path = tmp_path / "board.yaml"
    path.write_text(BoardGenerator(8, 0.3, 3, 5).text(), encoding="utf-8")
    options = {"steps": 2_500, "planning": True, "imitation": 1.0}
    solution = solve(load_problem(str(path)).task, make_solver(solver, options))
    assert solution.cost == pytest.approx(7.95595, rel=0.02)
