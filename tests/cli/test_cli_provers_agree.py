"""Four provers on random boards: exact search, enumeration, Fast Downward by PDDL, and verify.

Boards have stacks, lids, bridges, screws and up to four tools; charts follow the geometry or
contradict it. Each board is solved with its chart alone, by geometry alone, and by both.
"""

from __future__ import annotations

import math
import re
import subprocess
import sys
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

from random_boards import board_text, seed_blocks
from skillplan.judge import fast_downward

DETECTORS = ("precedence", "aabb", "precedence,aabb")
# Exit codes of Fast Downward: its translator or its search proves that there is no plan.
UNSOLVABLE = (10, 11)

pytestmark = pytest.mark.skipif(
    find_spec("up_fast_downward") is None, reason="needs skillplan[planner]"
)


@pytest.mark.parametrize("seeds", seed_blocks(1, 8, 300, reason="a board in every run"))
def test_status_and_cost_agree_on_random_boards(cli, tmp_path, seeds):
    for seed in seeds:
        board = tmp_path / f"board-{seed}.yaml"
        board.write_text(board_text(seed, tmp_path), "utf-8")
        for detectors in DETECTORS:
            folder = tmp_path / f"{seed}-{detectors}"
            folder.mkdir()
            differences = Comparison(cli, str(board), detectors, folder).differences()
            assert [] == list(differences), f"seed {seed}, {detectors}"


class Comparison:
    """A board under some detectors before the four provers."""

    def __init__(self, cli: Any, board: str, detectors: str, folder: Path) -> None:
        self.cli = cli
        self.board = board
        self.back_ends = ("--collision", detectors)
        self.folder = folder

    def differences(self) -> Iterator[str]:
        """Yield how a prover differs from exact search."""
        exact, enumerated = self.solved("exact"), self.solved("exhaustive")
        cost = exact["cost"]
        if exact["status"] not in ("optimal", "infeasible"):
            yield f"exact search ends {exact['status']}"
        if exact["status"] != enumerated["status"] or not same(cost, enumerated["cost"]):
            yield f"enumeration proves {enumerated['status']} {enumerated['cost']}, not {cost}"
        saved = str(self.folder / "exact")
        verified = self.cli("verify", saved, "--with", "fast-downward", "--format", "json")
        outcomes = {claim["outcome"] for claim in verified.document["claims"]}
        if verified.code != 0 or outcomes != {"holds"}:
            yield f"verify says {verified.out}"
        planned = self.planned(None if cost is None else saved)
        if (planned is None) != (cost is None):
            yield f"Fast Downward proves {planned}, not {cost}"
        if planned is not None and cost is not None:
            yield from self.rounded_differences(exact, planned)

    def rounded_differences(self, exact: dict[str, Any], planned: int) -> Iterator[str]:
        """Yield how costs differ by more than rounding to whole micrometres or microseconds."""
        rounded = sum(round(step["cost"] * 1e6) for step in exact["steps"])
        written = cost_in(self.folder / "pddl" / "plan.txt")
        if written != rounded:
            yield f"the exported plan costs {written}, its steps come to {rounded}"
        if planned > rounded:
            yield f"Fast Downward proves {planned}, the plan costs {rounded}"
        plan = ("--sequence", f"@{self.folder / 'pddl' / 'sas_plan'}", "--format", "json")
        walked = self.cli("evaluate", self.board, *self.back_ends, *plan).document
        # Each skill of either plan is off by half a unit at most.
        skills = (self.folder / "pddl" / "sas_plan").read_text("utf-8").count("(") - 1
        slack = (len(exact["steps"]) + skills) / 2e6
        if not walked["complete"]:
            yield f"the planner's plan does not hold: {walked['violations']}"
        elif not exact["cost"] - 1e-9 <= walked["cost"] <= exact["cost"] + slack:
            yield f"the planner's plan costs {walked['cost']}, not {exact['cost']}"

    def solved(self, solver: str) -> dict[str, Any]:
        """Return the result of a solver, which is saved."""
        words = ("--solver", solver, "--out", str(self.folder / solver), "--format", "json")
        document: dict[str, Any] = self.cli(
            "search-optimal", self.board, *self.back_ends, *words
        ).document
        return document

    def planned(self, result: str | None) -> int | None:
        """Return the cost that Fast Downward proves by exported files; None if there is no plan."""
        source = (self.board, *self.back_ends) if result is None else (result,)
        out = self.folder / "pddl"
        options = ("-O", "count_steps=true", "-O", "accept_rounding=true")
        exported = self.cli("export", *source, "--to", "pddl", "--out", str(out), *options)
        assert 0 == exported.code, exported.err
        words = [sys.executable, str(fast_downward.find_driver()), "--plan-file", "sas_plan"]
        words += ["domain.pddl", "problem.pddl", "--search", "astar(lmcut())"]
        ended = subprocess.run(words, cwd=out, capture_output=True, text=True, check=False)
        if ended.returncode in UNSOLVABLE:
            return None
        assert 0 == ended.returncode, ended.stdout[-2000:]
        return cost_in(out / "sas_plan")


def same(cost: float | None, other: float | None) -> bool:
    """Whether two costs are equal, or there is neither."""
    if cost is None or other is None:
        return cost is other
    return math.isclose(cost, other, rel_tol=1e-12)


def cost_in(plan: Path) -> int:
    """Return the cost that a plan of PDDL states."""
    cost = re.search(r"; cost = (\d+) ", plan.read_text("utf-8"))
    assert cost, plan
    return int(cost[1])
