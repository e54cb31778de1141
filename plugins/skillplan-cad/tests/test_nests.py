"""Nests: a part enters with clearance, stands, and is not let in where it would collide."""

import json
from dataclasses import replace
from functools import partial
from pathlib import Path

import jsonschema
import numpy as np
import pytest
import trimesh
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from skillplan.cli import run
from skillplan.domains.assembly import MAX_CORNERS, MAX_PIECES, read_mesh, read_pieces
from skillplan.plugins import installed
from skillplan_cad import KeepFree, NestSettings, build_jaws, build_nest
from skillplan_cad import check_nest as check_densely
from skillplan_cad.nests import make_nest

SCHEMA = Path(__file__).parents[3] / "docs/reference/documents/nest.yaml"
check_nest = partial(check_densely, most=1500)
PLUS_X = (1.0, 0.0, 0.0)


@pytest.fixture(autouse=True)
def registered(monkeypatch):
    """Let the command find the plugin, wherever it is installed."""

    class Entry:
        name, value, dist = "nest", "skillplan_cad.nests.make_nest:make_nest", None
        load = partial(getattr, make_nest, "make_nest")

    monkeypatch.setattr(installed, "importers", lambda: [Entry()])


def box(size_mm, centre_mm=(0, 0, 0)):
    """Return a box as a body."""
    mesh = trimesh.creation.box(
        size_mm, transform=trimesh.transformations.translation_matrix(centre_mm)
    )
    return body(mesh)


def join_pieces(nest):
    """Return a nest with its convex pieces as its mesh."""
    starts = np.cumsum([0, *(len(points) for points, _ in nest.pieces)])
    faces = [faces + start for (_, faces), start in zip(nest.pieces, starts, strict=False)]
    points = np.concatenate([points for points, _ in nest.pieces])
    return replace(nest, vertices_m=points, triangles=np.concatenate(faces))


def body(mesh):
    """Return a mesh in millimetres as a body."""
    return np.asarray(mesh.vertices) / 1e3, np.asarray(mesh.faces, dtype=np.int64)


def shrink(nest, factor):
    """Return a nest whose walls stand nearer, about its middle."""
    return replace(nest, vertices_m=nest.vertices_m * np.array([factor, factor, 1.0]))


NUT = body(trimesh.creation.cylinder(4.6, 4, sections=6))
BALL = body(trimesh.creation.icosphere(3, 8))
TEE = [box((6, 6, 20)), box((60, 20, 5), (20, 0, 12.5))]

sides = st.integers(4, 20)
places = st.integers(-10, 10)
boxes = st.builds(
    lambda size, at: box(size, at), st.tuples(sides, sides, sides), st.tuples(*[places] * 3)
)


@pytest.mark.slow
@given(bodies=st.lists(boxes, min_size=1, max_size=3), draft=st.sampled_from([0.0, 2.0]))
@settings(max_examples=8, deadline=None)
def test_a_group_enters_its_nest_with_the_clearance(bodies, draft):
    nest = build_nest(bodies, NestSettings(clearance_m=3e-4, draft_deg=draft))
    found = check_nest(bodies, nest)
    assert found.overlap_m <= 2e-6
    assert 3e-4 <= found.least_gap_m < 3.2e-4
    assert trimesh.Trimesh(nest.vertices_m, nest.triangles).is_watertight
    pieces = check_nest(bodies, join_pieces(nest))
    assert pieces.overlap_m <= 2e-6
    assert pieces.least_gap_m >= 0.75 * 3e-4
    assert pieces.supports


@pytest.mark.slow
@pytest.mark.parametrize("up", [(0.0, 0.0, -1.0), (0.6, 0.0, 0.8)])
def test_a_ball_is_held_along_any_axis(up):
    found = check_nest([BALL], build_nest([BALL], NestSettings(layer_m=2e-3), up))
    assert found.is_good
    assert found.play_m == pytest.approx((2.04e-4, 2.04e-4), abs=4e-5)
    assert found.turn_rad is None


def test_the_check_refuses_walls_that_are_too_near_and_a_part_in_the_wall():
    part = box((30, 20, 10))
    nest = build_nest([part], NestSettings(draft_deg=0.0))
    near = check_nest([part], shrink(nest, 0.992))
    assert "a wall is nearer than the clearance of 0.2 mm" in near.faults
    # The corners come nearer by 0.8 % of their distance from the middle.
    assert near.least_gap_m == pytest.approx(2.04e-4 - 0.008 * 18.03e-3, abs=3e-6)
    assert any("meets the nest" in fault for fault in check_nest([part], shrink(nest, 0.9)).faults)


