"""MAPF-LNS: large neighbourhood search on the schedule of several agents.

Li et al., "Anytime multi-agent path finding via large neighborhood search" (2021): a few agents are
removed from the schedule and replanned one after another (prioritised planning), each on its best
space-time path around all others. The result is kept where it is no worse.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from skillplan_swarmitfix.multiagent.joint_search import Objective
from skillplan_swarmitfix.multiagent.multi_agent import Move, MultiAgentProblem

Path = list[Move | None]
"""An agent's move in every step; None where it waits."""
Key = tuple[float, float, float]

# Weight of the second objective, which breaks ties, in the unit of the first.
_TIE = 1e-4
_NOISE = 1e-7
# Steps beyond the present makespan that a path may take where costs are minimised.
_SLACK = 2
_MOST_REMOVED = 4


class ScheduleImprovement:
    """Improves a schedule in rounds.

    Parameters
    ----------
    problem
        Agents, places and moves; none of the moves may be rejected depending on other agents.
    objective
        The objective; the other one breaks ties.
    rng
        Chooses the agents to replan.
    stop
        Polled before every round.

    Raises
    ------
    ValueError
        If back ends reject a move depending on where others stand.
    """

    def __init__(
        self,
        problem: MultiAgentProblem,
        objective: Objective,
        rng: random.Random,
        stop: Callable[[], bool],
    ) -> None:
        if any(move.rejected for move in problem.all_moves()):
            raise ValueError(
                "A space-time path has no moves that are rejected depending on where others stand."
            )
        self.problem = problem
        self.objective = objective
        self.rng = rng
        self.stop = stop
        self.rounds = 0
        noise = np.random.default_rng(rng.getrandbits(32))
        self._planners = [
            _SpaceTimePlanner(problem, agent, objective, noise)
            for agent in range(len(problem.agents))
        ]
        self._floor = self._least_key()

    def run(self, steps: Sequence[Sequence[Move]], rounds: int) -> list[tuple[Move, ...]]:
        """Return the moves of every step of a schedule that is no worse.

        Parameters
        ----------
        steps
            A schedule: moves that do not clash, by step.
        rounds
            How often to remove and replan agents, >= 0.
        """
        agents = range(len(self.problem.agents))
        paths: list[Path] = [[None] * len(steps) for _ in agents]
        for t, step in enumerate(steps):
            for move in step:
                paths[move.agent][t] = move
        key = self._key(paths)
        for index in range(rounds):
            if key[:2] <= self._floor or self.stop():
                break
            self.rounds += 1
            makespan = self._makespan(key)
            out = [index] if index < len(agents) else self._choose(paths)
            if self.objective is Objective.MAKESPAN and index % 2:
                makespan -= 1
                out = self._with_the_late(out, paths, makespan)
            changed = self._replan(paths, out, makespan)
            if changed is not None and (new := self._key(changed)) <= key:
                paths, key = changed, new
        chosen = [[path[t] for path in paths] for t in range(self._makespan(key))]
        return [tuple(move for move in step if move is not None) for step in chosen]

    def _choose(self, paths: list[Path]) -> list[int]:
        """Return the agents to replan, those with the longest detours most often."""
        agents = list(range(len(paths)))
        count = self.rng.randint(1, min(_MOST_REMOVED, len(agents)))
        weights = [
            1 + len(path) - path.count(None) - ahead.fewest
            for path, ahead in zip(paths, self._planners, strict=True)
        ]
        out: list[int] = []
        while len(out) < count:
            (agent,) = self.rng.choices(agents, weights)
            if agent not in out:
                out.append(agent)
        return out

    def _with_the_late(self, out: list[int], paths: list[Path], makespan: int) -> list[int]:
        """Return these agents and all that still move after `makespan` steps, in any order."""
        late = [agent for agent, path in enumerate(paths) if path[makespan] is not None]
        out = list(dict.fromkeys([*late, *out]))
        self.rng.shuffle(out)
        return out

    def _replan(self, paths: list[Path], out: list[int], makespan: int) -> list[Path] | None:
        slack = _SLACK if self.objective is Objective.SWINGS else 0
        changed = [[*path[:makespan], *[None] * slack] for path in paths]
        fixed = [agent for agent in range(len(paths)) if agent not in out]
        for agent in out:
            ahead = self._planners[agent]
            path = ahead.best([(other, changed[other]) for other in fixed], makespan + slack)
            if path is None:
                return None
            changed[agent] = path
            fixed.append(agent)
        return changed

    def _key(self, paths: list[Path]) -> Key:
        cost = sum(move.cost for path in paths for move in path if move is not None)
        ends = [
            max((t + 1 for t, m in enumerate(path) if m is not None), default=0) for path in paths
        ]
        if self.objective is Objective.SWINGS:
            return cost, max(ends), sum(ends)
        return max(ends), sum(ends), cost

    def _least_key(self) -> tuple[float, float]:
        cost = sum(ahead.cheapest for ahead in self._planners)
        fewest = [ahead.fewest for ahead in self._planners]
        if self.objective is Objective.SWINGS:
            return cost, max(fewest)
        return max(fewest), sum(fewest)

    def _makespan(self, key: Key) -> int:
        return int(key[1] if self.objective is Objective.SWINGS else key[0])


