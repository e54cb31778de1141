"""Closed polyhedra from files."""

import contextlib
import io
import json
import os
import random
import struct
import zipfile
from itertools import pairwise
from pathlib import Path

import pytest
import trimesh
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

import skillplan
from example_count import examples
from skillplan import load_problem
from skillplan.cli import main, run
from skillplan.domains.assembly import (
    MAX_BYTES,
    MAX_CORNERS,
    ArmFileError,
    MeshFileError,
    arm_files,
    arm_meshes,
    mesh_files,
    parse_mesh,
    read_arm,
    read_mesh,
)
from skillplan.errors import TaskError
from skillplan.task import Mesh
from urdf_text import urdf

# Corners and faces of a wedge: 2 long, 1 wide, 1 high where it is highest.
WEDGE = [(0, 0, 0), (2, 0, 0), (2, 1, 0), (0, 1, 0), (0, 0, 1), (0, 1, 1)]
WEDGE_FACES = [(3, 2, 1, 0), (0, 1, 4), (1, 2, 5, 4), (2, 3, 5), (3, 0, 4, 5)]


def triangles(faces):
    """Return the triangles of polygons, as fans."""
    return [(face[0], b, c) for face in faces for b, c in pairwise(face[1:])]


def as_obj(corners, faces):
    """Return an OBJ file's content."""
    lines = ["v {} {} {}".format(*corner) for corner in corners]
    lines += ["f " + " ".join(str(index + 1) for index in face) for face in faces]
    return "\n".join(lines).encode()


def as_stl(corners, faces):
    """Return a binary STL file's content, without normals."""
    rows = triangles(faces)
    content = bytes(80) + struct.pack("<I", len(rows))
    for row in rows:
        numbers = [0.0, 0.0, 0.0, *(value for index in row for value in corners[index])]
        content += struct.pack("<12fH", *numbers, 0)
    return content


def as_ply(corners, faces):
    """Return a PLY file's content, as text."""
    head = ["ply", "format ascii 1.0", f"element vertex {len(corners)}"]
    head += [f"property float {axis}" for axis in "xyz"]
    head += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header"]
    rows = ["{} {} {}".format(*corner) for corner in corners]
    rows += [" ".join(map(str, (len(face), *face))) for face in faces]
    return "\n".join([*head, *rows, ""]).encode()


FORMS = {".obj": as_obj, ".stl": as_stl, ".ply": as_ply}


def wedge_in(folder, suffix=".obj", **changes):
    """Write the wedge into a folder and return its file's name."""
    corners, faces = changes.get("corners", WEDGE), changes.get("faces", WEDGE_FACES)
    (folder / f"wedge{suffix}").write_bytes(FORMS[suffix](corners, faces))
    return f"wedge{suffix}"


def reason(folder, name="wedge.obj", scale=0.01):
    """Return why a file is refused, and at which key."""
    with pytest.raises(MeshFileError) as raised:
        read_mesh(folder, name, scale)
    return str(raised.value), raised.value.key


@pytest.mark.parametrize("suffix", sorted(FORMS))
def test_a_wedge_is_read_from_every_kind_of_file(tmp_path, suffix):
    """To metres, about the middle of the box about it."""
    read = read_mesh(tmp_path, wedge_in(tmp_path, suffix), 0.01)
    assert read.size == pytest.approx((0.02, 0.01, 0.01))
    corners = read.about((0.01, 0.005, 0.005))
    expected = {tuple(round(0.01 * value, 9) for value in corner) for corner in WEDGE}
    assert expected == set(corners)
    assert len(read.faces) == 8


@pytest.mark.parametrize("suffix", sorted(FORMS))
def test_a_kind_of_file_does_not_change_the_polyhedron(tmp_path, suffix):
    """The same corners in the same order, so that the same verdicts follow."""
    read = read_mesh(tmp_path, wedge_in(tmp_path, suffix), 0.01)
    assert read.corners == read_mesh(tmp_path, wedge_in(tmp_path), 0.01).corners


