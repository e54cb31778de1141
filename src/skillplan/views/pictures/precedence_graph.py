"""What comes before what in layers, each pair with why; what follows from others is left out."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field

from skillplan.chart.partial_order import acyclic, closure, reduction
from skillplan.chart.precedence_chart import DerivedChart
from skillplan.task.task import Task
from skillplan.views.pictures.graph_layers import GraphLayers, layers_of


@dataclass(frozen=True, slots=True)
class Edge:
    """One component before another.

    Parameters
    ----------
    before, after
        The two.
    why
        Reasons, in words.
    derived, drawn
        Whether back ends say so, and whether the hand-made chart does.
    closing
        Whether it closes a cycle, so that no order exists.
    """

    before: str
    after: str
    why: str
    derived: bool
    drawn: bool
    closing: bool = False


@dataclass(frozen=True, slots=True)
class Choice:
    """Groups of pairs, the first before the second, of which a skill needs at least one."""

    skill: str
    component: str
    groups: tuple[tuple[tuple[str, str], ...], ...]


@dataclass(frozen=True)
class PrecedenceGraph:
    """A precedence relation without the pairs that follow from others.

    Parameters
    ----------
    components
        All of the task's.
    edges
        Between them.
    choices
        What is no partial order: one or another.
    origin
        Where it is from, in words.
    notes
        What else was found out: impossible skills, undecided ones, cycles.
    """

    components: tuple[str, ...]
    edges: tuple[Edge, ...]
    choices: tuple[Choice, ...] = ()
    origin: str = ""
    notes: tuple[str, ...] = ()
    followers: int = field(default=0)

    @property
    def placed(self) -> GraphLayers:
        """The components by the longest chain before them, with what passes layers."""
        forward = [(one.before, one.after) for one in self.edges if not one.closing]
        return layers_of(self.components, forward)

    @property
    def layers(self) -> list[list[str]]:
        """The components by the longest chain before them, neighbours near each other."""
        layers = self.placed.layers
        return [[one for one in layer if isinstance(one, str)] for layer in layers]

    def dot(self, name: str) -> str:
        """Return the graph in the DOT language of Graphviz."""
        lines = [f"digraph {_quoted(name)} {{", "  rankdir=LR;", "  node [shape=box];"]
        lines += [f"  {_quoted(component)};" for component in self.components]
        for edge in self.edges:
            style = "solid" if edge.derived or not edge.drawn else "dashed"
            marks = f"tooltip={_quoted(edge.why)}, style={style}"
            lines.append(f"  {_quoted(edge.before)} -> {_quoted(edge.after)} [{marks}];")
        for number, choice in enumerate(self.choices, start=1):
            node = f"or_{number}"
            lines.append(f'  {node} [shape=circle, label="or", tooltip={_quoted(choice.skill)}];')
            for group in choice.groups:
                words = " and ".join(f"{one} before {other}" for one, other in group)
                for end in sorted({e for pair in group for e in pair} - {choice.component}):
                    marks = f"style=dotted, tooltip={_quoted(words)}"
                    lines.append(f"  {node} -> {_quoted(end)} [{marks}, dir=none];")
            lines.append(f"  {_quoted(choice.component)} -> {node} [style=dotted, dir=none];")
        return "\n".join([*lines, "}", ""])


def precedence_graph(
    task: Task, chart: DerivedChart | None, back_ends: Sequence[str] = ()
) -> PrecedenceGraph:
    """Return the relation of a task: derived, hand-made, or both laid over each other.

    Parameters
    ----------
    task
        Whose components are ordered.
    chart
        What back ends say; None for the hand-made chart alone.
    back_ends
        Their names.
    """
    lines = {(line.before, line.after) for line in task.chart}
    reasons = {} if chart is None else {(r.before, r.after): r.reason for r in chart.relations}
    forward, closing = acyclic(lines | set(reasons), tuple(task.operations))
    derived, drawn = closure(forward & set(reasons)), closure(forward & lines)
    kept = reduction(derived | drawn)
    edges = []
    for pair in sorted(kept | closing, key=lambda pair: _places(task, pair)):
        one, other = pair
        if pair in closing:
            said = f"{reasons.get(pair, 'hand-made')}; with what comes before it this is a cycle"
            words = f"{one} before {other}: {said}"
            edges.append(Edge(one, other, words, pair in reasons, pair in lines, closing=True))
            continue
        why = reasons.get(pair, "follows from derived pairs" if pair in derived else "hand-made")
        if pair in derived and pair in drawn:
            why += " (hand-made as well)"
        edges.append(
            Edge(one, other, f"{one} before {other}: {why}", pair in derived, pair in drawn)
        )
    named = f"derived by {', '.join(back_ends)}" if chart is not None else ""
    hand = "hand-made chart" if task.chart else ""
    return PrecedenceGraph(
        tuple(task.operations),
        tuple(edges),
        () if chart is None else _choices(chart),
        "; ".join(filter(None, (named, hand))),
        () if chart is None else tuple(_notes(chart, task)),
        len((derived | drawn) - kept),
    )


def _choices(chart: DerivedChart) -> tuple[Choice, ...]:
    """Return what has to hold in one way or another, once for all skills that need the same."""
    skills: dict[tuple[str, tuple[tuple[tuple[str, str], ...], ...]], list[str]] = {}
    for one in chart.alternatives:
        skills.setdefault((one.component, one.any_of), []).append(one.skill)
    return tuple(
        Choice(", ".join(names), component, groups) for (component, groups), names in skills.items()
    )


def _places(task: Task, pair: tuple[str, str]) -> tuple[int, int]:
    order = list(task.operations)
    return order.index(pair[0]), order.index(pair[1])


def _notes(chart: DerivedChart, task: Task) -> list[str]:
    notes = [f"{skill} is never feasible: {why}" for skill, why in chart.impossible.items()]
    if chart.cycle:
        notes.append(f"no order exists: {' before '.join(chart.cycle)}")
    elif chart.contradiction:
        notes.append(f"derived and hand-made disagree: {' before '.join(chart.contradiction)}")
    if chart.undecided:
        notes.append(f"undecided: {', '.join(chart.undecided)}")
    return [*notes, *chart.beyond_order(task)]


def _quoted(text: str) -> str:
    """Return a text in quotes as DOT reads it."""
    return json.dumps(text, ensure_ascii=False).replace("\\u", "\\\\u")
