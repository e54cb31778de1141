"""From a task file to an environment, by the name that Gymnasium knows it by."""

import subprocess
import sys

import gymnasium
import numpy as np
import pytest

from situations import CONFIGS
from skillplan.env import SkillEnv, SkillVectorEnv
from skillplan.errors import OptionError, PluginError, TaskError
from thinned import slow_case

BOARD = CONFIGS / "inverter_board.yaml"
NAME = "skillplan/Task-v0"


class TestRegistration:
    @pytest.mark.parametrize(
        ("imports", "name"),
        [
            ("gymnasium", f"skillplan.env:{NAME}"),
            *(
                slow_case(imports, NAME, reason="an interpreter each; one in every run")
                for imports in (
                    "gymnasium, skillplan",
                    "gymnasium, skillplan.env",
                    "skillplan.env, gymnasium",
                )
            ),
        ],
    )
    def test_a_fresh_interpreter_finds_it(self, imports, name):
        """By the module that registers it, or once Gymnasium and skillplan are there."""
        code = f"import {imports}; print(gymnasium.make({name!r}, task={str(BOARD)!r}).unwrapped)"
        done = subprocess.run(
            [sys.executable, "-W", "error", "-c", code], capture_output=True, text=True, check=False
        )
        assert ("", f"<SkillEnv<{NAME}>>\n") == (done.stderr, done.stdout)

    def test_skillplan_alone_does_not_load_gymnasium(self):
        code = "import skillplan, sys; print('gymnasium' in sys.modules)"
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
        assert "False\n" == done.stdout

    def test_many_places_at_once_are_made_by_the_same_name(self):
        envs = gymnasium.make_vec(NAME, num_envs=3, task=BOARD, observation="paper", mask="none")
        assert isinstance(envs, SkillVectorEnv)
        obs, infos = envs.reset(seed=0)
        assert ((3, 17), (3, 16)) == (obs.shape, infos["action_mask"].shape)
        assert envs.observation_space.contains(obs)
        assert infos["action_mask"].all()

    def test_gymnasium_can_vectorise_it_by_itself(self, board_task):
        """Slower, with the same observations and rewards."""
        ours = gymnasium.make_vec(NAME, num_envs=2, task=board_task)
        theirs = gymnasium.make_vec(NAME, num_envs=2, task=board_task, vectorization_mode="sync")
        assert ours.reset(seed=0)[0].tolist() == theirs.reset(seed=0)[0].tolist()
        for action in (0, 1, 2, 3):
            actions = np.array([action, action])
            first, other = ours.step(actions), theirs.step(actions)
            for mine, yours in zip(first[:4], other[:4], strict=True):
                assert mine.tolist() == yours.tolist()


class TestArguments:
    def test_back_ends_and_their_options_are_chosen_as_on_the_command_line(self):
        env = gymnasium.make(
            NAME,
            task=str(BOARD),
            physics="kinematic",
            collision="aabb, precedence",
            options={"aabb": {"tolerance_m": 0.003}},
        ).unwrapped
        assert isinstance(env, SkillEnv)
        names = {back_end.name for back_end in env.model.feasibility.back_ends}
        assert {"kinematic", "aabb", "precedence"} == names
        (aabb,) = [item for item in env.model.feasibility.back_ends if item.name == "aabb"]
        assert 0.003 == aabb.options.tolerance_m  # type: ignore[attr-defined]

    def test_by_default_they_are_those_of_the_task_file(self, board_task):
        for task in (BOARD, board_task):
            env = gymnasium.make(NAME, task=task).unwrapped
            assert isinstance(env, SkillEnv)
            names = {back_end.name for back_end in env.model.feasibility.back_ends}
            assert {"kinematic", "precedence"} == names

    def test_the_observation_mask_and_objective_arrive(self):
        env = gymnasium.make(NAME, task=BOARD, observation="layout", mask="none", objective="cost")
        _, info = env.reset(seed=0)
        _, reward, *_, after = env.step(0)
        assert info["action_mask"].all()
        assert -after["cost"] == reward
        assert "cost(pick(pcb))" in env.unwrapped.features  # type: ignore[attr-defined]

    def test_an_option_of_who_takes_no_part_is_refused(self):
        with pytest.raises(OptionError, match="No plugin 'aabb' takes part in this environment"):
            gymnasium.make(NAME, task=BOARD, options={"aabb": {}})

    def test_an_unknown_back_end_is_refused(self):
        with pytest.raises(PluginError, match="kinematik"):
            gymnasium.make(NAME, task=BOARD, physics="kinematik")

    def test_a_file_with_faults_is_refused_with_all_of_them(self, tmp_path):
        path = tmp_path / "task.yaml"
        path.write_text("kind: assembly\nname: board\n", "utf-8")
        with pytest.raises(TaskError, match="parts"):
            gymnasium.make(NAME, task=path)

    def test_a_part_of_a_chain_is_chosen_by_name(self, board_task):
        chain = CONFIGS / "swarmitfix_polygonal.yaml"
        env = gymnasium.make(NAME, task=chain, part="base-1").unwrapped
        envs = gymnasium.make_vec(NAME, num_envs=2, task=chain, part="base-1")
        assert isinstance(env, SkillEnv)
        assert isinstance(envs, SkillVectorEnv)
        assert "base-1" == env.model.task.name == envs.models[0].task.name
        with pytest.raises(OptionError, match="Did you mean 'base-1'"):
            gymnasium.make(NAME, task=chain, part="base1")
        with pytest.raises(OptionError, match="is a task already"):
            gymnasium.make(NAME, task=board_task, part="base-1")

    @pytest.mark.parametrize("make", [gymnasium.make, gymnasium.make_vec])
    def test_a_chain_of_tasks_is_refused_and_the_argument_named(self, make):
        message = "17 tasks in a chain; name one by `part`: goals, base-1"
        with pytest.raises(TaskError, match=message):
            make(NAME, task=CONFIGS / "swarmitfix_polygonal.yaml")

    @pytest.mark.parametrize("make", [gymnasium.make, gymnasium.make_vec])
    def test_a_task_is_required(self, make):
        with pytest.raises(gymnasium.error.MissingArgument, match="pass `task`, the path of"):
            make(NAME)

    def test_a_step_limit_of_gymnasium_needs_its_own_vector_environment(self):
        with pytest.raises(OptionError, match=r'`step_limit` in the task file, or pass .*"sync"'):
            gymnasium.make_vec(NAME, num_envs=2, task=BOARD, max_episode_steps=3)
        envs = gymnasium.make_vec(
            NAME, num_envs=2, task=BOARD, max_episode_steps=3, vectorization_mode="sync"
        )
        envs.reset(seed=0)
        late = [envs.step(np.array([action, action]))[3].tolist() for action in (0, 1, 2)]
        assert [[False, False], [False, False], [True, True]] == late
