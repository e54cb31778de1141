"""A plan becomes a task: meshes, grasps, directions, screws and a tray within the arm's reach."""

from __future__ import annotations

import io
import math
from dataclasses import replace

import manifold3d
import numpy as np
import pytest
import trimesh
import yaml

import skillplan_cad as cad
from cad_fixtures import box, part_of, rod
from cad_products import product as fixture
from cad_products import related, relation
from skillplan import load_problem
from skillplan.cli import run
from skillplan.domains.assembly import AssemblyDomain
from skillplan.errors import Issue
from skillplan.robots import ARMS
from skillplan.task import Pose
from skillplan_mujoco import MujocoSimulator
from skillplan_simulation import ExecutionSettings, get_hand

TOLERANCE_M = 1e-4
HAND = ARMS["panda"][1]
UP, DOWN = (0.0, 0.0, 1.0), (0.0, 0.0, -1.0)


def relate(product):
    """Return a product, its relation and its plan."""
    known = related(product)
    return product, known, cad.Planner(product, known).plan()


@pytest.fixture(scope="module")
def eight():
    """Eight parts: product, relation and plan."""
    product, known = fixture("eight"), relation("eight")
    return product, known, cad.Planner(product, known).plan()


@pytest.fixture(scope="module")
def written(eight):
    return cad.build_task(*eight)


@pytest.fixture(scope="module")
def screwed():
    """A plate that one screw holds on its base: product, relation and plan."""
    solids = {
        "base": box(0, 0, 0, 60, 40, 20) - rod(30, 20, 10, 2, 10),
        "plate": box(0, 0, 20, 60, 40, 30) - rod(30, 20, 20, 2, 10),
        "M4 screw": rod(30, 20, 15, 2, 15) + rod(30, 20, 30, 4, 3),
    }
    return relate(product_of(solids))


@pytest.fixture(scope="module")
def screwed_task(screwed):
    return cad.build_task(*screwed)


def test_the_plan_of_eight_parts_is_the_cheapest_and_needs_no_turn_and_no_second_hand(eight):
    plan = eight[2]
    assert (plan.base, plan.complete, plan.cheapest) == ("base", True, True)
    along = {step.parts[0]: step.along for step in plan.steps}
    assert along.pop("slide") == (1.0, 0.0, 0.0)
    assert set(along.values()) == {(0.0, 0.0, -1.0)}
    assert not any(step.turn or step.held or step.tips for step in plan.steps)
    order = [step.parts[0] for step in plan.steps]
    assert order.index("slide") < order.index("cover") < order.index("screw_1")
    assert [step.tool for step in plan.steps].count("screwdriver") == 2


def test_the_plan_stands_when_finer_solids_are_taken_apart(eight):
    _, known, plan = eight
    finer = fixture("eight", 0.02)
    assert cad.replay(finer, known, plan, TOLERANCE_M / 2).agrees


def test_identical_parts_come_from_one_feeder_and_screws_go_to_their_holes(written):
    document = written.document
    parts, screws = document["parts"], document["screws"]
    assert parts["post_1"]["feeder"] == parts["post_2"]["feeder"] == "post_1_feeder"
    assert [screw["through"] for screw in screws.values()] == ["cover", "cover"]
    for name, post in (("screw_1", "post_1"), ("screw_2", "post_2")):
        x, y, z = screws[name]["hole_m"]
        assert (x, y) == pytest.approx(parts[post]["goal_m"][:2], abs=1e-6)
        assert z == pytest.approx(0.047, abs=1e-6)
        assert screws[name]["head_diameter_m"] == pytest.approx(0.007, abs=1e-4)
    assert written.limits == {}


def test_a_head_is_seated_on_the_face_below_it_though_the_shank_fills_its_hole(screwed_task):
    """No play between shank and plate: both faces belong to one contact."""
    document = screwed_task.document
    assert document["screws"]["M4_screw"]["hole_m"][2] == pytest.approx(0.030, abs=1e-6)
    assert document["screws"]["M4_screw"]["head_height_m"] == pytest.approx(0.003, abs=1e-6)


def test_a_screw_that_holds_in_the_part_below_its_head_goes_through_it():
    """CAD draws the hole behind it wider than the shank."""
    solids = {
        "base": box(0, 0, 0, 60, 40, 20) - rod(30, 20, 10, 3, 10),
        "plate": box(0, 0, 20, 60, 40, 30) - rod(30, 20, 20, 1.9, 10),
        "M4 screw": rod(30, 20, 15, 2, 15) + rod(30, 20, 30, 4, 3),
    }
    task = cad.build_task(*relate(product_of(solids)))
    assert task.document["screws"]["M4_screw"]["through"] == "plate"
    assert task.document["screws"]["M4_screw"]["hole_m"][2] == pytest.approx(0.030, abs=1e-6)


@pytest.mark.parametrize("height_mm", [0.12, 0.5])
def test_a_screw_that_is_drawn_over_its_seat_is_driven_home(screwed_task, height_mm):
    """Its head has no contact with the plate."""
    solids = {
        "base": box(0, 0, 0, 60, 40, 20) - rod(30, 20, 10, 2, 10),
        "plate": box(0, 0, 20, 60, 40, 30) - rod(30, 20, 20, 2, 10),
        "M4 screw": rod(30, 20, 15 + height_mm, 2, 15) + rod(30, 20, 30 + height_mm, 4, 3),
    }
    task = cad.build_task(*relate(product_of(solids)))
    assert task.document["screws"] == screwed_task.document["screws"]
    (words,) = task.limits["M4 screw"]
    assert words.startswith(f"is drawn {height_mm} mm over plate, and driven home")


def test_pieces_leave_the_counterbore_free_in_which_a_chamfered_head_sinks():
    chamfer = manifold3d.Manifold.cylinder(0.3, 3.7, 4, 48).translate([30, 20, 24])
    solids = {
        "base": box(0, 0, 0, 60, 40, 20) - rod(30, 20, 10, 2, 10),
        "plate": box(0, 0, 20, 60, 40, 30) - rod(30, 20, 20, 2, 10) - rod(30, 20, 24, 4.2, 9),
        "M4 screw": rod(30, 20, 12, 2, 12) + chamfer + rod(30, 20, 24.3, 4, 3),
    }
    task = cad.build_task(*relate(product_of(solids)))
    head, (pieces,) = rod(0, 0, 4, 4, 3), task.pieces.pieces["plate"]
    hulls = [manifold3d.Manifold.hull_points(corners * 1e3) for corners, _ in pieces]
    assert max((hull ^ head).volume() for hull in hulls) < 1e-3


@pytest.mark.parametrize(("bore_mm", "width_mm"), [(4.0, 7.8), (4.05, 7.9), (4.2, 8.0)])
def test_a_head_has_play_in_its_counterbore(bore_mm, width_mm):
    solids = {
        "base": box(0, 0, 0, 60, 40, 20) - rod(30, 20, 10, 2, 10),
        "plate": box(0, 0, 20, 60, 40, 30) - rod(30, 20, 20, 2, 10) - rod(30, 20, 24, bore_mm, 9),
        "M4 screw": rod(30, 20, 12, 2, 12) + rod(30, 20, 24, 4, 3),
    }
    task = cad.build_task(*relate(product_of(solids)))
    written_mm = 1e3 * task.document["screws"]["M4_screw"]["head_diameter_m"]
    # Chords of a round wall lie within its radius.
    assert written_mm == pytest.approx(width_mm, abs=0.02)
    is_narrower = any("as plate leaves it" in words for words in task.limits.get("M4 screw", ()))
    assert is_narrower == (width_mm < 8)


