"""The playback: motions in few numbers, and as exact as they have to be."""

from __future__ import annotations

import base64
import math
import subprocess
import sys
from typing import Any

import numpy as np
import pytest

from situations import make_skill, make_task
from skillplan.physics import Contact, Sample
from skillplan.robots import PANDA
from skillplan.task import Facts, Place, Pose, Zone
from skillplan.views import (
    Playback,
    Tracks,
    build_hull_mesh,
    build_prism_mesh,
    coarsen,
    compute_link_frames,
    list_contacts,
    make_box,
    make_rows,
    read_obj,
    turn_along,
)
from skillplan.views.figures import WalkSteps
from skillplan_swarmitfix import BaseGrounding, Bench, at, compute_base_rows, make_turning

Numbers = Any


def played(tracks: Tracks, track: int) -> Numbers:
    """Return the poses that a player shows in every frame, shape (frames, 7)."""
    document = tracks.document()
    counts = document["key_counts"]
    first, count = sum(counts[:track]), counts[track]

    def numbers(key: str, kind: str, width: int) -> Numbers:
        read = np.frombuffer(base64.b64decode(document[key]), kind).reshape(-1, width)
        return read[first : first + count].astype(np.float64)

    keys = numbers("keys", "<u4" if document["wide_keys"] else "<u2", 1)[:, 0]
    places = numbers("positions", "<i2", 3) * document["position_scale_m"]
    places += document["position_offset_m"]
    turns = numbers("orientations", "<i2", 4) / 32767
    rows = np.hstack([places, turns])
    frames = np.arange(tracks.frames)
    stack = np.stack([np.interp(frames, keys, column) for column in rows.T], axis=1)
    stack[:, 3:] /= np.linalg.norm(stack[:, 3:], axis=1, keepdims=True)
    return stack


def a_motion(frames: int = 600) -> Numbers:
    """Return a body that rests, travels on a curve while it turns, and rests again."""
    share = np.clip((np.arange(frames) / frames - 0.3) / 0.4, 0, 1)
    angle = math.pi * (3 * share**2 - 2 * share**3)
    zero = np.zeros(frames)
    return np.stack(
        [
            np.cos(angle),
            np.sin(angle),
            0.2 * share,
            zero,
            zero,
            np.sin(angle / 2),
            np.cos(angle / 2),
        ],
        axis=1,
    )


def test_every_pose_is_played_within_a_tenth_of_a_millimetre():
    """With a fraction of the rows."""
    rows, tracks = a_motion(), Tracks(600)
    track = tracks.add(rows)
    shown = played(tracks, track)
    assert 1e-4 > np.linalg.norm(shown[:, :3] - rows[:, :3], axis=1).max()
    assert 0.002 > np.abs(shown[:, 3:] - rows[:, 3:]).max()
    assert 300 > tracks.document()["key_counts"][0]


def test_what_stands_takes_two_rows():
    tracks = Tracks(1000)
    tracks.add(np.tile([1.0, 2.0, 3.0, 0, 0, 0, 1], (1000, 1)))
    assert [2] == tracks.document()["key_counts"]


def test_a_body_that_is_nowhere_is_hidden():
    """No number of a document is NaN; where it appears it comes from nowhere."""
    rows, tracks = a_motion(), Tracks(600)
    rows[:250] = np.nan
    tracks.add(a_motion())
    track = tracks.add(rows)
    assert [[1, 0, 249]] == tracks.document()["hidden"]
    shown = played(tracks, track)
    assert np.allclose(rows[250:, :3], shown[250:, :3], atol=1e-4)
    assert np.isfinite(shown).all()


@pytest.mark.parametrize("rows", [np.full((5, 7), np.nan), np.zeros((4, 7))])
def test_a_motion_has_a_row_for_each_frame_and_a_pose(rows):
    with pytest.raises(ValueError, match="a row for each"):
        Tracks(5).add(rows)


