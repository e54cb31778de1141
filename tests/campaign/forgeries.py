"""Forged results: `verify` calls none valid, and no page repeats what is refuted."""

from __future__ import annotations

import copy
import json
import random
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tally import Tally, call, guarded_folder, holds_to_its_word, progress, survives

Document = dict[str, Any]
Forge = Callable[[Document], None]

SLIPPERY = """\
kind: assembly
name: slippery
robot: {home_m: [0.3, 0]}
tools: {t: {holder_m: [0.6, 0.2]}}
initial_tool: t
parts:
  a: {tool: t, size_m: [0.01, 0.01, 0.01], start_m: [0.4, -0.1], goal_m: [0.4, 0.1],
      grasp_failure: 0.3}
  b: {tool: t, size_m: [0.01, 0.01, 0.01], start_m: [0.5, -0.1], goal_m: [0.5, 0.1]}
"""
CORNER = """\
kind: swarmitfix
name: corner
trajectory: {vertices_m: [[0.56, 0.60], [0.72, 0.85], [0.88, 1.10]]}
heads: {side_m: 0.10, max_gap_m: 0.25, step_m: 0.05, orientations: 2, reorientation_cost: 0.1}
base: {home: C66, side: right}
"""
NO_PLAN: Document = {
    **dict.fromkeys(("cost", "lower_bound", "gap", "makespan", "makespan_s")),
    "skills": [],
    "actions": [],
    "steps": [],
}
FREE = {**NO_PLAN, "cost": 0.0, "lower_bound": 0.0, "gap": 0.0, "makespan": 0, "makespan_s": 0.0}
TABLES = (("board", "plan.csv"), ("chain", "plan.csv"), ("chain", "timeline.csv"))
# No plan tells these; `verify` lists them. A policy that is claimed and missing is named.
UNCHECKED = re.compile(
    r"(schema|solver|seed|bound_method|policy|stats|trace|reason"
    r"|origin\.(file|set|options|screening|part))\b.*"
)


def _cheaper(document: Document) -> None:
    document["cost"] = document["lower_bound"] = document["cost"] / 2


def _dearer(document: Document) -> None:
    document["cost"] = document["lower_bound"] = document["cost"] + 1


def _bound_above(document: Document) -> None:
    document.update(lower_bound=document["cost"] * 2)


def _solved_without_the_goal(document: Document) -> None:
    for key in ("skills", "actions", "steps"):
        document[key].pop()
    document["makespan"] -= 1


def _backwards(document: Document) -> None:
    for key in ("skills", "actions", "steps"):
        document[key].reverse()


def _missing_part(document: Document) -> None:
    document["sequences"].pop()


def _doubled_part(document: Document) -> None:
    document["sequences"].append(copy.deepcopy(document["sequences"][-1]))


EVERY: dict[str, Forge] = {
    "a chain of nothing, optimal": lambda d: d.update(FREE, sequences=[], stages=[]),
    "a chain of nothing, infeasible": lambda d: d.update(
        NO_PLAN, status="infeasible", sequences=[], stages=[]
    ),
    "no plan, infeasible": lambda d: d.update(NO_PLAN, status="infeasible", bound_method=""),
    "a lower cost": _cheaper,
    "a higher cost": _dearer,
    "a bound above the cost": _bound_above,
    "the end left out": _solved_without_the_goal,
    "steps backwards": _backwards,
}
CHAIN: dict[str, Forge] = {"a part left out": _missing_part, "a part twice": _doubled_part}


