"""Which parts are screws, nuts, washers and pins, and which only look or are named like them."""

from __future__ import annotations

import json

import manifold3d
import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

import skillplan_cad as cad
from skillplan.cli import run

Solid = manifold3d.Manifold
SCREW = "screw M3x8"


def rod(radius, low, high, sections=48):
    """Return a cylinder about z [mm]."""
    return Solid.cylinder(high - low, radius, radius, sections).translate((0, 0, low))


def hexagon(width, low, high):
    """Return a hexagonal prism about z [mm]."""
    return rod(width / np.sqrt(3), low, high, 6)


def cuboid(*bounds):
    """Return the cuboid between two corners [mm]."""
    low, high = np.reshape(bounds, (2, 3))
    return Solid.cube(tuple(high - low)).translate(tuple(low))


def pan_head_screw():
    """Return an M3x8 with a fillet of 0.5 mm under its head and a slot, the head above z = 0."""
    turn = np.linspace(0, np.pi / 2, 10)
    profile = [(0, -8), (1, -8), (1.5, -7.5)]
    profile += [(2 - 0.5 * np.cos(a), -0.5 + 0.5 * np.sin(a)) for a in turn]
    profile += [(2.8, 0), (2.8, 1), (2, 2), (0, 2)]
    return Solid.revolve(manifold3d.CrossSection([profile]), 48) - cuboid(-3, -0.4, 1, 3, 0.4, 3)


def write(folder, parts, turn=(0, 0, 0)):
    """Write solids as STL [mm], and return the folder."""
    folder.mkdir(exist_ok=True)
    for name, solid in parts.items():
        mesh = solid.rotate(turn).to_mesh()
        vertices = np.asarray(mesh.vert_properties)[:, :3]
        trimesh.Trimesh(vertices, np.asarray(mesh.tri_verts), process=False).export(
            folder / f"{name}.stl"
        )
    return folder


def screwed(core_mm=1.25, name=SCREW):
    """Return a cover on a base, joined by a screw in a core hole of a radius, 0 for none."""
    base = cuboid(-15, -15, -15, 15, 15, -3)
    if core_mm:
        base -= rod(core_mm, -13, 0)
    cover = cuboid(-15, -15, -3, 15, 15, 0) - rod(2.2, -4, 1)
    return {"base": base, "cover": cover, name: pan_head_screw()}


def find(folder, parts, options=None, **more):
    """Return the joints of parts as meshes."""
    product = cad.read_product(write(folder, parts, **more), cad.ReadOptions("mm"))
    return cad.find_joints(product, 1e-4, "cylinders", "unscrew", declared=options)


@pytest.mark.parametrize(
    ("kind", "names"),
    [
        ("screw", "MB4 vis M3 x 8-1|Zylinderschraube|tornillo|vite M4|DIN 912-M4|iso_4762|Bolt11L"),
        ("screw", "M3x8|socket head cap|SHCS M5|LargeScrew1-1|内六角螺钉|ボルト|винт|BOLT#2/SOLID"),
        ("screw", "button head cap screw|screw M3 holder plate|śruba M6|parafuso"),
        ("screw", "DIN EN ISO 4014|Lock:1/ISO 7046-1 - M4 x 20 - Z:1"),
        (
            "nut",
            "écrou frein|MD5 ecrou M3-7|Sechskantmutter|tuerca|dado|DIN 934|hexnut_m3|螺母|T-nut",
        ),
        ("washer", "U-Scheibe|washer .5-7|rondelle|arandela|DIN 125-A|lock washer|垫圈"),
        ("pin", "dowel pin 4x14|321-DowellGrooved-10|Zylinderstift|goupille|rivet|ISO 2338|PinL-1"),
        (
            None,
            "Bolts-1 plate-1|nut holder|bolt cover|lead screw|screwdriver|pin header|M3x8 spacer",
        ),
        (None, "support de vis|heat insert M3x5|visor|donut|pinion|Mutternhalter|deadbolt lock"),
    ],
)
def test_names_of_many_languages_and_standards_tell_the_kind(kind, names):
    assert {name: cad.recognise_kind(name, "") for name in names.split("|")} == dict.fromkeys(
        names.split("|"), kind
    )


@pytest.mark.parametrize("core_mm", [1.25, 1.5, 0])
def test_a_screw_with_a_fillet_is_threaded_in_the_last_part_that_its_shank_overlaps(
    tmp_path, core_mm
):
    """Though no cylinder is fitted to it; tapped, drawn as wide as the screw, or not drawn.

    A lid that covers its head is not joined.
    """
    lid = cuboid(-15, -15, 2, 15, 15, 5)
    (screw,) = find(tmp_path / "stl", screwed(core_mm) | {"lid": lid}).fasteners
    assert (screw.kind, screw.joins, screw.threaded_in) == ("screw", ("cover", "base"), ("base",))
    assert screw.diameter_m == pytest.approx(3e-3, rel=0.01)
    assert screw.length_m == pytest.approx(8e-3, rel=0.05)
    assert screw.axis == pytest.approx((0, 0, 1), abs=1e-3)


@settings(max_examples=3, deadline=None)
@given(st.tuples(*[st.floats(-180, 180)] * 3))
def test_fasteners_do_not_depend_on_the_frame(tmp_path_factory, turn):
    joints = find(tmp_path_factory.mktemp("turned") / "stl", screwed(), turn=turn)
    assert [(item.kind, item.threaded_in) for item in joints.fasteners] == [("screw", ("base",))]