def test_the_flange_is_where_the_arm_puts_it():
    """At its home posture the Panda's flange is 0.3069 m ahead and points down."""
    joints = np.array([PANDA.home_rad, PANDA.home_rad])
    flange = compute_link_frames(PANDA, Pose((0.1, 0.0, 0.0)), joints)[-1]
    assert np.allclose((0.4069, 0.0, 0.5903), flange[1, :3, 3], atol=1e-3)
    assert np.allclose((0.0, 0.0, -1.0), flange[0, :3, 2], atol=1e-9)


def test_quaternions_of_neighbours_are_near_each_other():
    """Over a whole turn about every axis, all four ways to a quaternion are taken."""
    angles = np.linspace(0, 2 * math.pi, 50)
    for axis in range(3):
        pose = np.zeros((50, 4, 4))
        j, k = (axis + 1) % 3, (axis + 2) % 3
        pose[:, axis, axis] = pose[:, 3, 3] = 1
        pose[:, j, j] = pose[:, k, k] = np.cos(angles)
        pose[:, k, j], pose[:, j, k] = np.sin(angles), -np.sin(angles)
        quaternions = make_rows(pose)[:, 3:]
        assert 0.1 > np.abs(np.diff(quaternions, axis=0)).max()
        assert np.allclose(np.abs(quaternions[:, axis]), np.abs(np.sin(angles / 2)), atol=1e-9)


def test_a_coarser_mesh_has_the_same_extent_and_fewer_faces(tmp_path):
    import trimesh

    ball = trimesh.creation.icosphere(3, 0.1)
    points, triangles = coarsen(np.array(ball.vertices), np.array(ball.faces), 0.02)
    assert len(triangles) < 0.5 * len(ball.faces)
    assert np.allclose(0.1, np.abs(points).max(axis=0), atol=0.02)
    path = tmp_path / "ball.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvn 0 0 1\nf 1//1 2//1 3//1 4//1\n")
    assert [[0, 1, 2], [0, 2, 3]] == read_obj(path)[1].tolist()


def test_a_document_holds_what_stands_and_what_moves():
    playback = Playback("t", 600)
    playback.add_body("table", "environment", [make_box((1, 1, 0.1))])
    playback.add_body(
        "part",
        "part",
        [playback.mesh(*build_hull_mesh([*np.eye(3).tolist(), [0, 0, 0]]))],
        rows=a_motion(),
        goal=Pose((1, 2, 3)),
    )
    document = playback.document()
    assert ("skillplan.playback/1", 60, 600) == tuple(
        document[key] for key in ("schema", "frames_per_s", "frames")
    )
    assert [None, 0] == [body["track"] for body in document["bodies"]]
    assert [1, 2, 3, 0, 0, 0, 1] == document["bodies"][1]["goal"]


