"""Plans read back: the formats by their content, and whatever is wrong in one message."""

import json

import pytest

from handovers import best
from skillplan import exporters
from skillplan.errors import OptionError
from skillplan.model import replay
from skillplan.pipeline import read_given_plan
from skillplan.testing import ExporterSuite, hostile_task, solved_lid

CHARTED = ["battery_module", "inverter_ur5e", "relay_rail", "sensor_stack", "motor_drive"]
TREE = '<root BTCPP_format="4"><BehaviorTree ID="plan">{}</BehaviorTree></root>'
BOMB = '<!DOCTYPE r [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;">]>' + TREE.format("&b;")
OUTSIDE = '<!DOCTYPE r [<!ENTITY a SYSTEM "file:///etc/passwd">]>' + TREE.format("&a;")


@pytest.mark.parametrize(
    "exporter",
    [exporters.CsvExporter(), exporters.PddlExporter(), exporters.BehaviourTreeExporter()],
)
def test_what_is_exported_is_read_back(board, tmp_path, exporter):
    """Names of files do not matter; of the lid task with hostile names, too."""
    for handover in (board, solved_lid(hostile_task())):
        files = exporter.files(handover)
        content = files.get("plan.txt") or next(iter(files.values()))
        (tmp_path / "plan").write_bytes(content.encode() if isinstance(content, str) else content)
        given_plan = read_given_plan(f"@{tmp_path / 'plan'}", handover.task)
        assert [skill.skill for skill in handover.skills] == list(given_plan)


@pytest.mark.slow(reason="seconds a config; the board in every run")
@pytest.mark.parametrize("config", CHARTED)
@pytest.mark.parametrize(
    "exporter",
    [exporters.CsvExporter(), exporters.PddlExporter(), exporters.BehaviourTreeExporter()],
)
def test_what_is_read_back_costs_exactly_what_it_did(tmp_path, exporter, config):
    """Of every config that goes by its chart."""
    handover = best(config)
    assert handover.plan is not None
    files = exporter.files(handover)
    content = files.get("plan.txt") or next(iter(files.values()))
    (tmp_path / "plan").write_bytes(content.encode() if isinstance(content, str) else content)
    given_plan = read_given_plan(f"@{tmp_path / 'plan'}", handover.task)
    assert handover.plan.cost == replay(handover.model, given_plan).cost


def test_a_result_and_a_list_are_read_as_json(board, tmp_path):
    """By names or numbers."""
    names = [item.skill.name for item in board.skills]
    numbers = [entry.step.action for entry in board.skills]
    for document in ({"schema": "skillplan.result/1", "skills": names}, names, numbers):
        (tmp_path / "plan").write_text(json.dumps(document))
        plan = exporters.read_plan(str(tmp_path / "plan"), board.task, lambda action: None)
        assert names == [skill.name for skill in plan]


def test_a_planner_may_write_in_capitals(board, tmp_path):
    """Names of PDDL are the same in both."""
    (tmp_path / "plan").write_text("; found\n(PICK_PCB LOCATION_HOME)\n\n; cost = 1\n")
    given_plan = read_given_plan(f"@{tmp_path / 'plan'}", board.task)
    assert ["pick(pcb)"] == [skill.name for skill in given_plan]


def test_a_tree_of_somebody_else_is_followed_into_its_subtrees(board, tmp_path):
    """Whatever nodes are around the skills."""
    inner = '<BehaviorTree ID="two"><Do skill="place(pcb)"/></BehaviorTree>'
    text = TREE.format('<Sequence><Inverter><Do skill="pick(pcb)"/></Inverter><SubTree ID="two"/>')
    text = text.replace("</BehaviorTree>", f"</Sequence></BehaviorTree>{inner}")
    (tmp_path / "plan").write_text(text)
    plan = exporters.read_plan(str(tmp_path / "plan"), board.task, lambda action: None)
    assert ["pick(pcb)", "place(pcb)"] == [skill.name for skill in plan]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", r":1: is in no known format. Give action numbers"),
        (b"step,what\n1,pick\n", r":1: is in no known format"),
        (b"skill\npick(pcb)\npick(cpb)\n", r":3: Unknown skill 'pick\(cpb\)'. Did you mean"),
        (b"a,skill\n1\n", r":2: has 1 cells, and the plan stands in cell 2"),
        (b'skill\n"pick\n', r": is no CSV"),
        (b"skill\n\x00\n", r":2: "),
        (b"action\n99\n", r":2: No action 99"),
        (b"skill\n", r":1: holds no plan"),
        (b"\xff\xfe", r":1: is not UTF-8"),
        (b"{", r":1: is no JSON"),
        (b'[\n"pick(pcb)"\n"place(pcb)"]', r":3: is no JSON"),
        (b"[" * 100, r":1: is no JSON: it is nested deeper"),
        (b'{"skills": {}}', r":1: holds no plan of inverter-board"),
        (b'{"skills": [1.5]}', r":1: holds no plan of inverter-board"),
        (b'["pick(pcb)",\n\n"pick(cpb)"]', r":3: Unknown skill 'pick\(cpb\)'"),
        (b"[0,\n1,\n99]", r":3: No action 99"),
        (b"(pick_pcb\n", r":1: is no action in brackets"),
        (b"()\n", r":1: is no action in brackets"),
        (b"; c\n(fly home)\n", r":2: no action 'fly' is exported for this task"),
        (b"<root", r":1: it is not XML"),
        (BOMB.encode(), r":1: it declares a document type, which is not read"),
        (OUTSIDE.encode(), r":1: it declares a document type, which is not read"),
        (b"<root/>", r":1: has no behaviour tree 'plan'"),
        (TREE.format('<SubTree ID="plan"/>').encode(), r":1: the tree 'plan' holds itself"),
        (
            TREE.format('<Fallback><A skill="0"/><A skill="1"/></Fallback>').encode(),
            r":1: Fallback leaves open which of 2 skills",
        ),
        (("<a>" * 100).encode(), r":1: its elements lie more than 64 deep; keep the plan alone"),
    ],
)
def test_what_is_wrong_is_said_with_its_line(board, tmp_path, content, message):
    """And what to give instead; no entity is followed."""
    path = tmp_path / "plan"
    path.write_bytes(content)
    with pytest.raises(OptionError, match=message) as raised:
        read_given_plan(f"@{path}", board.task)
    assert str(raised.value).startswith(str(path))


def test_what_is_too_large_or_no_file_is_not_read(board, tmp_path):
    """By its size alone."""
    path = tmp_path / "plan"
    with path.open("wb") as file:
        file.truncate(exporters.MAX_BYTES + 1)
    for name, message in ((path, "larger than"), (tmp_path, "folder"), ("no", "No such file")):
        with pytest.raises(OptionError, match=message):
            read_given_plan(f"@{name}", board.task)


# Built-in exporters, held to what every exporter owes its users.


class TestCsv(ExporterSuite):
    exporter = "csv"


class TestStructuredText(ExporterSuite):
    exporter = "st"


class TestPddl(ExporterSuite):
    exporter = "pddl"


class TestBehaviourTree(ExporterSuite):
    exporter = "btcpp"