def test_pieces_do_not_stand_out_of_the_face_that_a_jaw_presses():
    """A step of 0.25 mm below the jaw is less than other gaps of pieces may be wide."""
    solids = {
        "base": box(0, 0, 0, 60, 60, 10),
        "wall": box(10, 25, 10, 50, 35, 20) + box(10, 25, 20, 50, 34.75, 60),
    }
    task = cad.build_task(*relate(product_of(solids)))
    grasps, (pieces,) = task.document["parts"]["wall"]["grasp"], task.pieces.pieces["wall"]
    hulls = [manifold3d.Manifold.hull_points(corners * 1e3) for corners, _ in pieces]
    across = [grasp for grasp in grasps if grasp["closing_axis"] == "y"]
    assert across
    for grasp in across:
        face_mm = 1e3 * (grasp["at_m"][1] + grasp["width_m"] / 2)
        jaw = box(-5, face_mm + 0.05, 50 - 1e3 * grasp["depth_m"], 5, 20, 50)
        assert max((hull ^ jaw).volume() for hull in hulls) < 1e-3


def test_a_round_part_on_its_side_comes_from_a_feeder_as_it_rolls():
    shaft = rod(0, 0, -30, 10, 60).rotate((0, 90, 0)).translate((30, 20, 30))
    product = product_of({"base": box(0, 0, 0, 60, 40, 30) - shaft, "shaft": shaft})
    base, part = product.parts
    sides = part.vertices_m[part.triangles][:, 1:] - part.vertices_m[part.triangles][:, :1]
    (around,) = np.nonzero(np.abs(np.cross(*sides.swapaxes(0, 1))[:, 0]) < 1e-12)
    face = cad.Face("cylinder", around, (0.03, 0.02, 0.03), (1.0, 0.0, 0.0), 0.01)
    product = replace(product, parts=(base, replace(part, faces=(face,), shape=1)))
    document = cad.build_task(*relate(product)).document
    assert document["parts"]["shaft"]["feeder"] == "shaft_feeder"
    assert "feeder" not in document["parts"]["base"]


def test_a_screw_without_a_head_is_left_out_with_the_reason():
    solids = {
        "base": box(0, 0, 0, 60, 40, 20) - rod(30, 20, 10, 2, 10),
        "plate": box(0, 0, 20, 60, 40, 30) - rod(30, 20, 20, 2, 10),
        "M4 screw": rod(30, 20, 12, 2, 18),
    }
    task = cad.build_task(*relate(product_of(solids)))
    assert {name: reason.kind for name, reason in task.left_out.items()} == {"M4 screw": "no head"}


def test_a_bolt_from_above_goes_in_before_the_nut_that_is_left_out():
    solids = {
        "base": box(0, 0, 0, 60, 40, 20) - rod(30, 20, 0, 2.1, 20) - rod(30, 20, 0, 6, 6),
        "M4 bolt": rod(30, 20, 1, 2, 19) + rod(30, 20, 20, 4, 3),
        "M4 nut": rod(30, 20, 2, 5, 4) - rod(30, 20, 2, 2, 4),
    }
    task = cad.build_task(*relate(product_of(solids)))
    assert {name: reason.kind for name, reason in task.left_out.items()} == {"M4 nut": "from below"}
    assert task.document["screws"]["M4_bolt"]["through"] == "base"
    assert task.limits["M4 bolt"] == ("is put in without M4 nut",)


def product_of(solids):
    """Return a product of solids in millimetres."""
    parts = tuple(part_of(name, solid) for name, solid in solids.items())
    return cad.Product("solids", parts, "mm", 5e-5)


def test_the_slide_goes_in_from_the_side_and_the_cover_rests_on_both_posts(written):
    parts = written.document["parts"]
    assert parts["slide"]["insert_along"] == [[1.0, 0.0, 0.0]]
    assert parts["cover"]["goal_on"] == ["post_1", "post_2"]
    assert "insert_along" not in parts["cover"]


def test_written_meshes_enclose_what_the_parts_do(eight, written, tmp_path):
    product = eight[0]
    for part in product:
        if part.name not in written.document["parts"]:
            continue
        volume = 0.0
        for mesh in written.document["parts"][part.name]["meshes"]:
            path = tmp_path / "mesh.obj"
            path.write_text(written.files[mesh["file"]], "utf-8")
            loaded = trimesh.load(path, force="mesh")
            assert loaded.is_watertight
            volume += loaded.volume
        # Volumes are exact, and chords cut off up to a hundredth of a round part.
        assert volume == pytest.approx(part.volume_m3, rel=1e-2)


def test_pieces_are_few_and_block_what_the_true_meshes_do(written):
    """A plug in a round hole and a slide in a dovetail go in past them."""
    assert written.pieces.differences == ()
    counts = {name: sum(map(len, piece)) for name, piece in written.pieces.pieces.items()}
    assert counts["plug"] == 1
    assert max(counts.values()) < 80
    for name, entry in written.document["parts"].items():
        for mesh in entry["meshes"]:
            assert written.files[mesh["pieces"]].startswith("o piece_1"), name


def test_identical_parts_have_identical_pieces(written):
    posts = [written.files[f"meshes/post_{number}.pieces.obj"] for number in (1, 2)]
    assert posts[0] == posts[1]


def test_jaws_lift_the_heaviest_part_by_friction(written):
    """The base weighs 12.9 N; at friction 0.6 two jaws need more than 10.7 N each."""
    parts = written.document["parts"]
    gripper = written.document["tools"]["gripper"]
    weight_n = 9.81 * max(part["mass_kg"] for part in parts.values() if part["tool"] == "gripper")
    assert 2 * 0.6 * gripper["force_n"] > 3 * weight_n
    assert gripper["force_n"] <= 70


def test_equal_parts_have_grasps_of_their_own_without_references(written):
    parts = written.document["parts"]
    assert parts["post_1"]["grasp"] == parts["post_2"]["grasp"]
    assert "&id" not in written.files["product.yaml"]


def test_shanks_of_screws_hang_clear_of_the_table_in_their_feeder(written):
    feeders = written.document["feeders"]
    assert feeders["screw_1_feeder"]["height_m"] > 0.012
    assert "height_m" not in feeders["post_1_feeder"]


def test_the_file_is_what_the_document_says_and_the_same_every_time(screwed, screwed_task):
    assert yaml.safe_load(screwed_task.files["product.yaml"]) == screwed_task.document
    assert cad.build_task(*screwed).files == screwed_task.files


def test_parts_that_passed_their_trial_are_written_if_time_is_over(screwed, screwed_task):
    """Writing is interrupted at the end of its work; no part is tried again."""
    shares = []

    def attempt(make, share):
        made = make()
        if not hasattr(made, "document"):
            # Pieces, trials and orders, which are done in time.
            return made
        shares.append(share)
        return None if share < 1 else made

    task = cad.build_task(
        *screwed, watch=cad.Watch(must_stop=lambda share: bool(shares[1:]), attempt=attempt)
    )
    assert task.names == screwed_task.names
    assert len(shares) == 2
    nothing = cad.build_task(*screwed, watch=cad.Watch(attempt=lambda make, share: None))
    assert (nothing.document, nothing.names) == ({}, {})
    assert {reason.kind for reason in nothing.left_out.values()} == {"not examined"}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("has_more", "kinds"),
    [(False, ["pick", "place"] * 2), (True, ["pick", "place"] * 2 + ["fasten"])],
)
def test_an_order_is_found_of_the_parts_that_were_tried_in_time(screwed, has_more, kinds):
    """Trials end at 65 % of the time; with time left, the other parts are tried as well."""
    trials = iter([True, True, False])
    task = cad.build_task(
        *screwed,
        watch=cad.Watch(
            attempt=lambda make, share: make() if share > 0.65 or next(trials, has_more) else None
        ),
    )
    brought = [skill.partition("(")[0] for skill in task.skills]
    assert [kind for kind in brought if kind in {*kinds}] == kinds
    assert {*task.left_out} == (set() if has_more else {"M4 screw"})
    assert {reason.kind for reason in task.left_out.values()} <= {"not examined"}


