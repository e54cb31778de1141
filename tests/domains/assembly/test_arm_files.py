"""Arms from files: where packages are, what meshes hold, what xacro may do, and an arm alone."""

import json
import struct
from itertools import product

import numpy as np
import pytest
import trimesh
from scipy.spatial import ConvexHull

from skillplan.domains.assembly import ArmFileError, read_arm
from urdf_text import joint, urdf

BOX = trimesh.creation.box((0.1, 0.06, 0.06))
MESH = '<collision><geometry><mesh filename="{0}"/></geometry></collision>'


def write_stl(path, triangles):
    """Write a binary STL file; trimesh writes none without triangles."""
    path.parent.mkdir(parents=True, exist_ok=True)
    records = b"".join(
        struct.pack("<12fH", 0, 0, 0, *np.asarray(triangle, dtype=float).ravel(), 0)
        for triangle in triangles
    )
    path.write_bytes(b"own".ljust(80) + struct.pack("<I", len(triangles)) + records)


def write_arm(folder, mesh, name="arm.urdf"):
    """Write an arm whose third link has a mesh."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / name).write_text(urdf(collisions={3: MESH.format(mesh)}), "utf-8")


def third_link(folder, name="arm.urdf", packages=()):
    """Return the corners of the third link's shapes [m]."""
    arm = read_arm(folder, name, "flange", [0.1] * 6, packages)[0]
    return [np.array(hull.corners_m) for hull in arm.shapes[3]]


@pytest.fixture
def package(tmp_path):
    """Return a folder with the package ``own``, whose mesh is a box."""
    write_stl(tmp_path / "own" / "meshes" / "box.stl", BOX.triangles)
    return tmp_path


def assert_box(pieces):
    (corners,) = pieces
    assert np.ptp(corners, axis=0) == pytest.approx((0.1, 0.06, 0.06))


def test_a_package_is_found_around_its_urdf(package):
    """The folders urdf and meshes side by side, from the folder of the task or from their own."""
    write_arm(package / "own" / "urdf", "package://own/meshes/box.stl")
    assert_box(third_link(package, "own/urdf/arm.urdf"))
    assert_box(third_link(package / "own" / "urdf"))


def test_a_package_is_named_in_the_task(package):
    """Its folder, or one that contains it."""
    write_arm(package / "cell", "package://own/meshes/box.stl")
    for given in ("../own", "..", str(package)):
        assert_box(third_link(package / "cell", packages=[given]))
    with pytest.raises(ArmFileError, match="There is no folder 'nowhere'") as caught:
        third_link(package / "cell", packages=["nowhere"])
    assert caught.value.key == "packages"


@pytest.mark.parametrize(
    ("variable", "part"), [("ROS_PACKAGE_PATH", ""), ("AMENT_PREFIX_PATH", "share")]
)
def test_packages_of_ros_are_found(package, monkeypatch, variable, part):
    write_arm(package / "cell", "package://own/meshes/box.stl")
    root = package / "ros"
    (root / part).mkdir(parents=True)
    (package / "own").rename(root / part / "own")
    monkeypatch.setenv(variable, f"/nowhere:{root}")
    assert_box(third_link(package / "cell"))


def test_a_package_of_another_name_is_found_by_the_end_of_its_path(package):
    """Its folder was renamed; the description says so."""
    write_arm(package / "own" / "urdf", "package://former/meshes/box.stl")
    arm = read_arm(package / "own", "urdf/arm.urdf", "flange", [0.1] * 6)[0]
    assert arm.assumptions[0] == "no package 'former': its files are taken from own"
    assert len(arm.shapes[3]) == 1


def test_a_missing_mesh_names_the_folders_tried(package):
    write_arm(package / "own" / "urdf", "package://own/meshes/ball.stl")
    with pytest.raises(
        ArmFileError, match=r"Mesh 'package://own/meshes/ball.stl'.*tried"
    ) as caught:
        third_link(package, "own/urdf/arm.urdf")
    assert f"{package}/own; " in str(caught.value)


@pytest.mark.parametrize(
    "name",
    ["package://own/../secret.stl", "package://../secret.stl", "../secret.stl", "/secret.stl"],
)
def test_no_mesh_is_read_outside_the_folder_and_the_packages(package, name):
    write_stl(package / "secret.stl", BOX.triangles)
    write_arm(package / "own", name)
    with pytest.raises(ArmFileError):
        third_link(package / "own")