def test_faces_are_turned_outward(tmp_path):
    """However the file has them: the volume that they enclose is that of the wedge."""
    turned = [face[::-1] if i % 2 else face for i, face in enumerate(WEDGE_FACES)]
    read = read_mesh(tmp_path, wedge_in(tmp_path, faces=turned), 1.0)
    volume_m3 = 0.0
    for face in read.faces:
        (ax, ay, az), (bx, by, bz), (cx, cy, cz) = (read.corners[index] for index in face)
        volume_m3 += ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)
    assert volume_m3 / 6 == pytest.approx(1.0)


@given(order=st.permutations(range(len(WEDGE))), seed=st.integers(0, 99))
@settings(max_examples=examples(25))
def test_the_order_of_corners_and_faces_does_not_matter(tmp_path_factory, order, seed):
    """Corners come out sorted, and each once."""
    folder = tmp_path_factory.mktemp("mesh")
    corners = [WEDGE[index] for index in order]
    faces = [tuple(order.index(index) for index in face) for face in WEDGE_FACES]
    random.Random(seed).shuffle(faces)
    doubled = [*corners, *corners]
    faces = [tuple(i + len(WEDGE) * (i % 2) for i in face) for face in faces]
    read = read_mesh(folder, wedge_in(folder, corners=doubled, faces=faces), 0.01)
    assert read.corners == read_mesh(folder, wedge_in(folder), 0.01).corners
    assert Mesh(read.corners, read.faces).box.size == pytest.approx((0.02, 0.01, 0.01))


def test_corners_that_no_face_has_are_left_out(tmp_path):
    """They bound nothing."""
    name = wedge_in(tmp_path, corners=[*WEDGE, (50, 50, 50)])
    assert len(read_mesh(tmp_path, name, 0.01).corners) == 6
    corners, _ = parse_mesh((tmp_path / name).read_bytes(), ".obj")
    assert len(corners) == 6


def test_the_hash_is_that_of_the_file(tmp_path):
    """A comment more is another file."""
    mesh = read_mesh(tmp_path, wedge_in(tmp_path), 0.01)
    path = tmp_path / "wedge.obj"
    path.write_bytes(b"# a comment\n" + path.read_bytes())
    other = read_mesh(tmp_path, "wedge.obj", 0.01)
    assert mesh.corners == other.corners
    assert mesh.sha256 != other.sha256


def test_a_surface_with_a_dent_is_told_from_a_convex_one(tmp_path):
    """Whichever way its faces are listed, they are turned outward."""
    tip = (0.5, 0.5, 0.2)
    faces = [*WEDGE_FACES[:4], (3, 0, 6), (0, 4, 6), (4, 5, 6), (5, 3, 6)]
    mesh = read_mesh(tmp_path, wedge_in(tmp_path, corners=[*WEDGE, tip], faces=faces), 0.01)
    assert not mesh.convex
    mixed = [face[::-1] if number % 2 else face for number, face in enumerate(faces)]
    other = read_mesh(tmp_path, wedge_in(tmp_path, corners=[*WEDGE, tip], faces=mixed), 0.01)
    turned = [
        {(f[i], f[(i + 1) % 3]) for f in item.faces for i in range(3)} for item in (mesh, other)
    ]
    assert turned[0] == turned[1]
    assert read_mesh(tmp_path, wedge_in(tmp_path), 0.01).convex


def test_two_pieces_in_one_file_are_not_convex(tmp_path):
    """Each closed and convex, but not both together."""
    moved = [(x + 5, y, z) for x, y, z in WEDGE]
    faces = [*WEDGE_FACES, *(tuple(index + 6 for index in face) for face in WEDGE_FACES)]
    assert not read_mesh(
        tmp_path, wedge_in(tmp_path, corners=[*WEDGE, *moved], faces=faces), 0.01
    ).convex


