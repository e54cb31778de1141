"""The hulls that ``swept`` shows: what moves, what is met, and where."""

import json

import numpy as np
import pytest
from PIL import Image

from situations import assembly
from skillplan.cli import main
from skillplan.collision import HullDetector, HullRole
from skillplan_pinocchio import SweptDetector


@pytest.fixture
def shown(board):
    """Return a function from a skill and facts to the scene on the inverter board."""

    def scene(skill, *facts):
        state = board.facts.of("tool(gripper)", "at(home)", *facts)
        return SweptDetector(board).hulls(board.skill(skill), state)

    return scene


def named(scene, role):
    return {hull.name for hull in scene.hulls if hull.role is role}


def test_the_detector_says_that_it_has_hulls(board):
    assert isinstance(SweptDetector(board), HullDetector)


def test_hand_fingers_and_load_are_swept(shown):
    """And what is carried is no obstacle."""
    scene = shown("place(transformer)", "held(transformer)", "placed(pcb)")
    assert {"the hand", "a finger", "transformer"} == named(scene, HullRole.MOVING)
    assert {"pcb"} == named(scene, HullRole.STANDING)
    assert tuple(scene.touches) == ()


def test_what_is_run_into_is_marked_where_it_is_touched(shown):
    """The point lies in the box about the body."""
    scene = shown("place(transformer)", "held(transformer)", "placed(pcb)", "placed(brace)")
    assert {"brace"} == named(scene, HullRole.MET)
    corners = np.array([vertex for h in scene.hulls if h.name == "brace" for vertex in h.vertices])
    (touch,) = scene.touches
    assert (corners.min(axis=0) - 1e-6 <= touch).all()
    assert (touch <= corners.max(axis=0) + 1e-6).all()


def test_the_scene_has_the_reason_of_the_verdict_and_its_bodies(shown):
    """Also where nothing is run into."""
    scene = shown("place(transformer)", "held(transformer)", "placed(pcb)", "placed(brace)")
    assert scene.reason == "transformer runs into brace on the approach"
    assert scene.subjects == {"transformer", "brace"}
    alone = shown("place(transformer)", "held(transformer)")
    assert alone.reason == "transformer has nothing beneath it"
    assert alone.subjects == {"transformer"}


def test_a_body_is_only_where_the_state_has_it(shown):
    """Of its places one, by the fact that holds."""
    scene = shown("pick(pcb)", "at_start(pcb)", "at_start(clock)")
    assert {"clock"} == named(scene, HullRole.STANDING)


def test_a_sweep_reaches_from_the_safe_height_to_the_target(shown, board):
    """The load's hull holds both of its ends."""
    scene = shown("place(transformer)", "held(transformer)", "placed(pcb)")
    heights = [z for hull in scene.hulls if hull.name == "transformer" for _, _, z in hull.vertices]
    body = board.scene.body("transformer")
    safe_m = board.scene.robots[0].safe_height_m
    assert max(heights) == pytest.approx(safe_m + body.height_m, abs=1e-3)
    assert min(heights) < 0.01


def block(start_m, goal_m, size_m):
    return {"tool": "gripper", "size_m": size_m, "start_m": start_m, "goal_m": goal_m}


@pytest.mark.slow(reason="plans past a screen; other pictures in every run")
def test_the_arm_is_shown_where_a_link_runs_into_something():
    """Behind a screen that no elbow leads past."""
    content = {
        "kind": "assembly",
        "name": "shelf",
        "robot": {"home_m": [0.5, 0.02], "safe_height_m": 0.15},
        "tools": {"gripper": {"holder_m": [0.6, 0.3]}},
        "initial_tool": "gripper",
        "parts": {
            "base": block([0.4, -0.25], [0.5, 0.0], [0.06, 0.1, 0.02]),
            "screen": block([0.6, 0.3], [0.25, 0.0], [0.04, 0.6, 0.55]),
        },
        "step_limit": 20,
    }
    task = assembly(content)
    state = task.facts.of("at(home)", "tool(gripper)", "held(base)", "placed(screen)")
    scene = SweptDetector(task).hulls(task.skill("place(base)"), state)
    assert any(name.startswith("link ") for name in named(scene, HullRole.MOVING))
    assert {"screen"} == named(scene, HullRole.MET)


def test_what_the_jaws_cannot_hold_is_said_instead():
    """There is no motion to be shown."""
    content = {
        "kind": "assembly",
        "name": "wide",
        "robot": {"home_m": [0.5, 0.02]},
        "tools": {"gripper": {"holder_m": [0.6, 0.3]}},
        "initial_tool": "gripper",
        "parts": {"slab": block([0.4, -0.2], [0.5, 0.1], [0.3, 0.3, 0.02])},
        "step_limit": 20,
    }
    task = assembly(content)
    state = task.facts.of("at(home)", "tool(gripper)", "at_start(slab)", "hand_free")
    with pytest.raises(ValueError, match="slab"):
        SweptDetector(task).hulls(task.skill("pick(slab)"), state)


@pytest.mark.slow(reason="draws by the command; the same hulls without it in every run")
def test_explain_draws_them_without_an_engine_that_moves_bodies(tmp_path, capsys):
    """Where it refused before: the engine is kinematic."""
    path = tmp_path / "hulls.png"
    words = ["explain", "configs/inverter_board.yaml", "place(transformer)"]
    words += ["--after", "0,1,10,11,8", "--set", "chart=[]"]
    words += ["--collision", "swept", "--picture", str(path)]
    with pytest.raises(SystemExit) as ended:
        main([*words, "--format", "json"])
    assert ended.value.code == 1
    assert {"picture": str(path)} == json.loads(capsys.readouterr().out)["files"]
    with Image.open(path) as picture:
        assert picture.format == "PNG"
        # Not blank: the red of what is met is somewhere.
        pixels = np.asarray(picture.convert("RGB")).reshape(-1, 3).astype(int)
        assert (pixels[:, 0] - pixels[:, 2] > 60).sum() > 50
