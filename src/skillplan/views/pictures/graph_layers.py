"""Layers of a directed graph, with a place in each layer that an edge only passes.

Sugiyama, Tagawa and Toda, "Methods for visual understanding of hierarchical system structures"
(1981): levels by the longest chain, bends of long edges, order by barycentres.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

Pair = tuple[str, str]
_SWEEPS = 8


@dataclass(frozen=True, slots=True)
class Bend:
    """Where an edge passes a layer between its ends."""

    edge: Pair
    level: int


@dataclass(frozen=True, slots=True)
class GraphLayers:
    """A graph in layers.

    Parameters
    ----------
    layers
        Nodes and bends, level by level; neighbours are near each other.
    bends
        Those of every edge that passes layers, in order.
    """

    layers: list[list[str | Bend]]
    bends: Mapping[Pair, tuple[Bend, ...]]


def layers_of(nodes: Sequence[str], edges: Sequence[Pair]) -> GraphLayers:
    """Return a graph in layers.

    Parameters
    ----------
    nodes
        Their names, each once.
    edges
        From one to another; circles are allowed.
    """
    levels = _levels(nodes, edges)
    bends = {
        edge: tuple(Bend(edge, level) for level in range(levels[edge[0]] + 1, levels[edge[1]]))
        for edge in edges
    }
    layers: list[list[str | Bend]] = [[] for _ in range(1 + max(levels.values(), default=0))]
    for node in nodes:
        layers[levels[node]].append(node)
    near: dict[str | Bend, list[str | Bend]] = {node: [] for node in nodes}
    for (before, after), passed in bends.items():
        chain: list[str | Bend] = [before, *passed, after]
        for bend in passed:
            layers[bend.level].append(bend)
        for one, other in pairwise(chain):
            near.setdefault(one, []).append(other)
            near.setdefault(other, []).append(one)
    _sort(layers, near)
    return GraphLayers(layers, {edge: passed for edge, passed in bends.items() if passed})


def _levels(nodes: Sequence[str], edges: Sequence[Pair]) -> dict[str, int]:
    """Return how long the longest chain before each node is; those of a circle as met first."""
    before: dict[str, list[str]] = {node: [] for node in nodes}
    for one, other in edges:
        before[other].append(one)
    levels: dict[str, int] = {}
    for _ in nodes:
        for node in nodes:
            known = [levels[one] for one in before[node] if one in levels]
            if node not in levels and len(known) == len(before[node]):
                levels[node] = 1 + max(known, default=-1)
    deepest = 1 + max(levels.values(), default=-1)
    return {node: levels.get(node, deepest) for node in nodes}


def _sort(layers: list[list[str | Bend]], near: Mapping[str | Bend, Sequence[str | Bend]]) -> None:
    """Sort layers by the mean place of neighbours."""
    place: dict[str | Bend, float] = {}
    for layer in layers:
        place |= {one: (k + 0.5) / len(layer) for k, one in enumerate(layer)}
    for sweep in range(_SWEEPS):
        for layer in layers if sweep % 2 == 0 else reversed(layers):
            means = {
                one: sum(place[o] for o in near[one]) / len(near[one]) if near[one] else place[one]
                for one in layer
            }
            layer.sort(key=means.__getitem__)
            place |= {one: (k + 0.5) / len(layer) for k, one in enumerate(layer)}