def test_what_is_flat_to_within_rounding_is_convex(tmp_path):
    """A corner a millionth of the length outside a face's plane is there by rounding."""
    corners = [*WEDGE[:2], (2, 1, 1e-6), *WEDGE[3:]]
    assert len(read_mesh(tmp_path, wedge_in(tmp_path, corners=corners), 0.01).corners) == 6


def test_a_folded_sliver_does_not_make_a_hull_concave(tmp_path):
    """A corner half a ten-thousandth of a millimetre inside an edge folds a triangle there."""
    corners = [*WEDGE, (1, 5e-6, 5e-6)]
    faces = [(6, 0, 3, 2, 1), (0, 6, 1), *WEDGE_FACES[1:]]
    mesh = read_mesh(tmp_path, wedge_in(tmp_path, corners=corners, faces=faces), 0.01)
    assert mesh.convex
    assert len(mesh.corners) == 7


def test_a_concave_foil_is_told_from_a_hull(tmp_path):
    """Its walls, 40 micrometres high at 5 m of length, alone show the corner of the L."""
    outline = [(0, 0), (5, 0), (5, 1), (1, 1), (1, 5), (0, 5)]
    corners = [(x, y, z) for z in (0, 4e-5) for x, y in outline]
    top = [(6, 7, 8, 9), (6, 9, 10, 11)]
    walls = [(i, (i + 1) % 6, (i + 1) % 6 + 6, i + 6) for i in range(6)]
    faces = [*top, *(tuple(i - 6 for i in face[::-1]) for face in top), *walls]
    assert not read_mesh(tmp_path, wedge_in(tmp_path, corners=corners, faces=faces), 1.0).convex


def test_a_surface_with_a_hole_is_refused(tmp_path):
    """A face is missing, stands twice, or has two corners."""
    fans = triangles(WEDGE_FACES)
    # As many corners as triangles have, on one line too many and on the next too few.
    uneven = [*fans[:-2], (*fans[-2], fans[-1][0]), fans[-1][1:]]
    for faces in (WEDGE_FACES[1:], [*WEDGE_FACES, (0, 1, 4)], uneven):
        message, _ = reason(tmp_path, wedge_in(tmp_path, faces=faces))
        assert message.startswith("It is not closed")


def shifted(corners, by):
    return [tuple(a + b for a, b in zip(corner, by, strict=True)) for corner in corners]


@pytest.mark.parametrize("write", [as_obj, as_stl])
def test_closed_bodies_may_share_an_edge(tmp_path, write):
    """As a lid that ends where its tray does: the second wedge stands on the first one's back."""
    name = f"two.{write.__name__[3:]}"
    # The back's upper edge, from (0, 0, 1) to (0, 1, 1), is the lower front edge of the second.
    second = shifted([(-x, y, z) for x, y, z in WEDGE], (0, 0, 1))
    faces = [tuple(index + len(WEDGE) for index in face[::-1]) for face in WEDGE_FACES]
    (tmp_path / name).write_bytes(write([*WEDGE, *second], [*WEDGE_FACES, *faces]))
    both = read_mesh(tmp_path, name, 0.01)
    assert both.size == pytest.approx((0.04, 0.01, 0.02))
    assert (len(both.corners), len(both.faces)) == (12, 16)
    assert not both.convex
    surface = trimesh.Trimesh(both.corners, both.faces, process=False)
    assert surface.is_watertight
    assert surface.volume == pytest.approx(2e-6)


def test_closed_bodies_may_share_faces(tmp_path):
    """As mirrored halves."""
    second = [(-x, y, z) for x, y, z in WEDGE]
    faces = [tuple(index + len(WEDGE) for index in face[::-1]) for face in WEDGE_FACES]
    name = wedge_in(tmp_path, corners=[*WEDGE, *second], faces=[*WEDGE_FACES, *faces])
    both = read_mesh(tmp_path, name, 0.01)
    assert (len(both.corners), len(both.faces)) == (12, 16)


