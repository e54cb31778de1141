"""Random boards for provers that must agree: stacks, lids, screws, racks of tools, charts.

Of each seed one YAML text. A board need not be buildable: charts may contradict the geometry, lids
may lack their posts, and step limits may be too tight for all plans or for the cheapest one.
"""

from __future__ import annotations

import random
from itertools import pairwise
from typing import Any

import pytest
import yaml

from skillplan.errors import TaskError
from skillplan.pipeline import load_problem

Content = dict[str, Any]
Place = list[float]

_SITES = [(0.36, -0.24), (0.50, -0.24), (0.36, -0.10), (0.50, -0.10)]
_TRAY = [(x, y) for x in (0.32, 0.42, 0.52) for y in (0.10, 0.19, 0.28)]
_THICK = 0.01


def seed_blocks(every_run: int, slow: int, release: int, reason: str, size: int = 20) -> list[Any]:
    """Return ranges of seeds as parameters: for every run, the whole suite and a release.

    Parameters
    ----------
    every_run, slow, release
        How many boards there are up to each of them.
    reason
        Which boards the cheaper runs have.
    size
        Boards of a block for a release.
    """
    bounds = [0, every_run, slow, *range(slow + size, release, size), release]
    marks: list[Any] = [(), pytest.mark.slow(reason=f"a second a board; {reason}")]
    marks += [
        pytest.mark.release(reason=f"half a minute a block; {slow} boards in the whole suite")
    ]
    return [
        pytest.param(range(first, last), marks=marks[min(n, 2)], id=f"{first}-to-{last - 1}")
        for n, (first, last) in enumerate(pairwise(bounds))
    ]


def board_text(seed: int, folder: Any, *, most: int = 4, tight: bool = True) -> str:
    """Return a board that loads, as YAML; drafts that the loader refuses are drawn again.

    Parameters
    ----------
    seed
        Governs all randomness.
    folder
        Where drafts are written.
    most
        Most parts of a board, >= 2.
    tight
        Whether step limits may be so tight that the cheapest order does not fit.
    """
    rng = random.Random(seed)
    while True:
        text = yaml.safe_dump(_Draft(rng, most).content(seed, tight), sort_keys=False)
        path = folder / "draft.yaml"
        path.write_text(text, "utf-8")
        try:
            load_problem(path)
        except TaskError:
            continue
        return text