@pytest.mark.slow
def test_pins_stand_beneath_an_overhang_that_would_tip():
    without = NestSettings(pin_m=0.0)
    tipped = check_nest(TEE, build_nest(TEE, without))
    assert tipped.support_margin_m < -0.01
    assert not tipped.held_by_walls
    assert any(fault.startswith("the part tips") for fault in tipped.faults)
    nest = build_nest(TEE)
    assert nest.pins
    assert [pin.top_m for pin in nest.pins] == pytest.approx([0.010] * len(nest.pins))
    assert check_nest(TEE, nest).is_good


@pytest.mark.parametrize(("depth_m", "is_held"), [(0.003, False), (0.03, True)])
def test_a_pin_on_its_tip_stands_in_a_deep_hole_only(depth_m, is_held):
    points = [[0, 0], [3, 1.5], [3, 40], [0, 40]]
    pin = body(trimesh.creation.revolve(np.array(points), sections=24))
    found = check_nest([pin], build_nest([pin], NestSettings(depth_m=depth_m, pin_m=0.0)))
    assert found.support_margin_m == pytest.approx(0, abs=1e-5)
    assert found.held_by_walls == is_held
    assert [fault.partition(":")[0] for fault in found.faults] == ["the part tips"] * (not is_held)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("part", "words"),
    [
        (box((3, 3, 3)), ["--wall", "0.8"]),
        (box((30, 20, 10)), ["--clearance", "1"]),
        (BALL, ["--layer", "0.15"]),
    ],
    ids=["small", "wide", "curved"],
)
def test_a_task_accepts_each_nest_that_is_written(part, words, tmp_path):
    """Also where the printed mesh has more corners than a task accepts."""
    vertices_m, triangles = part
    trimesh.Trimesh(vertices_m * 1e3, triangles).export(tmp_path / "part.stl")
    out = tmp_path / "nest"
    assert run(["nest", str(tmp_path / "part.stl"), "--unit", "mm", "--out", str(out), *words]) == 0
    printed = trimesh.load(out / "nest.stl")
    mesh = read_mesh(out, "nest.obj", 1.0)
    assert mesh.size == pytest.approx(printed.extents / 1e3, abs=1e-5)
    assert 0 < len(read_pieces(out, "nest.pieces.obj", 1.0, mesh)[0]) <= MAX_PIECES
    assert len(mesh.corners) <= min(len(printed.vertices), MAX_CORNERS)


def test_a_nut_is_kept_from_turning_unless_its_pocket_is_too_wide():
    nest = build_nest([NUT])
    assert 0.05 < check_nest([NUT], nest, may_turn=False).turn_rad < 0.2
    wide = build_nest([NUT], NestSettings(clearance_m=2e-3))
    faults = check_nest([NUT], wide, may_turn=False).faults
    assert faults == ("the part turns in the pocket, so a nut is not held against its screw",)


@pytest.mark.slow
def test_a_free_region_is_cut_open_upwards():
    part = box((30, 20, 10))
    region = KeepFree(np.array([[-5, -50], [5, -50], [5, 50], [-5, 50]]) / 1e3, -0.005)
    assert not check_nest([part], build_nest([part], free=[region]), [region]).faults
    assert "stand in free region 1" in check_nest([part], build_nest([part]), [region]).faults[0]


@pytest.mark.slow
def test_jaws_close_on_a_part_and_end_above_its_plane():
    part = body(trimesh.creation.cylinder(8, 20, sections=48))
    jaws = build_jaws([part], PLUS_X, gap_m=2e-3)
    for jaw, side in zip(jaws, (1, -1), strict=True):
        assert check_nest([part], jaw, stands=False).is_good
        near = side * jaw.vertices_m[:, 0]
        assert near.min() == pytest.approx(1e-3, abs=1e-6)
        assert jaw.vertices_m[:, 2].min() == pytest.approx(-9.5e-3, abs=1e-6)


@pytest.mark.slow
def test_an_undercut_is_named():
    """The wall cannot follow a waist."""
    spool = [box((20, 20, 4), (0, 0, 2)), box((10, 10, 6), (0, 0, 7)), box((20, 20, 4), (0, 0, 12))]
    (undercut,) = check_nest(spool, build_nest(spool, NestSettings(depth_m=0.014))).undercuts
    assert undercut.body == 1
    assert undercut.low_m == pytest.approx(0.004, abs=1e-4)
    assert undercut.high_m == pytest.approx(0.010, abs=1e-4)