def test_a_tray_with_its_lid_is_two_closed_bodies(tmp_path):
    """The lid stands on the rim: only an outer edge joins the tray's inside to its outside."""
    outer = [(x, y, z) for z in (0, 2) for x, y in ((0, 0), (4, 0), (4, 3), (0, 3))]
    inner = [(x, y, z) for z in (1, 2) for x, y in ((1, 1), (3, 1), (3, 2), (1, 2))]
    lid = [(x, y, z) for z in (2, 3) for x, y in ((0, 0), (4, 0), (4, 3), (0, 3))]
    ring = [(0, 1), (1, 2), (2, 3), (3, 0)]
    faces = [(3, 2, 1, 0), (8, 9, 10, 11), (19, 18, 17, 16), (20, 21, 22, 23)]
    faces += [(a, b, b + 4, a + 4) for a, b in ring]
    faces += [(b + 8, a + 8, a + 12, b + 12) for a, b in ring]
    faces += [(a + 4, b + 4, b + 12, a + 12) for a, b in ring]
    faces += [(a + 16, b + 16, b + 20, a + 20) for a, b in ring]
    (tmp_path / "tray.stl").write_bytes(as_stl([*outer, *inner, *lid], faces))
    assert read_mesh(tmp_path, "tray.stl", 0.01).size == pytest.approx((0.04, 0.03, 0.03))


def test_a_body_that_touches_itself_has_corners_of_its_own_on_each_side(tmp_path):
    """Two cubes that share an edge, below a slab that joins them: one inside about the edge."""
    cells = {(0, 0, 0), (1, 1, 0), *((x, y, 1) for x in (0, 1) for y in (0, 1))}
    corners, faces = [], []
    for cell in sorted(cells):
        for axis in range(3):
            for side in (0, 1):
                beyond = tuple(n + (2 * side - 1) * (k == axis) for k, n in enumerate(cell))
                if beyond in cells:
                    continue
                across, up = (axis + 1) % 3, (axis + 2) % 3
                ring = [(0, 0), (1, 0), (1, 1), (0, 1)]
                for a, b in ring if side else ring[::-1]:
                    offset = {axis: side, across: a, up: b}
                    corners.append(tuple(cell[k] + offset[k] for k in range(3)))
                faces.append(tuple(range(len(corners) - 4, len(corners))))
    body = read_mesh(tmp_path, wedge_in(tmp_path, corners=corners, faces=faces), 0.01)
    surface = trimesh.Trimesh(body.corners, body.faces, process=False)
    assert surface.is_watertight
    assert surface.volume == pytest.approx(6e-6)
    # The lower end of the shared edge has a corner in either cube; its upper end is in the slab.
    assert len(body.corners) == len(set(corners)) + 1


def test_units_are_told_by_the_scale(tmp_path):
    """What would be right in millimetres is named."""
    wedge_in(tmp_path)
    assert reason(tmp_path, scale=10.0) == (
        "It is 20 m long, where 10 m are the most. Is the file in millimetres? "
        "Then give scale: 0.01.",
        "scale",
    )
    assert "millimetres" not in reason(tmp_path, scale=1e9)[0]
    message, key = reason(tmp_path, scale=1e-7)
    assert (message, key) == ("It is 2e-07 m long, where 1e-06 m are the least.", "scale")


@pytest.mark.parametrize("value", ["nan", "inf", "1e999", "1e308"])
def test_a_coordinate_without_an_end_is_refused(tmp_path, value):
    """Before anything is computed with it."""
    wedge_in(tmp_path, corners=[(value, 0, 0), *WEDGE[1:]])
    message, _ = reason(tmp_path, scale=1e9)
    assert "not finite" in message or " m long, where 10 m are the most" in message


