"""Random boards as YAML: many parts, a chart of a given density, several tools.

Parts lie in the cells of a tray and belong in the cells of a board next to it. They have the same
height and do not touch, so their geometry allows every order and only the chart restricts it.
Costs are planar distances, as for all assemblies (Moller et al., section 4.2).
"""

from __future__ import annotations

import math
import random
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from textwrap import wrap

from skillplan.errors import OptionError


class RandomOrder:
    """A random partial order that grows pair by pair to a total order.

    A total order is drawn, and then a random order of all its pairs. A pair that does not follow
    from
    earlier pairs is added together with all its consequences, one at a time, such that the relation
    is
    transitive after each addition. So every number of pairs is reached, and smaller relations are
    contained in larger ones.

    Parameters
    ----------
    count
        Number of elements, >= 0; the elements are 0 to count - 1.
    draw
        Source of uniform random numbers in [0, 1).
    pairs
        Number of pairs in the transitive relation, 0 to ``count * (count - 1) / 2``.

    Raises
    ------
    ValueError
        If the number of pairs is out of range.
    """

    def __init__(self, count: int, draw: Callable[[], float], pairs: int) -> None:
        most = count * (count - 1) // 2
        if not 0 <= pairs <= most:
            raise ValueError(f"{count} elements have from 0 to {most} pairs, not {pairs}.")
        self._elements = sorted(range(count), key=[draw() for _ in range(count)].__getitem__)
        # Bit masks of the places before and after each place of the total order.
        self._before = [0] * count
        self._after = [0] * count
        additions = self._additions(draw)
        for _ in range(pairs):
            earlier, later = next(additions)
            self._after[earlier] |= 1 << later
            self._before[later] |= 1 << earlier

    def covers(self) -> dict[int, list[int]]:
        """Return the direct successors of each element (transitive reduction).

        Elements without successors are left out.
        """
        successors: dict[int, list[int]] = {}
        for place, after in enumerate(self._after):
            further = 0
            for later in _list_bits(after):
                further |= self._after[later]
            if after:
                right_after = (self._elements[later] for later in _list_bits(after & ~further))
                successors[self._elements[place]] = sorted(right_after)
        return dict(sorted(successors.items()))

    def _additions(self, draw: Callable[[], float]) -> Iterator[tuple[int, int]]:
        """Yield pairs of places to add, given the relation at that time."""
        count = len(self._elements)
        drawn = [
            (draw(), lower, upper) for lower in range(count) for upper in range(lower + 1, count)
        ]
        for _, lower, upper in sorted(drawn):
            while not self._after[lower] >> upper & 1:
                # Take the first place before `lower` that is not yet before `upper`, and the last
                # place after `upper` that is not yet after it. Everything before the first is
                # already before the last, and everything after the last is already after the first.
                missing = (self._before[lower] | 1 << lower) & ~self._before[upper]
                earlier = (missing & -missing).bit_length() - 1
                missing = (self._after[upper] | 1 << upper) & ~self._after[earlier]
                yield earlier, missing.bit_length() - 1


def _list_bits(mask: int) -> Iterator[int]:
    """Yield the positions of the set bits, the lowest first."""
    while mask:
        lowest = mask & -mask
        yield lowest.bit_length() - 1
        mask ^= lowest


MOST_PARTS = 256
MOST_TOOLS = 8

_COLUMNS = 16
_PITCH_M = 0.020
# Corner of tray and board with the least coordinates.
_TRAY_M = (0.300, 0.036)
_BOARD_M = (0.300, -0.356)
_LEAST_SIDE_M, _MOST_SIDE_M = 0.008, 0.012
_HEIGHT_M = 0.010
# Distance of a part from the edge of its cell.
_MARGIN_M = 0.001
_DENSITY_KG_PER_M3 = 2700.0
# Holders are on an arc about the base: a detour by a third holder always costs more.
_HOLDER_RADIUS_M = 0.740
_HOLDER_PITCH_M = 0.080
# Place of the arm after a missed grasp, out of the camera's view: home.
_LOOK_M = (0.307, 0.000)
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_-]{0,63}")


