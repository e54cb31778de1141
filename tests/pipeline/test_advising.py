"""Advice on a cell: changes of one thing at a time, each proved by solving the changed task."""

import json
from pathlib import Path

import pytest
import yaml

from skillplan import testing
from skillplan.cli import main
from skillplan.errors import OptionError
from skillplan.pipeline import advise, list_changes, load_problem, solve
from skillplan.solvers import Stop
from yaml_data import yaml_data

CONFIGS = Path(__file__).parents[2] / "configs"


SEVERAL_SEARCHES = "hundreds of changed tasks are grounded; a small one in every run"


def write_lid(folder, *parts, **changes):
    """Write the lid task, or some of its parts without its screw, and return its path."""
    content = {**testing.lid_content(), "collision": {"precedence": {}}, **changes}
    if parts:
        content["parts"] = {name: content["parts"][name] for name in parts}
        content["tools"] = {"gripper": content["tools"]["gripper"]}
        del content["screws"], content["chart"]
        content["collision"] = {"aabb": {}}
    else:
        content["chart"] = [{"before": "box", "after": ["fuse", "lid"]}, *changes.get("chart", [])]
    path = folder / "lid.yaml"
    path.write_text(yaml.safe_dump(content))
    return path


def test_each_saving_is_that_of_the_changed_file(tmp_path):
    """Carried out by hand, every piece of advice costs what it says."""
    path = write_lid(tmp_path, "box")
    problem = load_problem(path)
    advice = advise(problem, tries=6)
    assert len(advice.tips) > 1
    assert advice.tips == tuple(sorted(advice.tips, key=lambda tip: -tip.saving))
    assert len({tip.item for tip in advice.tips}) == len(advice.tips)
    base = solve(problem.task)
    for tip in advice.tips:
        content = yaml_data(path)
        content = json.loads(json.dumps(content))
        for key, text in tip.changes.items():
            *holders, last = key.split(".")
            section = content
            for holder in holders:
                section = section[holder]
            section[last] = json.loads(text)
        changed = tmp_path / "changed.yaml"
        changed.write_text(yaml.safe_dump(content))
        result = solve(load_problem(changed).task)
        assert tip.proved
        assert result.cost == pytest.approx(tip.result.cost)
        assert base.cost - result.cost == pytest.approx(tip.saving)


@pytest.mark.slow(reason=SEVERAL_SEARCHES)
def test_the_counts_of_the_tries_add_up(tmp_path):
    """What is not tried is counted, too."""
    advice = advise(load_problem(write_lid(tmp_path)), tries=5)
    assert advice.tried == 5
    assert advice.reason == "limit of 5 tries"
    whole = advise(load_problem(write_lid(tmp_path, "box", "fuse")), tries=10_000, within_m=0.05)
    assert whole.reason == ""
    assert whole.tried + whole.refused + whole.longer == whole.proposed
    assert all(
        abs(moved - start) <= 0.05 + 1e-9
        for tip in whole.tips
        if tip.item == "the start of box"
        for moved, start in zip(
            json.loads(tip.changes["parts.box.start_m"]),
            testing.lid_content()["parts"]["box"]["start_m"],
            strict=True,
        )
    )


def test_changes_name_entries_of_the_file_and_not_what_a_count_writes_out(tmp_path):
    """Parts of a count change together, and those in a tray move with it."""
    path = write_lid(tmp_path, "box", "fuse")
    content = yaml_data(path)
    del content["parts"]["fuse"]["start_m"]
    content["parts"]["fuse"] |= {"count": 2, "start_in": "tray"}
    content["parts"]["fuse"]["goal_pattern"] = {"grid": [2, 1], "pitch_m": [0.02, 0.02]}
    content["tools"]["cup"] = {"type": "suction", "holder_m": [0.2, 0.4]}
    grid = {"grid": [2, 1], "pitch_m": [0.06, 0.06]}
    content["trays"] = {"tray": {"at_m": [0.4, -0.3], "pattern": grid}}
    path.write_text(yaml.safe_dump(json.loads(json.dumps(content))))
    problem = load_problem(path)
    changes = [*list_changes(problem, 0.1)]
    keys = {key for change in changes for key in change.changes}
    assert {"trays.tray.at_m", "parts.fuse.tool", "parts.fuse.grasp"} <= keys
    assert not any("fuse_" in key or key.startswith("fixtures") for key in keys)
    assert len({(change.item, str(change.changes)) for change in changes}) == len(changes)
    moved = next(c for c in changes if c.item == "the tray tray")
    assert problem.ground_with(moved.changes) is not None
    assert any(change.words == "handle fuse with cup" for change in changes)