def test_a_surface_of_too_many_corners_is_refused(tmp_path):
    """With how many there may be."""
    count = MAX_CORNERS // 2 + 1
    corners = [(i / count, (i / count) ** 2, z) for z in (0, 1) for i in range(count)]
    ring = [(i, (i + 1) % count, count + (i + 1) % count, count + i) for i in range(count)]
    faces = [tuple(range(count))[::-1], tuple(range(count, 2 * count)), *ring]
    message, _ = reason(tmp_path, wedge_in(tmp_path, corners=corners, faces=faces))
    assert message == "It has 20,002 corners, where 20,000 are the most; simplify it."


def test_a_file_too_large_is_refused_unread(tmp_path):
    """Four mebibytes are the most."""
    (tmp_path / "wedge.obj").write_bytes(b"#" * (MAX_BYTES + 1))
    message, _ = reason(tmp_path)
    assert message == "The file is larger than 4 MiB; keep the surface alone."


def test_a_link_that_leads_out_of_the_folder_is_refused(tmp_path):
    """Of a file or of a folder; one that stays inside is followed."""
    inside, outside = tmp_path / "inside", tmp_path / "outside"
    inside.mkdir()
    outside.mkdir()
    wedge_in(outside)
    wedge_in(inside)
    (inside / "file.obj").symlink_to(outside / "wedge.obj")
    (inside / "folder").symlink_to(outside)
    (inside / "own.obj").symlink_to(inside / "wedge.obj")
    for name in ("file.obj", "folder/wedge.obj", "../outside/wedge.obj", "folder/../wedge.obj"):
        message, _ = reason(inside, name)
        assert message == "The file lies outside the task file's folder; copy it there."
    assert len(read_mesh(inside, "own.obj", 0.01).corners) == 6


def test_a_link_to_itself_is_refused(tmp_path):
    """It leads nowhere."""
    (tmp_path / "wedge.obj").symlink_to(tmp_path / "wedge.obj")
    assert reason(tmp_path)[0].startswith(("The file cannot be", "There is no such file"))


def test_a_pipe_is_refused_and_not_waited_for(tmp_path):
    """Nobody may ever write to it."""
    os.mkfifo(tmp_path / "wedge.obj")
    assert reason(tmp_path)[0] == "This is no regular file; give one."


@pytest.mark.parametrize("name", ["", " ", "\0", "a\nb.obj", "C:/wedge.obj", "a\\wedge.obj"])
def test_a_name_that_is_no_relative_path_is_refused(tmp_path, name):
    """Whatever the system would make of it."""
    wedge_in(tmp_path)
    message, key = reason(tmp_path, name)
    assert key == "file"
    assert message.startswith(("This names no file", "The path must be relative"))


@given(
    suffix=st.sampled_from(sorted(FORMS)),
    content=st.binary(max_size=200) | st.text(max_size=200).map(lambda text: text.encode()),
    cut=st.integers(0, 400),
)
@settings(max_examples=examples(150))
def test_no_file_is_too_odd(tmp_path_factory, suffix, content, cut):
    """Bytes that are no mesh, and a mesh with bytes in it: a polyhedron or a reason."""
    folder = tmp_path_factory.getbasetemp()
    whole = FORMS[suffix](WEDGE, WEDGE_FACES)
    for text in (content, whole[:cut] + content + whole[cut:]):
        (folder / f"odd{suffix}").write_bytes(text)
        message = io.StringIO()
        with contextlib.redirect_stderr(message), contextlib.suppress(MeshFileError):
            read = read_mesh(folder, f"odd{suffix}", 0.01)
            Mesh(read.about((0.0, 0.0, 0.0)), read.faces)
        assert message.getvalue() == ""


MESH = '<collision><geometry><mesh filename="m.stl" scale="{0} {0} {0}"/></geometry></collision>'


