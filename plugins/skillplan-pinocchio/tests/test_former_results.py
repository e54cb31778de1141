"""Results of version 0.2, in which ``swept`` had dwell times of its own, are still verified."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from skillplan.cli import main

RESULTS = Path(__file__).parent / "former_results"
KINDS = ("named", "plain", "boxes", "infile", "feeder")
"""Option on the command line, no option, by boxes, option in the task file, a screw feeder."""


@pytest.fixture
def former(tmp_path):
    """The results and their task files, to be changed freely."""
    former = shutil.copytree(RESULTS, tmp_path / "former")
    for file in RESULTS.glob("*.yaml"):
        for kind in KINDS:
            shutil.copy(file, former / kind)
    return former


def command(capsys, *words):
    """Return the exit code of a command, and what it prints on both streams."""
    capsys.readouterr()
    with pytest.raises(SystemExit) as ended:
        main([str(word) for word in words])
    printed = capsys.readouterr()
    return ended.value.code, printed.out, printed.err


@pytest.mark.parametrize("kind", KINDS)
def test_a_result_of_an_earlier_version_is_verified_by_the_dwells_of_its_time(former, capsys, kind):
    """And the table says so."""
    code, out, err = command(capsys, "verify", former / kind)
    assert code == 0, out + err
    words = " ".join(out.split())
    assert "not checked today's durations_s: the result is of an earlier version" in words
    assert ("drive_s 3 s" in words) == (kind in ("named", "infile"))


@pytest.mark.parametrize("kind", KINDS)
def test_a_forged_time_of_an_earlier_version_is_found(former, capsys, kind):
    """Each step counts, and their sum."""
    path = former / kind / "result.json"
    document = json.loads(path.read_text("utf-8"))
    document["steps"][-1]["duration_s"] -= 1.0
    document["makespan_s"] -= 1.0
    path.write_text(json.dumps(document), "utf-8")
    code, out, _ = command(capsys, "verify", path)
    assert code == 1
    assert "NOT VALID" in out


@pytest.mark.parametrize("value", ["soon", "-1", "nan"])
def test_an_option_that_is_no_time_is_damage(former, capsys, value):
    """Named with the option."""
    path = former / "named" / "result.json"
    document = json.loads(path.read_text("utf-8"))
    document["origin"]["options"]["swept"]["drive_s"] = value
    path.write_text(json.dumps(document), "utf-8")
    code, _, err = command(capsys, "verify", path)
    assert code == 2
    assert f"is damaged: its option drive_s is {value!r}, no time." in err


@pytest.mark.parametrize("kind", KINDS)
def test_its_plan_is_handed_over_with_its_times(former, capsys, kind):
    """With a warning; what the user changes is read by the rules of today."""
    stored = json.loads((former / kind / "result.json").read_text("utf-8"))
    out = former / "plan.csv"
    code, _, err = command(capsys, "export", former / kind, "--to", "csv", "--out", out)
    assert code == 0, err
    assert "warning" in err
    assert "today's durations_s" in err
    durations_s = [float(line.split(",")[11]) for line in out.read_text("utf-8").splitlines()[1:]]
    assert durations_s == pytest.approx([step["duration_s"] for step in stored["steps"]])


def test_a_task_file_or_command_that_names_a_removed_option_is_told_what_replaces_it(
    former, capsys
):
    """With its place, and whose key that is."""
    code, _, err = command(capsys, "check", former / "infile.yaml")
    assert code == 2
    assert (
        "infile.yaml:78:21: collision.swept.drive_s: 'swept' has no option 'drive_s'. Dwell times "
        "are part of the task: give durations_s.fasten of the task, of a tool or of a screw." in err
    )
    assert "give durations_s.pick of the task, of a tool or of a part." in err
    code, _, err = command(capsys, "search-optimal", former / "board.yaml", "-O", "swept.load_s=3")
    assert code == 2
    assert "give durations_s.load of the task or of a tool." in err