@dataclass(frozen=True)
class BoardGenerator:
    """Settings of a random board; equal settings give equal text.

    A seed fixes shapes, starts and goals of `MOST_PARTS` parts; a board has the first ones. Boards
    with
    other densities, numbers of parts or tools can therefore be compared. With the same parts, a
    denser
    chart contains a less dense one, so its optimum is at least as high.

    Parameters
    ----------
    parts
        Number of parts, 1 to `MOST_PARTS`.
    density
        Share of all pairs of parts that the transitive chart orders, 0 (no chart) to 1 (total
        order)
        [-]; rounded to the nearest pair.
    tools
        Number of tools, 1 to `MOST_TOOLS`. Each part has a random tool; all tools are used if there
        are enough parts.
    seed
        Random seed, >= 0.
    name
        Name of the task; "" for a name made of parts, tools and seed.
    failures
        Range of the failure probability of grasps that may fail, in [0, 1), drawn uniformly and
        rounded
        to hundredths [-]; None for grasps that never fail. After a failed grasp the arm goes home,
        and that path has a cost.
    failing_share
        Share of the parts whose grasp may fail, rounded to the nearest number, in (0, 1] [-].

    Raises
    ------
    OptionError
        If a value is out of range, or the name is invalid.
    """

    parts: int
    density: float
    tools: int = 1
    seed: int = 0
    name: str = ""
    failures: tuple[float, float] | None = None
    failing_share: float = 1.0

    def __post_init__(self) -> None:
        if not 1 <= self.parts <= MOST_PARTS:
            raise OptionError(f"parts must be from 1 to {MOST_PARTS}, not {self.parts}.")
        if not 0 <= self.density <= 1:
            raise OptionError(f"density must be from 0 to 1, not {self.density}.")
        if not 1 <= self.tools <= MOST_TOOLS:
            raise OptionError(f"tools must be from 1 to {MOST_TOOLS}, not {self.tools}.")
        if self.seed < 0:
            raise OptionError(f"seed must be at least 0, not {self.seed}.")
        if self.failures is not None and not 0 <= self.failures[0] <= self.failures[1] < 1:
            shown = ":".join(f"{failure}" for failure in self.failures)
            raise OptionError(f"failures must be LEAST:GREATEST in [0, 1), not {shown}.")
        if not 0 < self.failing_share <= 1:
            raise OptionError(
                f"failing share must be above 0 and at most 1, not {self.failing_share}."
            )
        if self.name and not _NAME.fullmatch(self.name):
            shown = self.name if len(self.name) <= 48 else f"{self.name[:45]}..."
            raise OptionError(
                f"{shown!r} cannot be the name of a task: it must begin with a letter and have at "
                "most 64 letters, digits, '-' and '_'."
            )

    @property
    def pairs(self) -> int:
        """Number of pairs of parts."""
        return self.parts * (self.parts - 1) // 2

    @property
    def ordered_pairs(self) -> int:
        """Number of pairs that the transitive chart orders."""
        return math.floor(self.density * self.pairs + 0.5)

    @property
    def task_name(self) -> str:
        """The task's name."""
        return self.name or f"generated-{self.parts}-parts-{self.tools}-tools-seed-{self.seed}"

    @property
    def summary(self) -> str:
        """Summary of the board in a few words."""
        missed = len(self._misses)
        failing = f"; {_format_count(missed, 'grasp')} may fail" if missed else ""
        return (
            f"{_format_count(self.parts, 'part')} and {_format_count(self.tools, 'tool')}; "
            f"{self.ordered_pairs} of {_format_count(self.pairs, 'pair')} of parts ordered{failing}"
        )

    @property
    def command(self) -> str:
        """Command line that generates this board."""
        density = f"{self.density}".removesuffix(".0")
        name = f" --name {self.name}" if self.name else ""
        failing = ""
        if self.failures is not None:
            lowest, greatest = self.failures
            failing = f" --failures {lowest:g}:{greatest:g} --failing-share {self.failing_share:g}"
        return (
            f"skillplan generate assembly --parts {self.parts} --density {density} "
            f"--tools {self.tools} --seed {self.seed}{failing}{name}"
        )

    @cached_property
    def chart(self) -> dict[str, list[str]]:
        """Direct successors in the chart by part; empty for a chart without order."""
        order = RandomOrder(self.parts, self._draws("order"), self.ordered_pairs)
        return {
            _name_part(before): [_name_part(successor) for successor in after]
            for before, after in order.covers().items()
        }

    def text(self, version: str = "") -> str:
        """Return the board as a task file.

        Parameters
        ----------
        version
            Version of the program for the header; may be empty.
        """
        return "\n".join(self._lines(f"skillplan {version}".strip())) + "\n"

    def _lines(self, program: str) -> Iterator[str]:
        yield "# yaml-language-server: $schema=assembly.schema.json"
        yield f"# Made by {program}: {self.command}"
        yield "# Parts lie in cells of a tray and belong into cells of a board, at random. They are"
        yield "# of one height and keep apart, so that nothing but the chart orders them."
        yield "kind: assembly"
        yield f"name: {self.task_name}"
        yield f"description: {self.summary}."
        yield ""
        yield "robot:"
        yield "  name: panda"
        yield "  home_m: [0.307, 0.000]"
        if self._misses:
            yield f"  look_m: [{_LOOK_M[0]:.3f}, {_LOOK_M[1]:.3f}]"
        yield "  reach_m: 0.855"
        yield "  safe_height_m: 0.180"
        yield "  travel_speed_m_per_s: 0.25"
        yield ""
        yield "durations_s: {pick: 3.0, place: 3.0, load: 10.0, offload: 5.0}"
        yield ""
        yield "tools:"
        for tool in range(self.tools):
            # From the middle outwards, on alternating sides.
            y_m = _HOLDER_PITCH_M * ((tool + 1) // 2) * (-1 if tool % 2 else 1)
            holder = _format_vector(math.sqrt(_HOLDER_RADIUS_M**2 - y_m**2), y_m)
            yield f"  {_name_tool(tool)}: {{type: suction, holder_m: {holder}}}"
        yield f"initial_tool: {_name_tool(0)}"
        yield "tool_change: {style: swap, reload: false}"
        yield ""
        yield "parts:"
        for number, tool in enumerate(self._tools_of_parts()):
            failure = self._misses.get(number)
            missed = "" if failure is None else f"grasp_failure: {failure:.2f}, "
            rest = f"{missed}{self._geometry[number]}"
            yield f"  {_name_part(number)}: {{tool: {_name_tool(tool)}, {rest}}}"
        yield ""
        if self.chart:
            yield "chart:"
            for before, after in self.chart.items():
                line = f"- {{before: {before}, after: [{', '.join(after)}]}}"
                yield from wrap(
                    line, 98, initial_indent="  ", subsequent_indent=" " * 6, break_on_hyphens=False
                )
            yield ""
        yield "collision: {aabb: {}}    # all parts are boxes along the axes"
        yield ""
        yield "# Table II of Moller et al."
        yield "reward:"
        yield "  infeasible: -10.0"
        yield "  complete: 10.0"
        yield "  per_cost: -0.1"
        yield "  out_of_time: -10.0"
        if self.tools > 1:
            yield "  repeated_tool_change: -2.5"
        if not self._misses:
            # A pick, a place and a tool change for each part: two changes in a row never save
            # distance. With grasps that may fail, the default of the kind leaves room for retries.
            yield f"step_limit: {3 * self.parts}"

    @cached_property
    def _geometry(self) -> list[str]:
        """Mass, size, start and goal of every part as text in the file."""
        draw = self._draws("geometry")
        trays, boards = _shuffle(_COLUMNS**2, draw), _shuffle(_COLUMNS**2, draw)
        lines = []
        for start, goal in zip(trays, boards, strict=True):
            span_m = _MOST_SIDE_M - _LEAST_SIDE_M
            # In tenths of a millimetre, the precision of the file.
            sides_m = [round(_LEAST_SIDE_M + span_m * draw(), 4) for _ in "xy"]
            mass_kg = _DENSITY_KG_PER_M3 * math.prod(sides_m) * _HEIGHT_M
            lines.append(
                f"mass_kg: {mass_kg:.4f}, size_m: {_format_vector(*sides_m, _HEIGHT_M)}, "
                f"start_m: {_format_vector(*_draw_inside(_TRAY_M, start, sides_m, draw))}, "
                f"goal_m: {_format_vector(*_draw_inside(_BOARD_M, goal, sides_m, draw))}"
            )
        return lines

    @cached_property
    def _misses(self) -> dict[int, float]:
        """Failure probability by part number, for parts whose grasp may fail."""
        if self.failures is None:
            return {}
        draw = self._draws("failures")
        count = math.floor(self.failing_share * self.parts + 0.5)
        lowest, greatest = self.failures
        probabilities = {}
        for number in _shuffle(self.parts, draw)[:count]:
            # The file has two decimals and refuses grasps that always fail.
            probability = min(round(lowest + (greatest - lowest) * draw(), 2), 0.99)
            if probability:
                probabilities[number] = probability
        return probabilities

    def _tools_of_parts(self) -> list[int]:
        """Return a tool for each part: distinct tools for the first parts, then random ones."""
        draw = self._draws(f"tools of {self.tools}")
        first = _shuffle(self.tools, draw)
        others = [int(draw() * self.tools) for _ in range(self.parts)]
        return [*first, *others][: self.parts]

    def _draws(self, subject: str) -> Callable[[], float]:
        """Return uniform random numbers in [0, 1) from a sequence for one subject."""
        # Only random() keeps its sequence across versions of Python.
        return random.Random(f"{self.seed} {subject}").random


def _draw_inside(
    corner_m: tuple[float, float], cell: int, sides_m: list[float], draw: Callable[[], float]
) -> Iterator[float]:
    """Yield x and y of a part's centre, drawn such that the part is inside a cell [m]."""
    for low_m, index, side_m in zip(corner_m, divmod(cell, _COLUMNS), sides_m, strict=True):
        play_m = (_PITCH_M - side_m) / 2 - _MARGIN_M
        yield low_m + (index + 0.5) * _PITCH_M + play_m * (2 * draw() - 1)


def _shuffle(count: int, draw: Callable[[], float]) -> list[int]:
    return sorted(range(count), key=[draw() for _ in range(count)].__getitem__)


def _format_vector(*values_m: float) -> str:
    return f"[{', '.join(f'{value_m:.4f}' for value_m in values_m)}]"


def _format_count(count: int, what: str) -> str:
    return f"{count} {what}{'' if count == 1 else 's'}"


def _name_part(number: int) -> str:
    return f"part_{number + 1}"


def _name_tool(number: int) -> str:
    return f"cup_{number + 1}"
