"""Overlaps that are drawn on purpose, and those that are not."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import manifold3d
import numpy as np
import pytest
import trimesh
import yaml
from hypothesis import given
from hypothesis import strategies as st

from skillplan.cli import run
from skillplan_cad import (
    FitOptions,
    ImportSettings,
    Lane,
    ReadOptions,
    compute_allowance_m,
    compute_thread_depth_m,
    decompose_convex,
    find_blocked,
    find_joints,
    list_thinned,
    read_product,
    relieve_fits,
)
from skillplan_cad.reading import step_file

sys.path.insert(0, str(Path(__file__).parent / "step_writer"))
from solids import Product, box, cut, write_step

TOLERANCE_M = 1e-4


def ring(outer_mm, inner_mm):
    """Return a cuboid with a rectangular hole through it, both around the origin."""
    outer, inner = np.array(outer_mm) / 2, np.array(inner_mm) / 2
    inner[2] = outer[2] + 1
    return cut(box(*-outer, *outer), box(*-inner, *inner))


def write(folder, pin_mm=10.1, **more):
    """Write a pin in a hub with a hole of 10 mm, and return the folder."""
    hub = trimesh.creation.annulus(r_min=5, r_max=20, height=20, sections=128)
    pin = trimesh.creation.cylinder(radius=pin_mm / 2, height=35, sections=128)
    pin.apply_translation((0, 0, 7.5))
    for name, mesh in {"hub": hub, "pin": pin, **more}.items():
        mesh.export(folder / f"{name}.stl")
    return folder


def contact(folder, first="hub", second="pin", **options):
    """Return the contact of two parts."""
    product = read_product(folder, ReadOptions("mm"))
    joints = find_joints(product, TOLERANCE_M, "cylinders", "unscrew", FitOptions(**options))
    return next(item for item in joints.contacts if item.parts == (first, second))


def test_a_press_fit_has_a_depth_and_a_volume_whatever_the_facets(tmp_path):
    """0.05 mm a side over 20 mm; ISO 286 allows 0.053 mm at 10 mm."""
    fit = contact(write(tmp_path)).fit
    assert fit.kind == "press fit"
    assert fit.depth_m == pytest.approx(5e-5, rel=1e-3)
    assert fit.volume_m3 == pytest.approx(np.pi * (5.05**2 - 25) * 20e-9, rel=1e-3)
    assert fit.allowed_m == pytest.approx(5.3e-5)


def test_a_deeper_overlap_is_interference_until_it_is_declared_or_allowed(tmp_path):
    folder = write(tmp_path, pin_mm=13.6)
    assert contact(folder).interferes
    assert contact(folder).fit is None
    assert not contact(folder, allowance_m=2e-3).interferes
    declared = contact(folder, press_fits=(("pin", "hub"),))
    assert declared.fit.kind == "press fit"
    assert not declared.interferes


def test_a_fit_blocks_nothing_along_its_axis(tmp_path):
    """0.3 mm a side would block by rays, which let 0.1 mm pass."""
    product = read_product(write(tmp_path, pin_mm=10.6), ReadOptions("mm"))
    options = FitOptions(press_fits=(("pin", "hub"),))
    joints = find_joints(product, TOLERANCE_M, "axes", "unscrew", options)

    def blocked(parts):
        entries = find_blocked(parts, joints.directions, TOLERANCE_M).entries
        return {entry.direction for entry in entries if entry.part == "pin"}

    assert blocked(product) == {0, 1, 2, 3, 4, 5}
    assert blocked(relieve_fits(product, joints.contacts, joints.fasteners, TOLERANCE_M)) == {
        0,
        1,
        2,
        3,
    }


def make_connector():
    """Return a board with a slot of 2.3 mm, and a connector with a tab of 3.7 mm through it."""
    slot = manifold3d.Manifold.cube((0.28, 2.3, 5), True)
    shell = manifold3d.Manifold.cube((8, 8, 3), True).translate((0, 0, 2.5))
    tab = manifold3d.Manifold.cube((0.2, 3.7, 5), True).translate((0, 0, -0.5))
    board = manifold3d.Manifold.cube((40, 30, 2), True) - slot
    return {"board": board, "connector": shell + tab}


def test_a_pressed_part_that_is_as_wide_beyond_its_hole_comes_out_of_it(tmp_path):
    """The tab of a connector, which reaches 2 mm below its board."""
    for name, solid in make_connector().items():
        mesh = solid.to_mesh()
        trimesh.Trimesh(mesh.vert_properties, mesh.tri_verts).export(tmp_path / f"{name}.stl")
    product = read_product(tmp_path, ReadOptions("mm"))
    options = FitOptions(press_fits=(("connector", "board"),))
    joints = find_joints(product, TOLERANCE_M, "axes", "unscrew", options)
    loose = relieve_fits(
        product, joints.contacts, joints.fasteners, TOLERANCE_M, directions=joints.directions
    )
    entries = find_blocked(loose, joints.directions, TOLERANCE_M).entries
    blocked = {joints.directions[e.direction] for e in entries if e.part == "connector"}
    assert (0, 0, 1) not in blocked
    assert (0, 0, -1) in blocked
    # From the top of the board down, the tab loses 0.7 mm on each side.
    drawn, thinner = (
        trimesh.Trimesh(p.parts[1].vertices_m, p.parts[1].triangles) for p in (product, loose)
    )
    assert 1e9 * (drawn.volume - thinner.volume) == pytest.approx(1.4 * 0.2 * 4, rel=1e-2)


def test_a_seal_may_be_squeezed_by_a_third_of_its_section(tmp_path):
    """A ring of 2 mm that stands 0.2 mm into its groove."""
    seal = trimesh.creation.torus(major_radius=21.0, minor_radius=1.2)
    fit = contact(write(tmp_path, pin_mm=9.9, **{"o-ring": seal}), "hub", "o-ring").fit
    assert fit.kind == "seal"
    assert fit.allowed_m == pytest.approx(0.3 * 2.4e-3, rel=1e-3)


@pytest.mark.parametrize(("name", "is_fit"), [("spur gear (24 teeth)", True), ("disc", False)])
def test_gears_whose_teeth_overlap_in_the_drawing_mesh(tmp_path, name, is_fit):
    """Two rims of 20 mm that are 1.5 mm deep in each other, 5 mm long."""
    wheel = trimesh.creation.annulus(r_min=5, r_max=20, height=5, sections=64)
    wheel.export(tmp_path / f"a {name}.stl")
    wheel.apply_translation((38.5, 0, 0))
    wheel.export(tmp_path / f"b {name}.stl")
    fit = contact(tmp_path, f"a {name}", f"b {name}").fit
    assert (fit is not None and fit.kind == "teeth") == is_fit


def overlap(folder, first, second):
    """Return the contact of two meshes, in millimetres."""
    for name, mesh in (("first", first), ("second", second)):
        mesh.export(folder / f"{name}.stl")
    return contact(folder, "first", "second")


@pytest.fixture
def read_contact(monkeypatch):
    """Return a function that reads the only contact of a STEP file, in this process."""
    monkeypatch.setattr(
        step_file,
        "read_in_process",
        lambda path, prepare, content, limits, report: prepare(content)(None),
    )

    def read(path):
        product = read_product(path, ReadOptions())
        (result,) = find_joints(product, TOLERANCE_M, "axes", "unscrew", FitOptions()).contacts
        return result

    return read


def block(size_mm, middle_mm=(0, 0, 0)):
    """Return a cuboid."""
    mesh = trimesh.creation.box(size_mm)
    mesh.apply_translation(middle_mm)
    return mesh


def test_a_thin_fin_in_a_block_without_slot_is_as_deep_as_its_end(tmp_path):
    """0.2 mm thick and 20 mm deep, at a cube of 60 mm that ISO 286 allows 0.25 mm."""
    fin = block((0.2, 60, 30), (0, 0, 45)) + block((60, 60, 60), (0, 0, 90))
    result = overlap(tmp_path, block((100, 100, 100)), trimesh.boolean.union(fin.split()))
    assert result.interferes
    assert result.overlap_depth_m == pytest.approx(0.02, rel=1e-3)


def test_a_pin_without_a_hole_is_as_deep_as_its_end(tmp_path):
    pin = trimesh.creation.cylinder(radius=0.3, height=30, sections=32)
    pin.apply_translation((0, 0, 53))
    result = overlap(tmp_path, block((100, 100, 100)), pin)
    assert result.interferes
    assert result.overlap_depth_m == pytest.approx(0.012, rel=1e-3)


@pytest.mark.parametrize("corner", [False, True])
def test_an_overlap_of_edges_or_corners_is_as_deep_as_the_parts_have_to_move(tmp_path, corner):
    """0.48 mm; the feature has a section of 0.48 mm, whose allowance is 0.033 mm."""
    across = 39.52 if corner else 0
    result = overlap(tmp_path, block((40, 40, 40)), block((40, 40, 40), (39.52, across, 39.52)))
    assert result.interferes
    assert result.overlap_depth_m == pytest.approx(0.48e-3, rel=1e-3)


@pytest.mark.parametrize(
    ("depth_mm", "tilt_deg", "is_fit"), [(0.8, 0, True), (0.8, 45, False), (1.3, 0, False)]
)
def test_a_foot_that_is_drawn_a_little_sunk_leaves_its_seat_and_no_deeper_one_does(
    tmp_path, depth_mm, tilt_deg, is_fit
):
    """Up to 1 mm and a tenth of its height; a corner that digs in has no seat."""
    foot = block((12, 12, 20))
    foot.apply_transform(trimesh.transformations.rotation_matrix(np.radians(tilt_deg), (0, 1, 0)))
    foot.apply_translation((0, 0, 20 - depth_mm - foot.bounds[0][2]))
    result = overlap(tmp_path, block((40, 40, 40)), foot)
    assert result.interferes == (not is_fit)
    if is_fit:
        assert result.fit.kind == "sunk"
        assert result.fit.depth_m == pytest.approx(depth_mm * 1e-3, rel=0.05)
        assert result.fit.allowed_m == pytest.approx(1e-3)


@pytest.mark.parametrize("height_mm", [10, 60], ids=["inside", "through"])
def test_a_plate_within_a_block_is_no_fit(tmp_path, height_mm):
    """No surface of the block is near that of the plate."""
    result = overlap(tmp_path, block((40, 40, 40)), block((0.1, 20, height_mm)))
    assert result.interferes
    assert result.overlap_depth_m >= 0.019


def test_a_square_peg_in_a_square_hole_is_a_fit_with_its_depth_on_each_side(tmp_path, read_contact):
    """0.08 mm a side, as thin as what chords of curved faces explain."""
    hub = Product("p").add("hub", ring((40, 40, 20), (20, 20, 20)))
    path = tmp_path / "p.step"
    write_step(hub.add("peg", box(-10.08, -10.08, -10, 10.08, 10.08, 20)), path)
    result = read_contact(path)
    assert result.fit.kind == "overlap"
    assert result.fit.depth_m == pytest.approx(8e-5, rel=1e-3)


@pytest.mark.parametrize(("excess_mm", "is_fit"), [(0.3, True), (1.6, False)])
def test_a_rail_that_is_too_wide_for_its_slot_is_squeezed_in_and_leaves_it_along_the_slot(
    tmp_path, excess_mm, is_fit
):
    """On each side: 0.3 mm is more than a press fit of ISO 286 has, 1.6 mm is too deep."""
    slot = trimesh.boolean.difference([block((40, 60, 20)), block((20, 80, 20), (0, 0, 10))])
    rail = block((20 + 2 * excess_mm, 200, 16), (0, 0, 8))
    for name, mesh in (("slot", slot), ("rail", rail)):
        mesh.export(tmp_path / f"{name}.stl")
    product = read_product(tmp_path, ReadOptions("mm"))
    joints = find_joints(product, TOLERANCE_M, "axes", "unscrew")
    (result,) = joints.contacts
    assert result.interferes == (not is_fit)
    relieved = relieve_fits(product, joints.contacts, joints.fasteners, TOLERANCE_M)
    entries = find_blocked(relieved, joints.directions, TOLERANCE_M).entries
    free = set(range(6)) - {entry.direction for entry in entries if entry.part == "rail"}
    assert free == ({2, 3, 4} if is_fit else set())
    if is_fit:
        assert result.fit.kind == "squeezed"
        assert result.fit.depth_m == pytest.approx(excess_mm * 1e-3, rel=0.05)
        assert result.fit.allowed_m == pytest.approx(1.5e-3)


@pytest.mark.parametrize(("lip_mm", "leaves"), [(1.0, True), (8.0, False)])
def test_the_hook_of_a_squeezed_part_gives_way_unless_it_is_large(tmp_path, lip_mm, leaves):
    """A plug, 0.2 mm too wide on each side, has a lip beneath the plate that it goes through."""
    plate = trimesh.boolean.difference([block((80, 80, 20)), block((20, 20, 30))])
    shank = block((20.4, 20.4, 40), (0, 0, 10))
    lip = block((20 + 2 * lip_mm, 20, 4), (0, 0, -12))
    plug = trimesh.boolean.union([shank, block((60, 60, 10), (0, 0, 15)), lip])
    for name, mesh in (("plate", plate), ("plug", plug)):
        mesh.export(tmp_path / f"{name}.stl")
    product = read_product(tmp_path, ReadOptions("mm"))
    joints = find_joints(product, TOLERANCE_M, "axes", "unscrew")
    (result,) = joints.contacts
    assert result.fit.kind == "squeezed"
    relieved = joints.relieve(product, TOLERANCE_M)
    entries = find_blocked(relieved, joints.directions, TOLERANCE_M).entries
    blocked = {entry.direction for entry in entries if entry.part == "plug"}
    assert (4 not in blocked) == leaves


def add_pins(pin_mm, *more):
    """Return a body of 20 x 10 x 8 mm over a board with two pins, 1 mm thick, through the board."""
    pins = [block((*pin_mm, 6), (x, 0, -1)) for x in (-5, 5)]
    return trimesh.boolean.union([block((20, 10, 8), (0, 0, 4.75)), *pins, *more])


@pytest.mark.parametrize(
    ("pin_mm", "more", "is_fit"),
    [
        ((1, 1), (), True),
        ((1, 2.5), (), True),
        ((1, 6), (), False),
        ((4, 4), (), False),
        ((1, 1), (((14, 4, 2), (0, 0, -4.5)),), False),
    ],
    ids=["square", "flat", "fin", "post", "riveted"],
)
def test_thin_pins_in_a_board_without_holes_are_a_fit_if_the_part_comes_straight_off(
    tmp_path, pin_mm, more, is_fit
):
    """The board is drilled for them, also where the part is drawn 0.25 mm sunk."""
    part = add_pins(pin_mm, *(block(*item) for item in more))
    sunk = trimesh.boolean.union([part, block((6, 4, 1), (0, 0, 1))])
    for name, mesh in (("board", block((60, 40, 1.5))), ("part", sunk)):
        mesh.export(tmp_path / f"{name}.stl")
    product = read_product(tmp_path, ReadOptions("mm"))
    joints = find_joints(product, TOLERANCE_M, "axes", "unscrew")
    (result,) = joints.contacts
    assert result.interferes == (not is_fit)
    relieved = joints.relieve(product, TOLERANCE_M)
    entries = find_blocked(relieved, joints.directions, TOLERANCE_M).entries
    free = set(range(6)) - {entry.direction for entry in entries if entry.part == "part"}
    assert free == ({4} if is_fit else set())
    if is_fit:
        assert result.fit.kind == "pins in solid"
        assert result.fit.volume_m3 == pytest.approx((3 * np.prod(pin_mm) + 6) * 1e-9, rel=0.01)
        board = relieved.parts[product.index("board")]
        drilled = trimesh.Trimesh(board.vertices_m, board.triangles)
        assert 3.6e-6 - drilled.volume == pytest.approx(result.fit.volume_m3, rel=1e-3)
        ((name, (words,)),) = list_thinned(product, joints, TOLERANCE_M, relieved).items()
        assert (name, words.split()[1:4]) == ("board", ["drawn", "without", "holes"])


def test_an_overlap_has_its_own_centre_and_depth_beside_faces_that_coincide(tmp_path, read_contact):
    """A block that fills a tray, whose wall it enters by 4.5 mm."""
    tray = ring((40, 50, 10), (30, 40, 10))
    path = tmp_path / "p.step"
    write_step(Product("p").add("tray", tray).add("block", box(-15, -10, -5, 15, 24.5, 5)), path)
    result = read_contact(path)
    assert result.interferes
    assert result.overlap_depth_m == pytest.approx(4.5e-3, rel=1e-3)
    assert result.overlap_point_m == pytest.approx((0, 0.02225, 0), abs=1e-5)


def test_a_press_fit_does_not_hide_that_the_shoulder_is_sunk(tmp_path):
    shoulder = trimesh.creation.cylinder(radius=10, height=10, sections=128)
    shoulder.apply_translation((0, 0, 14))
    pin = trimesh.creation.cylinder(radius=5.05, height=30, sections=128)
    write(tmp_path)
    trimesh.boolean.union([pin, shoulder]).export(tmp_path / "pin.stl")
    result = contact(tmp_path)
    assert result.interferes
    assert result.overlap_depth_m == pytest.approx(1e-3, rel=0.01)


def test_of_a_sunk_part_and_a_pressed_one_each_is_told_for_what_it_is_thinner(tmp_path):
    """A chip sunk in the face of a pressed pin, whose other end is sunk in a bar."""
    chip, bar = block((4, 4, 3)), block((6, 6, 100))
    chip.apply_translation((0, 0, 26.3))
    bar.apply_translation((0, 0, -59.8))
    product = read_product(write(tmp_path, 10.02, chip=chip, bar=bar), ReadOptions("mm"))
    joints = find_joints(product, TOLERANCE_M, "cylinders", "unscrew")
    loose = relieve_fits(product, joints.contacts, joints.fasteners, TOLERANCE_M, 1e-4)
    thinned = list_thinned(product, joints, TOLERANCE_M, loose)
    assert {name: [words.split()[1:3] for words in notes] for name, notes in thinned.items()} == {
        "chip": [["drawn", "sunk"]],
        "pin": [["drawn", "sunk"], ["written", "with"]],
    }


def test_a_shaft_in_a_core_hole_counts_as_a_thread_and_no_deeper(tmp_path):
    """ISO 261: M10 has a pitch of 1.5 mm, so its thread is 0.92 mm deep in a core hole."""
    (write(tmp_path, pin_mm=11.7) / "pin.stl").rename(tmp_path / "stud.stl")
    fit = contact(tmp_path, "hub", "stud").fit
    assert (fit.kind, fit.allowed_m) == ("thread", pytest.approx(0.92e-3, rel=0.01))
    assert compute_thread_depth_m(0.003) == pytest.approx(0.307e-3, rel=0.01)
    assert compute_thread_depth_m(0.1) == 0


@pytest.mark.parametrize(("name", "is_fit"), [("dowel", True), ("bar", False)])
def test_a_pin_in_a_solid_plate_counts_as_a_fit_if_its_name_says_so(tmp_path, name, is_fit):
    """Its hole is then drilled towards the nearer side, and the pin leaves along its axis."""
    pin = trimesh.creation.cylinder(radius=3, height=20, sections=48)
    pin.apply_translation((0, 0, 8))
    parts = {"plate": block((60, 60, 20)), name: pin}
    for part, mesh in parts.items():
        mesh.export(tmp_path / f"{part}.stl")
    product = read_product(tmp_path, ReadOptions("mm"))
    joints = find_joints(product, TOLERANCE_M, "axes", "unscrew")
    (result,) = joints.contacts
    assert result.interferes == (not is_fit)
    assert (result.fit is not None and result.fit.kind == "no hole") == is_fit
    drilled = relieve_fits(product, joints.contacts, joints.fasteners, TOLERANCE_M)
    entries = find_blocked(drilled, joints.directions, TOLERANCE_M).entries
    free = set(range(6)) - {entry.direction for entry in entries if entry.part == name}
    assert free == ({4} if is_fit else set())
    volume_mm3 = drilled.parts[drilled.index("plate")].volume_m3 * 1e9
    assert volume_mm3 == pytest.approx(72000)  # masses are those of the parts as drawn


@given(st.floats(1e-4, 1.0), st.floats(1e-4, 1.0))
def test_the_allowance_grows_with_the_diameter(first_m, second_m):
    low, high = sorted((first_m, second_m))
    assert 0 < compute_allowance_m(low) <= compute_allowance_m(high) <= 1.4e-3


def test_a_pair_that_does_not_exist_is_refused_with_the_nearest_name(capsys, tmp_path):
    (tmp_path / "parts").mkdir()
    source = str(write(tmp_path / "parts"))
    for pair, words in (("pin", "give two part names, as A,B"), ("pinn,hub", "Did you mean 'pin'")):
        words_given = ["import-cad", source, "--unit", "mm", "--out", str(tmp_path / "out")]
        assert run([*words_given, "--no-cache", "--press-fit", pair]) == 2
        assert words in " ".join(capsys.readouterr().err.split())


def test_patterns_declare_all_pairs_that_they_fit():
    options = ImportSettings(press_fit=("pin*,plate",)).resolve_fits(["pin 1", "pin 2", "plate"])
    assert options.press_fits == (("pin 1", "plate"), ("pin 2", "plate"))


# Radii of holes and their pins [mm]: of 0.1 and 0.02 mm of clearance, and pressed.
HOLES_MM, PINS_MM = (5.1, 5.02, 5.0), (5.0, 5.0, 5.01)
PLACES_MM = (-20.0, 0.0, 20.0)
PINS = ("pin_0", "pin_1", "pin_2", "peg")


def import_solids(folder, solids, *options):
    """Import solids [mm] by name from STL files, and return the folder of the task."""
    (folder / "parts").mkdir()
    for name, solid in solids.items():
        mesh = solid.to_mesh()
        trimesh.Trimesh(mesh.vert_properties, mesh.tri_verts).export(folder / f"parts/{name}.stl")
    out = folder / "out"
    words = ["import-cad", str(folder / "parts"), "--unit", "mm", "--no-cache", "--out", str(out)]
    assert run([*words, *options]) == 0
    return out


@pytest.fixture(scope="module")
def pinned(tmp_path_factory):
    """Return the folder of an import: a block, a pin in each of its holes, and a pressed peg."""
    folder = tmp_path_factory.mktemp("pinned")
    block = manifold3d.Manifold.cube((80, 60, 20), True).translate((0, 0, 10))
    solids = {}
    for number, (hole_mm, pin_mm, x_mm) in enumerate(
        zip(HOLES_MM, PINS_MM, PLACES_MM, strict=True)
    ):
        hole = manifold3d.Manifold.cylinder(10, hole_mm, hole_mm, 24)
        pin = manifold3d.Manifold.cylinder(25, pin_mm, pin_mm, 32)
        block -= hole.translate((x_mm, 15, 10))
        solids[f"pin_{number}"] = pin.translate((x_mm, 15, 10))
    block -= manifold3d.Manifold.cube((12, 12, 10), True).translate((0, -15, 15))
    solids["peg"] = manifold3d.Manifold.cube((12.3, 12, 25), True).translate((0, -15, 22.5))
    words = ("--no-nests", "--press-fit", "peg,block")
    return import_solids(folder, {"block": block, **solids}, *words)


@pytest.fixture(scope="module")
def pinned_plan(pinned):
    """Return the result of a search for the pins and the peg."""
    plan = pinned / "plan"
    words = ["search-optimal", str(pinned / "product.yaml"), "--collision", "swept"]
    assert run([*words, "--out", str(plan)]) == 0
    return str(plan)


def read_bodies(path):
    """Return the bodies of an OBJ file as solids [mm]."""
    bodies = trimesh.load(path, process=False).split()
    return [manifold3d.Manifold.hull_points(np.asarray(body.vertices) * 1e3) for body in bodies]


def test_pieces_of_a_fit_leave_its_clearance_and_the_task_says_which(pinned):
    """A fifth of the clearance is the most that pieces take; with less, there are 0.1 mm."""
    parts = yaml.safe_load((pinned / "product.yaml").read_text())["parts"]
    drawn_mm = {name: 1e3 * parts[name]["fits"]["block"]["drawn_m"] for name in PINS}
    assert drawn_mm == pytest.approx({"pin_0": 0.1, "pin_1": 0.02, "pin_2": -0.01, "peg": -0.15})
    pieces = read_bodies(pinned / "meshes/block.pieces.obj")
    goal_mm = 1e3 * np.array(parts["block"]["goal_m"])
    for name in PINS:
        fit = parts[name]["fits"]["block"]
        assert fit["play_m"] == 1e-4
        assert fit["outside_m"] <= 0.2 * fit["play_m"]
        (own,) = read_bodies(pinned / f"meshes/{name}.pieces.obj")
        (mesh,) = read_bodies(pinned / f"meshes/{name}.obj")
        assert (own - mesh).volume() < 1e-3
        at = own.translate(tuple(1e3 * np.array(parts[name]["goal_m"]) - goal_mm))
        # Off its seat.
        at = at.trim_by_plane((0, 0, 1), 10.1)
        assert min(piece.min_gap(at, 1.0) for piece in pieces) > 0.8 * 0.1 - 0.015


def test_pieces_leave_a_pressed_tab_its_slot(tmp_path):
    """The overlap of 0.7 mm on each side is no waist that the tab keeps: all of it has to pass."""
    out = import_solids(tmp_path, make_connector(), "--press-fit", "connector,board", "--up", "z")
    parts = yaml.safe_load((out / "product.yaml").read_text())["parts"]
    board, connector = (read_bodies(out / f"meshes/{name}.pieces.obj") for name in sorted(parts))
    shift_mm = 1e3 * (np.array(parts["connector"]["goal_m"]) - parts["board"]["goal_m"])
    for lift_mm in (0.0, 1.0, 2.0):
        at = tuple(shift_mm + np.array([0, 0, lift_mm]))
        met = [(own ^ piece.translate(at)).volume() for own in board for piece in connector]
        assert max(met) < 1e-3


def test_pieces_leave_a_cavity_that_is_not_round_to_the_part_that_goes_in(tmp_path):
    """A part with 0.1 mm of play would jam where they take more than a fifth of it.

    Its wall has a step of 0.003 mm: the hull of such a sheet would cross the way of the part. The
    groove of a lid that is drawn sunk on a ridge is a cavity, too.
    """
    oval = manifold3d.CrossSection.circle(1, 40)
    plug = oval.scale((14, 9)).extrude(20).translate((0, 0, 5))
    block = manifold3d.Manifold.cube((70, 50, 15), True).translate((0, 0, 7.5)) - plug
    block -= oval.scale((14.003, 9.003)).extrude(6).translate((0, 0, 9))
    for x_mm, y_mm in ((-25, -15), (-25, 15), (25, -15), (25, 15)):
        hole = manifold3d.Manifold.cylinder(20, 3, 3, 24)
        block -= hole.translate((x_mm, y_mm, -1))
    (tmp_path / "parts").mkdir()
    corners_mm = [(x, y, 25 + 0.15 * (x == 0)) for x in (-0.6, 0, 0.6) for y in (-4, 4)]
    plug += manifold3d.Manifold.hull_points(corners_mm)
    lid = manifold3d.Manifold.cube((30, 20, 5), True).translate((0, 0, 27.5))
    for name, solid in {"block": block, "plug": plug, "lid": lid}.items():
        mesh = solid.to_mesh()
        trimesh.Trimesh(mesh.vert_properties, mesh.tri_verts).export(tmp_path / f"parts/{name}.stl")
    out = tmp_path / "out"
    words = ["import-cad", str(tmp_path / "parts"), "--unit", "mm", "--no-nests", "--out", str(out)]
    assert run([*words, "--tolerance", "0.2", "--no-cache"]) == 0
    parts = yaml.safe_load((out / "product.yaml").read_text())["parts"]
    assert parts["plug"]["fits"]["block"]["outside_m"] <= 2e-5
    mesh = trimesh.load(out / "meshes/plug.obj")
    mesh = manifold3d.Mesh(np.float32(1e3 * mesh.vertices), np.uint32(mesh.faces))
    for name in ("block", "lid"):
        shift_mm = 1e3 * (np.array(parts["plug"]["goal_m"]) - np.array(parts[name]["goal_m"]))
        placed = manifold3d.Manifold(mesh).translate(tuple(shift_mm))
        pieces = read_bodies(out / f"meshes/{name}.pieces.obj")
        assert min(2 * piece.volume() / piece.surface_area() for piece in pieces) > 0.02
        filled = [part for part in (piece ^ placed for piece in pieces) if part.volume() > 1e-3]
        assert max((2 * part.volume() / part.surface_area() for part in filled), default=0) < 0.01


def test_pieces_of_a_grid_leave_the_narrow_gap_free_that_jaws_reach_into():
    """Pieces end before all 169 gaps are cut, the widest first; a finger would meet a hull."""
    grid = manifold3d.Manifold.cube((132, 132, 8))
    for i, j in np.ndindex(13, 13):
        width_mm = 4 if (i, j) == (6, 6) else 8
        gap = manifold3d.Manifold.cube((width_mm, width_mm, 10))
        grid -= gap.translate((2 + 10 * i, 2 + 10 * j, -1))
    mesh = grid.to_mesh()
    jaws = manifold3d.Manifold.cube((3, 3, 6)).translate((62.5, 62.5, 2))
    lane = Lane(manifold3d.Manifold(), 0.0, 2e-5, jaws)
    points_m, triangles = mesh.vert_properties / 1e3, mesh.tri_verts

    def are_free(lane_of_cut):
        pieces = decompose_convex(points_m, triangles, 1e-3, (), lane_of_cut)
        return lane.frees_jaws(corners for corners, _ in pieces)

    assert are_free(lane)
    assert not are_free(None)


def test_pieces_of_a_wide_hole_do_not_reach_into_the_part_that_goes_through_it():
    """A hole 1 mm wider than the part on each side, in a plate that is cut for that part alone."""
    hole, room, part = (
        manifold3d.Manifold.cylinder(22, radius, radius, 96).translate((0, 0, -1))
        for radius in (18.5, 17.74, 17.5)
    )
    plate = manifold3d.Manifold.cylinder(20, 40, 40, 96) - hole
    mesh = plate.to_mesh()
    lane = Lane(room ^ (plate.hull() - plate), 2.4e-4, 2e-5, manifold3d.Manifold())
    pieces = decompose_convex(mesh.vert_properties / 1e3, mesh.tri_verts, 5e-3, (), lane)
    hulls = [manifold3d.Manifold.hull_points(corners * 1e3) for corners, _ in pieces]
    assert max((hull ^ part).volume() for hull in hulls) < 1e-3


def test_a_strip_that_no_cut_frees_leaves_the_way_of_parts():
    """Its hull would fill the way before a ledge; both halves of any cut are sheer."""
    strip = manifold3d.Manifold.cube((0.02, 0.01, 8.8))
    strip += manifold3d.Manifold.cube((0.02, 0.15, 1)).translate((0, 0, 3.9))
    solid = strip + manifold3d.Manifold.cube((2, 2, 8.8)).translate((0, -3, 0))
    way = manifold3d.Manifold.cube((0.02, 1, 3.9)).translate((0, 0.01, 0))
    lane, mesh = Lane(way, 1e-4, 2e-5, manifold3d.Manifold()), solid.to_mesh()
    pieces = decompose_convex(mesh.vert_properties / 1e3, mesh.tri_verts, 3e-4, (), lane)
    hulls = [manifold3d.Manifold.hull_points(corners * 1e3) for corners, _ in pieces]
    assert hulls
    assert sum((hull ^ way).volume() for hull in hulls) < 1e-4


@pytest.mark.slow(reason="simulates; the shapes are tested in every run")
@pytest.mark.parametrize("engine", ["mujoco", "pybullet"])
def test_pins_and_pegs_of_real_fits_go_in_and_the_answer_says_with_which_play(
    pinned_plan, engine, capsys
):
    if engine == "pybullet" and sys.version_info >= (3, 12):
        pytest.skip("pybullet has no wheels for this Python")
    capsys.readouterr()
    assert run(["simulate", pinned_plan, "--physics", engine, "--format", "json"]) == 0
    simulated = json.loads(capsys.readouterr().out)
    assert simulated["feasible"]
    assert simulated["complete"]
    assert simulated["largest_offset_mm"] < 0.5
    (sentence,) = [words for words in simulated["not_checked"] if words.startswith("fits")]
    assert "pin_2 in block (drawn -0.01 mm)" in sentence
    assert "pin_1 in block (drawn 0.02 mm)" in sentence
    assert "pin_0" not in sentence
    springs = any("it is on 10 N/mm" in words for words in simulated["not_checked"])
    assert springs == (engine == "mujoco")


def test_a_sleeve_over_a_post_and_blocks_side_by_side_have_play_and_chamfers_in_any_order(tmp_path):
    """Slivers are thinner than the play, pieces meet at corners, either block may come last.

    A collar keeps its seat.
    """
    cube, cylinder = manifold3d.Manifold.cube, manifold3d.Manifold.cylinder
    frame = cube((140, 70, 30), True).translate((10, 0, 15))
    frame -= cube((80, 40, 25), True).translate((0, 0, 17.5))
    square = cube((6, 6, 40), True).translate((-50, 0, 50))
    solids = {"frame": frame + cylinder(40, 6, 6, 36).translate((62, 0, 30)) + square}
    for name, x_mm in (("left", -20), ("right", 20)):
        solids[name] = cube((40, 40, 35), True).translate((x_mm, 0, 22.5))
    sleeve = cylinder(30, 9, 9, 44) - cylinder(30, 6, 6, 36)
    solids["sleeve"] = sleeve.translate((62, 0, 30))
    cap = cube((18, 18, 18), True) - cube((18, 6, 6), True) - cube((6, 18, 6), True)
    solids["cap"] = cap.translate((-50, 0, 39)) - square
    # Its collar rests on a ring narrower than a chamfer.
    bore = cylinder(24, 3.02, 3.02, 36) + cylinder(9, 3.46, 3.46, 36).translate((0, 0, 20))
    solids["frame"] -= bore.translate((62, 24, 6))
    stud = cylinder(20, 3, 3, 36) + cylinder(12, 3.4, 3.4, 36).translate((0, 0, 20))
    solids["stud"] = stud.translate((62, 24, 6))
    out = import_solids(tmp_path, solids, "--no-nests")
    corners = trimesh.load(out / "meshes/stud.pieces.obj", force="mesh").vertices * 1e3
    ring = corners[np.abs(corners[:, 2] - 20) < 0.02]
    assert np.hypot(ring[:, 0], ring[:, 1]).max() > 3.05
    posts = {
        "sleeve": cylinder(30, 6, 6, 36),
        "cap": cube((6, 6, 18), True).translate((0, 0, 9)),
    }
    for name, post in posts.items():
        # Within the play, too, corners of a pocket do not meet those of its post.
        aside = post.translate((0.05, 0.05, 0))
        pieces = read_bodies(out / f"meshes/{name}.pieces.obj")
        assert min(piece.min_gap(post, 1.0) for piece in pieces) > 0.099
        assert min(piece.min_gap(aside, 1.0) for piece in pieces) > 0.02
    for name in ("left", "right"):
        (block,) = read_bodies(out / f"meshes/{name}.pieces.obj")
        low, high = np.reshape(block.trim_by_plane((0, 0, -1), -0.01).bounding_box(), (2, 3))
        assert (high - low)[:2] == pytest.approx([39.0, 39.0], abs=0.3)


def test_thin_leaves_between_two_walls_do_not_leave_each_other_out(tmp_path):
    """Each is thinner than its play, and the other one lies behind it."""
    cube = manifold3d.Manifold.cube
    base = cube((60, 40, 10))
    for x_mm in (9.92, 30.08):
        base += cube((20, 24, 30)).translate((x_mm, 8, 10))
    leaves = cube((20, 20, 12)).translate((20, 10, 40))
    for x_mm in (29.92, 30.01):
        leaves += cube((0.07, 20, 29)).translate((x_mm, 10, 10))
    out = import_solids(tmp_path, {"base": base, "leaves": leaves}, "--no-nests")
    assert len(read_bodies(out / "meshes/leaves.pieces.obj")) == 3


@pytest.mark.slow(reason="an import; the parts of it are tested in every run")
def test_a_peg_that_only_a_hole_holds_is_supported_and_goes_in_from_the_side(tmp_path):
    """Its centre is beside the wall: with the play of the fit it tips before the hole holds."""
    cube = manifold3d.Manifold.cube
    wall = cube((120, 90, 15), True).translate((0, 0, 7.5))
    wall += cube((20, 90, 50), True).translate((-50, 0, 25))
    wall -= cube((30, 12, 12), True).translate((-50, 0, 40))
    solids = {"wall": wall, "peg": cube((80, 12, 12), True).translate((-20, 0, 40))}
    for name, y_mm in (("left", 30), ("right", -30)):
        solids[name] = cube((20, 16, 20), True).translate((30, y_mm, 25))
    out = import_solids(tmp_path, solids)
    task = yaml.safe_load((out / "product.yaml").read_text())
    assert ["peg"] in [holder["parts"] for holder in task["holders"].values()]
    (along,) = task["parts"]["peg"]["insert_along"]
    assert along == [-1.0, 0.0, 0.0]
    (own,) = read_bodies(out / "meshes/peg.pieces.obj")
    leading, rest = sorted(
        (piece.bounding_box() for piece in own.split_by_plane((1, 0, 0), -39.9)),
        key=lambda box: box[0],
    )
    assert leading[2] - rest[2] > 0.3, "its leading end has chamfers, the underside too"
    assert rest[5] - leading[5] > 0.3


def test_no_piece_is_a_lid_over_a_hole_in_a_sheet():
    """Cuts leave sheets of a tapered plate, whose hulls would be lids of a few micrometres."""
    ends = [(0, y, 0) for y in (-14, 14)] + [(80, y, z) for y in (-14, 14) for z in (0, 0.06)]
    way, hole = (
        manifold3d.Manifold.cylinder(9, radius, radius, 32).translate((10, 0, -3))
        for radius in (7.4, 7.5)
    )
    sheet = manifold3d.Manifold.hull_points(np.array(ends, dtype=float)) - hole
    solid = sheet + manifold3d.Manifold.cube((80, 28, 3)).translate((0, 40, 0))
    lane, mesh = Lane(way ^ solid.hull(), 1e-4, 2e-5, manifold3d.Manifold()), solid.to_mesh()
    pieces = decompose_convex(mesh.vert_properties / 1e3, mesh.tri_verts, 3e-4, (), lane)
    hulls = [manifold3d.Manifold.hull_points(points * 1e3) for points, _ in pieces]
    assert hulls
    assert max((hull ^ way).volume() for hull in hulls) < 1e-3