class _Draft:
    """One board in the making."""

    def __init__(self, rng: random.Random, most: int) -> None:
        self.rng = rng
        self.tools = self._rack()
        self.parts: dict[str, Content] = {}
        self.screws: dict[str, Content] = {}
        self.cells = rng.sample(_TRAY, len(_TRAY))
        self.sites = rng.sample(_SITES, len(_SITES))
        # Sequences are enumerated, too: their number grows with tools and components.
        many_tools = len(self.tools) > 2
        count = rng.randint(2, min(most, 3) if many_tools else most)
        while len(self.parts) < count:
            left = count - len(self.parts)
            choices = [self._loose, self._stack]
            choices += [self._box] if left >= 2 else []
            choices += [self._bridge] if left >= 3 else []
            rng.choice(choices)(left)
        for number in range(min(rng.choice([0, 0, 1, 1, 2]), (4 if many_tools else 5) - count)):
            self._screw(number)

    def content(self, seed: int, tight: bool) -> Content:
        """Return the board as the content of its file."""
        rng, tools = self.rng, self.tools
        board: Content = {
            "kind": "assembly",
            "name": f"random-{seed}",
            "robot": {
                "name": "panda",
                "home_m": rng.choice([[0.307, 0.0], [0.45, 0.05]]),
                "safe_height_m": rng.choice([0.18, 0.18, 0.05]),
            },
            "tools": tools,
            "initial_tool": rng.choice([None, *tools, *tools]),
            "tool_change": {
                "style": rng.choice(["swap", "swap", "separate"]),
                "reload": rng.random() < 0.2,
            },
            "parts": self.parts,
            "screws": self.screws,
            "feeders": {"feeder": {"position_m": [0.60, 0.30]}},
            "chart": self._chart(),
            "cost": rng.choice(["distance", "distance", "time"]),
        }
        large = len(tools) * (len(self.parts) + len(self.screws)) > 6
        if tight and (large or rng.random() < 0.3):
            board["step_limit"] = self._fewest(board) + rng.randint(0, 2)
        return board

    def _fewest(self, board: Content) -> int:
        """Return the fewest skills that a plan may have; more tool changes may be needed."""
        used = {thing["tool"] for thing in (*self.parts.values(), *self.screws.values())}
        separate = board["tool_change"]["style"] == "separate"
        changes = len(used - {board["initial_tool"]}) * (2 if separate else 1)
        changes -= separate and board["initial_tool"] is None
        return 2 * len(self.parts) + len(self.screws) + changes

    def _rack(self) -> dict[str, Content]:
        """Return one to four tools: in a row of equal pitch, on an arc, or anywhere."""
        rng = self.rng
        count = rng.randint(1, 4)
        pitch = rng.choice([0.05, 0.08, 0.1])
        kind = rng.choice(["row", "row", "anywhere"])
        order = rng.sample(range(count), count)
        holders = [[0.62, round((k - 1) * pitch, 3)] for k in order]
        if kind == "anywhere":
            holders = [
                [round(rng.uniform(0.60, 0.70), 3), round(rng.uniform(-0.3, 0.3), 3)] for _ in order
            ]
        tools: dict[str, Content] = {}
        for number, holder in enumerate(holders):
            tool: Content = {"type": "suction", "holder_m": holder}
            if rng.random() < 0.15:
                tool["envelope_m"] = [0.04, 0.04, 0.06]
            tools[f"cup_{number}"] = tool
        return tools

    def _part(self, size: Place, site: tuple[float, float], **more: Any) -> str:
        """Add a part, which lies in the tray or on another part there."""
        rng = self.rng
        name = f"part_{len(self.parts)}"
        part: Content = {"tool": rng.choice([*self.tools]), "size_m": size, "goal_m": [*site]}
        part.update(more)
        flat = [
            n
            for n, p in self.parts.items()
            if "start_m" in p and p.get("size_m", [0.0])[0] >= size[0]
        ]
        if flat and rng.random() < 0.2:
            part["start_on"] = rng.choice(flat)
        else:
            part["start_m"] = [*self.cells.pop()]
        self.parts[name] = part
        return name

    def _site(self) -> tuple[float, float]:
        x, y = self.sites.pop() if self.sites else self.rng.choice(_SITES)
        return round(x + self.rng.choice([0, 0.003, -0.007]), 4), y

    def _loose(self, left: int) -> None:
        """Add a part on the table, sometimes one that is taller than the safe height."""
        height = self.rng.choice([0.01, 0.02, 0.03, 0.07])
        self._part([0.03, 0.02, height], self._site(), **self._ways())

    def _stack(self, left: int) -> None:
        """Add a plate, and what lies on it."""
        site = self._site()
        below = self._part([0.06, 0.06, _THICK], site)
        for _ in range(min(left - 1, self.rng.randint(1, 2))):
            aside = (round(site[0] + self.rng.choice([0, 0.01, -0.02]), 4), site[1])
            size = [0.02, self.rng.choice([0.02, 0.05]), self.rng.choice([0.01, 0.02])]
            below = self._part(size, aside, goal_on=below, **self._ways())

    def _box(self, left: int) -> None:
        """Add a part and a lid with two legs over it, which goes on last, as boxes see it."""
        site = self._site()
        self._part([0.02, 0.02, 0.02], site, **self._ways())
        lid = self._part([0.06, 0.04, 0.035], site)
        legs = [
            {"size_m": [0.01, 0.04, 0.03], "centre_m": [x, 0.0, 0.015]} for x in (-0.025, 0.025)
        ]
        roof = {"size_m": [0.06, 0.04, 0.005], "centre_m": [0.0, 0.0, 0.0325]}
        self.parts[lid]["boxes"] = [roof, *legs]
        del self.parts[lid]["size_m"]
        self.parts[lid].update(start_m=self.parts[lid].get("start_m") or [*self.cells.pop()])
        self.parts[lid].pop("start_on", None)

    def _bridge(self, left: int) -> None:
        """Add posts and a plate over them, which stays up on any two of three posts."""
        x, y = self._site()
        offsets = [-0.03, 0.03, 0.0] if left >= 4 else [-0.03, self.rng.choice([0.03, 0.005])]
        posts = [self._part([0.012, 0.03, 0.03], (round(x + dx, 4), y)) for dx in offsets]
        on = posts if self.rng.random() < 0.8 else posts[:1]
        self._part([0.08, 0.03, _THICK], (x, y), goal_on=on)

    def _ways(self) -> Content:
        """Return directions to choose from, now and then."""
        if self.rng.random() < 0.85:
            return {}
        aside = self.rng.choice([[1, 0, 0], [-1, 0, 0], [0, 1, 0]])
        return {"insert_along": [aside, [0, 0, -1]], "insert_m": 0.05}

    def _screw(self, number: int) -> None:
        """Add a screw through a part, fetched from a feeder or brought along."""
        through = self.rng.choice([*self.parts])
        screw: Content = {
            "tool": self.rng.choice([*self.tools]),
            "hole_m": [*self.parts[through]["goal_m"]],
            "through": through,
        }
        screw["hole_m"][1] = round(screw["hole_m"][1] + 0.008 * number, 4)
        if self.rng.random() < 0.5:
            screw["feeder"] = "feeder"
        self.screws[f"screw_{number}"] = screw

    def _chart(self) -> list[Content]:
        """Return a chart that follows the order of the file, or any order at all."""
        rng = self.rng
        elements = [*self.parts, *self.screws]
        if rng.random() < 0.35:
            rng.shuffle(elements)
        density = rng.choice([0.1, 0.3, 0.6])
        pairs = [
            {"before": before, "after": [after]}
            for i, before in enumerate(elements)
            for after in elements[i + 1 :]
            if rng.random() < density
        ]
        return pairs or [{"before": elements[0], "after": [elements[-1]]}]
