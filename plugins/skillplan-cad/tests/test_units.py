"""Bought-in units come as one part, and parts that close others in come as their bodies."""

from __future__ import annotations

from contextlib import nullcontext

import numpy as np
import pytest
import trimesh

from skillplan_cad import analyse_product, analyse_units, parse_settings


def block(size_mm, at_mm):
    """Return a cuboid, in metres."""
    mesh = trimesh.creation.box([side / 1e3 for side in size_mm])
    mesh.apply_translation([value / 1e3 for value in at_mm])
    return mesh


def shell(at_mm):
    """Return a closed box of 20 mm with a cavity of 10 mm."""
    return trimesh.boolean.difference([block((20, 20, 20), at_mm), block((10, 10, 10), at_mm)])


def analyse(folder, parts, **options):
    """Return the product that an import goes on with; names give the assemblies."""
    scene = trimesh.Scene()
    for name, mesh in parts.items():
        above, _, own = name.rpartition("/")
        if above and above not in scene.graph.nodes:
            scene.graph.update(above)
        scene.add_geometry(mesh, node_name=own, parent_node_name=above or None)
    (folder / "pump.glb").write_bytes(scene.export(file_type="glb"))

    def read(settings):
        watching = lambda: nullcontext(lambda: True)  # noqa: E731
        return analyse_product(folder / "pump.glb", settings, lambda line: None, watching)

    return analyse_units(read, parse_settings({"keep": False, **options}))[0].product


@pytest.mark.parametrize("inner", ["caught", "overlapping"])
def test_parts_of_one_assembly_that_are_caught_in_each_other_are_one_unit(tmp_path, inner):
    """Also if others stand round them; a plate that is stuck in another assembly is no unit."""
    size = (8, 8, 8) if inner == "caught" else (16, 8, 8)
    parts = {
        "plate": block((60, 60, 10), (0, 0, -15)),
        "post": block((5, 5, 40), (25, 25, 10)),
        "bearing/race": shell((0, 0, 0)),
        "bearing/ball": block(size, (0, 0, 0)),
    }
    product = analyse(tmp_path, parts)
    assert {part.name for part in product} == {"plate", "post", "bearing/race"}
    assert "bearing/ball, bearing/race are one part" in " ".join(product.notes)
    volume_mm3 = product.parts[product.index("bearing/race")].volume_m3 * 1e9
    assert volume_mm3 == pytest.approx(7000 + size[0] * 64, rel=1e-4)
    assert len(analyse(tmp_path, parts, uniting=False)) == 4


def test_a_unit_has_its_screws_without_head_and_the_parts_that_are_drawn_into_it(tmp_path):
    """Also if its assembly has most of the parts; screws with a head stay parts."""
    along = trimesh.transformations.rotation_matrix(np.pi / 2, (0, 1, 0))

    def rod(radius_mm, low_mm, high_mm, y_mm):
        mesh = trimesh.creation.cylinder(radius_mm / 1e3, (high_mm - low_mm) / 1e3, transform=along)
        mesh.apply_translation([(low_mm + high_mm) / 2e3, y_mm / 1e3, 0])
        return mesh

    tapped = trimesh.boolean.difference(
        [shell((0, 0, 0)), rod(1.25, 0, 20, -3), rod(1.25, 0, 20, 3)]
    )
    parts = {
        "plate": block((60, 60, 10), (0, 0, -15)),
        "bearing/race": tapped,
        "bearing/ball": block((8, 8, 8), (0, 0, 0)),
        "bearing/lid": block((6, 6, 6), (0, 0, 11)),
        "bearing/chip": block((0.3, 0.6, 0.3), (8, 8, 10.15)),
        "bearing/M3 set screw": rod(1.5, 5.5, 9.5, -3),
        "bearing/M3 screw": trimesh.boolean.union([rod(1.5, 5.5, 10, 3), rod(2.75, 10, 13, 3)]),
    }
    names = {part.name for part in analyse(tmp_path, parts)}
    assert names == {"plate", "bearing/race", "bearing/M3 screw"}


def test_parts_that_an_option_names_and_parts_below_the_root_are_no_unit(tmp_path):
    apart = {"race": shell((0, 0, 0)), "ball": block((8, 8, 8), (0, 0, 0))}
    others = {"plate": block((60, 60, 10), (0, 0, -15)), "post": block((5, 5, 40), (25, 25, 10))}
    assert len(analyse(tmp_path, others | apart)) == 4
    named = {f"bearing/{name}": mesh for name, mesh in apart.items()}
    assert len(analyse(tmp_path, others | named, press_fit=["ball,race"])) == 4


def test_a_housing_that_is_drawn_as_one_part_comes_as_its_halves_if_it_closes_others_in(tmp_path):
    whole = shell((0, 0, 0))
    halves = [
        trimesh.boolean.intersection([whole, block((30, 30, 20), (0, 0, side * 10.01))])
        for side in (1, -1)
    ]
    parts = {
        "housing": trimesh.util.concatenate(halves),
        "board": block((9, 9, 2), (0, 0, -4)),
        "foot": block((5, 5, 5), (0, 0, -12.52)),
    }
    names = {part.name for part in analyse(tmp_path, parts)}
    assert names == {"housing.1", "housing.2", "board", "foot"}
    assert len(analyse(tmp_path, parts, uniting=False)) == 3
    rod = block((1, 1, 20), (14, 0, 0))
    framed = {**parts, "housing": trimesh.util.concatenate([*halves, rod])}
    assert "housing" in {part.name for part in analyse(tmp_path, framed)}
    loose = {**parts, "board": block((9, 9, 2), (0, 0, 40))}
    assert "housing" in {part.name for part in analyse(tmp_path, loose)}
