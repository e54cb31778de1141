"""The reason given for a skill that is never feasible: with everything else in place."""

import json

import pytest

from skillplan.cli import main

# The cover of the starter board, with a wall beside the hole of its screw: without the cover the
# screw has nothing beneath it, and with it the screwdriver does not get there.
WALLED = (
    "parts.cover.boxes=["
    "{size_m: [0.06, 0.02, 0.005], centre_m: [0.0, 0.0, 0.0225]}, "
    "{size_m: [0.01, 0.02, 0.02], centre_m: [-0.025, 0.0, 0.01]}, "
    "{size_m: [0.01, 0.02, 0.02], centre_m: [0.025, 0.0, 0.01]}, "
    "{size_m: [0.01, 0.02, 0.07], centre_m: [0.035, 0.0, 0.06]}]"
)
TRUE_REASON = "screwdriver runs into cover on the approach"


@pytest.fixture
def board(tmp_path, capsys):
    """Return a function that runs a command on the starter board with the walled cover."""
    path = tmp_path / "board.yaml"
    with pytest.raises(SystemExit):
        main(["init", "assembly", "--out", str(path)])
    capsys.readouterr()

    def run(command, *words):
        with pytest.raises(SystemExit) as ended:
            main([command, str(path), *words, "--set", WALLED, "--collision", "swept"])
        return ended.value.code, capsys.readouterr().out

    return run


def test_a_search_names_what_stops_the_skill_after_everything_else(board):
    code, text = board("search-optimal", "--format", "json")
    reason = json.loads(text)["reason"]
    assert code == 1
    assert reason == (
        f"fasten(screw) is never feasible: swept: {TRUE_REASON} (with everything else in place)"
    )


def test_explain_last_gives_the_same_reason(board):
    code, text = board("explain", "fasten(screw)", "--last", "--format", "json")
    document = json.loads(text)
    assert code == 1
    assert document["reason"] == TRUE_REASON
    assert "placed(cover)" in document["state"]


def test_explain_last_goes_with_no_other_state(board):
    code, _ = board("explain", "fasten(screw)", "--last", "--after", "0")
    assert code == 2