def test_a_relative_mesh_may_lie_in_a_named_package(package):
    write_arm(package / "cell", "../own/meshes/box.stl")
    with pytest.raises(ArmFileError, match=r"outside .* 'robot\.packages'"):
        third_link(package / "cell")
    assert_box(third_link(package / "cell", packages=["../own"]))


def dae(unit, turned):
    """Return a DAE file of the box in a unit [m], its node turned about z."""
    corners = " ".join(f"{v:.9g}" for v in (np.asarray(BOX.vertices) / unit).ravel())
    faces = " ".join(str(index) for index in np.asarray(BOX.faces).ravel())
    matrix = "0 -1 0 0 1 0 0 0 0 0 1 0 0 0 0 1" if turned else "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1"
    axes = "".join(f'<param name="{axis}" type="float"/>' for axis in "XYZ")
    return f"""<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><created>2026-01-01T00:00:00</created><modified>2026-01-01T00:00:00</modified>
<unit name="own" meter="{unit}"/><up_axis>Z_UP</up_axis></asset>
<library_geometries><geometry id="g"><mesh><source id="p">
<float_array id="n" count="{3 * len(BOX.vertices)}">{corners}</float_array>
<technique_common><accessor source="#n" count="{len(BOX.vertices)}" stride="3">{axes}</accessor>
</technique_common></source><vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="{len(BOX.faces)}"><input semantic="VERTEX" source="#v" offset="0"/>
<p>{faces}</p></triangles></mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node id="o"><matrix>{matrix}</matrix>
<instance_geometry url="#g"/></node></visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene></COLLADA>
"""


@pytest.mark.parametrize(("unit", "turned"), [(1, False), (0.001, False), (0.0254, True)])
def test_unit_and_node_of_a_dae_file_count(tmp_path, unit, turned):
    pytest.importorskip("collada", reason="of the extra urdf")
    (tmp_path / "box.dae").write_text(dae(unit, turned), "utf-8")
    write_arm(tmp_path, "box.dae")
    (corners,) = third_link(tmp_path)
    assert np.ptp(corners, axis=0) == pytest.approx(
        (0.06, 0.1, 0.06) if turned else (0.1, 0.06, 0.06)
    )


def test_a_dae_file_declares_no_document_type(tmp_path):
    pytest.importorskip("collada", reason="of the extra urdf")
    bomb = dae(1, turned=False).replace("<COLLADA", '<!DOCTYPE a [<!ENTITY b "c">]><COLLADA')
    (tmp_path / "box.dae").write_text(bomb, "utf-8")
    write_arm(tmp_path, "box.dae")
    with pytest.raises(ArmFileError, match="document type"):
        third_link(tmp_path)


def test_a_glb_file_is_read(tmp_path):
    (tmp_path / "box.glb").write_bytes(BOX.export(file_type="glb"))
    write_arm(tmp_path, "box.glb")
    assert_box(third_link(tmp_path))


def test_an_empty_mesh_is_no_shape(tmp_path):
    write_stl(tmp_path / "box.stl", [])
    write_arm(tmp_path, "box.stl")
    arm = read_arm(tmp_path, "arm.urdf", "flange", [0.1] * 6)[0]
    assert arm.shapes[3] == ()
    assert "no volume in a shape of link_3 (box.stl): left out" in arm.assumptions


def test_pieces_cover_an_angle_and_leave_its_inside_free(tmp_path):
    """A single hull of an L would fill the space between its legs."""
    upright = trimesh.creation.box((0.05, 0.05, 0.4)).apply_translation((0, 0, 0.2))
    foot = trimesh.creation.box((0.4, 0.05, 0.05)).apply_translation((0.175, 0, 0.025))
    angle = trimesh.util.concatenate([upright, foot])
    write_stl(tmp_path / "box.stl", angle.triangles)
    write_arm(tmp_path, "box.stl")
    hulls = [ConvexHull(corners) for corners in third_link(tmp_path)]
    assert len(hulls) > 1

    def covers(point):
        return any((hull.equations @ (*point, 1.0) <= 1e-6).all() for hull in hulls)

    assert all(covers(point) for point in trimesh.sample.sample_surface(angle, 300, seed=1)[0])
    assert not covers((0.2, 0.0, 0.2))


