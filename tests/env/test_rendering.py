"""Pictures of states, and the window that shows them."""

from __future__ import annotations

import sys

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from board_situations import OPTIMAL
from situations import CONFIGS, model_of
from skillplan.env import SkillEnv, SkillVectorEnv
from skillplan.errors import OptionError
from thinned import slow_case

NAME = "skillplan.env:skillplan/Task-v0"
DISPLAYS = ("DISPLAY", "WAYLAND_DISPLAY", "SDL_VIDEODRIVER")


@pytest.fixture
def no_display(monkeypatch):
    for variable in DISPLAYS:
        monkeypatch.delenv(variable, raising=False)
    monkeypatch.setattr(sys, "platform", "linux")


@pytest.fixture
def hidden_display(monkeypatch):
    """A driver of SDL that draws windows without showing them."""
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    monkeypatch.setenv("PYGAME_HIDE_SUPPORT_PROMPT", "1")
    import pygame

    return pygame


class TestImages:
    def test_every_state_has_one_of_the_same_size_that_shows_it(self, board_task):
        env = SkillEnv(model_of(board_task), render_mode="rgb_array")
        env.reset()
        frames = [env.render()]
        for action in OPTIMAL[:2]:
            env.step(action)
            frames.append(env.render())
        assert {((480, 640, 3), np.dtype(np.uint8))} == {(f.shape, f.dtype) for f in frames}
        assert 3 == len({frame.tobytes() for frame in frames})
        env.reset()
        assert np.array_equal(frames[0], env.render())

    @pytest.mark.parametrize(
        ("file", "part"),
        [
            ("ESC12.sop", None),
            ("swarmitfix_polygonal.yaml", "base-1"),
            slow_case("swarmitfix_polygonal.yaml", "goals", reason="a walk in every run"),
            slow_case("swarmitfix_fleet.yaml", None, reason="a walk in every run"),
            slow_case("inverter_grasps.yaml", None, reason="another board in every run"),
            slow_case("gear_unit.yaml", None, reason="another board in every run"),
        ],
    )
    def test_tasks_of_every_kind_have_them(self, file, part):
        """Also under chance, and if facts are neither parts nor places."""
        env = gymnasium.make(NAME, task=CONFIGS / file, part=part, render_mode="rgb_array")
        _, info = env.reset(seed=0)
        before = env.render()
        env.step(int(np.flatnonzero(info["action_mask"])[-1]))
        assert (480, 640, 3) == before.shape == env.render().shape
        assert not np.array_equal(before, env.render())

    def test_the_vector_environment_has_one_for_every_episode(self, board_task):
        envs = gymnasium.make_vec(NAME, num_envs=2, task=board_task, render_mode="rgb_array")
        envs.reset(seed=0)
        envs.step(np.array([0, 2]))
        frames = envs.render()
        assert isinstance(frames, tuple)
        assert [(480, 640, 3)] * 2 == [frame.shape for frame in frames]
        assert not np.array_equal(*frames)

    def test_text_of_the_vector_environment_names_last_skills_and_ends(self, board_task):
        envs = SkillVectorEnv(model_of(board_task), 2, render_mode="ansi")
        with pytest.raises(gymnasium.error.ResetNeeded):
            envs.render()
        envs.reset()
        envs.step(np.array([0, 1]))
        first, second = envs.render()
        assert first.startswith("step 1; pick(pcb); {held(pcb)")
        assert second.startswith("step 0; before: place(pcb), which was infeasible; {at_start(pcb)")
        assert SkillVectorEnv(model_of(board_task), 2).render() is None

    @pytest.mark.parametrize("environment", [SkillEnv, lambda *a, **o: SkillVectorEnv(*a, 1, **o)])
    def test_an_unknown_mode_is_refused_with_the_nearest(self, board_task, environment):
        with pytest.raises(OptionError, match=r"'rgb_aray'\. Did you mean 'rgb_array'"):
            environment(model_of(board_task), render_mode="rgb_aray")

    @pytest.mark.slow(reason="encodes videos")
    @pytest.mark.filterwarnings("ignore:invalid escape sequence", "ignore:.*Overwriting existing")
    def test_gymnasium_records_them_as_a_video(self, board_task, tmp_path):
        from gymnasium.wrappers import RecordVideo

        env = gymnasium.make(NAME, task=board_task, render_mode="rgb_array")
        recorder = RecordVideo(env, str(tmp_path), episode_trigger=lambda episode: True)
        recorder.reset(seed=0)
        for action in OPTIMAL:
            recorder.step(action)
        recorder.close()
        (video,) = tmp_path.glob("*.mp4")
        import imageio_ffmpeg

        frames, duration_s = imageio_ffmpeg.count_frames_and_secs(str(video))
        assert (16, 8.0) == (frames, pytest.approx(duration_s, abs=0.1))

    @pytest.mark.slow(reason="a window of every kind; ours in every run")
    def test_gymnasium_shows_them_in_its_own_window(self, board_task, hidden_display):
        from gymnasium.wrappers import HumanRendering

        env = gymnasium.make(NAME, task=board_task, render_mode="rgb_array")
        window = HumanRendering(env)
        window.reset()
        window.step(0)
        assert (640, 480) == hidden_display.display.get_surface().get_size()
        window.close()


class TestWindow:
    def test_it_shows_every_step(self, board_task, hidden_display):
        env = SkillEnv(model_of(board_task), render_mode="human")
        images = SkillEnv(model_of(board_task), render_mode="rgb_array")
        env.reset()
        images.reset()
        surface = hidden_display.display.get_surface()
        for action in (None, 0):
            if action is not None:
                env.step(action)
                images.step(action)
            shown = hidden_display.surfarray.array3d(surface).swapaxes(0, 1)
            assert np.array_equal(images.render(), shown)
        assert env.render() is None
        env.close()
        assert not hidden_display.display.get_init()

    @pytest.mark.slow(reason="another window; that of one episode in every run")
    def test_that_of_several_episodes_is_a_grid(self, board_task, hidden_display):
        envs = SkillVectorEnv(model_of(board_task), 3, render_mode="human")
        envs.reset()
        assert (1280, 960) == hidden_display.display.get_surface().get_size()
        envs.close()

    @pytest.mark.usefixtures("no_display")
    def test_without_a_display_it_is_refused_and_the_checker_of_gymnasium_passes(self, board_task):
        with pytest.raises(OptionError, match=r"no display is set.*use render_mode='rgb_array'"):
            gymnasium.make(NAME, task=board_task, render_mode="human")
        env = gymnasium.make(NAME, task=board_task, render_mode="rgb_array").unwrapped
        assert ["ansi", "rgb_array"] == env.metadata["render_modes"]
        check_env(env)

    def test_without_pygame_it_names_the_package(self, board_task, monkeypatch):
        monkeypatch.setenv("DISPLAY", ":0")
        monkeypatch.setitem(sys.modules, "pygame", None)
        env = SkillEnv(model_of(board_task), render_mode="human")
        with pytest.raises(gymnasium.error.DependencyNotInstalled, match="pip install pygame-ce"):
            env.reset()