@pytest.mark.slow(reason=SEVERAL_SEARCHES)
def test_an_interruption_keeps_what_was_found(tmp_path):
    """As a time limit does."""
    stop = Stop()

    def interrupt(done):
        if done.saving is not None and done.saving > 0:
            stop.interrupt()

    advice = advise(load_problem(write_lid(tmp_path)), stop=stop, on_try=interrupt)
    assert advice.interrupted
    assert advice.reason == "interrupted"
    assert len(advice.tips) == 1


def test_a_rule_of_the_chart_that_costs_something_is_named(tmp_path):
    """Dropped, the rest of the chart stays."""
    path = write_lid(tmp_path, chart=[{"before": "lid", "after": ["fuse"]}])
    rules = [
        change.words
        for change in load_problem(path).domain.list_changes(load_problem(path).config, 0.1)
        if change.kind == "order"
    ]
    assert rules == [
        "drop the rule that box comes before fuse",
        "drop the rule that box comes before lid",
        "drop the rule that lid comes before fuse",
    ]


@pytest.mark.slow(reason=SEVERAL_SEARCHES)
def test_times_of_a_plan_are_travel_work_and_tool_change(tmp_path):
    """Together they are its duration."""
    advice = advise(load_problem(write_lid(tmp_path, cost="time")), tries=1)
    shares, base = advice.shares, advice.base
    assert shares.total_s == pytest.approx(base.makespan_s)
    changes_s = [step.duration_s for step in base.steps if step.skill.startswith("load")]
    assert shares.change_s == pytest.approx(sum(changes_s))
    assert shares.cycles_per_hour == pytest.approx(3600 / base.makespan_s)
    dwells = testing.lid_content().get("durations_s", {})
    assert shares.work_s == pytest.approx(6 * dwells.get("pick", 3.0) + dwells.get("fasten", 8.0))


def test_a_kind_without_changes_gets_no_advice():
    """It says so."""
    with pytest.raises(OptionError, match="has no changes to try"):
        advise(load_problem(CONFIGS / "br17.10.sop"))


def run(command):
    """Run a command and return its exit code."""
    with pytest.raises(SystemExit) as ended:
        main(command)
    return ended.value.code


@pytest.mark.slow(reason=SEVERAL_SEARCHES)
def test_a_result_is_advised_with_its_own_file_changes_and_back_ends(tmp_path, capsys):
    """The saved document is that of stdout, and a report shows it."""
    path, solved = str(write_lid(tmp_path)), str(tmp_path / "solved")
    assert run(["search-optimal", path, "--set", "cost=time", "--out", solved]) == 0
    capsys.readouterr()
    saved, page = tmp_path / "advice.json", tmp_path / "page.html"
    command = ["advise", solved, "--tries", "3", "--format", "json", "--out", str(saved)]
    assert run(command) == 0
    document = json.loads(capsys.readouterr().out)
    assert document == json.loads(saved.read_text())
    assert document["cost_unit"] == "s"
    assert document["origin"]["set"] == {"cost": "time"}
    assert run(["report", str(saved), "--out", str(page)]) == 0
    assert "cycles/h" in page.read_text()
    assert run([*command[:-1], "advice.txt"]) == 2
    assert run(["advise", path, "--within", "0"]) == 2