@pytest.fixture
def part_file(tmp_path):
    """An STL of a plate on a peg, which stands in nothing but a nest."""
    plate = trimesh.creation.box((30, 20, 12))
    peg = trimesh.creation.cylinder(6, 10, sections=32)
    peg.apply_translation((-8, 0, -10))
    trimesh.boolean.union([plate, peg], engine="manifold").export(tmp_path / "plate.stl")
    return tmp_path / "plate.stl"


@pytest.mark.slow
def test_the_command_writes_what_passed_its_check_only(part_file, tmp_path, capsys):
    out = tmp_path / "nest"
    assert run(["nest", str(part_file), "--unit", "mm", "--out", str(out), "--format", "json"]) == 0
    document = json.loads(capsys.readouterr().out)
    (nest,) = document["nests"]
    assert document["good"]
    jsonschema.validate(document, yaml.safe_load(SCHEMA.read_text("utf-8")))
    assert nest["check"]["least_gap_mm"] >= 0.2
    printed = trimesh.load(out / "nest.stl")
    assert printed.is_watertight
    assert printed.extents.tolist() == pytest.approx(nest["size_mm"], abs=1e-3)
    assert printed.bounds[0][2] == 0
    tips = ["--depth", "5", "--pin", "0", "--wall", "0.8"]
    out = tmp_path / "bad"
    assert run(["nest", str(part_file), "--unit", "mm", "--out", str(out), *tips]) == 1
    assert "not good: the part tips" in capsys.readouterr().out
    assert sorted(file.name for file in out.iterdir()) == ["nest.json", "nest.png"]


TASK = """\
kind: assembly
name: nested
robot: {{name: panda, home_m: [0.35, 0.0], safe_height_m: 0.22, travel_speed_m_per_s: 0.25}}
tools: {{gripper: {{type: gripper, opening_m: 0.08, holder_m: [0.25, 0.4]}}}}
initial_tool: gripper
fixtures:
  nest: {{meshes: [{{file: nest/nest.obj, pieces: nest/nest.pieces.obj}}], at_m: [0.5, 0.0]}}
  supply: {{meshes: [{{file: nest/nest.obj, pieces: nest/nest.pieces.obj}}], at_m: [0.45, -0.25]}}
parts:
  plate:
    tool: gripper
    mass_kg: 0.05
    meshes: [{{file: plate.stl, scale: 0.001}}]
    grasp: {{closing_axis: y, depth_m: 0.006}}
    start_m: {start}
    start_on: supply
    goal_m: {goal}
    goal_on: nest
collision: {{swept: }}
"""


@pytest.mark.slow
@pytest.mark.parametrize("engine", ["mujoco", "pybullet"])
def test_a_part_goes_from_nest_to_nest_in_swept_and_both_engines(
    part_file, tmp_path, capsys, engine
):
    """It stands in nothing else: on the table it would tip off its peg."""
    words = ["--unit", "mm", "--depth", "13", "--out", str(tmp_path / "nest"), "--format", "json"]
    assert run(["nest", str(part_file), *words]) == 0
    seated_mm = json.loads(capsys.readouterr().out)["nests"][0]["seated_mm"]
    x, y, z = (value / 1e3 for value in seated_mm)
    goal, start = [0.5 + x, y, z], [0.45 + x, y - 0.25, z]
    task = tmp_path / "task.yaml"
    task.write_text(TASK.format(start=start, goal=goal))
    words = ["--physics", engine, "--collision", "swept", "--format", "json"]
    assert run(["search-optimal", str(task), *words]) == 0
    assert json.loads(capsys.readouterr().out)["skills"] == ["pick(plate)", "place(plate)"]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--free", "1,2,3"], "--free 1,2,3: give a rectangle"),
        (["--free", "90,0,95,9"], "--free 90,0,95,9: this region cuts nothing"),
        (["--gap", "3"], "--gap is for --kind jaws"),
        (["--closing", "y"], "--closing is for --kind jaws"),
        (["--kind", "jaws", "--pin", "3"], "--pin is for nests"),
        (["--clearance", "9"], "clearance 9 mm: must be from 0.02 to 5 mm"),
        (["--draft", "50"], "draft 50 degrees: must be from 0 to 45"),
        (["--kind", "jaws", "--closing", "z"], "the closing direction of jaws must be level"),
        (["--kind", "jaws", "--gap", "40"], "hold nothing of a part that is 30 mm wide"),
        (["--only", "lid"], "--only lid: no part has such a name"),
    ],
)
def test_wrong_options_are_refused_with_a_message(part_file, tmp_path, capsys, words, message):
    out = tmp_path / "nest"
    assert run(["nest", str(part_file), "--unit", "mm", "--out", str(out), *words]) == 2
    assert message in capsys.readouterr().err
    assert not out.exists()