def arm_of(folder, *scales):
    """Return the arm of a URDF whose links have wedges of such scales."""
    (folder / "m.stl").write_bytes(as_stl(WEDGE, WEDGE_FACES))
    shapes = "".join(MESH.format(scale) for scale in scales)
    (folder / "arm.urdf").write_text(urdf(collisions={3: shapes}), "utf-8")
    return read_arm(folder, "arm.urdf", "flange", None)[0]


def test_a_mesh_that_an_arm_names_often_is_read_once_a_scale(tmp_path, monkeypatch):
    reads = []

    def count_reads(content, suffix):
        reads.append(suffix)
        return parse_mesh(content, suffix)

    monkeypatch.setattr(arm_meshes, "parse_mesh", count_reads)
    arm = arm_of(tmp_path, *[0.11] * 100, 0.22)
    assert len(arm.shapes[3]) == 101
    assert arm.shapes[3][0] == arm.shapes[3][99] != arm.shapes[3][100]
    assert len(reads) == 2


def test_a_mesh_that_is_refused_is_read_once(tmp_path, monkeypatch):
    """Thousands of parts of a task may name it."""
    reads = []

    def count_reads(content, suffix):
        reads.append(suffix)
        return parse_mesh(content, suffix)

    monkeypatch.setattr(mesh_files, "parse_mesh", count_reads)
    (tmp_path / "open.obj").write_bytes(as_obj(WEDGE, WEDGE_FACES[1:]))
    for _ in range(3):
        with pytest.raises(MeshFileError, match="It is not closed"):
            read_mesh(tmp_path, "open.obj", 1.0)
    assert len(reads) == 1


def test_meshes_of_an_arm_that_are_too_large_together_are_refused(tmp_path, monkeypatch):
    size = len(as_stl(WEDGE, WEDGE_FACES))
    monkeypatch.setattr(arm_files, "MAX_MESH_BYTES", 3 * size)
    assert len(arm_of(tmp_path, 0.1, 0.2, 0.3).shapes[3]) == 3
    with pytest.raises(ArmFileError, match=r"Its meshes have more than \d+ MiB together"):
        arm_of(tmp_path, 0.1, 0.2, 0.3, 0.4)


@pytest.mark.parametrize("scale", ["1e6", "-1e6", "0", "1e-300"])
def test_a_mesh_of_an_arm_at_no_sensible_scale_is_refused(tmp_path, scale):
    with pytest.raises(ArmFileError, match=r"Mesh 'm\.stl': it is"):
        arm_of(tmp_path, scale)


def as_3mf(corners, faces, unit="millimeter", extra=""):
    """Return the content of a 3MF that builds an object twice, once moved by 3 along x."""
    points = "".join('<vertex x="{}" y="{}" z="{}"/>'.format(*corner) for corner in corners)
    rows = "".join('<triangle v1="{}" v2="{}" v3="{}"/>'.format(*row) for row in triangles(faces))
    mesh = f"<mesh><vertices>{points}</vertices><triangles>{rows}</triangles></mesh>"
    move = 'transform="1 0 0 0 1 0 0 0 1 3 0 0"'
    model = (
        f'{extra}<model unit="{unit}"><resources><object id="1">{mesh}</object>'
        f'<object id="2"><components><component objectid="1"/><component objectid="1" {move}/>'
        '</components></object></resources><build><item objectid="2"/></build></model>'
    )
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        archive.writestr("3D/3dmodel.model", model)
    return stream.getvalue()


@pytest.mark.parametrize(("unit", "scale"), [("millimeter", 1e-3), ("inch", 0.0254)])
def test_a_3mf_is_in_its_own_unit_with_its_components_placed(tmp_path, unit, scale):
    (tmp_path / "wedges.3mf").write_bytes(as_3mf(WEDGE, WEDGE_FACES, unit))
    wedges = read_mesh(tmp_path, "wedges.3mf", 1.0)
    assert wedges.size == pytest.approx((5 * scale, scale, scale))
    assert len(wedges.corners) == 2 * len(WEDGE)


