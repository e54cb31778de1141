"""Complete search over the configurations of many agents, successors made lazily by priority.

After LaCAM (Okumura, "LaCAM: search-based algorithm for quick multi-agent pathfinding", 2023):
depth first over configurations, where each visit to one makes a single successor under a further
constraint. The successor comes from priority inheritance (PIBT; Okumura et al., 2022), adapted to
moves that need more than their goal vertex: who is in the way of a move is asked to clear all
that it forbids, and the mover waits meanwhile, as what is left in a step is not free in it.

The last constraints of a configuration are its single moves. Any step can be serialised into such,
so that a search that ends has seen all that can be reached: where it ends without a way, there is
none.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from skillplan.model.multi_agent import Move, MultiAgentProblem

# Questions of priority inheritance in one step, beyond which nobody is asked to clear the way.
_MOST_ASKED = 64
_POLL_EVERY = 16
# Successors that a search makes before another is started, without and with a way in hand.
_FIRST_LIMIT, _LEAST_LIMIT = 2_000, 200
Configuration = tuple[int, ...]


@dataclass(slots=True)
class _Node:
    """A configuration, how it was reached, and what is still to be tried there."""

    places: Configuration
    bits: int
    parent: _Node | None
    moves: tuple[Move, ...]
    waited: tuple[int, ...]
    constraints: Iterator[tuple[Move | None, int | None, bool]]


@dataclass(frozen=True, slots=True)
class RestartResult:
    """What several searches found.

    Parameters
    ----------
    ways
        Ways to the goals, as the moves of every step.
    complete
        Whether one of them has seen all that can be reached.
    generated
        Successors made by all of them.
    searches
        How many there were.
    """

    ways: tuple[tuple[tuple[Move, ...], ...], ...]
    complete: bool
    generated: int
    searches: int


def search_with_restarts(
    problem: MultiAgentProblem,
    rng: random.Random,
    stop: Callable[[], bool],
    *,
    restarts: int,
    max_nodes: int,
) -> RestartResult:
    """Search from different seeds until there is a way, and then some more for better ones.

    Until a way is found the limit of a search is twice that of the one before, so that one of
    them is complete in the end; after that it is what the best needed.

    Parameters
    ----------
    problem
        Agents, places and moves.
    rng
        Seeds the searches.
    stop
        Polled once in a while.
    restarts
        Searches after the first way was found, >= 0.
    max_nodes
        The most successors to make, for the sake of memory and time.
    """
    ways: list[tuple[tuple[Move, ...], ...]] = []
    limit, generated, searches, left = _FIRST_LIMIT, 0, 0, restarts
    while generated < max_nodes:
        search = ConfigurationSearch(problem, random.Random(rng.getrandbits(64)), stop)
        way = search.run(min(limit, max_nodes - generated))
        generated += search.generated
        searches += 1
        if search.exhausted:
            return RestartResult(tuple(ways), True, generated, searches)
        if way is not None:
            limit = search.generated if not ways else min(limit, search.generated)
            limit = max(limit, _LEAST_LIMIT)
            ways.append(way)
        elif not ways:
            limit *= 2
        if stop() or (ways and left == 0):
            break
        left -= bool(ways)
    return RestartResult(tuple(ways), False, generated, searches)


class ConfigurationSearch:
    """One depth-first search; a limit and a seed make it one of several restarts.

    Parameters
    ----------
    problem
        Agents, places and moves.
    rng
        Breaks ties.
    stop
        Polled once in a while.

    Attributes
    ----------
    generated
        Successors made, also those met before.
    exhausted
        Whether everything that can be reached was seen.
    """

    def __init__(
        self, problem: MultiAgentProblem, rng: random.Random, stop: Callable[[], bool]
    ) -> None:
        self.problem = problem
        self.rng = rng
        self.stop = stop
        self.generated = 0
        self.exhausted = False
        self._agents = range(len(problem.agents))
        self._costs = problem.least_costs
        self._ties = [rng.random() for _ in self._agents]
        self._options: dict[tuple[int, int], list[Move | None]] = {}

    def run(self, limit: int) -> tuple[tuple[Move, ...], ...] | None:
        """Return the moves of every step of a way to the goals, or None.

        Parameters
        ----------
        limit
            The most successors to make, >= 1.
        """
        problem = self.problem
        start = self._node(problem.starts, None, (), tuple(0 for _ in self._agents))
        stack, seen = [start], {start.places}
        while stack:
            node = stack[-1]
            if node.places == problem.goals:
                return _way(node)
            if self.generated >= limit or (self.generated % _POLL_EVERY == 0 and self.stop()):
                return None
            constraint = next(node.constraints, None)
            if constraint is None:
                stack.pop()
                continue
            self.generated += 1
            moves = self._step(node, *constraint)
            places = list(node.places)
            for move in moves:
                places[move.agent] = move.end
            if (to := tuple(places)) not in seen:
                seen.add(to)
                waited = tuple(
                    0 if to[i] == problem.goals[i] else node.waited[i] + 1 for i in self._agents
                )
                stack.append(self._node(to, node, moves, waited))
        self.exhausted = True
        return None

    def _node(
        self,
        places: Configuration,
        parent: _Node | None,
        moves: tuple[Move, ...],
        waited: tuple[int, ...],
    ) -> _Node:
        order = sorted(self._agents, key=lambda i: (-waited[i], self._ties[i]))
        constraints = self._constraints(places, order)
        return _Node(places, self.problem.bits(places), parent, moves, waited, constraints)

    def _constraints(
        self, places: Configuration, order: list[int]
    ) -> Iterator[tuple[Move | None, int | None, bool]]:
        """Yield what a successor is made under: a move or an agent that waits, and if alone."""
        yield None, None, False
        for agent in order:
            for move in self.ranked(agent, places[agent]):
                yield move, agent, False
        for agent in order:
            for move in self.problem.moves[agent][places[agent]]:
                yield move, agent, True

    def ranked(self, agent: int, place: int) -> list[Move | None]:
        """Return the moves from a place and waiting, the nearest to the goal first."""
        ranked = self._options.get((agent, place))
        if ranked is None:
            costs = self._costs[agent]
            ranked = [None, *self.problem.moves[agent][place]]
            self.rng.shuffle(ranked)
            ranked.sort(
                key=lambda move: (
                    (costs[place], 0)
                    if move is None
                    else (costs[move.end], move.occupies.bit_count())
                )
            )
            self._options[agent, place] = ranked
        return ranked

    def _step(
        self, node: _Node, forced: Move | None, agent: int | None, alone: bool
    ) -> tuple[Move, ...]:
        """Return the moves of one step under a constraint; none where it cannot be met."""
        if forced is not None and not forced.passes(node.bits):
            return ()
        if alone:
            return () if forced is None else (forced,)
        if forced is not None and forced.rejected:
            return ()
        decided: dict[int, Move | None] = {} if agent is None else {agent: forced}
        asking = _Asking(self, node, decided)
        for i in sorted(self._agents, key=lambda i: (-node.waited[i], self._ties[i])):
            if i not in decided:
                asking.decide(i, 0)
        return tuple(move for move in decided.values() if move is not None)


class _Asking:
    """The decisions of one step: priority inheritance."""

    def __init__(
        self, search: ConfigurationSearch, node: _Node, decided: dict[int, Move | None]
    ) -> None:
        self.search = search
        self.node = node
        self.decided = decided
        self.place_bits = [
            bits[place] for bits, place in zip(search.problem.place_bits, node.places, strict=True)
        ]
        self.asked = 0

    def decide(self, agent: int, avoid: int) -> bool:
        """Decide what an agent does; return whether it moves out of what is to be avoided.

        Parameters
        ----------
        agent
            Not decided yet; it is afterwards.
        avoid
            Bits of places that another agent wants it to leave; 0 where nobody queries.
        """
        self.asked += 1
        decided, bits = self.decided, self.node.bits
        options = self.search.ranked(agent, self.node.places[agent])
        if avoid:
            options = [move for move in options if move is not None]
            options.sort(key=lambda move: bool(move.end_bit & avoid))  # type: ignore[union-attr]
        for move in options:
            if move is None:
                break
            if move.rejected or any(m is not None and move.clashes(m) for m in decided.values()):
                continue
            blocking = move.forbids & bits
            if not blocking:
                decided[agent] = move
                return True
            if self.asked > _MOST_ASKED:
                continue
            before = dict(decided)
            decided[agent] = None
            if self._clear(blocking, move.forbids):
                return True
            decided.clear()
            decided.update(before)
        decided[agent] = None
        return False

    def _clear(self, blocking: int, forbidden: int) -> bool:
        """Query all agents in the way to leave; return whether they do."""
        for agent, bit in enumerate(self.place_bits):
            if not bit & blocking:
                continue
            if agent in self.decided:
                if self.decided[agent] is None:
                    return False
            elif not self.decide(agent, forbidden):
                return False
        return True


def _way(node: _Node) -> tuple[tuple[Move, ...], ...]:
    steps = []
    here: _Node | None = node
    while here is not None and here.parent is not None:
        steps.append(here.moves)
        here = here.parent
    return tuple(reversed(steps))
