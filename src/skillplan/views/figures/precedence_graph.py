"""The precedence relation of a task as a graph in layers, without pairs that follow from others.

The layers follow Sugiyama, Tagawa and Toda, "Methods for visual understanding of hierarchical
system structures" (1981): levels by the longest chain, bends of long edges, order by barycentres.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

from skillplan.chart.partial_order import break_cycles, closure, reduction
from skillplan.chart.precedence_chart import DerivedChart
from skillplan.task.task import Task

Pair = tuple[str, str]
_SWEEPS = 8


@dataclass(frozen=True, slots=True)
class Edge:
    """A component before another one.

    Parameters
    ----------
    derived, drawn
        True if back ends derive the pair, and if the hand-made chart has it.
    closing
        True if it closes a cycle, which rules out any order.
    """

    before: str
    after: str
    why: str
    derived: bool
    drawn: bool
    closing: bool = False


@dataclass(frozen=True, slots=True)
class Choice:
    """Groups of pairs, of which a skill needs at least one group."""

    skill: str
    component: str
    groups: tuple[tuple[Pair, ...], ...]

    @property
    def words(self) -> str:
        """The groups in words."""
        return " or ".join(
            " and ".join(f"{before} before {after}" for before, after in group)
            for group in self.groups
        )

    @property
    def components(self) -> list[str]:
        """All components of the groups, in alphabetical order."""
        return sorted({name for group in self.groups for pair in group for name in pair})


@dataclass(frozen=True)
class PrecedenceGraph:
    """A precedence relation.

    Parameters
    ----------
    edges
        Pairs that do not follow from others.
    choices
        Alternatives, which are not part of the order.
    origin
        Source of the relation, in words.
    notes
        Further findings: impossible skills, undecided ones, cycles.
    followers
        Number of pairs that follow from the edges.
    """

    components: tuple[str, ...]
    edges: tuple[Edge, ...]
    choices: tuple[Choice, ...] = ()
    origin: str = ""
    notes: tuple[str, ...] = ()
    followers: int = 0

    @property
    def placed(self) -> GraphLayers:
        """Components and bends in layers."""
        forward = [(edge.before, edge.after) for edge in self.edges if not edge.closing]
        return arrange_layers(self.components, forward)

    @property
    def layers(self) -> list[list[str]]:
        """Components by the longest chain before them."""
        return [[node for node in layer if isinstance(node, str)] for layer in self.placed.layers]

    def dot(self, name: str) -> str:
        """Return the graph in the DOT language of Graphviz."""
        lines = [f"digraph {_quote(name)} {{", "  rankdir=LR;", "  node [shape=box];"]
        lines += [f"  {_quote(component)};" for component in self.components]
        for edge in self.edges:
            style = "solid" if edge.derived or not edge.drawn else "dashed"
            marks = f"tooltip={_quote(edge.why)}, style={style}"
            lines.append(f"  {_quote(edge.before)} -> {_quote(edge.after)} [{marks}];")
        for number, choice in enumerate(self.choices, start=1):
            node = f"or_{number}"
            lines.append(f'  {node} [shape=circle, label="or", tooltip={_quote(choice.skill)}];')
            for group in choice.groups:
                words = " and ".join(f"{before} before {after}" for before, after in group)
                for end in sorted({name for pair in group for name in pair} - {choice.component}):
                    marks = f"style=dotted, tooltip={_quote(words)}"
                    lines.append(f"  {node} -> {_quote(end)} [{marks}, dir=none];")
            lines.append(f"  {_quote(choice.component)} -> {node} [style=dotted, dir=none];")
        return "\n".join([*lines, "}", ""])


def build_precedence_graph(
    task: Task, chart: DerivedChart | None, back_ends: Sequence[str] = ()
) -> PrecedenceGraph:
    """Return the relation of a task: derived, hand-made, or both laid over each other.

    Parameters
    ----------
    chart
        Relation that back ends derive; None for the hand-made chart alone.
    """
    lines = {(line.before, line.after) for line in task.chart if not line.instead}
    reasons = {} if chart is None else {(r.before, r.after): r.reason for r in chart.relations}
    order = {name: number for number, name in enumerate(task.operations)}
    forward, closing = break_cycles(lines | set(reasons), tuple(order))
    derived, drawn = closure(forward & set(reasons)), closure(forward & lines)
    kept = reduction(derived | drawn)
    edges = []
    for pair in sorted(kept | closing, key=lambda pair: (order[pair[0]], order[pair[1]])):
        before, after = pair
        if pair in closing:
            why = f"{reasons.get(pair, 'hand-made')}; with what comes before it this is a cycle"
            flags = (pair in reasons, pair in lines, True)
        else:
            follows = "follows from derived pairs" if pair in derived else "hand-made"
            why = reasons.get(pair, follows)
            why += " (hand-made as well)" if pair in derived and pair in drawn else ""
            flags = (pair in derived, pair in drawn, False)
        edges.append(Edge(before, after, f"{before} before {after}: {why}", *flags))
    sources = [f"derived by {', '.join(back_ends)}"] if chart is not None else []
    sources += ["hand-made chart"] if task.chart else []
    return PrecedenceGraph(
        tuple(task.operations),
        tuple(edges),
        () if chart is None else _collect_choices(chart),
        "; ".join(sources),
        () if chart is None else tuple(_write_notes(chart, task)),
        len((derived | drawn) - kept),
    )


def _collect_choices(chart: DerivedChart) -> tuple[Choice, ...]:
    """Return the alternatives, once for all skills that need the same."""
    skills: dict[tuple[str, tuple[tuple[Pair, ...], ...]], list[str]] = {}
    for choice in chart.alternatives:
        skills.setdefault((choice.component, choice.any_of), []).append(choice.skill)
    return tuple(
        Choice(", ".join(names), component, groups) for (component, groups), names in skills.items()
    )


def _write_notes(chart: DerivedChart, task: Task) -> list[str]:
    notes = [f"{skill} is never feasible: {why}" for skill, why in chart.impossible.items()]
    if chart.cycle:
        notes.append(f"no order exists: {' before '.join(chart.cycle)}")
    elif chart.contradiction:
        notes.append(f"derived and hand-made disagree: {' before '.join(chart.contradiction)}")
    if chart.undecided:
        notes.append(f"undecided: {', '.join(chart.undecided)}")
    return [*notes, *chart.beyond_order(task)]


def _quote(text: str) -> str:
    """Return a text in quotes for DOT."""
    return json.dumps(text, ensure_ascii=False).replace("\\u", "\\\\u")


@dataclass(frozen=True, slots=True)
class Bend:
    """The place of an edge in a layer between its ends."""

    edge: Pair
    level: int


Node = str | Bend


@dataclass(frozen=True, slots=True)
class GraphLayers:
    """A graph in layers.

    Parameters
    ----------
    layers
        Nodes and bends by level, connected ones near each other.
    bends
        Bends of every edge that passes layers, in order.
    """

    layers: list[list[Node]]
    bends: Mapping[Pair, tuple[Bend, ...]]


def arrange_layers(nodes: Sequence[str], edges: Sequence[Pair]) -> GraphLayers:
    """Return a graph in layers; cycles are allowed."""
    levels = _find_levels(nodes, edges)
    bends = {
        edge: tuple(Bend(edge, level) for level in range(levels[edge[0]] + 1, levels[edge[1]]))
        for edge in edges
    }
    layers: list[list[Node]] = [[] for _ in range(1 + max(levels.values(), default=0))]
    neighbours: dict[Node, list[Node]] = {}
    for node in nodes:
        layers[levels[node]].append(node)
    for (before, after), passed in bends.items():
        for bend in passed:
            layers[bend.level].append(bend)
        chain: list[Node] = [before, *passed, after]
        for left, right in pairwise(chain):
            neighbours.setdefault(left, []).append(right)
            neighbours.setdefault(right, []).append(left)
    places: dict[Node, float] = {}
    for sweep in range(-1, _SWEEPS):
        for layer in layers if sweep % 2 == 0 or sweep < 0 else reversed(layers):
            if sweep >= 0:
                means = {
                    node: sum(places[other] for other in near) / len(near)
                    for node in layer
                    if (near := neighbours.get(node))
                }
                layer.sort(key=lambda node: means.get(node, places[node]))
            places |= {node: (k + 0.5) / len(layer) for k, node in enumerate(layer)}
    return GraphLayers(layers, {edge: passed for edge, passed in bends.items() if passed})


def _find_levels(nodes: Sequence[str], edges: Sequence[Pair]) -> dict[str, int]:
    """Return the length of the longest chain before each node; nodes of cycles come last."""
    before: dict[str, list[str]] = {node: [] for node in nodes}
    for start, end in edges:
        before[end].append(start)
    levels: dict[str, int] = {}
    for _ in nodes:
        for node in nodes:
            known = [levels[other] for other in before[node] if other in levels]
            if node not in levels and len(known) == len(before[node]):
                levels[node] = 1 + max(known, default=-1)
    deepest = 1 + max(levels.values(), default=-1)
    return {node: levels.get(node, deepest) for node in nodes}
