"""A plan of assembly for a whole product: base, steps, sub-assemblies, and what cannot be done."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from skillplan_cad.planning.free_paths import FreePath, Move, free_path
from skillplan_cad.planning.precedence import (
    Precedence,
    as_set,
    members,
    precedence_of,
    touching,
)
from skillplan_cad.planning.sequence import Removal, Sequencer
from skillplan_cad.planning.stability import Stability
from skillplan_cad.product import Product, Vector
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


DRIVER, GRIPPER = "screwdriver", "gripper"
_MOST_FOR_ALL_FORCES = 60


@dataclass(frozen=True, slots=True)
class Step:
    """One step of putting together.

    Parameters
    ----------
    parts
        Names of what comes: one part, or a sub-assembly that was put together before.
    onto
        Name of the base of what it comes to.
    along
        Unit vector in which it comes at the end, in the product's frame.
    path
        Moves by which it goes off again, where no straight one does; empty else.
    up
        What points up then.
    tool
        That brings it.
    turn
        Whether what is together is turned over before it.
    held
        Names of parts that do not stay by themselves afterwards, and must be held.
    tips
        Whether what is together would tip over.
    connected
        Whether what was together before hangs together.
    """

    parts: tuple[str, ...]
    onto: str
    along: Vector
    path: tuple[Move, ...]
    up: Vector
    tool: str
    turn: bool
    held: tuple[str, ...]
    tips: bool
    connected: bool


@dataclass(frozen=True, slots=True)
class Stuck:
    """A part for which no way out was found.

    Parameters
    ----------
    part
        Its name.
    among
        Names of the parts that were there.
    search
        What the search for a path came to, with what is in the way.
    """

    part: str
    among: tuple[str, ...]
    search: FreePath


@dataclass(frozen=True, slots=True)
class AssemblyPlan:
    """How a product is put together.

    Parameters
    ----------
    base, why_base
        The part that everything else comes to, and why it was chosen.
    steps
        In order of assembly; a sub-assembly's own come before it comes.
    subassemblies
        Sets of parts that are put together apart, each with its base first.
    stuck
        Parts that no motion that was searched frees.
    locks
        Sets that no straight move takes apart, with the proof.
    precedence
        All alternatives, those by paths included.
    cost
        What the order costs, without unit.
    cheapest
        Whether no order costs less.
    """

    base: str
    why_base: str
    steps: tuple[Step, ...]
    subassemblies: tuple[tuple[str, ...], ...]
    stuck: tuple[Stuck, ...]
    locks: tuple[Lock, ...]
    precedence: Precedence
    cost: float
    cheapest: bool

    @property
    def complete(self) -> bool:
        """Whether all parts come together."""
        return not self.stuck

    @property
    def up(self) -> Vector:
        """What points up in most steps, in the product's frame."""
        ups = [step.up for step in self.steps]
        return max(dict.fromkeys(ups), key=ups.count, default=(0.0, 0.0, 1.0))


@dataclass
class _Work:
    """What a plan is made of, while it is."""

    precedence: Precedence
    directions: list[Vector]
    paths: dict[int, FreePath] = field(default_factory=dict)
    removed: list[tuple[int, Removal, int, int]] = field(default_factory=list)
    searched: dict[tuple[int, int], FreePath] = field(default_factory=dict)
    subassemblies: list[tuple[str, ...]] = field(default_factory=list)
    stuck: list[Stuck] = field(default_factory=list)
    cost: float = 0.0
    cheapest: bool = True