class _SpaceTimePlanner:
    """The best space-time path of one agent around others whose paths are fixed.

    Dynamic programming backwards in time, over all moves of the agent at once; waiting is one more
    move from each place. The moves that another agent's move blocks are cached as a mask.
    """

    def __init__(
        self,
        problem: MultiAgentProblem,
        agent: int,
        objective: Objective,
        rng: np.random.Generator,
    ) -> None:
        self.problem = problem
        self.rng = rng
        self.start, self.goal = problem.starts[agent], problem.goals[agent]
        self.cheapest = problem.least_costs[agent][self.start]
        self.fewest = int(problem.fewest_moves[agent][self.start])
        moves: list[Move | None] = []
        starts: list[int] = []
        for place, here in enumerate(problem.moves[agent]):
            moves += [None, *here]
            starts += [place] * (1 + len(here))
        self.moves = moves
        self.starts = np.array(starts)
        self.ends = np.array(
            [p if m is None else m.end for m, p in zip(moves, starts, strict=True)]
        )
        self.firsts = np.searchsorted(self.starts, np.arange(len(problem.moves[agent]) + 1))
        self._facts = sum(map(len, problem.places))
        self._places = [bit.bit_length() - 1 for bit in problem.place_bits[agent]]
        self._forbids = _columns([0 if m is None else m.forbids for m in moves], self._facts)
        self._occupies = _columns(
            [0 if m is None else m.occupies for m in moves], len(problem.resources)
        )
        costs = np.array([0.0 if move is None else move.cost for move in moves])
        unit = float(costs[costs > 0].min(initial=1.0)) if costs.any() else 1.0
        if objective is Objective.SWINGS:
            self.costs, self.step_cost = costs / unit, _TIE
        else:
            self.costs, self.step_cost = costs / unit * _TIE, 1.0
        self._blocked: dict[tuple[int, int], NDArray[np.bool_]] = {}

    def best(self, others: list[tuple[int, Path]], steps: int) -> Path | None:
        """Return the best path that ends at the goal within some steps, or None.

        Parameters
        ----------
        others
            Pairs of another agent and its path, `steps` long.
        steps
            Length of the path, waiting at the goal included, >= 0.
        """
        blocked = self._masks(others, steps)
        costs = self.costs + self.rng.random(len(self.costs)) * _NOISE
        at_goal = self.firsts[self.goal]
        ahead = np.full(len(self._places), np.inf)
        ahead[self.goal] = 0.0
        values = np.empty((steps, len(costs)))
        stays = steps
        for t in range(steps - 1, -1, -1):
            if stays == t + 1 and not blocked[t, at_goal]:
                stays = t
            np.add(costs, ahead[self.ends], out=values[t])
            values[t][blocked[t]] = np.inf
            ahead = np.minimum.reduceat(values[t], self.firsts[:-1]) + self.step_cost
            if stays == t:
                ahead[self.goal] = 0.0
        if not np.isfinite(ahead[self.start]):
            return None
        place = self.start
        path: Path = []
        for t in range(steps):
            if place == self.goal and t >= stays:
                return [*path, *[None] * (steps - t)]
            first, last = self.firsts[place], self.firsts[place + 1]
            choice = int(first + np.argmin(values[t, first:last]))
            path.append(self.moves[choice])
            place = int(self.ends[choice])
        return path

    def _masks(self, others: list[tuple[int, Path]], steps: int) -> NDArray[np.bool_]:
        """Return which moves are blocked in every step, shape (steps, moves)."""
        blocked = np.zeros((steps, len(self.moves)), dtype=np.bool_)
        for other, path in others:
            place = self.problem.starts[other]
            for t, move in enumerate(path):
                blocked[t] |= self._blocked_by(other, place, move)
                if move is not None:
                    place = move.end
        return blocked

    def _blocked_by(self, other: int, place: int, move: Move | None) -> NDArray[np.bool_]:
        """Return which moves are blocked where another agent stands, or by a move of it."""
        bit = self.problem.place_bits[other][place]
        key = (bit, -1 if move is None else move.index)
        mask = self._blocked.get(key)
        if mask is None:
            mask = self._forbids[:, bit.bit_length() - 1]
            if move is not None:
                kept_out = _columns([move.forbids], self._facts)[0, self._places]
                needs = _columns([move.occupies], len(self.problem.resources))[0]
                mask = (
                    mask
                    | self._forbids[:, move.end_bit.bit_length() - 1]
                    | kept_out[self.starts]
                    | kept_out[self.ends]
                    | self._occupies[:, needs].any(axis=1)
                )
            self._blocked[key] = mask
        return mask


def _columns(values: Sequence[int], width: int) -> NDArray[np.bool_]:
    """Return the bits of some integers, the lowest first, shape (values, width)."""
    size = (width + 7) // 8
    raw = b"".join(value.to_bytes(size, "little") for value in values)
    table = np.frombuffer(raw, dtype=np.uint8).reshape(len(values), size)
    return np.unpackbits(table, axis=1, count=width, bitorder="little").astype(np.bool_)
