"""Parts that come into the product together are built at a station, then placed as one part."""

from __future__ import annotations

import json

import pytest
import trimesh
import yaml

from cad_fixtures import box, part_of
from cad_products import related
from skillplan.cli import run
from skillplan_cad import Planner, Product, find_bearing, find_parted_groups, join_groups

UP = (0.0, 0.0, 1.0)
# A key that slides into the T-slot of a body from its side. In the base, one wall is in its way,
# and the other keeps the body from leaving it behind.
SOLIDS = {
    "base": box(-45, -30, -20, 45, 30, 0)
    + box(20.3, -15, 0, 30, 15, 25)
    + box(-30, -15, 0, -20.3, 15, 25),
    "body": box(-20, -20, 0, 20, 20, 30)
    - box(-10.3, -6.5, 10, 20, 6.5, 14.5)
    - box(-10.3, -3.5, 14, 20, 3.5, 30),
    "key": box(-9.8, -6, 10, 19.8, 6, 14) + box(-9.8, -3, 14, 19.8, 3, 44),
}
# A part on the base that has the name of the group's nest.
CUBE = {"body_group_nest": box(-44, 16, 0, -32, 28, 15)}


def test_parts_whose_neighbour_is_in_the_way_of_each_leave_together():
    """The whole is blocked as its parts are, but not by itself."""
    product = Product("slot", tuple(part_of(*item) for item in SOLIDS.items()), "mm", 0.0)
    relation = related(product)
    bearing = find_bearing(product, relation, UP)
    (group,) = find_parted_groups(product, relation, bearing, ())
    assert (group.parts, group.along) == (("body", "key"), (0.0, 0.0, -1.0))
    assert find_parted_groups(product, relation, bearing, ("key",)) == []
    plan = Planner(product, relation).plan("base")
    joined = join_groups(product, relation, plan, [group], UP)
    assert joined.relation.names == ("base", "body group")
    (contact,) = joined.relation.contacts
    assert contact.parts == ("base", "body group")
    whole = joined.product.parts[1]
    assert whole.mass_kg == pytest.approx(sum(part.mass_kg for part in product.parts[1:]))
    up = joined.relation.directions.index(UP)
    assert joined.relation.blockers("body group", up) == ()
    assert joined.relation.blockers("base", up) == ("body group",)
    crowded = Product("slot", (*product, part_of("body group", box(60, 0, 0, 70, 9, 9))), "mm", 0.0)
    joined = join_groups(crowded, related(crowded), plan, [group], UP)
    assert joined.relation.names == ("base", "body group_2", "body group")


@pytest.mark.slow(reason="reads a product, plans it and simulates the plan")
def test_a_group_is_built_in_a_nest_of_its_own_and_placed_as_one_part(capsys, tmp_path):
    """Planned with proof, and executed to the end by MuJoCo; names of other parts stay theirs."""
    (tmp_path / "slot").mkdir()
    for name, solid in (SOLIDS | CUBE).items():
        mesh = solid.to_mesh()
        trimesh.Trimesh(mesh.vert_properties[:, :3], mesh.tri_verts).export(
            tmp_path / "slot" / f"{name}.stl"
        )
    out = tmp_path / "out"
    options = ["--unit", "mm", "--up", "z", "--out", str(out), "--no-cache"]
    assert run(["import-cad", str(tmp_path / "slot"), *options, "--format", "json"]) == 0
    assert {*json.loads(capsys.readouterr().out)["summary"]["in_task"]} == {*SOLIDS, *CUBE}
    task = yaml.safe_load((out / "product.yaml").read_text())
    assert task["parts"]["body_group"]["made_of"] == ["body", "key"]
    assert task["parts"]["body"]["goal_on"] == ["body_group_nest_2"]
    assert (out / "nests" / "body_group_nest_2.stl").exists()
    assert run(["search-optimal", str(out / "product.yaml"), "--out", str(out / "plan")]) == 0
    capsys.readouterr()
    result = str(out / "plan" / "result.json")
    assert run(["simulate", result, "--physics", "mujoco", "--format", "json"]) == 0
    simulated = json.loads(capsys.readouterr().out)
    assert simulated["complete"]