class Planner:
    """Makes plans of a product.

    Parameters
    ----------
    product, relation
        Its parts, and what blocks what.
    tolerance_m
        By which meshes are shrunk in searches for paths.
    budget
        The most iterations of one such search.
    """

    def __init__(
        self,
        product: Product,
        relation: Relation,
        tolerance_m: float = 1e-4,
        budget: int = 5_000,
    ) -> None:
        self._product, self._relation = product, relation
        self._tolerance_m, self._budget = tolerance_m, budget
        self._touches = touching(relation)
        self._stability = Stability(product, relation)
        self._tools = _tools(relation)

    def plan(
        self,
        base: str | None = None,
        up: Vector = (0.0, 0.0, 1.0),
        grounded: Collection[str] = (),
    ) -> AssemblyPlan:
        """Return the plan for a base, by name; left out, one is chosen.

        Parameters
        ----------
        base
            The part that everything comes to.
        up
            What points up in the finished product.
        grounded
            Names of the parts that stand on the table by themselves, of which the base is one if
            all others come off any of them.
        """
        precedence = precedence_of(self._relation)
        number, why = self._base(precedence, base, grounded)
        locks = groups_of(self._relation, precedence, 1 << number).locks
        work = _Work(precedence, list(self._relation.directions))
        self._take_apart(work, precedence.everything, number, up)
        steps = tuple(self._step(work, *one) for one in reversed(work.removed))
        return AssemblyPlan(
            self._relation.names[number],
            why,
            steps,
            tuple(reversed(work.subassemblies)),
            tuple(work.stuck),
            locks,
            work.precedence,
            round(work.cost, 6),
            work.cheapest,
        )

    def _base(
        self, precedence: Precedence, asked: str | None, grounded: Collection[str]
    ) -> tuple[int, str]:
        """Return the base and why it is."""
        if asked is not None:
            return self._product.index(asked), "It was asked for."
        masses = np.array([part.mass_kg for part in self._product])
        others = max(1, len(masses) - 1)
        shares = masses / masses.sum()
        touched = np.array([each.bit_count() for each in self._touches]) / others
        names = self._relation.names
        order = sorted(range(len(masses)), key=lambda n: (-(shares[n] + touched[n]), n))
        free = [n for n in order if precedence.core(fixed=1 << n) == 1 << n]
        best = next((n for n in free if names[n] in grounded), (free or order)[0])
        why = (
            f"It has {shares[best]:.0%} of the mass and touches "
            f"{self._touches[best].bit_count()} of the {others} other parts"
        )
        why += ", which all come off it one at a time." if free else "."
        return best, why

    def _take_apart(self, work: _Work, present: int, base: int, up: Vector) -> None:
        """Remove what can be from a set until the base is left, and note what cannot."""
        while present != 1 << base:
            sequencer = Sequencer(
                work.precedence,
                tuple(work.directions),
                self._touches,
                self._stability,
                self._tools,
            )
            found = sequencer.sequence(present, base, up)
            for removal in found.removals:
                work.removed.append((1 << removal.part, removal, present, base))
                present &= ~(1 << removal.part)
                up = removal.up
            work.cost += found.cost
            work.cheapest = work.cheapest and found.cheapest
            if present == 1 << base:
                return
            split = split_of(self._relation, work.precedence, present, 1 << base)
            if split is not None:
                self._take_off(work, split.moved, split.direction, present, base, up)
                present = split.left
            elif not self._find_path(work, present, base):
                self._note_stuck(work, present, base)
                return

    def _take_off(
        self, work: _Work, moved: int, direction: int, present: int, base: int, up: Vector
    ) -> None:
        """Remove a sub-assembly as one, and take it apart by itself."""
        vector = work.directions[direction]
        above = up if float(np.dot(up, vector)) > -1e-3 else vector
        first = next(members(moved))
        single = Removal(first, direction, above, GRIPPER, above != up, True, False, True)
        work.removed.append((moved, single, present, base))
        masses = {n: self._product.parts[n].mass_kg for n in members(moved)}
        inner = max(masses, key=lambda n: (masses[n], -n))
        names = names_of(moved & ~(1 << inner), work.precedence)
        work.subassemblies.append((work.precedence.names[inner], *names))
        self._take_apart(work, moved, inner, above)

    def _find_path(self, work: _Work, present: int, base: int) -> bool:
        """Look for a path for any of the parts that are left, the smallest first."""
        parts = self._product.parts
        for part in sorted(members(present & ~(1 << base)), key=lambda n: (parts[n].volume_m3, n)):
            if (part, present) in work.searched:
                continue
            fastener = self._relation.fastener(parts[part].name)
            gripped = as_set(
                [self._product.index(name) for name in (fastener.threaded_in if fastener else ())]
            )
            standing = [parts[n] for n in members(present & ~(1 << part) & ~gripped)]
            path = free_path([parts[part]], standing, self._tolerance_m, self._budget)
            work.searched[part, present] = path
            if path.outcome == "free":
                number = len(work.directions)
                offset = np.asarray(path.moves[-1].offset_m)
                length = float(np.linalg.norm(offset))
                way = offset / length if length else np.array([0.0, 0.0, 1.0])
                work.directions.append((float(way[0]), float(way[1]), float(way[2])))
                work.paths[number] = path
                absent = work.precedence.everything & ~present
                work.precedence = work.precedence.with_path(part, number, absent)
                return True
        return False

    def _note_stuck(self, work: _Work, present: int, base: int) -> None:
        names = work.precedence.names
        for part in members(present & ~(1 << base)):
            among = names_of(present & ~(1 << part), work.precedence)
            work.stuck.append(Stuck(names[part], among, work.searched[part, present]))

    def _step(self, work: _Work, moved: int, removal: Removal, present: int, base: int) -> Step:
        """Return a removal read backwards."""
        held: tuple[int, ...] = () if removal.stays else (removal.part,)
        if len(self._product) <= _MOST_FOR_ALL_FORCES:
            held = self._stability.must_be_held(present, base, removal.up)
        path = work.paths.get(removal.direction)
        vector = np.asarray(work.directions[removal.direction])
        along = tuple(float(one) + 0.0 for one in -vector)
        names = work.precedence.names
        return Step(
            names_of(moved, work.precedence),
            names[base],
            (along[0], along[1], along[2]),
            path.moves if path else (),
            removal.up,
            removal.tool,
            removal.turn,
            tuple(names[part] for part in held),
            removal.tips,
            removal.connected,
        )


def with_groups(relation: Relation, plan: AssemblyPlan) -> Relation:
    """Return a relation with the sub-assemblies and the stuck parts of a plan."""
    groups = [names_of(lock.parts, plan.precedence) for lock in plan.locks]
    groups += [tuple(sorted(one, key=relation.index)) for one in plan.subassemblies]
    stuck = tuple(sorted((one.part for one in plan.stuck), key=relation.index))
    return replace(relation, groups=tuple(dict.fromkeys(groups)), stuck=stuck)


def _tools(relation: Relation) -> Mapping[int, str]:
    """Return which parts a screwdriver brings; all others are gripped."""
    driven = {one.part for one in relation.fasteners if one.kind in ("screw", "nut")}
    return {relation.index(name): DRIVER for name in driven}