def test_the_prism_of_a_zone_is_closed_and_of_its_volume():
    """Concave polygons, too."""
    corners = ((0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (1.0, 0.5), (0.0, 2.0))
    points, triangles = build_prism_mesh(Zone("z", corners, 0.0, 9.0), 0.5, 2.5)
    a, b, c = points[triangles].transpose(1, 0, 2)
    volume = float((a * np.cross(b, c)).sum() / 6)
    # A square of 4 m2 less a notch of 2 m x 1.5 m.
    assert volume == pytest.approx((4.0 - 1.5) * 2.0)
    edges = [
        tuple(sorted(edge))
        for t in triangles.tolist()
        for edge in zip(t, t[1:] + t[:1], strict=True)
    ]
    assert all(edges.count(edge) == 2 for edge in edges)


@pytest.mark.parametrize("along", [(0, 0, 1), (0, 0, -1), (1, 0, 0), (0.6, 0, -0.8)])
def test_a_cylinder_lies_along_its_axis(along):
    assert np.allclose(along, turn_along((0, 0, 0), along).rotate((0, 0, 1)), atol=1e-9)


def test_a_base_ends_a_swing_where_the_lattice_has_it():
    """Whatever it turns about, and however far."""
    bench = Bench(6, 13, 0.34, 11)
    start = bench.position("C41")
    for action in range(1, 11):
        swing, created = bench.swing(start, action), make_turning(bench, start, action, 1.0, 3.0)
        assert (swing is None) == (created is None)
        if swing is None or created is None:
            continue  # it would leave the bench
        xs, ys, _ = compute_base_rows(bench, start, [created], np.array([0.0, 1.0, 2.0, 3.0, 4.0]))
        assert np.allclose(bench.centroids_m[start], (xs[0], ys[0]), atol=1e-12)
        assert np.allclose(bench.centroids_m[swing.end], (xs[-1], ys[-1]), atol=1e-12)


def pressed(forces_n: list[float], place_m: float = 0.0) -> list[Sample]:
    """Return a row of the trace a frame, in which one body presses on another so strongly."""
    return [
        Sample(
            frame / 60,
            "",
            "",
            (0, 0, 0),
            (0, 0, 0),
            (),
            0.0,
            0.0,
            {},
            (Contact(("peg", "block"), (frame * place_m, 0, 0), (0, 0, -force_n)),),
        )
        for frame, force_n in enumerate(forces_n)
    ]


def test_a_steady_contact_is_one_entry_as_strong_as_its_peak():
    (entry,) = list_contacts(pressed([20.0, 21.0, 20.0, 19.0] * 100))
    assert (0.0, 6.65, -21.0) == (entry["time_s"], entry["until_s"], entry["force_n"][2])
    assert ["peg", "block"] == entry["bodies"]


def test_a_blow_is_an_entry_beside_the_steady_contact():
    entries = list_contacts(pressed([20.0] * 30 + [80.0] + [20.0] * 30))
    assert [-20.0, -80.0, -20.0] == [entry["force_n"][2] for entry in entries]
    assert entries[1]["time_s"] == entries[1]["until_s"] == 0.5


def test_contacts_that_cannot_be_seen_are_left_out():
    assert [] == list_contacts(pressed([0.5] * 10))


def test_a_contact_that_travels_stays_with_its_bodies():
    """An entry stands where it began."""
    entries = list_contacts(pressed([20.0] * 61, place_m=0.005))
    assert 0.021 > max(entry["until_s"] * 60 * 0.005 - entry["position_m"][0] for entry in entries)


def test_no_trace_has_more_contacts_than_a_page_can_hold():
    entries = list_contacts(pressed([5.0, 90.0, 300.0, 20.0] * 400), most=50)
    assert len(entries) <= 50
    assert -300.0 == min(entry["force_n"][2] for entry in entries)


def test_meshes_of_a_page_load_no_trimesh():
    """It takes as long to import as a page without it."""
    code = (
        "import sys\n"
        "from skillplan.views import build_hull_mesh\n"
        "build_hull_mesh([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)])\n"
        "print('trimesh' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "False" == done.stdout.strip()


# Fewest steps of walking: the same as the bench counts by its geometry.


@pytest.fixture
def bench():
    """A small bench of all eleven actions."""
    return Bench(4, 5, 0.1, 11)


def test_steps_are_those_of_the_bench(bench):
    """From every position, found by skills alone."""
    goal = 7
    task = BaseGrounding(bench, {0: 0.0}.fromkeys(range(-360, 361), 1.0)).task("walk", 0, goal)
    walk = WalkSteps(task, at(bench.name(goal)))
    expected = {at(bench.name(i)): int(n) for i, n in enumerate(bench.distances(goal))}
    assert expected == walk.fewest


def test_successors_stand_in_the_order_of_the_actions(bench):
    """Of equal steps the first action counts, as on the bench."""
    task = BaseGrounding(bench, {0: 0.0}.fromkeys(range(-360, 361), 1.0)).task("walk", 0, 7)
    walk = WalkSteps(task, at(bench.name(7)))
    ends = [at(bench.name(end)) for end in bench.successors[3].tolist() if end >= 0]
    assert ends == list(walk.successors[at(bench.name(3))])


def test_a_place_from_which_nothing_leads_to_the_goal_has_no_steps():
    """A road of one direction."""
    facts = Facts(["a", "b", "c"])
    go = make_skill(facts, "go", requires=["a"], add=["b"], delete=["a"])
    task = make_task(facts, [go], initial=["a"], goal=["b"]).replace(
        places={name: Place(name, (0.0, 0.0, 0.0)) for name in ("a", "b", "c")}
    )
    assert {"b": 0, "a": 1} == WalkSteps(task, "b").fewest