def test_a_name_counts_only_if_the_shape_agrees(tmp_path):
    """A flat block named a screw and a plug named a nut are parts, and the output says so."""
    parts = screwed() | {"side screw": cuboid(15, -10, -15, 35, 10, -5), "nut": rod(3, -20, -15)}
    joints = find(tmp_path / "stl", parts)
    assert [item.part for item in joints.fasteners] == [SCREW]
    assert [note.partition(": ")[0] for note in joints.notes] == [
        "nut is named like a nut, but has no hole through it",
        "side screw is named like a screw, but is not round about an axis",
    ]


def test_a_rod_with_a_head_and_a_tapped_end_is_no_screw_if_it_is_named_a_rod(tmp_path):
    """Spring rods of pedals have the features of screws, but nobody drives them."""
    kinds = [
        [item.kind for item in find(tmp_path / name, screwed(name=name)).fasteners]
        for name in ("spring rod", "element")
    ]
    assert kinds == [[], ["screw"]]


def test_a_housing_with_a_square_pocket_is_no_screw(tmp_path):
    """Four walls are a drive only if they are narrower than a head, and a cast face no thread."""
    body = Solid.sphere(60, 48).scale((1, 0.9, 0.8)).trim_by_plane((0, 0, 1), -20)
    body = body + rod(12.7, 0, 70) - cuboid(-20, -20, -25, 20, 20, 15)
    parts = {"housing": body, "plate": cuboid(-70, -65, -30, 70, 65, -20)}
    assert find(tmp_path / "stl", parts).fasteners == ()


def test_a_nut_in_the_air_holds_what_its_bolt_holds(tmp_path):
    """It touches nothing but its bolt."""
    parts = {
        "plate": cuboid(-20, -20, -5, 20, 20, 0) - rod(4.2, -6, 1),
        "bolt": rod(4, -25, 0) + hexagon(13, 0, 5),
        "nut": hexagon(13, -20, -13) - rod(4, -30, 0),
    }
    by_part = {item.part: item for item in find(tmp_path / "stl", parts).fasteners}
    assert by_part["nut"].joins == ("bolt", "plate")
    assert by_part["bolt"].joins == ("plate", "nut")
    assert by_part["bolt"].threaded_in == ("nut",)


def bolted(pocket_mm):
    """Return a cover bolted on a base whose nut is in a pocket of a width, or None for round."""
    hole = rod(4.2, -30, 30)
    low = 18 if pocket_mm is None else 16
    pocket = rod(9, low, 20) if pocket_mm is None else hexagon(pocket_mm, low, 20)
    return {
        "base": cuboid(-30, -30, 0, 30, 30, 20) - pocket - hole,
        "cover": cuboid(-30, -30, 20, 30, 30, 26) - rod(9, 19, low + 7) - hole,
        "bolt M8x25": rod(4, 5, 26) + hexagon(13, 26, 31.5),
        "nut M8": hexagon(13, low, low + 6.5) - hole,
    }


@pytest.mark.parametrize(("pocket_mm", "is_held"), [(13.4, True), (None, False)])
def test_a_nut_in_a_hexagonal_pocket_is_held_and_its_bolt_driven(tmp_path, pocket_mm, is_held):
    fasteners = find(tmp_path / "stl", bolted(pocket_mm)).fasteners
    assert {item.part: item.held for item in fasteners} == {"bolt M8x25": False, "nut M8": is_held}


@pytest.mark.slow(reason="plans; that the nut is held is tested in every run")
def test_a_support_keeps_a_nut_without_a_pocket_from_turning(tmp_path):
    source, out = write(tmp_path / "stl", bolted(None)), tmp_path / "out"
    assert run(["import-cad", str(source), "--unit", "mm", "--out", str(out), "--no-cache"]) == 0
    report = json.loads((out / "report.json").read_text())
    assert report["left_out"] == {}
    assert report["attitude"]["held"] == ["nut M8"]
    result = tmp_path / "result"
    task = str(out / "product.yaml")
    assert run(["search-optimal", task, "--collision", "swept", "--out", str(result)]) == 0
    plan = (result / "plan.csv").read_text()
    assert plan.index("place(nut_M8)") < plan.index("fasten(bolt_M8x25)")


def test_options_overrule_what_was_recognised(capsys, tmp_path):
    source = write(tmp_path / "stl", screwed(name="knob"))
    command = ["import-cad", str(source), "--unit", "mm", "--no-cache"]
    out = tmp_path / "out"
    assert run([*command, "--out", str(out), "--fastener", "kn*"]) == 0
    relation = json.loads((out / "relation.json").read_text())
    assert [(item["part"], item["by"]) for item in relation["fasteners"]] == [("knob", ["option"])]
    for words, message in (
        (["--fastener", "knop"], "no part has such a name. Did you mean 'knob'?"),
        (["--fastener", "knob", "--not-fastener", "k*"], "by --fastener and by --not-fastener"),
    ):
        assert run([*command, "--out", str(tmp_path / "none"), *words]) == 2
        assert message in " ".join(capsys.readouterr().err.split())
    options = cad.FastenerOptions(others=(SCREW,))
    assert find(tmp_path / "named", screwed(), options=options).fasteners == ()