XACRO = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'


def write_xacro(folder, more="", head="", name="arm.urdf.xacro"):
    """Write the usual arm, with elements of xacro before its links."""
    text = urdf(head="").replace('<robot name="six">', f'<robot name="six" {XACRO}>{head}{more}')
    (folder / name).write_text(text, "utf-8")


def read_xacro(folder, **arguments):
    return read_arm(folder, "arm.urdf.xacro", "flange", [0.1] * 6, (), arguments)[0]


def test_xacro_is_expanded(tmp_path):
    """Properties, arguments with defaults, macros, and included files of the folder."""
    pytest.importorskip("xacro", reason="of the extra urdf")
    (tmp_path / "more.xacro").write_text(
        f'<robot {XACRO}><xacro:macro name="twin" params="of"><link name="${{of}}_twin"/>'
        "</xacro:macro></robot>"
    )
    write_xacro(
        tmp_path,
        '<xacro:include filename="more.xacro"/><xacro:arg name="long" default="0.5"/>'
        '<xacro:twin of="a"/><xacro:property name="half" value="${0.5 * $(arg long)}"/>',
    )
    path = tmp_path / "arm.urdf.xacro"
    path.write_text(path.read_text().replace("0 0 0.42", "0 0 ${half}"))
    assert read_xacro(tmp_path).joints[2].placement.xyz_m[2] == 0.25
    assert read_xacro(tmp_path, long="0.8").joints[2].placement.xyz_m[2] == 0.4


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ('<xacro:include filename="/etc/hostname"/>', "outside the task file's folder"),
        ('<xacro:include filename="../other.xacro"/>', "outside the task file's folder"),
        ('<xacro:include filename="$(find nowhere)/a.xacro"/>', "no package 'nowhere'"),
        ('<a b="${[x for x in ().__class__.__base__.__subclasses__()]}"/>', "uses '__"),
        ('<a b="${9**9**9**9}"/>', "a power without bound"),
        ('<a b="$(env HOME)"/>', "reads the environment variable 'HOME'"),
        ('<a b="$(arg arm_type)"/>', "robot.xacro_args: {arm_type: ...}"),
        ('<xacro:macro name="m"><xacro:m/></xacro:macro><xacro:m/>', "call themselves without end"),
        ('<a b="${nothing}"/>', "name 'nothing' is not defined"),
    ],
)
def test_xacro_does_not_reach_beyond_its_files(tmp_path, more, words):
    pytest.importorskip("xacro", reason="of the extra urdf")
    (tmp_path.parent / "other.xacro").write_text("<robot/>")
    write_xacro(tmp_path, more)
    with pytest.raises(ArmFileError) as caught:
        read_xacro(tmp_path)
    assert words in str(caught.value)


def test_without_the_library_the_first_use_is_named(tmp_path, monkeypatch):
    """A definition without use is passed over."""
    (tmp_path / "arm.urdf").write_text(
        urdf(head="").replace(
            '<robot name="six">',
            f'<robot name="six" {XACRO}>\n<xacro:property name="a_m" value="1"/>\n',
        )
    )
    arm = read_arm(tmp_path, "arm.urdf", "flange", [0.1] * 6)[0]
    assert arm.assumptions[0] == "1 xacro element passed over, because nothing uses it"
    (tmp_path / "arm.urdf").write_text(
        (tmp_path / "arm.urdf").read_text().replace("0 0 0.42", "0 0 ${a_m}")
    )
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(ArmFileError, match=r"Line \d+: \$\{a_m\} is xacro.*skillplan\[urdf\]"):
        read_arm(tmp_path, "arm.urdf", "flange", [0.1] * 6)