def test_a_station_stays_as_high_when_its_last_orientation_is_gone():
    solids = {"base": box(0, 0, 0, 60, 40, 20), "plate": box(0, 0, 20, 60, 40, 30)}
    parts = product_of(solids | {"cap": box(0, 0, 30, 60, 40, 35)}).parts
    names = {part.name: part.name for part in parts}
    bearing = cad.Bearing(UP, tuple(names), turned={"plate": DOWN, "cap": (1.0, 0.0, 0.0)})
    before = cad.lay_out_parts(parts, parts, names, (), bearing, "panda")
    fewer = replace(bearing, order=("base", "plate"), turned={"plate": DOWN})
    alone = cad.lay_out_parts(parts[:2], parts[:2], names, (), fewer, "panda")
    after = cad.lay_out_parts(parts[:2], parts[:2], names, (), fewer, "panda", before=before)
    assert len(after.upright.poses) == 2
    assert alone.upright.pivot_m[2] < before.upright.pivot_m[2]
    assert after.upright.pivot_m == before.upright.pivot_m
    assert after.upright.of("plate") is before.upright.of("plate")


@pytest.mark.slow
def test_what_was_checked_of_an_order_when_the_time_is_over_is_a_task_with_an_order(screwed):
    """The check with all paths ends at the fifth skill, which picks the third part."""
    task = cad.build_task(
        *screwed,
        watch=cad.Watch(attempt=lambda make, share: make() if share != 0.9 else None),
    )
    assert len(task.names) == 2
    assert [skill.partition("(")[0] for skill in task.skills] == ["pick", "place"] * 2
    assert task.doubt == ""
    assert {reason.kind for reason in task.left_out.values()} <= {"not examined", "follows"}


def test_a_body_that_touches_itself_along_an_edge_is_in_the_task():
    """Two posts that meet in an edge, on a plate; without it, each is a mesh of its own."""
    posts = box(0, 0, 20, 20, 20, 60) + box(20, 20, 20, 40, 40, 60)
    base, plate = box(-20, -20, 0, 60, 60, 20), box(0, 0, 20, 40, 40, 30)
    for solid, count in ((posts + plate, 1), (posts, 2)):
        task = cad.build_task(*relate(product_of({"base": base, "posts": solid})))
        assert set(task.names) == {"base", "posts"}
        files = [mesh["file"] for mesh in task.document["parts"]["posts"]["meshes"]]
        assert len(files) == count
        texts = [io.StringIO(task.files[file]) for file in files]
        assert all(trimesh.load(text, "obj", force="mesh").is_watertight for text in texts)


def finder_of(solid, name="part"):
    """Return the search for grasps of a part that stands with its centre over the origin."""
    part = part_of(name, solid)
    low, high = part.bounds_m
    bottom = np.array([*(low + high)[:2] / 2, low[2]])
    return cad.GraspFinder(part, part.vertices_m - bottom, np.asarray(part.centre_m) - bottom)


@pytest.mark.parametrize(
    ("solid", "width_m", "at_m"),
    [
        (box(0, 0, 0, 50, 60, 10) + box(0, 0, 10, 10, 60, 100), 0.010, -0.020),
        (box(0, 0, 0, 200, 90, 8) + box(80, 35, 8, 100, 55, 30), 0.020, -0.010),
    ],
    ids=["the wall of an angle", "the knob of a plate"],
)
def test_jaws_close_on_opposite_faces_of_the_mesh(solid, width_m, at_m):
    """Its box is wider, and in the middle of the box there is nothing, or too much."""
    grasps = finder_of(solid).find_jaw_grasps(HAND, [DOWN], 0.0)
    found = [grasp.entry for grasp in grasps if grasp.entry["closing_axis"] == "x"]
    assert found
    for entry in found:
        assert entry["width_m"] == pytest.approx(width_m, abs=1e-6)
        assert entry["at_m"][0] == pytest.approx(at_m, abs=1e-5)


def test_jaws_hold_a_ring_from_outside_and_a_high_one_from_inside():
    """A washer of 1 mm, with a hole in the middle of which nothing is between the jaws."""
    washer = finder_of(rod(0, 0, 0, 6, 1) - rod(0, 0, -1, 3, 3))
    grasps = washer.find_jaw_grasps(HAND, [DOWN], 0.0)
    assert max(grasp.entry["width_m"] for grasp in grasps) == pytest.approx(0.012, abs=1e-4)
    # Tips would be in the table below a washer, and rays of a large part are 7 mm apart.
    slim = replace(HAND, jaw_m=((0.0, 0.002, 0.0, 0.001), (0.05, 0.002, 0.0, 0.001)))
    assert washer.find_inner_grasps(slim, [DOWN]) == []
    assert finder_of(box(0, 0, 0, 20, 20, 500)).find_inner_grasps(slim, [DOWN]) == []
    ring = finder_of(rod(0, 0, 0, 15, 5) - rod(0, 0, -1, 7, 7))
    assert {grasp.entry["hold"] for grasp in ring.find_inner_grasps(slim, [DOWN])} == {"inner"}


def test_jaws_reach_below_the_bevel_of_a_part_on_which_rays_are_wide_apart():
    """On the bevel, a single row of rays does not show that it slopes."""
    post = (box(0, 0, 0, 40, 40, 255) + box(5, 0, 0, 35, 40, 260)).hull()
    grasps = finder_of(post).find_jaw_grasps(HAND, [DOWN], 0.0)
    widths_m = [grasp.entry["width_m"] for grasp in grasps if grasp.entry["closing_axis"] == "x"]
    assert widths_m
    assert min(widths_m) == pytest.approx(0.04, abs=1e-4)


def test_jaws_close_across_small_faces_that_are_a_little_askew():
    """Along y, they would turn the key by 2 degrees until its ends are flush with them."""
    key = box(-3.5, -7.5, 30, 3.5, 7.5, 31).rotate((0.0, 0.0, -2.0)) + rod(0, 0, 0, 2.5, 30)
    grasps = finder_of(key).find_jaw_grasps(HAND, [DOWN], 0.0)
    closings = [grasp.entry["closing_axis"] for grasp in grasps]
    assert "y" not in closings
    widths_m = [grasp.entry["width_m"] for grasp in grasps if grasp.entry["closing_axis"][1] > 0.9]
    assert widths_m[0] == pytest.approx(0.015, abs=1e-5)


def test_a_plate_that_is_wider_than_jaws_open_is_held_by_no_jaws():
    assert finder_of(box(0, 0, 0, 100, 90, 12)).find_jaw_grasps(HAND, [DOWN], 0.0) == []


def test_a_cup_stands_on_material():
    """In the middle of a plate, beside its hole, and on a ring if it is narrow enough."""
    plate = box(0, 0, 0, 100, 90, 8)
    assert finder_of(plate).find_cup_place(0.016) == pytest.approx((0.0, 0.0))
    holed = finder_of(plate - box(40, 35, -1, 60, 55, 20))
    x, y = holed.find_cup_place(0.016)
    assert max(abs(x), abs(y)) > 0.018
    ring = finder_of(box(0, 0, 0, 60, 60, 5) - box(10, 10, -1, 50, 50, 9))
    assert ring.find_cup_place(0.016) is None
    assert ring.find_cup_place(0.006) is not None


