"""Travels that are planned round something, by commands."""

import pytest

# What is tall stands between the start and the goal of what is flat.
TOWER = """
kind: assembly
name: tower
robot: {home_m: [0.35, 0.0], safe_height_m: 0.15}
tools: {gripper: {holder_m: [0.6, 0.3]}}
initial_tool: gripper
parts:
  base: {tool: gripper, size_m: [0.06, 0.1, 0.02], start_m: [0.4, -0.25], goal_m: [0.5, 0.0]}
  tower: {tool: gripper, size_m: [0.03, 0.03, 0.25], start_m: [0.45, -0.12], goal_m: [0.6, 0.3]}
step_limit: 20
"""


@pytest.mark.slow(reason="plans travels four times; paths to the bit by another process")
def test_two_jobs_find_what_one_does(cli, tmp_path):
    """At the cost of time; and the way round the tower is the same after either."""
    board = tmp_path / "tower.yaml"
    board.write_text(TOWER, encoding="utf-8")
    results = []
    for jobs in ("1", "2"):
        words = ["--set", "cost=time", "--collision", "swept", "--jobs", jobs]
        document = cli("search-optimal", str(board), *words, "--format", "json").document
        del document["stats"]["wall_s"]
        explained = cli(
            "explain", str(board), "place(base)", "--after", "0", "--collision", "swept"
        ).out
        assert "around tower" in explained
        results.append((document, explained))
    assert results[0] == results[1]
    assert results[0][0]["status"] == "optimal"