class Forger:
    """Genuine results of several kinds, to forge and to verify.

    Parameters
    ----------
    folder
        Where they lie.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        assert 0 == survives("init", "assembly", "--out", folder / "board.yaml")
        (folder / "chance.yaml").write_text(SLIPPERY, "utf-8")
        (folder / "chain.yaml").write_text(CORNER, "utf-8")
        self.genuine: dict[str, Document] = {}
        for kind in ("board", "chance", "chain"):
            task, out = folder / f"{kind}.yaml", folder / kind
            assert 0 == survives("search-optimal", task, "--out", out)
            self.genuine[kind] = json.loads((out / "result.json").read_text("utf-8"))
            assert self.is_valid(kind, self.genuine[kind]), f"a genuine {kind} is not valid"

    def is_valid(self, kind: str, document: Document, *, without: str = "") -> bool:
        """Whether `verify` calls a document valid, with the files of a kind of result beside it."""
        forged = self.write(kind, document, without)
        code, errors = call("verify", forged, "--format", "json")
        holds_to_its_word(code, errors)
        return code == 0

    def write(self, kind: str, document: Document, without: str = "") -> Path:
        """Write a forged result in a folder of its own; return the folder."""
        forged = self.folder / "forged"
        shutil.rmtree(forged, ignore_errors=True)
        shutil.copytree(self.folder / kind, forged)
        (forged / "result.json").write_text(json.dumps(document), "utf-8")
        if without:
            (forged / without).unlink()
        return forged

    def refute(self, kind: str, forge: Forge, name: str) -> None:
        """Assert that a forged result is not valid, and that no page shows it."""
        document = copy.deepcopy(self.genuine[kind])
        forge(document)
        assert not self.is_valid(kind, document), f"{name} of a {kind} is valid"
        page = self.folder / "page.html"
        page.unlink(missing_ok=True)
        forged = self.write(kind, document)
        code, errors = call("report", forged, "--no-simulation", "--out", page)
        holds_to_its_word(code, errors)
        assert code == 2, f"a page on {name} of a {kind}"
        assert not page.exists(), f"a page on {name} of a {kind}"

    def leaf(self, chance: random.Random) -> None:
        """Change one leaf of a result; only what `verify` lists as unchecked may stay valid."""
        kind = chance.choice(("board", "chance", "chain"))
        document = copy.deepcopy(self.genuine[kind])
        path = chance.choice(list(_leaves(document)))
        *holders, last = path
        holder: Any = document
        for key in holders:
            holder = holder[key]
        holder[last] = _lie(holder[last], chance)
        words = re.sub(r"^(sequences|stages)\.\d+\.", "", ".".join(map(str, path)))
        if not UNCHECKED.fullmatch(words) and document != self.genuine[kind]:
            assert not self.is_valid(kind, document), f"{path} of a {kind} as {holder[last]!r}"

    def table(self, kind: str, name: str, chance: random.Random) -> None:
        """Change a digit in a table beside a result."""
        forged = self.write(kind, self.genuine[kind])
        text = (forged / name).read_text("utf-8")
        at = chance.choice([match.start() for match in re.finditer(r"[0-8]", text)])
        (forged / name).write_text(f"{text[:at]}9{text[at + 1 :]}", "utf-8")
        code, errors = call("verify", forged, "--format", "json")
        holds_to_its_word(code, errors)
        assert code == 1, f"{name} of a {kind} with another digit at {at} is valid"

    def policy(self, factor: float) -> None:
        """Claim a multiple of the cost without the policy."""
        document = copy.deepcopy(self.genuine["chance"])
        document["cost"] *= factor
        document["lower_bound"] = min(document["cost"], document["lower_bound"])
        valid = self.is_valid("chance", document, without="policies.json")
        assert not valid, f"{factor} of the cost without a policy"


def _leaves(value: Any, path: tuple[str | int, ...] = ()) -> Any:
    if isinstance(value, dict):
        for key, item in value.items():
            yield from _leaves(item, (*path, key))
    elif isinstance(value, list):
        for index, item in enumerate(value):
            yield from _leaves(item, (*path, index))
    else:
        yield path


def _lie(value: Any, chance: random.Random) -> Any:
    """Return another value than a leaf has."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, int | float):
        return chance.choice((value + 1, value - 1, value * 1.001 + 0.01, None, -1e300))
    if isinstance(value, str):
        return chance.choice((f"{value}x", "", None))
    return chance.choice((1, "x", [], False))


def forge_results(tally: Tally, leaves: int) -> None:
    """Verify every known forgery, and so many results with one changed leaf."""
    with guarded_folder() as inside:
        forger = Forger(inside)
        progress(f"forgeries, and {leaves} changed leaves")
        number = 0
        for kind in forger.genuine:
            for name, forge in {**EVERY, **(CHAIN if kind == "chain" else {})}.items():
                tally.case(
                    "forged-result",
                    number,
                    lambda _, kind=kind, forge=forge, name=name: forger.refute(kind, forge, name),
                )
                number += 1
        for number, factor in enumerate((0.5, 1.0, 2.0)):
            tally.case("missing-policy", number, lambda _, factor=factor: forger.policy(factor))
        for number, (kind, name) in enumerate(TABLES):
            tally.case(
                "forged-table",
                number,
                lambda chance, kind=kind, name=name: forger.table(kind, name, chance),
            )
        for number in range(leaves):
            tally.case("forged-leaf", number, forger.leaf)