def test_a_cup_lifts_no_more_than_its_area_does():
    """2 kg of steel hang on 32 mm, not on 16 mm."""
    heavy = finder_of(box(0, 0, 0, 150, 100, 17))
    assert heavy.find_cup_place(0.016) is None
    assert heavy.find_cup_place(0.032) == pytest.approx((0.0, 0.0))


def test_a_needle_picks_up_a_washer_of_m2_next_to_its_hole():
    """The needle stands between hole and rim. A wider cup has no room there, or would peel off."""
    washer = finder_of(rod(0, 0, 0, 2.5, 0.3) - rod(0, 0, -1, 1.1, 3))
    x, y = washer.find_cup_place(0.0008)
    assert 1.6 <= 1e3 * math.hypot(x, y) <= 2.0
    assert washer.find_cup_place(0.0025) is None
    plate = box(0, 0, 0, 20, 20, 2)
    assert finder_of(plate).find_cup_place(0.0025) == pytest.approx((0.0, 0.0))
    assert finder_of(plate - box(5, 5, -1, 15, 15, 9)).find_cup_place(0.0025) is None


@pytest.mark.slow(reason="imports a product of two parts")
def test_a_ring_at_the_bottom_of_a_bore_that_leaves_fingers_no_room_is_brought_by_a_needle(
    capsys, tmp_path
):
    """Neither tips nor the narrow cup reach it: 0.2 mm around it, and a face 1.3 mm wide."""
    solids = {
        "block": box(-20, -20, 0, 20, 20, 12) - rod(0, 0, 8, 2.7, 9),
        "ring": rod(0, 0, 8, 2.5, 0.5) - rod(0, 0, 7, 1.2, 3),
    }
    (tmp_path / "product").mkdir()
    for name, solid in solids.items():
        mesh = solid.to_mesh()
        trimesh.Trimesh(mesh.vert_properties[:, :3], mesh.tri_verts).export(
            tmp_path / "product" / f"{name}.stl"
        )
    out = tmp_path / "out"
    options = ["--unit", "mm", "--up", "z", "--out", str(out), "--no-cache"]
    assert run(["import-cad", str(tmp_path / "product"), *options]) == 0, capsys.readouterr().err
    task = yaml.safe_load((out / "product.yaml").read_text("utf-8"))
    assert task["parts"]["ring"]["tool"] == "vacuum_needle"
    assert task["tools"]["vacuum_needle"]["cup_diameter_m"] == 0.0008


@pytest.mark.slow
def test_of_two_walls_that_leave_no_room_for_fingers_one_is_in_no_order():
    """Each can be placed alone; beside the other a finger does not fit, and their ends slope."""
    walls = [
        (
            name,
            manifold3d.Manifold.batch_hull(
                [box(10, y, 20, 110, y + 4, 21), box(40, y, 79, 80, y + 4, 80)]
            ),
        )
        for name, y in (("left", 20), ("right", 25.5))
    ]
    task = assembled(("block", box(0, 0, 0, 120, 60, 20)), *walls)
    ((name, reason),) = task.left_out.items()
    assert (reason.kind, *reason.by) in {("no order", "left"), ("no order", "right")}
    assert "a finger runs into" in reason.text
    placed = [skill for skill in task.skills if skill.startswith("place")]
    assert placed == [f"place({other})" for other in ("block", "left", "right") if other != name]
    assert not task.doubt


@pytest.mark.parametrize(
    ("width_mm", "height_mm", "closing", "gripper"),
    [
        (72, 50, ("x", 0.072), "robotiq_2f85"),
        (79, 40, ("x", 0.079), "robotiq_2f85"),
        (110, 20, ("y", 0.1), "robotiq_2f140"),
        (110, 60, ("y", 0.1), "long_jaws"),
    ],
)
def test_the_lightest_gripper_of_the_catalogue_holds_what_no_hand_and_no_cup_does(
    width_mm, height_mm, closing, gripper
):
    """A block whose top is a ridge; that of 5.1 kg is beyond the payload of light grippers.

    The hand has room for the narrowest one of 3 kg, but not the force.
    """
    low = box(0, 0, 0, width_mm, 100, height_mm)
    solid = manifold3d.Manifold.batch_hull([low, box(0, 50, 0, width_mm, 51, height_mm + 5)])
    part = part_of("roof", solid)
    local = part.vertices_m - [width_mm / 2e3, 0.05, 0.0]
    holds = list(cad.list_holds(part, local, np.array([0.0, 0.0, height_mm / 2e3]), HAND))
    assert holds[0].tool == gripper
    grasp = holds[0].entry["grasp"][0]
    assert (grasp["closing_axis"], grasp["width_m"]) == closing
    tools = cad.build_tool_entries("ur30", [holds[0].entry], {gripper: holds[0].grip_n})
    (entry,) = tools.values()
    by_weight_n = part.mass_kg * 9.81 / (2 * 0.6)
    assert entry["model"] == gripper
    assert 4 * by_weight_n <= entry["force_n"] < 6 * by_weight_n


def test_a_bush_on_its_side_is_held_from_inside_and_a_rod_at_its_ends():
    """Both go level into what leaves jaws no room; at an end, they press with more force."""
    bush = part_of("bush", (rod(0, 0, -3, 8, 6) - rod(0, 0, -3, 6, 6)).rotate((0, 90, 0)))
    local = bush.vertices_m + np.array([0.0, 0.0, 0.008])
    *_, inside = cad.list_holds(bush, local, np.array([0.0, 0.0, 0.008]), HAND)
    assert inside.tool == "finger_tips"
    assert inside.raised_m > 0
    assert {(g["hold"], *g["approach"]) for g in inside.grasps} == {
        ("inner", 1.0, 0.0, 0.0),
        ("inner", -1.0, 0.0, 0.0),
    }
    shaft = part_of("shaft", rod(0, 0, -75, 5, 150).rotate((0, 90, 0)))
    local = shaft.vertices_m + np.array([0.0, 0.0, 0.005])
    *_, ends = cad.list_holds(shaft, local, np.array([0.0, 0.0, 0.005]), HAND)
    assert ends.at_end
    assert sorted(np.sign(g["at_m"][0]) for g in ends.grasps) == [-1.0, 1.0]
    assert min(abs(g["at_m"][0]) for g in ends.grasps) > 0.06
    tools = cad.build_tool_entries("ur10e", [ends.entry], {ends.tool: ends.grip_n})
    assert 10 * shaft.mass_kg * 9.81 < tools[ends.tool]["force_n"] <= HAND.force_n


@pytest.mark.slow
def test_parts_in_no_order_at_the_end_of_the_time_are_left_out_of_the_task():
    """The search is stopped once the block and one of two posts are in; their order is checked."""
    posts = [(name, box(x, 0, 20, x + 20, 60, 60)) for name, x in (("left", 0), ("right", 100))]
    task = assembled(("block", box(0, 0, 0, 120, 60, 20)), *posts, watch=StoppedSearch(checks=5))
    ((name, reason),) = task.left_out.items()
    assert reason.kind == "not examined"
    assert name in {"left", "right"}
    (other,) = {"left", "right"} - {name}
    placed = [skill for skill in task.skills if skill.startswith("place")]
    assert placed == ["place(block)", f"place({other})"]
    assert not task.doubt


class StoppedSearch(cad.Watch):
    """The share of the search for an order is over after a number of checks in it."""

    def __init__(self, checks):
        super().__init__(
            attempt=lambda make, share: None if share == 0.85 and self.is_over() else make()
        )
        self.left, self.searches = checks, False

    def report(self, text):
        self.searches |= "finding an order" in text

    def is_over(self):
        self.left -= self.searches
        return self.left < 0


