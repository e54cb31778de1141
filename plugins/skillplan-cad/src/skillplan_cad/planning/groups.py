"""Sub-assemblies: parts that no single straight move takes apart, and what proves it.

Where no part can go off by itself, a set of parts may still go off as one: all that stand in each
other's way in a direction. In the blocking graph of that direction these are the strongly connected
ones. What is strongly connected in every direction comes apart by no straight move of any set.
"""

from __future__ import annotations

from dataclasses import dataclass

from skillplan_cad.planning.precedence import Precedence, members
from skillplan_cad.relation import Relation


@dataclass(frozen=True, slots=True)
class Split:
    """A set of parts that goes off as one.

    Parameters
    ----------
    moved, left
        The two sets, as bits.
    direction
        Number of the direction in which it goes.
    """

    moved: int
    left: int
    direction: int


@dataclass(frozen=True, slots=True)
class Lock:
    """Why a set of parts comes apart by no straight move.

    Parameters
    ----------
    parts
        The set, as bits.
    rounds
        For each direction a closed walk through all of the set, every part of it blocked by the
        next: whichever moves, all have to. In the order of the directions.
    """

    parts: int
    rounds: tuple[tuple[int, ...], ...]


@dataclass(frozen=True, slots=True)
class Groups:
    """How what does not come apart part by part comes apart.

    Parameters
    ----------
    core
        What is left once every part has gone that can by itself, as bits; 0 where nothing is.
    splits
        Moves of sub-assemblies that take it apart further.
    locks
        Sets that no straight move takes apart, each with the proof.
    """

    core: int
    splits: tuple[Split, ...]
    locks: tuple[Lock, ...]

    @property
    def subassemblies(self) -> tuple[int, ...]:
        """Sets of two or more parts that have to be put together apart from the rest."""
        return tuple(one.moved for one in self.splits if one.moved & (one.moved - 1))


def groups_of(relation: Relation, precedence: Precedence, fixed: int = 0) -> Groups:
    """Return the sub-assemblies of a product, and what of it is locked.

    Parameters
    ----------
    relation
        What blocks what.
    precedence
        The same as alternatives; what was found to get past others is left out there.
    fixed
        A part that is never moved, the base, as bits.
    """
    core = precedence.core(fixed=fixed)
    blocked = _blocked_by(relation, precedence)
    splits: list[Split] = []
    locks: list[Lock] = []
    waiting = [core]
    while waiting:
        parts = precedence.core(waiting.pop(), fixed)
        if not parts & (parts - 1):
            continue
        split = _smallest_split(parts, blocked, fixed)
        if split is None:
            locks.append(Lock(parts, _rounds(parts, blocked)))
        else:
            splits.append(split)
            waiting += [split.left, split.moved]
    alone = not core & (core - 1)
    return Groups(0 if alone else core, tuple(splits), tuple(locks))


def holds(lock: Lock, relation: Relation) -> bool:
    """Return whether a proof is one: each round is closed, through all parts, along blockings."""
    wanted = set(members(lock.parts))
    matrix = relation.matrix
    return len(lock.rounds) == len(relation.directions) and all(
        set(walk) == wanted
        and all(
            matrix[direction, part, by] for part, by in zip(walk, (*walk[1:], walk[0]), strict=True)
        )
        for direction, walk in enumerate(lock.rounds)
    )


def _blocked_by(relation: Relation, precedence: Precedence) -> list[list[int]]:
    """Return for each direction and part the set of its blockers."""
    found = [[0] * len(relation.parts) for _ in relation.directions]
    for part, alternatives in enumerate(precedence.alternatives):
        for one in alternatives:
            for direction in one.directions:
                if direction < len(found):  # those beyond are paths
                    found[direction][part] = one.blockers
    return found


def split_of(relation: Relation, precedence: Precedence, parts: int, fixed: int) -> Split | None:
    """Return the smallest set of some parts that goes off the others as one, or None.

    Parameters
    ----------
    relation, precedence
        As for `groups_of`.
    parts
        The set to take apart, as bits.
    fixed
        Parts that are not moved, as bits.
    """
    return _smallest_split(parts, _blocked_by(relation, precedence), fixed)


def _smallest_split(parts: int, blocked: list[list[int]], fixed: int) -> Split | None:
    """Return the smallest set that can go off the rest; the first direction among equals."""
    best: Split | None = None
    for direction, blockers in enumerate(blocked):
        for part in members(parts):
            moved = _closure(part, parts, blockers)
            if moved == parts or moved & fixed:
                continue
            if best is None or moved.bit_count() < best.moved.bit_count():
                best = Split(moved, parts & ~moved, direction)
    return best


def _closure(part: int, parts: int, blockers: list[int]) -> int:
    """Return all that has to move where one part moves."""
    moved = frontier = 1 << part
    while frontier:
        met = 0
        for one in members(frontier):
            met |= blockers[one]
        frontier = met & parts & ~moved
        moved |= frontier
    return moved


def _rounds(parts: int, blocked: list[list[int]]) -> tuple[tuple[int, ...], ...]:
    """Return a closed walk through all of a set for each direction."""
    return tuple(_round(parts, blockers) for blockers in blocked)


def _round(parts: int, blockers: list[int]) -> tuple[int, ...]:
    """Return a closed walk through all parts of a strongly connected set."""
    start = next(members(parts))
    walk, here = [start], start
    missing = parts & ~(1 << start)
    while missing:
        way = _way(here, missing, parts, blockers)
        walk += way
        here = way[-1]
        for part in way:
            missing &= ~(1 << part)
    if here != start:
        walk += _way(here, 1 << start, parts, blockers)[:-1]
    return tuple(walk)


def _way(start: int, wanted: int, parts: int, blockers: list[int]) -> list[int]:
    """Return the shortest way from a part to any of those wanted, without the first."""
    came: dict[int, int] = {start: start}
    queue = [start]
    for part in queue:
        for by in members(blockers[part] & parts):
            if by in came:
                continue
            came[by] = part
            if wanted >> by & 1:
                way = [by]
                while came[way[-1]] != start:
                    way.append(came[way[-1]])
                return way[::-1]
            queue.append(by)
    raise ValueError("the set is not strongly connected")


def names_of(parts: int, precedence: Precedence) -> tuple[str, ...]:
    """Return the names of the parts in a set, in order."""
    return tuple(precedence.names[part] for part in members(parts))
