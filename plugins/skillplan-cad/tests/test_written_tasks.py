"""Every task that is written: `check` accepts it, and its chart is that of the relation."""

from __future__ import annotations

import json
from functools import cache

import numpy as np
import pytest
import yaml

from cad_fixtures import box, part_of
from cad_products import product, related, relation
from skillplan import load_problem
from skillplan.cli import run
from skillplan_cad import Planner, Product, build_task, find_best_bearing
from thinned import slow_case

DOWN = [0.0, 0.0, -1.0]
# How many parts and screws of how many are in the task: others go round a corner, or float.
WRITTEN = {
    "bayonet": (1, 2),
    "bracket": (6, 6),
    "dovetail": (2, 2),
    "eight": (8, 8),
    "fastened": (7, 8),
    "floating": (2, 3),
    "l_slot": (1, 2),
    "made": (3, 4),
    "mirrored": (4, 4),
    "nested": (7, 7),
    "threads": (3, 3),
}
SOLIDS = {
    "plate": box(0, 0, 0, 60, 60, 10),
    "sleeve": box(20, 20, 10, 40, 40, 40) - box(25, 25, 10, 35, 35, 40),
    "post": box(25, 25, 10, 35, 35, 60),
    "collar": box(15, 15, 42, 45, 45, 50) - box(25, 25, 42, 35, 35, 50),
}
CASES = [
    slow_case(name, reason="reads a product; solids in every run")
    for name in WRITTEN
    if name != "made"
]


@cache
def build(name):
    """Return a relation, and the task of it."""
    if name == "made":
        parts = Product("made", tuple(part_of(*item) for item in SOLIDS.items()), "mm", 0.0)
        known = related(parts)
    else:
        parts, known = product(name), relation(name)
    bearing = find_best_bearing(parts, known)
    grounded = [name for name in bearing.order if not bearing.on[name]]
    plan = Planner(parts, known).plan(None, bearing.up, grounded)
    return known, build_task(parts, known, plan, bearing=bearing)


@pytest.fixture
def written(request, tmp_path):
    """Return a relation, the task of it, and the file."""
    known, task = build(request.param)
    for name, content in task.files.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(content, "utf-8")
    return request.param, known, task, tmp_path / "product.yaml"


def closure(pairs):
    """Return all pairs that follow from some."""
    result = set(pairs)
    while more := {(a, d) for a, b in result for c, d in result if b == c} - result:
        result |= more
    return result


def related_pairs(known, task, document):
    """Return which part comes before which, as what blocks a part's first way comes after it."""
    directions = np.asarray(known.directions) @ task.upright.matrix.T
    for name, own in task.names.items():
        entry = document["parts"].get(own) or document["screws"][own]
        way = np.asarray(entry.get("insert_along") or entry.get("axis") or DOWN)
        (number,) = np.flatnonzero(directions @ -way > 1 - 1e-6)[:1]
        yield from (
            (own, task.names[by]) for by in known.blockers(name, number) if by in task.names
        )


def chart_of(file, capsys):
    """Return which parts run into which, and which fingers do first; supports are left aside."""
    set_up = ["--collision", "swept", "--set", "collision.swept.check_support=false"]
    assert run(["chart", str(file), *set_up, "--format", "json"]) == 0
    loads = json.loads(capsys.readouterr().out)
    assert not loads["impossible"]
    pairs = {True: set(), False: set()}
    for item in loads["relations"]:
        moving = item["evidence"]["moving"]
        pairs[moving == "a finger"].add((item["before"], item["after"]))
    return pairs[False], pairs[True]


@pytest.mark.slow(reason="plans a product of eight parts; words of other limits in every run")
def test_what_takes_a_second_hand_or_a_turn_is_told_in_words():
    """No pocket keeps the nut; the bolt goes in without it."""
    _, task = build("fastened")
    assert task.left_out.keys() == {"nut"}
    assert "is on bolt, which is driven, and no pocket keeps it" in task.left_out["nut"].text
    assert task.limits["nut"] == (
        "comes after a turn in the plan of the product in CAD",
        "must be held once cover is placed, until bolt is",
    )


@pytest.mark.parametrize("written", ["made", *CASES], indirect=True)
def test_a_written_task_is_accepted_and_its_chart_is_the_relation(written, capsys):
    """For the first direction that the file gives each part, with a hand and no arm."""
    name, known, task, file = written
    count, of = WRITTEN[name]
    assert (len(task.names), len(task.left_out)) == (count, of - count)
    assert task.faults == ()
    assert len(load_problem(file).task.operations) == count
    document = yaml.safe_load(file.read_text("utf-8"))
    del document["robot"]["model"]
    for tool in document["tools"].values():
        tool.pop("force_n", None)
        tool.pop("opening_m", None)
    for part in document["parts"].values():
        if isinstance(part["grasp"], list):
            part["grasp"] = part["grasp"][0]
        part["insert_along"] = part.get("insert_along", [DOWN])[0]
    document["collision"] = {"swept": {"check_support": False}}
    bare = file.with_name("bare.yaml")
    bare.write_text(yaml.safe_dump(document), "utf-8")
    expected = closure(related_pairs(known, task, document))
    by_parts, by_fingers = chart_of(bare, capsys)
    assert closure(by_parts | (by_fingers & expected)) == expected