def assembled(*solids, watch=None, up=None):
    """Return the task of parts of steel."""
    parts = cad.Product("p", tuple(part_of(*item) for item in solids), "mm", 0.0)
    known = related(parts)
    bearing = cad.find_bearing(parts, known, up) if up else cad.find_best_bearing(parts, known)
    grounded = [name for name in bearing.order if not bearing.on[name]]
    plan = cad.Planner(parts, known).plan(None, bearing.up, grounded)
    return cad.build_task(parts, known, plan, bearing=bearing, watch=watch)


POCKET = box(0, 0, 0, 60, 60, 12) - box(2, 2, 5, 58, 58, 30)
SEAT, RING = (box(0, 0, 0, 60, 60, 20) - rod(30, 30, 13, 11.5, 20), rod(30, 30, 13, 11, 7))


def test_a_part_whose_tools_were_not_all_tried_in_time_keeps_its_last_failure():
    """The time is over once the fingers have met the wall of the pocket."""
    trials = iter([True, True])
    watch = cad.Watch(
        attempt=lambda make, share: make() if share != 0.65 or next(trials, 0) else None
    )
    part = box(4.5, 2.6, 5, 10, 8.1, 12)
    task = assembled(("case", POCKET), ("part", part), watch=watch, up=UP)
    reason = task.left_out["part"]
    assert reason.kind == "not examined"
    assert "a finger runs into case" in reason.text


def test_a_part_whose_grasp_is_refused_by_check_gets_the_next_tool(monkeypatch):
    """Only its first tool is refused, as if the hole for it were too narrow."""
    solids = ("case", box(0, 0, 0, 60, 60, 12)), ("part", box(20, 20, 12, 40, 40, 24))
    first = assembled(*solids, up=UP).document["parts"]["part"]["tool"]
    find_issues = AssemblyDomain.issues

    def find_more(domain, config):
        yield from find_issues(domain, config)
        if config.parts["part"].tool == first:
            yield Issue("no hole there", ("parts", "part", "grasp", "at_m"))

    monkeypatch.setattr(AssemblyDomain, "issues", find_more)
    task = assembled(*solids, up=UP)
    assert not task.left_out
    assert task.document["parts"]["part"]["tool"] != first


@pytest.mark.slow
@pytest.mark.parametrize(
    ("case", "part", "is_inner"),
    [
        (POCKET, box(4.5, 2.6, 5, 10, 8.1, 12), False),
        (SEAT, RING - rod(30, 30, 12, 4, 10), True),
    ],
    ids=["gaps of 2.5 and 0.6 mm", "a ring in its seat"],
)
def test_thin_tips_put_a_part_next_to_walls(case, part, is_inner):
    """Fingers are 14 mm thick, and open by 4 mm on each side."""
    task = assembled(("case", case), ("part", part), up=UP)
    assert not task.left_out
    assert task.document["parts"]["part"]["tool"] == "finger_tips"
    assert task.document["tools"]["finger_tips"]["clearance_m"] == 0.001
    holds = [grasp.get("hold") for grasp in task.document["parts"]["part"]["grasp"]]
    assert ("inner" in holds) == is_inner


@pytest.mark.slow
def test_long_tips_put_a_ring_at_the_bottom_of_a_bore():
    """The others get thick 40 mm above their ends, which is below the rim."""
    case = box(0, 0, 0, 80, 80, 72) - rod(40, 40, 10, 24, 70)
    ring = rod(40, 40, 10, 15, 7) - rod(40, 40, 9, 9, 9)
    task = assembled(("case", case), ("ring", ring), up=UP)
    assert not task.left_out
    assert task.document["parts"]["ring"]["tool"] == "long_finger_tips"
    length_m = task.document["tools"]["long_finger_tips"]["length_m"]
    assert length_m == pytest.approx(HAND.tip_on_flange.xyz_m[2] + 0.025)


@pytest.mark.slow
def test_a_part_that_is_flush_with_its_pocket_is_let_go_above_it():
    """A key with a round back: no cup seals on it."""
    case = box(0, 0, 0, 60, 60, 30) - box(20, 25.7, 22, 40, 34.3, 30)
    pin = rod(0, 0, -9.7, 4, 19.4).rotate((0, 90, 0)).translate((30, 30, 26))
    key = pin + box(20.3, 26, 22, 39.7, 34, 26)
    task = assembled(("case", case), ("key", key), up=UP)
    assert not task.left_out
    entry = task.document["parts"]["key"]
    grasps = entry["grasp"] if isinstance(entry["grasp"], list) else [entry["grasp"]]
    tips_m = [0.008 - grasp["depth_m"] + entry["release_m"] for grasp in grasps]
    assert min(tips_m) == pytest.approx(0.0085, abs=1e-4)


@pytest.mark.slow
def test_a_screw_next_to_a_wall_gets_a_bit_that_reaches_past_it():
    """A driver is 36 mm wide above a bit of 40 mm; the wall is 50 mm higher than the head."""
    hole = rod(22, 30, 0, 2, 30) + rod(60, 30, 0, 2, 30)
    task = assembled(
        ("block", box(0, 0, 0, 80, 60, 20) + box(0, 0, 20, 10, 60, 80) - hole),
        ("lid", box(11, 10, 20, 70, 50, 26) - hole),
        ("M4 screw", rod(22, 30, 10, 2, 16) + rod(22, 30, 26, 4, 4)),
        ("M4 screw 2", rod(60, 30, 10, 2, 16) + rod(60, 30, 26, 4, 4)),
    )
    assert task.left_out == {}
    tools = {name: screw["tool"] for name, screw in task.document["screws"].items()}
    assert tools == {"M4_screw": "long_screwdriver", "M4_screw_2": "screwdriver"}
    assert task.document["tools"]["long_screwdriver"]["bit_length_m"] == pytest.approx(0.1)


@pytest.mark.slow
def test_a_countersunk_screw_is_seated_at_its_rim():
    shank = rod(30, 20, 5, 2.5, 23) + manifold3d.Manifold.cylinder(2, 2.5, 4.5, 48).translate(
        [30, 20, 28]
    )
    lid = box(5, 5, 20, 55, 35, 30) - shank
    task = assembled(("block", box(0, 0, 0, 60, 40, 20) - shank), ("lid", lid), ("M5 screw", shank))
    assert task.left_out == {}
    assert task.document["screws"]["M5_screw"]["hole_m"][2] == pytest.approx(0.030, abs=2e-4)


@pytest.mark.slow
def test_a_rounded_head_is_seated_on_the_floor_of_its_recess():
    """The edge of the head touches the wall of the recess 0.4 mm above the floor."""
    head = rod(30, 20, 28.4, 4.5, 1.6) + manifold3d.Manifold.cylinder(0.4, 4.1, 4.5, 48).translate(
        [30, 20, 28]
    )
    shank = rod(30, 20, 5, 2.5, 23)
    lid = box(5, 5, 20, 55, 35, 30) - rod(30, 20, 28, 4.5, 2) - rod(30, 20, 20, 2.55, 8)
    block = box(0, 0, 0, 60, 40, 20) - shank
    task = assembled(("block", block), ("lid", lid), ("M5 screw", shank + head))
    assert task.document["screws"]["M5_screw"]["hole_m"][2] == pytest.approx(0.028, abs=1e-5)


