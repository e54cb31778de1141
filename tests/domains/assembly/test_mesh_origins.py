"""A mesh without centre_m is moved: `check` says how far, and which centre_m keeps its origin."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from skillplan import load_problem
from skillplan.cli import main
from skillplan.errors import TaskError

FACES = [(1, 3, 4, 2), (5, 6, 8, 7), (1, 2, 6, 5), (3, 7, 8, 4), (1, 5, 7, 3), (2, 4, 8, 6)]


def write_block(folder: Path, name: str, low_mm: list[float], high_mm: list[float]) -> None:
    """Write a block between two corners [mm] as an OBJ file."""
    xs, ys, zs = zip(low_mm, high_mm, strict=True)
    corners = [(x, y, z) for x in xs for y in ys for z in zs]
    lines = [f"v {x} {y} {z}" for x, y, z in corners]
    lines += ["f " + " ".join(map(str, face)) for face in FACES]
    (folder / name).write_text("\n".join(lines))


def write_board(folder: Path, meshes: list[dict[str, object]], **parts: object) -> Path:
    """Write a task with a part of some meshes, and other parts; return its file."""
    part = {"tool": "gripper", "meshes": meshes, "start_m": [0.4, 0.2], "goal_m": [0.5, 0.0]}
    content = {
        "kind": "assembly",
        "name": "origins",
        "robot": {"home_m": [0.3, 0.0]},
        "tools": {"gripper": {"holder_m": [0.6, 0.3]}},
        "initial_tool": "gripper",
        "parts": {"lever": part, **parts},
    }
    path = folder / "board.yaml"
    path.write_text(yaml.safe_dump(content))
    return path


def check(path: Path, capsys: pytest.CaptureFixture[str], *words: str) -> str:
    """Return what `check` prints on a valid file."""
    with pytest.raises(SystemExit) as ended:
        main(["check", str(path), *words])
    out, error = capsys.readouterr()
    assert ended.value.code == 0, error
    return out


def test_check_says_how_far_a_mesh_is_moved_and_how_to_keep_its_origin(tmp_path, capsys):
    write_block(tmp_path, "lever.obj", [-10, -10, 0], [13, 10, 76])
    path = write_board(tmp_path, [{"file": "lever.obj", "scale": 0.001}])
    (line,) = [line for line in check(path, capsys).splitlines() if line.startswith("mesh ")]
    assert line.split(maxsplit=1)[1].startswith("'lever.obj' is moved by -1.5 0 0 mm")
    result = json.loads(check(path, capsys, "--format", "json"))["meshes"]
    centre_m = [0.0015, 0.0, 0.038]
    assert result == [
        {"part": "lever", "mesh": 0, "moved_mm": [-1.5, 0.0, 0.0], "centre_m": centre_m}
    ]
    kept = write_board(tmp_path, [{"file": "lever.obj", "scale": 0.001, "centre_m": centre_m}])
    assert "meshes" not in json.loads(check(kept, capsys, "--format", "json"))


def test_nothing_is_said_of_a_mesh_that_stands_centred_on_its_origin(tmp_path):
    write_block(tmp_path, "lever.obj", [-10, -5, 0], [10, 5, 8])
    problem = load_problem(write_board(tmp_path, [{"file": "lever.obj", "scale": 0.001}]))
    assert "meshes" not in problem.domain.overview(problem.config).document


def test_a_height_that_is_moved_cannot_be_kept_and_heights_count_from_the_bottom(tmp_path, capsys):
    write_block(tmp_path, "lever.obj", [-10, -5, -4], [10, 5, 4])
    path = write_board(tmp_path, [{"file": "lever.obj", "scale": 0.001}])
    assert "'lever.obj' is moved by 0 0 4 mm, as heights count from the part's bottom" in " ".join(
        check(path, capsys).split()
    )


@given(
    low_mm=st.lists(st.floats(-50, 50), min_size=3, max_size=3),
    size_mm=st.lists(st.floats(5, 60), min_size=3, max_size=3),
)
def test_centre_m_as_printed_keeps_the_origin(tmp_path_factory, low_mm, size_mm):
    """In plan; the bottom is that of the part."""
    folder = tmp_path_factory.mktemp("meshes")
    high_mm = [low + size for low, size in zip(low_mm, size_mm, strict=True)]
    write_block(folder, "lever.obj", low_mm, high_mm)
    mesh = {"file": "lever.obj", "scale": 0.001}
    problem = load_problem(write_board(folder, [mesh]))
    (moved,) = problem.domain.overview(problem.config).document.get(
        "meshes", [{"moved_mm": [0, 0, 0], "centre_m": None}]
    )
    (own,) = problem.task.scene.body("lever").boxes
    for axis in range(3):
        middle_mm = (low_mm[axis] + high_mm[axis]) / 2
        assert moved["moved_mm"][axis] == pytest.approx(
            1000 * own.centre[axis] - middle_mm, abs=0.011
        )
    if moved["centre_m"] is not None:
        kept = load_problem(write_board(folder, [mesh | {"centre_m": moved["centre_m"]}]))
        (box,) = kept.task.scene.body("lever").boxes
        low_m = [box.centre[axis] - box.size[axis] / 2 for axis in range(3)]
        expected = [low_mm[0] / 1000, low_mm[1] / 1000, 0.0]
        assert low_m == pytest.approx(expected, abs=2e-6)


def test_meshes_of_one_part_keep_their_places_to_each_other(tmp_path):
    """As a CAD program has them: a post on a plate, high above its origin."""
    write_block(tmp_path, "plate.obj", [0, 0, 30], [40, 20, 34])
    write_block(tmp_path, "post.obj", [0, 0, 34], [10, 20, 50])
    meshes = [{"file": name, "scale": 0.001} for name in ("plate.obj", "post.obj")]
    problem = load_problem(write_board(tmp_path, meshes))
    moved = problem.domain.overview(problem.config).document["meshes"]
    assert [mesh["centre_m"] for mesh in moved] == [[0.02, 0.01, 0.002], [0.005, 0.01, 0.012]]
    assert moved[1]["moved_mm"] == [-5.0, -10.0, -34.0]


def test_an_overlap_of_a_moved_mesh_says_that_it_was_moved(tmp_path):
    """The lever ends where the wall begins, in the frame of the file."""
    write_block(tmp_path, "lever.obj", [-10, -10, 0], [13, 10, 76])
    wall = {
        "tool": "gripper",
        "size_m": [0.01, 0.02, 0.02],
        "start_m": [0.4, -0.2],
        "goal_m": [0.485, 0.0],
    }
    mesh = {"file": "lever.obj", "scale": 0.001}
    with pytest.raises(TaskError, match=r"overlap by 1\.5 mm .*centre_m: \[0\.0015, 0, 0\.038\]"):
        load_problem(write_board(tmp_path, [mesh], wall=wall))
    load_problem(write_board(tmp_path, [mesh | {"centre_m": [0.0015, 0, 0.038]}], wall=wall))
