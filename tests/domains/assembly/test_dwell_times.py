"""Dwell times: those of a part or screw come first, then those of its tool, then the task's."""

from __future__ import annotations

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from example_count import examples
from situations import assembly, model_of, small_assemblies
from skillplan.collision import AabbDetector
from skillplan.domains.assembly import AssemblyConfig, find_hints
from skillplan.domains.load import _hash_content
from skillplan.model import replay
from skillplan.pipeline import Setup, solve
from skillplan.testing import lid_content

PLAN = (
    "pick(box),place(box),pick(fuse),place(fuse),pick(lid),place(lid),"
    "load(screwdriver),fasten(screw)"
)
VISITS = {"pick": 3, "place": 3, "load": 1, "offload": 1, "fetch": 1, "fasten": 1}
DEFAULTS = {"pick": 3.0, "place": 3.0, "load": 5.0, "offload": 5.0, "fetch": 1.0, "fasten": 8.0}
BOXES = Setup(collision=("aabb",), options={"aabb": {"check_support": False}})
SECONDS = st.floats(0, 600).map(lambda value: round(value, 3))


def content(cost="distance", **durations_s):
    """Return a board of which every kind of dwell is in the plan."""
    created = lid_content()
    created["cost"] = cost
    created["feeders"] = {"tray": {"position_m": [0.45, 0.3]}}
    created["screws"]["screw"]["feeder"] = "tray"
    if durations_s:
        created["durations_s"] = durations_s
    return created


def makespan_s(document):
    """Return how long the plan takes without trajectories [s]."""
    task = assembly(document)
    return replay(model_of(task, AabbDetector(task)), task.parse_sequence(PLAN)).duration_s


def test_a_file_without_durations_has_the_documented_ones():
    """As if it gave them."""
    assert makespan_s(content()) == makespan_s(content(**DEFAULTS))


@pytest.mark.parametrize("kind", VISITS)
def test_every_duration_of_the_task_has_an_effect(kind):
    """Once for every time that the hand acts so: a swap puts a tool back and attaches another."""
    more_s = makespan_s(content(**{kind: DEFAULTS[kind] + 50.0})) - makespan_s(content())
    assert more_s == pytest.approx(VISITS[kind] * 50.0)


@pytest.mark.parametrize(
    ("section", "owner", "tool", "kind"),
    [
        ("parts", "fuse", "gripper", "pick"),
        ("parts", "fuse", "gripper", "place"),
        ("screws", "screw", "screwdriver", "fetch"),
        ("screws", "screw", "screwdriver", "fasten"),
    ],
)
def test_of_a_part_or_screw_comes_first_then_of_its_tool_then_of_the_task(
    section, owner, tool, kind
):
    """Zero is a dwell, too."""
    count = VISITS[kind]
    created = content(**{kind: 20.0})
    of_task_s = makespan_s(created)
    created["tools"][tool]["durations_s"] = {kind: 12.0}
    of_tool_s = makespan_s(created)
    created[section][owner]["durations_s"] = {kind: 0.0}
    assert of_tool_s - of_task_s == pytest.approx(-8.0 * count)
    assert makespan_s(created) - of_tool_s == pytest.approx(-12.0)


@pytest.mark.parametrize(("tool", "kind"), [("gripper", "offload"), ("screwdriver", "load")])
def test_a_tool_change_takes_the_dwells_of_both_tools(tool, kind):
    """Each has its own."""
    created = content()
    created["tools"][tool]["durations_s"] = {kind: 7.5}
    assert makespan_s(created) - makespan_s(content()) == pytest.approx(2.5)


def test_a_task_names_where_its_dwells_are_from():
    """Those of single bodies and tools first."""
    created = content()
    created["screws"]["screw"]["durations_s"] = {"fasten": 12}
    created["tools"]["gripper"]["durations_s"] = {"place": 1, "pick": 2}
    paths = ["screws.screw.durations_s.fasten"]
    paths += [f"tools.gripper.durations_s.{kind}" for kind in ("pick", "place")]
    assert assembly(created).dwells_from == (*paths, "durations_s")
    assert assembly(content()).dwells_from == ("durations_s",)


@pytest.mark.parametrize(
    ("tool", "kind"),
    [
        ("gripper", "fasten"),
        ("gripper", "fetch"),
        ("screwdriver", "pick"),
        ("screwdriver", "place"),
    ],
)
def test_a_dwell_of_a_tool_that_no_skill_has_is_pointed_out(tool, kind):
    """With its place; none is, of a board on which all count."""
    created = content()
    assert not list(find_hints(AssemblyConfig.model_validate(created)))
    created["tools"][tool]["durations_s"] = {kind: 4.0, "load": 3.0}
    (issue,) = find_hints(AssemblyConfig.model_validate(created))
    assert issue.path == ("tools", tool, "durations_s", kind)
    assert "has no effect" in issue.message


def test_a_fetch_of_a_screw_without_feeder_is_pointed_out():
    """Its other dwell counts."""
    created = content()
    del created["screws"]["screw"]["feeder"]
    created["screws"]["screw"]["durations_s"] = {"fetch": 4.0, "fasten": 3.0}
    (issue,) = find_hints(AssemblyConfig.model_validate(created))
    assert issue.path == ("screws", "screw", "durations_s", "fetch")


@settings(max_examples=examples(25))
@given(made=small_assemblies(), one_s=SECONDS, data=st.data())
def test_doubling_a_dwell_of_one_part_adds_exactly_that_to_the_least_cycle_time(made, one_s, data):
    """Every part is picked once in any plan, so that the order stays the best; any layout."""
    name = data.draw(st.sampled_from(sorted(made["parts"])))
    made["cost"] = "time"
    costs = []
    for dwell_s in (one_s, 2 * one_s):
        made["parts"][name]["durations_s"] = {"pick": dwell_s}
        result = solve(assembly(made), "exact", BOXES)
        assume(result.status == "optimal")
        assert result.cost == pytest.approx(result.makespan_s)
        costs.append(result.cost)
    assert costs[1] - costs[0] == pytest.approx(one_s, abs=1e-6)


@pytest.mark.parametrize(
    ("given_keys", "sha256"),
    [({}, "8eb420633a83"), ({"durations_s": {"fasten": 9.0}}, "7d810fd3a701")],
)
def test_a_file_without_the_later_keys_keeps_its_hash(given_keys, sha256):
    """So that results of earlier versions are still of the same task."""
    config = AssemblyConfig.model_validate(lid_content() | given_keys)
    assert _hash_content(config)[:12] == sha256