def test_a_glb_is_in_metres(tmp_path):
    corners = [[0.01 * value for value in corner] for corner in WEDGE]
    mesh = trimesh.Trimesh(corners, triangles(WEDGE_FACES), process=False)
    (tmp_path / "wedge.glb").write_bytes(mesh.export(file_type="glb"))
    assert read_mesh(tmp_path, "wedge.glb", 1.0).size == pytest.approx((0.02, 0.01, 0.01))


def as_glb(**changes):
    """Return a GLB of one triangle; an accessor has further keys as given."""
    accessor = {"componentType": 5126, "count": 3, "type": "VEC3"}
    header = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [accessor | changes.pop("accessor", {})],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "buffers": [{"byteLength": 36}],
        **changes,
    }
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 4)
    chunk = struct.pack("<I4s", len(text), b"JSON") + text
    chunk += struct.pack("<I4s", 36, b"BIN\0") + struct.pack("<9f", 0, 0, 0, 1, 0, 0, 0, 1, 0)
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunk)) + chunk


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"accessor": {"count": 2_000_000_000}}, "claim 24,000,000,000 bytes, where the file has"),
        ({"accessor": {"count": -1}}, "claim -12 bytes"),
        ({}, "accessor 0 has no data in the file"),
        ({"accessor": {"bufferView": 0, "sparse": {"count": 1}}}, "sparse or normalized"),
        ({"accessor": {"bufferView": 0, "normalized": True}}, "sparse or normalized"),
        ({"extensionsRequired": ["KHR_draco_mesh_compression"]}, "is compressed by Draco"),
        ({"extensionsUsed": ["EXT_meshopt_compression"]}, "is compressed by meshopt"),
        ({"accessor": {"bufferView": 0}, "nodes": [{"mesh": 0}] * 700_000}, "2,100,000 corners"),
    ],
)
def test_a_glb_is_refused_before_it_takes_memory(changes, words, capsys):
    with pytest.raises(MeshFileError, match=words):
        parse_mesh(as_glb(**changes), ".glb")
    assert capsys.readouterr().err == ""


def test_a_plain_glb_is_read():
    corners, faces = parse_mesh(as_glb(accessor={"bufferView": 0}), ".glb")
    assert (len(corners), len(faces)) == (3, 1)


@pytest.mark.parametrize(
    "content",
    [
        b"PK nothing",
        as_3mf(WEDGE, WEDGE_FACES, "parsec"),
        as_3mf(WEDGE[:-1], WEDGE_FACES),
        as_3mf(WEDGE, WEDGE_FACES, extra='<!DOCTYPE a [<!ENTITY b "c">]>'),
    ],
)
def test_a_damaged_or_hostile_3mf_is_refused(tmp_path, content):
    (tmp_path / "odd.3mf").write_bytes(content)
    with pytest.raises(MeshFileError, match="It cannot be read as 3MF; save it again"):
        read_mesh(tmp_path, "odd.3mf", 1.0)


def test_a_step_file_needs_a_plugin_that_meshes_it(tmp_path, monkeypatch):
    monkeypatch.setattr(mesh_files, "list_mesh_readers", list)
    (tmp_path / "part.step").write_bytes(b"ISO-10303-21;")
    with pytest.raises(MeshFileError, match="STEP is read by skillplan-cad; install it"):
        read_mesh(tmp_path, "part.step", 1.0)


# Convex pieces that a task file gives for a mesh: what a part moves as.