@pytest.mark.slow
def test_a_ring_that_ends_at_the_rim_of_its_seat_is_let_go_from_a_shallow_grasp():
    """Fingers have room above the wheel; the deepest grasp would begin too high to be guided."""
    wheel = rod(30, 30, 0, 8, 8.9) - rod(30, 30, 5, 5.02, 4)
    ring = rod(30, 30, 5, 5, 4.2) - rod(30, 30, 5, 2, 4.2)
    task = assembled(("wheel", wheel), ("ring", ring), up=UP)
    assert not task.left_out
    assert task.document["parts"]["ring"]["release_m"] < 0.0029


@pytest.mark.slow
def test_a_level_screw_comes_down_behind_the_roof_above_it():
    """The roof ends 70 mm behind the hole, farther than the usual stretch of 50 mm."""
    screw = (rod(0, 0, 0, 2, 16) + rod(0, 0, -4, 4, 4)).rotate([0, 90, 0]).translate([80, 30, 70])
    walls = box(0, 0, 0, 100, 60, 10) + box(80, 0, 0, 100, 60, 100) + box(10, 0, 90, 100, 60, 100)
    task = assembled(("block", walls - screw), ("M4 screw", screw), up=UP)
    assert task.left_out == {}
    assert task.document["screws"]["M4_screw"]["insert_m"] == pytest.approx(0.075, abs=1e-3)


@pytest.mark.slow
def test_a_part_that_falls_in_the_trial_gets_a_support_if_supports_are_allowed():
    """A beam of which two thirds overhang; the supports that the import found are withheld."""
    beam = box(40, 10, 20, 140, 30, 30)
    solids = ("base", box(0, 0, 0, 60, 40, 20)), ("beam", beam)
    product = cad.Product("p", tuple(part_of(*item) for item in solids), "mm", 0.0)
    known = related(product)
    bearing = replace(cad.find_best_bearing(product, known, holding=True), held=())
    plan = cad.Planner(product, known).plan(None, bearing.up, ["base"])
    task = cad.build_task(product, known, plan, bearing=bearing, holding=True)
    assert task.left_out == {}
    assert task.document["holders"]["hold_beam"]["parts"] == ["beam"]
    assert task.skills[-1] == "place(beam)"
    bare = cad.build_task(product, known, plan, bearing=bearing)
    assert "beam would tip off base" in bare.left_out["beam"].text


@pytest.mark.slow
def test_a_part_that_is_blocked_itself_is_tried_with_one_tool():
    """The relation is that of a pocket without the lip above the foot of the part."""
    foot = box(20.2, 10.2, 10, 39.8, 29.8, 18) + box(20.2, 10.2, 10, 28, 29.8, 70)
    pocket = box(0, 0, 0, 60, 40, 30) - box(20, 10, 10, 40, 30, 30)
    free, roofed = (
        cad.Product("p", (part_of("base", base), part_of("foot", foot)), "mm", 0.0)
        for base in (pocket, pocket + box(32, 5, 22, 45, 35, 30))
    )
    known = related(free)
    bearing = cad.find_best_bearing(free, known)
    plan = cad.Planner(free, known).plan(None, bearing.up, ["base"])
    watch = NotedTrials()
    task = cad.build_task(roofed, known, plan, bearing=bearing, watch=watch)
    assert "foot runs into base" in task.left_out["foot"].text
    assert [part for part in watch.tried if part == "foot"] == ["foot"]


class NotedTrials(cad.Watch):
    """Notes the parts whose trial is reported."""

    def __init__(self):
        super().__init__()
        self.tried = []

    def report(self, text):
        before, trying, after = text.partition("writing: trying ")
        if trying and not before:
            self.tried.append(after.partition(",")[0])


@pytest.mark.slow
def test_a_part_that_a_new_layout_puts_out_of_reach_is_tried_again():
    solids = {"base": box(0, 0, 0, 60, 40, 20), "plate": box(0, 0, 20, 60, 40, 30)}
    task = cad.build_task(*relate(product_of(solids)))
    (feeder,) = task.document["feeders"]
    far = {**task.document, "feeders": {feeder: {"position_m": [0.8, 0.0]}}}
    with cad.TaskTrials(cad.Watch()) as trials:
        first = trials.try_task(task.document, task.files, ["base", "plate"])
        again = trials.try_task(far, task.files, ["base", "plate"])
        assert trials.granted == {"base"}
    assert not first.failures
    assert again.failures.keys() == {"plate"}
    assert "beyond what the arm spans" in again.failures["plate"].text


def test_a_base_beyond_the_payload_stands_in_place_and_another_part_is_left_out():
    """9.5 kg, of which a panda carries 2.27 kg in its hand."""
    block = ("block", box(0, 0, 0, 70, 200, 86))
    task = assembled(block, ("lid", box(0, 0, 86, 60, 60, 96)))
    entry = task.document["parts"]["block"]
    assert entry["fixed"]
    assert not {"tool", "start_m", "grasp"} & entry.keys()
    (words,) = task.limits["block"]
    assert "9.45 kg, and panda carries 2.27 kg" in words
    assert "--robot ur10e" in words
    assert task.in_place == ("block",)
    other = assembled(block, ("top", box(0, 0, 86, 70, 200, 140)))
    assert other.document == {}
    assert other.left_out["top"].kind == "too heavy"


def test_a_heavy_part_on_the_base_stands_in_place_too_if_others_need_it():
    """5.9 kg, without which the lid has nothing to lie on."""
    block, top = box(0, 0, 0, 70, 200, 86), box(0, 0, 86, 70, 200, 140)
    task = assembled(("block", block), ("top", top), ("lid", box(0, 0, 140, 60, 60, 150)))
    parts = task.document["parts"]
    assert [name for name, part in parts.items() if part.get("fixed")] == ["block", "top"]
    assert task.skills == ("pick(lid)", "place(lid)")


def test_no_part_stands_in_place_before_what_bears_it():
    """A block too heavy for the arm, beside whose middle a foot is put on the table first."""
    block, foot = box(0, 0, 10, 70, 200, 96), box(0, 0, 0, 20, 20, 10)
    product, relation, plan = relate(
        product_of({"block": block, "foot": foot, "lid": box(0, 0, 96, 60, 60, 106)})
    )
    bearing = cad.find_bearing(product, relation, UP, holding=True)
    task = cad.build_task(product, relation, plan, bearing=bearing, holding=True)
    assert "block" in bearing.held
    assert task.left_out["block"].kind == "too heavy"
    assert not any(part.get("fixed") for part in task.document["parts"].values())


def test_a_part_that_goes_in_below_another_comes_down_beside_it():
    """A block that may slide below a roof 24 mm deep, first in the plan, begins at 29 mm."""
    solids = {
        "base": box(0, 0, 0, 100, 60, 10),
        "pillar": box(0, 0, 10, 35, 60, 40),
        "roof": box(0, 0, 40, 60, 60, 50),
        "block": box(36, 10, 10, 56, 50, 40),
    }
    product, relation, plan = relate(product_of(solids))
    bearing = cad.find_best_bearing(product, relation)
    on = {"base": (), "pillar": ("base",), "roof": ("pillar",), "block": ("base",)}
    task = cad.build_task(product, relation, plan, bearing=replace(bearing, order=tuple(on), on=on))
    entry = task.document["parts"]["block"]
    assert all(way[2] == 0.0 for way in entry["insert_along"])
    assert entry["insert_m"] == pytest.approx(0.029)