def test_check_describes_an_arm_alone(tmp_path, check):
    """Joints, tip at zero, reach, masses, and a picture; the tip is found."""
    (tmp_path / "arm.urdf").write_text(urdf(), "utf-8")
    code, out, err = check(
        tmp_path / "arm.urdf", "--format", "json", "--picture", tmp_path / "arm.png"
    )
    assert (code, err) == (0, "")
    document = json.loads(out)
    assert document["schema"] == "skillplan.arm/1"
    assert document["tip"] == "flange"
    assert document["tip_at_zero_m"] == pytest.approx((0.0, 0.0, 1.3))
    assert document["reach_m"] == pytest.approx(1.3, abs=0.02)
    assert document["mass_kg"] == 6.0
    assert [joint["name"] for joint in document["joints"]] == [f"joint_{n}" for n in range(1, 7)]
    assert (tmp_path / "arm.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--set", "robot.tip=hand"], "there is no link 'hand'"),
        (["--set", "robot.tip=link_2"], "2 joints move between its base and 'link_2'"),
        (["--set", "parts.a=1"], "a robot alone has keys under 'robot' only"),
        (["--picture", "arm.svg"], "arm.svg"),
    ],
)
def test_check_says_why_an_arm_is_none(tmp_path, check, words, message):
    (tmp_path / "arm.urdf").write_text(urdf(), "utf-8")
    code, out, err = check(tmp_path / "arm.urdf", *words)
    assert (code, out) == (2, "")
    assert message in err.lower() or message in err


def test_check_tells_how_many_joints_move_where_they_are_too_few(tmp_path, check):
    text = urdf()
    for number in (4, 5, 6):
        text = text.replace(f'"joint_{number}" type="revolute"', f'"joint_{number}" type="fixed"')
    (tmp_path / "gantry.urdf").write_text(text, "utf-8")
    code, _, err = check(tmp_path / "gantry.urdf")
    assert code == 2
    assert "no chain of 4 to 8 moving joints: 3 are the most" in err


def test_a_picture_of_a_task_is_refused(tmp_path, check):
    (tmp_path / "task.yaml").write_text("kind: assembly\n")
    code, _, err = check(tmp_path / "task.yaml", "--picture", tmp_path / "arm.png")
    assert code == 2
    assert "--picture draws a robot or tool alone" in err


def test_one_warning_lists_all_assumptions(tmp_path, check):
    text = urdf().replace('effort="100"', 'effort="0"').replace('value="1.0"', 'value="0"')
    (tmp_path / "arm.urdf").write_text(text, "utf-8")
    (tmp_path / "task.yaml").write_text(
        "kind: assembly\nname: box\n"
        "robot: {model: arm.urdf, tip: flange, home_m: [0.4, 0.0], reach_m: 1.1}\n"
        "tools: {gripper: {holder_m: [0.5, 0.3]}}\ninitial_tool: gripper\nparts:\n"
        "  box: {tool: gripper, size_m: [0.05, 0.1, 0.1], start_m: [0.4, 0.2],\n"
        "    goal_m: [0.5, 0.0]}\n"
    )
    code, out, _ = check(tmp_path / "task.yaml", "--collision", "aabb", "--format", "json")
    assert code == 0
    (warning,) = [text for text in json.loads(out)["warnings"] if "robot.model" in text]
    for n in range(1, 7):
        assert f"link_{n}" in warning
        assert f"joint_{n}" in warning


def test_corners_of_a_thin_ball_stay_few(tmp_path):
    """A mesh of thousands of triangles becomes a hull of at most a thousand corners."""
    ball = trimesh.creation.icosphere(4, 0.1)
    write_stl(tmp_path / "box.stl", ball.triangles)
    write_arm(tmp_path, "box.stl")
    (corners,) = third_link(tmp_path)
    assert len(corners) <= 1_000
    directions = np.array(list(product((-1, 1), repeat=3))) / np.sqrt(3)
    assert (corners @ directions.T).max(axis=0) == pytest.approx(0.1, abs=3e-4)


def test_check_counts_no_follower_as_a_freedom_and_moves_it_with_its_leader(tmp_path, check):
    """At zero joint_3 stands at its offset, 0.2 rad."""
    text = urdf({3: joint(3, more='<mimic joint="joint_2" multiplier="-0.5" offset="0.2"/>')})
    (tmp_path / "arm.urdf").write_text(text, "utf-8")
    (tmp_path / "free.urdf").write_text(urdf(), "utf-8")
    assert "5, 1 missing" in check(tmp_path / "arm.urdf")[1]
    tips_m = [
        json.loads(check(tmp_path / file, "--format", "json")[1])["tip_at_zero_m"]
        for file in ("arm.urdf", "free.urdf")
    ]
    assert tips_m[0] != tips_m[1]