BOARD = """\
kind: assembly
name: channel-on-plate
robot: {home_m: [0.3, 0.0], safe_height_m: 0.2}
tools:
  gripper: {opening_m: 0.080, holder_m: [0.5, 0.3]}
  cup: {type: suction, holder_m: [0.6, 0.3]}
initial_tool: gripper
parts:
  plate: {tool: cup, size_m: [0.10, 0.16, 0.02], start_m: [0.3, 0.2], goal_m: [0.5, 0.0]}
  channel:
    tool: gripper
    meshes: [{file: channel.obj, pieces: pieces.obj}]
    start_m: [0.4, -0.2]
    goal_m: [0.5, 0.0]
    goal_on: plate
"""
# A floor and two walls, of 5 mm each.
BOXES = (
    ((-0.015, 0.015), (-0.01, 0.01), (0.0, 0.005)),
    ((-0.015, -0.010), (-0.01, 0.01), (0.0, 0.020)),
    ((0.010, 0.015), (-0.01, 0.01), (0.0, 0.020)),
)
FACES = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
PROFILE = ((-15, 20), (-15, 0), (15, 0), (15, 20), (10, 20), (10, 5), (-10, 5), (-10, 20))
"""Of the channel, x and z [mm]."""


def boxes_text(boxes):
    """Return boxes as OBJ, each with corners of its own."""
    lines = []
    for number, (xs, ys, zs) in enumerate(boxes):
        lines += [f"v {x} {y} {z}" for x in xs for y in ys for z in zs]
        lines += ["f " + " ".join(str(8 * number + corner + 1) for corner in f) for f in FACES]
    return "\n".join(lines) + "\n"


def channel_text():
    """Return the closed surface of the channel as OBJ."""
    corners = [(x / 1e3, y, z / 1e3) for y in (-0.01, 0.01) for x, z in PROFILE]
    sides = [(i, i + 8, (i + 1) % 8 + 8, (i + 1) % 8) for i in range(8)]
    ends = [(0, 1, 6, 7), (1, 2, 5, 6), (2, 3, 4, 5)]
    ends += [tuple(corner + 8 for corner in reversed(end)) for end in ends]
    lines = [f"v {x} {y} {z}" for x, y, z in corners]
    lines += ["f " + " ".join(str(corner + 1) for corner in face) for face in sides + ends]
    return "\n".join(lines) + "\n"


@pytest.fixture
def board(tmp_path):
    """A task file whose channel brings three pieces along."""
    (tmp_path / "channel.obj").write_text(channel_text())
    (tmp_path / "pieces.obj").write_text(boxes_text(BOXES))
    path = tmp_path / "board.yaml"
    path.write_text(BOARD)
    return path


def test_check_says_as_how_many_pieces_a_part_moves_and_how_far_they_are_off(board, capsys):
    """No plugin takes it apart."""
    assert run(["check", str(board), "--format", "json"]) == 0
    (result,) = json.loads(capsys.readouterr().out)["pieces"]
    assert result["part"] == "channel"
    assert result["pieces"] == 3
    assert result["outside_mm"] == pytest.approx(0, abs=1e-3)
    assert result["missing_mm"] == pytest.approx(0, abs=1e-3)


def test_other_pieces_are_another_task(board):
    """Its hash says so, as verdicts that are kept depend on them."""
    first = skillplan.load_problem(board).sha256
    (board.parent / "pieces.obj").write_text(boxes_text((BOXES[1], BOXES[0], BOXES[2])))
    assert skillplan.load_problem(board).sha256 != first


# A mesh without centre_m is moved: `check` says how far, and which centre_m keeps its origin.


SHIFTED_FACES = [(1, 3, 4, 2), (5, 6, 8, 7), (1, 2, 6, 5), (3, 7, 8, 4), (1, 5, 7, 3), (2, 4, 8, 6)]


def write_block(folder: Path, name: str, low_mm: list[float], high_mm: list[float]) -> None:
    """Write a block between two corners [mm] as an OBJ file."""
    xs, ys, zs = zip(low_mm, high_mm, strict=True)
    corners = [(x, y, z) for x in xs for y in ys for z in zs]
    lines = [f"v {x} {y} {z}" for x, y, z in corners]
    lines += ["f " + " ".join(map(str, face)) for face in SHIFTED_FACES]
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