def test_a_bush_goes_into_a_level_bore_from_the_side_that_has_room_for_the_hand():
    """Held from inside; a hand beyond the wall would have to point back at the arm."""
    bore = rod(0, 0, 0, 8, 13).rotate((0, 90, 0)).translate((24, 30, 200))
    hole = rod(0, 0, 0, 6, 13).rotate((0, 90, 0)).translate((24, 30, 200))
    solids = {
        "base": box(0, 0, 0, 60, 60, 180) + box(24, 0, 180, 37, 60, 220) - bore,
        "bush": bore - hole,
    }
    product, relation, plan = relate(product_of(solids))
    bearing = cad.find_bearing(product, relation, UP, holding=True)
    task = cad.build_task(product, relation, plan, bearing=bearing, holding=True)
    assert task.left_out == {}
    bush = task.document["parts"]["bush"]
    assert sorted(bush["insert_along"]) == [[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]
    assert bush["grasp"][0]["hold"] == "inner"


def test_a_level_hand_takes_parts_from_a_place_with_room_for_its_wrist():
    """0.31 m from the axis of the arm, it pointed away from it and did not reach."""
    items = [
        cad.Item("bush", (0.013, 0.016, 0.016), is_raised=True),
        *(cad.Item(f"part_{n}", (0.08, 0.08, 0.16)) for n in range(4)),
    ]
    x, y = cad.lay_out_table((0.08, 0.08, 0.25), items, "panda").places["bush"]
    assert math.hypot(x, y) > 0.45


@pytest.mark.parametrize(("robot", "nearest_m"), [("panda", 0.25), ("iiwa14", 0.42)])
def test_a_tray_keeps_parts_apart_and_within_reach(robot, nearest_m):
    items = [cad.Item(f"part_{n}", (0.04, 0.03, 0.02)) for n in range(10)]
    result = cad.lay_out_table((0.12, 0.10, 0.05), items, robot)
    assert result.without == ()
    places = list(result.places.values())
    for number, (x, y) in enumerate(places):
        assert nearest_m <= math.hypot(x, y) < 0.75
        assert max(abs(x - result.product_m[0]), abs(y - result.product_m[1])) > 0.15
        for other in places[:number]:
            assert max(abs(x - other[0]) - 0.04, abs(y - other[1]) - 0.03) > 0.039


def test_what_finds_no_place_is_named():
    items = [cad.Item(f"panel_{n}", (0.40, 0.40, 0.02)) for n in range(6)]
    assert cad.lay_out_table((0.12, 0.10, 0.05), items, "panda").without


def test_tools_of_a_large_arm_stand_where_it_reaches_down():
    """Its elbow does not bend far enough for holders half a metre before it."""
    entry = {"tool": "gripper"}
    for arm, least_m in (("panda", 0.5), ("m710ic_45m", 0.65)):
        holder_m = cad.build_tool_entries(arm, [entry], {"gripper": 10.0})["gripper"]["holder_m"]
        assert least_m < math.hypot(*holder_m) < 0.8
    parts = [part_of("block", box(0, 0, 0, 50, 50, 50))]
    places = cad.lay_out_parts(parts, parts, {"block": "block"}, (), cad.Bearing(UP, ()), arm)
    assert tuple(holder_m) in places.holders


def test_the_task_is_of_the_arm_that_was_asked_for(screwed, screwed_task):
    """Its name, its reach, what it carries."""
    document = cad.build_task(*screwed, robot="ur5e").document
    assert (document["robot"]["name"], document["robot"]["model"]) == ("ur5e", "ur5e")
    assert document["parts"].keys() == screwed_task.document["parts"].keys()
    starts = [part["start_m"] for part in document["parts"].values() if "start_m" in part]
    assert all(math.hypot(*place) < 0.85 for place in starts)


def test_the_arm_is_the_default_one_or_the_smallest_that_carries_and_reaches_most(eight):
    parts = eight[0].parts
    wide = part_of("plate", box(0, 0, 0, 600, 400, 5))
    high = part_of("mast", box(0, 0, 0, 20, 20, 600))
    heavy = {kg: weigh(parts[0], kg) for kg in (3.2, 9.1, 14.1, 99.0)}
    more = ((), (wide,), (high,), (heavy[3.2],), (heavy[9.1],), (heavy[14.1],), (heavy[99.0],))
    arms = [cad.choose_arm((*parts, *others), UP) for others in more]
    assert arms == ["panda", "ur10e", "ur20", "gen3_7dof", "crx10ia", "ur20", "panda"]
    # In a gripper of 6 kg, and held at the middle.
    loads = {"heavy": cad.Load(20.1, 0.02), "mast": cad.Load(0.9, 0.3)}
    arms = [cad.choose_arm((*parts, other), UP, loads) for other in (heavy[14.1], high)]
    assert arms == ["ur30", "crx10ia"]


def test_a_longer_arm_brings_parts_that_are_out_of_reach_above_other_parts():
    mast = {"plate": box(0, 0, 0, 200, 100, 40), "mast": box(40, 40, 40, 60, 60, 440)}
    known = relate(product_of(mast))
    short, longer = (cad.build_task(*known, longer=arm) for arm in (None, "ur10e"))
    assert short.left_out["mast"].kind == "unreachable"
    assert "out of reach at robot.safe_height_m" in short.left_out["mast"].text
    assert longer.document["robot"]["model"] == "ur10e"
    assert longer.names.keys() == mast.keys()


def weigh(part, mass_kg):
    """Return a part of that mass."""
    return replace(part, name="heavy", density_kg_m3=mass_kg / part.volume_m3)


def test_names_of_cad_become_names_of_a_task():
    names = cad.assign_task_names(["Körper #2", "a/b", "a b", "3rd", "gripper"], taken=["gripper"])
    assert list(names.values()) == ["K_rper_2", "a_b", "a_b_2", "part_3rd", "gripper_2"]


def test_a_product_that_is_drawn_lying_is_written_standing(eight):
    product = eight[0]
    upright = cad.place_upright(product, (0.0, 1.0, 0.0), (0.5, 0.1))
    points = np.concatenate([upright.vertices(part) for part in product])
    assert points[:, 2].min() == pytest.approx(0.0)
    assert upright.vector((0.0, 1.0, 0.0)) == pytest.approx((0.0, 0.0, 1.0))
    assert np.linalg.det(upright.matrix) == pytest.approx(1.0)


# A block that is pushed sideways beneath the roof of a bracket of 0.26 kg.
BRACKET = box(0, 0, 0, 60, 40, 5) + box(0, 30, 5, 60, 40, 25) + box(0, 14, 20, 60, 40, 25)
BLOCK = box(10, -15, 5, 50, 29, 19.5)


def push_block(density_kg_m3, nesting=True, watch=None):
    """Return the task of the bracket and the block."""
    bracket = replace(part_of("bracket", BRACKET), density_kg_m3=density_kg_m3)
    product = cad.Product("push", (bracket, part_of("block", BLOCK)), "mm", 0.0)
    known = related(product)
    plan = cad.Planner(product, known).plan("bracket", (0.0, 0.0, 1.0), ["bracket"])
    bearing = cad.find_best_bearing(product, known)
    return cad.build_task(product, known, plan, bearing=bearing, nesting=nesting, watch=watch)


@pytest.mark.slow(reason="swept tries a task; fixtures of nests are checked in every run")
def test_a_light_base_that_is_pushed_sideways_stands_in_a_nest(tmp_path, capsys):
    task = push_block(7850.0)
    assert task.names.keys() == {"bracket", "block"}
    assert task.nest.entry["check"]["good"]
    (nest,) = task.document["fixtures"].values()
    bracket, block = (task.document["parts"][name] for name in ("bracket", "block"))
    assert bracket["goal_on"] == ["nest"]
    assert "goal_on" in block
    assert "nest" not in block["goal_on"]
    assert bracket["goal_m"][2] == pytest.approx(0.003)
    assert block["goal_m"][2] == pytest.approx(0.008)
    assert {nest["meshes"][0][key] for key in ("file", "pieces")} <= task.files.keys()
    for name, content in task.files.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(content, "utf-8")
    assert run(["check", str(tmp_path / "product.yaml")]) == 0, capsys.readouterr().err
    late = push_block(
        7850.0, watch=cad.Watch(attempt=lambda make, share: None if share == 0.75 else make())
    )
    assert (late.nest, late.why_no_nest) == (None, "none was cut in the time")


@pytest.mark.slow(reason="swept tries tasks")
@pytest.mark.parametrize(("nesting", "is_driven"), [(True, True), (False, False)])
def test_supports_hold_a_product_higher_if_the_driver_meets_the_table(nesting, is_driven):
    """Supports hold two rollers beneath the base; a screw goes in level, 15 mm above the table."""
    screw = (rod(0, 0, 0, 2, 16) + rod(0, 0, -4, 4, 4)).rotate((-90, 0, 0))
    roller = rod(0, 0, 0, 15, 80).rotate((-90, 0, 0))
    rollers = {"left": roller - screw, "right": roller.translate((60, 0, 0))}
    base = box(-15, 5, 15, 75, 75, 30)
    product = product_of({**rollers, "base": base, "M4 screw": screw})
    known = related(product)
    bearing = cad.find_bearing(product, known, UP, holding=True)
    plan = cad.Planner(product, known).plan(None, bearing.up, ["base"])
    task = cad.build_task(product, known, plan, bearing=bearing, holding=True, nesting=nesting)
    assert ("M4 screw" in task.names) == is_driven, task.left_out
    assert "left" in task.names
    if is_driven:
        assert task.document["parts"]["left"]["goal_m"][2] == pytest.approx(0.06)


@pytest.mark.slow(reason="simulates; 12 landings of a nut")
def test_an_eccentric_nut_that_is_let_go_over_a_round_hole_keeps_its_angle(tmp_path):
    """Seams between pieces of both parts meet as it lands, 0.3 mm lower."""
    hexagon = manifold3d.Manifold.cylinder(5, 4.544, 4.544, 6).translate((0, 0.82, 3.5))
    boss = rod(0, 0, 0, 3.555, 2.5) + rod(0, 0.82, 2.5, 5, 1) - rod(0, 0.82, 0, 2.5, 8.5)
    nut = (boss + hexagon - rod(0, 0.82, 0, 2.5, 8.5)).translate((30, 30, 3.5))
    plate = box(0, 0, 0, 60, 60, 6) - rod(30, 30, 0, 3.6, 6) - rod(30, 30, 0, 6, 1.5)
    for name, content in assembled(("plate", plate), ("nut", nut)).files.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(content, "utf-8")
    task = load_problem(tmp_path / "product.yaml").task
    (robot,) = task.scene.robots
    goals = {
        name: task.skill(f"place({name})").motion.routes[0].visits[-1].pose
        for name in ("plate", "nut")
    }
    random = np.random.default_rng(1)
    for _ in range(12):
        aside_m, tilts_rad = random.normal(0, 1e-5, 2), random.normal(0, 2e-4, 2)
        turned_rad = random.normal(0, 3e-3)
        world, arm = MujocoSimulator(task, ExecutionSettings()).cell(get_hand(robot))
        arm.stand(arm.kinematics.home_rad, 0.04)
        world.add(task.scene.body("plate"), goals["plate"])
        place_m = np.add(goals["nut"].position, (*aside_m, 3e-4))
        axis = np.array([*tilts_rad, turned_rad, 2.0]) / 2
        x, y, z, w = axis / np.linalg.norm(axis)
        world.add(task.scene.body("nut"), Pose(tuple(place_m.tolist()), (x, y, z, w)))
        world.stand(["nut"])
        for _ in range(60):
            arm.actuate()
            world.step()
        *_, z, w = world.pose("nut").orientation
        assert 2 * math.atan2(z, w) == pytest.approx(turned_rad, abs=math.radians(0.5))


def relate_pinned(axis, length_mm=40):
    """Return a base with a post at each end, and a pin that goes into each from outside."""

    def lay(solid):
        return solid.rotate((0, 0, 90)) if axis == "y" else solid

    half = 130 + length_mm - 21
    base = box(-130, -30, 0, 130, 30, 30)
    base += box(-130, -30, 30, -90, 30, 180) + box(90, -30, 30, 130, 30, 180)
    lying = rod(0, 0, 0, 6, length_mm).rotate((0, 90, 0))
    pins = [lying.translate((x, 0, 150)) for x in (-half, half - length_mm)]
    solids = {"base": base - pins[0] - pins[1], "left": pins[0], "right": pins[1]}
    product, relation, plan = relate(
        product_of({name: lay(solid) for name, solid in solids.items()})
    )
    return product, relation, plan, cad.find_bearing(product, relation, UP, holding=True)


@pytest.mark.parametrize(("axis", "heading"), [("x", 1), ("y", 0)])
def test_pins_for_both_ends_of_a_product_go_in_along_y(axis, heading):
    """One end is beside the arm and the other one out of its reach if they lie along x."""
    product, relation, _, bearing = relate_pinned(axis)
    assert cad.choose_heading(product, relation, bearing, "panda") == heading


def test_a_product_without_level_parts_keeps_its_heading():
    solids = {"base": box(0, 0, 0, 600, 60, 20), "lid": box(0, 0, 20, 600, 60, 30)}
    product, relation, _ = relate(product_of(solids))
    bearing = cad.find_bearing(product, relation, UP)
    assert cad.choose_heading(product, relation, bearing, "panda") == 0


def test_the_task_of_a_turned_product_has_its_level_parts_along_y():
    product, relation, plan, bearing = relate_pinned("x")
    task = cad.build_task(product, relation, plan, bearing=bearing, holding=True, heading=True)
    assert np.allclose(task.upright.matrix, [[0, -1, 0], [1, 0, 0], [0, 0, 1]])
    left = task.document["parts"]["left"]
    assert left["insert_along"] == [[0.0, 1.0, 0.0]]
    base = task.document["parts"]["base"]["goal_m"]
    assert left["goal_m"][0] == pytest.approx(base[0], abs=1e-4)
    assert left["goal_m"][1] == pytest.approx(base[1] - 0.129, abs=1e-4)


def test_a_level_hand_holds_a_pin_outside_the_wall_that_it_goes_into():
    """Jaws at the middle of the pin, 35 mm deep, would be in the wall."""
    pin = part_of("pin", rod(0, 0, -35, 6, 70).rotate((90, 0, 0)))
    local = pin.vertices_m + np.array([0.0, 0.0, 0.006])
    along = (0.0, -1.0, 0.0)

    def find(walls_m):
        holds = cad.list_holds(pin, local, np.array([0.0, 0.0, 0.006]), HAND, 0.0, walls_m, 0.06)
        raised = next(hold for hold in holds if hold.raised_m)
        return [grasp for grasp in raised.grasps if grasp["approach"] == list(along)]

    assert min(grasp["depth_m"] for grasp in find({})) > 0.019
    grasps = find({along: 0.016})
    assert grasps
    assert max(grasp["depth_m"] for grasp in grasps) < 0.019


def test_a_large_arm_takes_parts_where_a_level_hand_may_point_back_at_it():
    items = [cad.Item("pin", (0.013, 0.07, 0.013), is_raised=True)]
    x, y = cad.lay_out_table((0.5, 0.5, 0.3), items, "m710ic_45m").places["pin"]
    assert max(np.hypot(abs(x) + 0.52, y), np.hypot(x, abs(y) + 0.52)) < 1.83
