"""Policies as ONNX: ONNX Runtime chooses what the policy chooses, also under a mask."""

from __future__ import annotations

import json
from contextlib import closing
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from run_folders import OPTIMAL, SWITCHED, write_runs
from skillplan.env import Observation, SkillEnv, SkillVectorEnv
from skillplan.errors import OptionError
from skillplan.exporters import Handover, TrainedPolicy
from skillplan.pipeline import (
    Setup,
    describe_policy,
    export_files,
    list_notes,
    load_problem,
    make_exporter,
    make_handover,
    make_model,
)
from skillplan.records import RunFolder
from skillplan.solvers import NetworkPolicy
from skillplan.task import Task
from skillplan.testing import ExporterSuite
from skillplan_torch import DqnSolver, PpoSolver

onnxruntime = pytest.importorskip("onnxruntime")

BOARD = Path(__file__).parents[3] / "configs" / "inverter_board.yaml"
BEST = 1.8670860141568904
BY_CHART = Setup(collision=("precedence",))


def random_policy(
    task: Task, learner: type[DqnSolver | PpoSolver] = DqnSolver, cost: float | None = None
) -> TrainedPolicy:
    """Return a policy of two hidden layers, as a learner begins with it."""
    solver = learner(learner.Options(width=32, layers=2))
    env = SkillVectorEnv(make_model(task, BY_CHART), 1)
    network = solver.begin(env, [3], 1_000).learned(0).last
    features = Observation.of(task, "markov").features
    return TrainedPolicy(
        weights=network.weights,
        biases=network.biases,
        features=tuple(features),
        actions=tuple(skill.name for skill in task.skills),
        observation="markov",
        mask="applicable",
        solver=solver.name,
        task=task.name,
        step=0,
        cost=cost,
        own_rule=solver.own_rule.words,
    )


def handed_over(task: Task, policies: dict[int, TrainedPolicy]) -> Handover:
    model = make_model(task, BY_CHART)
    with closing(model.feasibility):
        return make_handover(model, BY_CHART, None, policies)


def session_of(handover: Handover, **options: int) -> onnxruntime.InferenceSession:
    (content,) = export_files(make_exporter("onnx", options), handover).values()
    return onnxruntime.InferenceSession(content)


class TestOnnx(ExporterSuite):
    exporter = "onnx"

    def handover(self, task: Task) -> Handover:
        return handed_over(task, {0: random_policy(task)})


@cache
def board() -> Task:
    return load_problem(BOARD).task


@pytest.mark.parametrize("learner", [DqnSolver, PpoSolver])
def test_scores_and_actions_are_those_of_the_policy(learner):
    """Of random observations and masks; a mask that allows nothing allows all."""
    policy = random_policy(board(), learner)
    session = session_of(handed_over(board(), {0: policy}))
    generator = np.random.Generator(np.random.PCG64(1))
    network = NetworkPolicy(policy.weights, policy.biases)
    observations = generator.integers(2, size=(500, network.inputs)).astype(np.float32)
    masks = generator.random((500, network.actions)) < 0.3
    masks[0] = False
    scores, actions = session.run(None, {"observation": observations, "mask": masks})
    assert np.abs(scores - network.scores(observations)).max() < 1e-5
    assert (actions == network.greedy(observations, masks)).all()


def test_inputs_and_metadata_say_what_they_are():
    session = session_of(handed_over(board(), {0: random_policy(board())}))
    assert [(entry.name, entry.shape) for entry in session.get_inputs()] == [
        ("observation", ["batch", 34]),
        ("mask", ["batch", 16]),
    ]
    about = session.get_modelmeta().custom_metadata_map
    assert [skill.name for skill in board().skills] == json.loads(about["actions"])
    assert len(json.loads(about["features"])) == 34
    assert about["observation"] == "markov"


def test_a_policy_acts_in_the_environment_and_reaches_the_optimum(tmp_path):
    """The cheapest run is taken unless another one is named."""
    folder = RunFolder(write_runs(tmp_path / "runs", str(BOARD), [SWITCHED, OPTIMAL]))
    policies = {run.run: describe_policy(run.policy) for run in folder.runs()}
    session = session_of(handed_over(board(), policies), run=1)
    env = SkillEnv(make_model(board()))
    observation, info = env.reset()
    cost, ended = 0.0, False
    while not ended:
        inputs = {"observation": observation[None], "mask": info["action_mask"][None] > 0}
        action = session.run(["action"], inputs)[0][0]
        observation, _, ended, _, info = env.step(action)
        cost += info["cost"]
    assert cost == pytest.approx(BEST, abs=1e-12)


def test_the_cheapest_run_is_exported_and_named():
    costs = {0: None, 1: 2.5, 2: 1.9}
    policies = {run: random_policy(board(), cost=cost) for run, cost in costs.items()}
    handover = handed_over(board(), policies)
    assert "policy of run 2 of dqn" in list_notes(make_exporter("onnx", {}), handover)[0]
    with pytest.raises(OptionError, match=r"onnx.run=7: runs with a policy are 0, 1, 2"):
        export_files(make_exporter("onnx", {"run": 7}), handover)
