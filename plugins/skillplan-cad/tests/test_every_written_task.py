"""Whatever is read, the task that is written is accepted, and says what is left out and why."""

from __future__ import annotations

import json

import pytest
import yaml

from cad_products import file
from skillplan.cli.app import run
from skillplan_cad.importing.import_cad import import_cad

NAMES = (
    "bayonet",
    "bracket",
    "dovetail",
    "eight",
    "floating",
    "inch",
    "l_slot",
    "mirrored",
    "nested",
    "threads",
)
# Of these the chart by swept hulls is the relation, but for what a hand is in the way of.
EQUAL = ("dovetail", "eight", "mirrored")
IN_EVERY_RUN = "l_slot"


def written(name, folder, **settings):
    """Import a fixture; return its folder, what the file says, and the report."""
    out = folder / "product"
    import_cad(str(file(name)), str(out), {"keep": False, **settings}, lambda line: None, None)
    task = yaml.safe_load((out / "product.yaml").read_text("utf-8"))
    return out, task, json.loads((out / "report.json").read_text("utf-8"))


@pytest.mark.parametrize(
    "name",
    [
        name
        if name == IN_EVERY_RUN
        else pytest.param(name, marks=pytest.mark.slow(reason="imports; one in every run"))
        for name in NAMES
    ],
)
def test_is_accepted_by_check(name, tmp_path, capsys):
    out, _, _ = written(name, tmp_path)
    assert run(["check", str(out / "product.yaml")]) == 0, capsys.readouterr().err


@pytest.mark.slow(reason="imports a product; what is accepted is in every run")
def test_what_hangs_in_the_air_is_left_out_and_named(tmp_path):
    _, task, report = written("floating", tmp_path)
    assert list(task["parts"]) == ["plate", "block"]
    assert report["limits"]["balloon"][0] == (
        "touches nothing, with nothing beneath it: it is left out of the task"
    )


@pytest.mark.slow(reason="imports a product; what is accepted is in every run")
def test_what_lies_on_a_later_part_needs_a_stand(tmp_path):
    """A dovetail turned over: the slide, which comes second, bears the rail."""
    _, task, report = written("dovetail", tmp_path, up="-z")
    assert list(task["parts"]) == ["rail", "slide"]
    (words,) = report["limits"]["rail"]
    assert words.startswith("lies on nothing before slide is there: it needs a stand, its lowest")


@pytest.mark.slow(reason="imports a product; what is accepted is in every run")
def test_of_a_plate_on_its_edge_what_hangs_beside_it_is_left_out(tmp_path, capsys):
    out, task, report = written("mirrored", tmp_path, up="x")
    assert list(task["parts"]) == ["plate"]
    for name in ("left_1", "left_2", "right"):
        assert report["limits"][name][0] == (
            "hangs in plate, with nothing beneath it: it is left out of the task"
        )
    assert run(["check", str(out / "product.yaml")]) == 0, capsys.readouterr().err


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(
            name,
            marks=pytest.mark.release(reason="derives an order by hulls of true meshes")
            if name == "eight"
            else pytest.mark.slow(reason="imports a product and derives its order"),
        )
        for name in EQUAL
    ],
)
def test_its_chart_is_the_relation_in_the_written_directions(name, tmp_path, capsys):
    out, task, report = written(name, tmp_path)
    capsys.readouterr()
    path = str(out / "product.yaml")
    assert run(["chart", path, "--collision", "swept", "--format", "json"]) == 0
    found = json.loads(capsys.readouterr().out)["relations"]
    relation = json.loads((out / "relation.json").read_text("utf-8"))
    wanted = blocked_in_every_way(relation, task, report)
    assert wanted
    assert wanted <= {(one["before"], one["after"]) for one in found}
    assert {(one["before"], one["after"]) for one in found if is_of_the_part(one)} <= wanted


def blocked_in_every_way(relation, task, report):
    """Return pairs of which the first cannot come in any written direction after the other."""
    names, turn = report["task_names"], report["placement"]["turn"]
    blockers = {}
    for entry in relation["blocked"]:
        along = [sum(a * b for a, b in zip(row, entry["direction"], strict=True)) for row in turn]
        key = names[entry["part"]], rounded(along)
        blockers.setdefault(key, set()).add(names[entry["by"]])
    entries = {**task["parts"], **task.get("screws", {})}
    pairs = set()
    for name, entry in entries.items():
        ways = entry.get("insert_along") or [entry.get("axis", [0.0, 0.0, -1.0])]
        sets = [blockers.get((name, rounded([-x for x in way])), set()) for way in ways]
        pairs |= {(name, other) for other in set.intersection(*sets) & entries.keys()}
    return pairs


def rounded(vector):
    return tuple(round(x, 4) + 0.0 for x in vector)


def is_of_the_part(relation):
    """Whether the part itself, and not the hand, is stopped in every direction."""
    ways = relation["evidence"].get("ways") or {"": relation["reason"]}
    reasons = {}
    for way, reason in ways.items():
        along = way.split(",")[0] if way.startswith("along") else ""
        reasons.setdefault(along, []).append(reason)
    own = f"{relation['before']} runs into"
    return all(any(reason.startswith(own) for reason in some) for some in reasons.values())
