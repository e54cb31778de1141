"""Plan the assembly of a product: base, steps, sub-assemblies and stuck parts."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from skillplan_cad.planning.free_paths import FreePath, Move, find_free_path, get_inset_m
from skillplan_cad.planning.motion_space import Met, Surroundings
from skillplan_cad.planning.precedence import (
    Precedence,
    derive_precedence,
    encode_set,
    find_touching,
    list_members,
)
from skillplan_cad.planning.sequence import Removal, Sequencer
from skillplan_cad.planning.shrunk_meshes import MeshTrees
from skillplan_cad.planning.stability import Stability
from skillplan_cad.planning.watch import Watch
from skillplan_cad.product import Part, Product, Vector
from skillplan_cad.relation import Relation


@dataclass(frozen=True, slots=True)
class Split:
    """A set of parts that leaves the rest as one.

    Parameters
    ----------
    moved, left
        The two sets, as bits.
    direction
        Number of the direction of the move.
    """

    moved: int
    left: int
    direction: int


@dataclass(frozen=True, slots=True)
class Lock:
    """Proof that a set of parts has no straight move.

    Parameters
    ----------
    rounds
        For each direction a closed walk through the set in which each part is blocked by the next,
        so a move of any part moves all.
    """

    parts: int
    rounds: tuple[tuple[int, ...], ...]


@dataclass(frozen=True, slots=True)
class Groups:
    """Sub-assemblies and locks among the parts that do not come off one at a time.

    Parameters
    ----------
    core
        Parts that remain after every part that can leave alone has left, as bits; 0 if none.
    splits
        Moves of sub-assemblies that break up the core.
    locks
        Sets without a straight move, each with its proof.
    """

    core: int
    splits: tuple[Split, ...]
    locks: tuple[Lock, ...]

    @property
    def subassemblies(self) -> tuple[int, ...]:
        """Sets of two or more parts that must be assembled separately."""
        return tuple(split.moved for split in self.splits if split.moved & (split.moved - 1))


def find_groups(relation: Relation, precedence: Precedence, fixed: int = 0) -> Groups:
    """Return the sub-assemblies and the locked sets of a product.

    Parameters
    ----------
    precedence
        Alternatives of the relation, including those by paths.
    fixed
        The base, which never moves, as a bit.
    """
    core = precedence.find_core(fixed=fixed)
    blocked = _collect_blockers(relation, precedence)
    splits: list[Split] = []
    locks: list[Lock] = []
    waiting = [core]
    while waiting:
        parts = precedence.find_core(waiting.pop(), fixed)
        if not parts & (parts - 1):
            continue
        split = _find_smallest_split(parts, blocked, fixed)
        if split is None:
            locks.append(Lock(parts, _find_rounds(parts, blocked)))
        else:
            splits.append(split)
            waiting += [split.left, split.moved]
    alone = not core & (core - 1)
    return Groups(0 if alone else core, tuple(splits), tuple(locks))


def _collect_blockers(relation: Relation, precedence: Precedence) -> list[list[int]]:
    """Return the set of blockers for each direction and part."""
    blockers_of = [[0] * len(relation.parts) for _ in relation.directions]
    for part, alternatives in enumerate(precedence.alternatives):
        for alternative in alternatives:
            for direction in alternative.directions:
                if direction < len(blockers_of):  # numbers above are paths
                    blockers_of[direction][part] = alternative.blockers
    return blockers_of


def find_split(relation: Relation, precedence: Precedence, parts: int, fixed: int) -> Split | None:
    """Return the smallest part set that can leave the others as one, or None.

    Parameters
    ----------
    relation, precedence
        As for `find_groups`.
    parts
        The set to split, as bits.
    fixed
        Parts that do not move, as bits.
    """
    return _find_smallest_split(parts, _collect_blockers(relation, precedence), fixed)


def _find_smallest_split(parts: int, blocked: list[list[int]], fixed: int) -> Split | None:
    """Return the smallest set that can leave the rest; ties go to the first direction."""
    best: Split | None = None
    for direction, blockers in enumerate(blocked):
        for part in list_members(parts):
            moved = _find_closure(part, parts, blockers)
            if moved == parts or moved & fixed:
                continue
            if best is None or moved.bit_count() < best.moved.bit_count():
                best = Split(moved, parts & ~moved, direction)
    return best


def _find_closure(part: int, parts: int, blockers: list[int]) -> int:
    """Return all parts that must move together with a part."""
    moved = frontier = 1 << part
    while frontier:
        met = 0
        for member in list_members(frontier):
            met |= blockers[member]
        frontier = met & parts & ~moved
        moved |= frontier
    return moved


def _find_rounds(parts: int, blocked: list[list[int]]) -> tuple[tuple[int, ...], ...]:
    """Return a closed walk through the whole set for each direction."""
    return tuple(_find_round(parts, blockers) for blockers in blocked)


def _find_round(parts: int, blockers: list[int]) -> tuple[int, ...]:
    """Return a closed walk through all parts of a strongly connected set."""
    start = next(list_members(parts))
    walk, here = [start], start
    missing = parts & ~(1 << start)
    while missing:
        way = _find_walk(here, missing, parts, blockers)
        walk += way
        here = way[-1]
        for part in way:
            missing &= ~(1 << part)
    if here != start:
        walk += _find_walk(here, 1 << start, parts, blockers)[:-1]
    return tuple(walk)


def _find_walk(start: int, targets: int, parts: int, blockers: list[int]) -> list[int]:
    """Return the shortest walk from a part to any target, without the start."""
    came: dict[int, int] = {start: start}
    queue = [start]
    for part in queue:
        for by in list_members(blockers[part] & parts):
            if by in came:
                continue
            came[by] = part
            if targets >> by & 1:
                walk = [by]
                while came[walk[-1]] != start:
                    walk.append(came[walk[-1]])
                return walk[::-1]
            queue.append(by)
    raise ValueError("the set is not strongly connected")


def list_names(parts: int, precedence: Precedence) -> tuple[str, ...]:
    """Return the names of the parts in a set, in order."""
    return tuple(precedence.names[part] for part in list_members(parts))


DRIVER, GRIPPER = "screwdriver", "gripper"
_MOST_FOR_ALL_FORCES = 60
_ALMOST = 0.9
# Limits of the work of path searches: of all together, at least and by part; and of one part, first
# with little of it and then in full.
_EFFORT, _EFFORT_EACH = 6_000.0, 600.0
_ROUNDS = (600.0, 1_200.0)


@dataclass(frozen=True, slots=True)
class Step:
    """A step of the assembly.

    Parameters
    ----------
    parts
        Names of the parts that come: one part, or a sub-assembly built before.
    onto
        Name of the base they are added to.
    along
        Unit vector of the final move, in the product's frame.
    path
        Moves of the removal if no straight move works; empty otherwise.
    up
        Vector that points up during the step.
    tool
        Name of the tool that brings the parts.
    turn
        True if the product is turned over before the step.
    held
        Names of parts that are unstable afterwards and must be held.
    tips
        True if the product would tip over.
    connected
        True if the product was in one piece before the step.
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
    """A part without a known way out.

    Parameters
    ----------
    among
        Names of the parts that were present.
    search
        Result of the path search, with the parts in the way.
    """

    part: str
    among: tuple[str, ...]
    search: FreePath


@dataclass(frozen=True, slots=True)
class AssemblyPlan:
    """A plan of how to assemble a product.

    Parameters
    ----------
    base, why_base
        The part that all others are added to, and the reason for the choice.
    steps
        Steps in order of assembly; a sub-assembly's own steps come first.
    subassemblies
        Sets of parts that are assembled separately, each with its base first.
    locks
        Sets without a straight move, with proof.
    cost
        Cost of the order [-].
    cheapest
        True if the order is proved optimal.
    withdrawn
        Stuck parts that are left out, because the others then come together.
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
    withdrawn: tuple[str, ...] = ()

    @property
    def complete(self) -> bool:
        """True if all parts are assembled."""
        return not self.stuck


@dataclass(frozen=True, slots=True)
class _Search:
    """The last search of a way out for a part, the parts present then, and its limit of work."""

    path: FreePath
    present: int
    effort: float


@dataclass
class _Work:
    """Intermediate results of planning."""

    precedence: Precedence
    directions: list[Vector]
    paths: dict[int, FreePath] = field(default_factory=dict)
    removed: list[tuple[int, Removal, int, int]] = field(default_factory=list)
    searched: dict[int, _Search] = field(default_factory=dict)
    subassemblies: list[tuple[int, int]] = field(default_factory=list)
    stuck: dict[int, Stuck] = field(default_factory=dict)
    withdrawn: list[int] = field(default_factory=list)
    cost: float = 0.0
    cheapest: bool = True


class Planner:
    """Plans the assembly of a product.

    Parameters
    ----------
    tolerance_m
        Distance by which meshes are shrunk for path searches [m].
    budget
        Iteration limit of a path search.
    effort
        Limit of the work of all path searches, as in `find_free_path`; None for more with more
        parts.
    watch
        Progress reports, and requests to stop.
    """

    def __init__(
        self,
        product: Product,
        relation: Relation,
        tolerance_m: float = 1e-4,
        budget: int = 5_000,
        effort: float | None = None,
        watch: Watch | None = None,
    ) -> None:
        self._product, self._relation = product, relation
        self._tolerance_m, self._budget = tolerance_m, budget
        self._effort = max(_EFFORT, _EFFORT_EACH * len(product)) if effort is None else effort
        self._watch = watch or Watch()
        self._trees = MeshTrees(get_inset_m(tolerance_m))
        self._touches = find_touching(relation)
        self._stability = Stability(product, relation)
        self._tools = _tools(relation)

    def plan(
        self, base: str | None = None, up: Vector = (0.0, 0.0, 1.0), grounded: Collection[str] = ()
    ) -> AssemblyPlan:
        """Plan the assembly onto a base.

        Parameters
        ----------
        base
            Name of the base; None to choose it.
        up
            Vector that points up in the finished product.
        grounded
            Names of the parts that stand on the table by themselves. One of them is the base if it
            has almost the mass and the contacts of the best part.
        """
        precedence = derive_precedence(self._relation)
        number, why = self._choose_base(precedence, base, grounded)
        locks = find_groups(self._relation, precedence, 1 << number).locks
        work = _Work(precedence, list(self._relation.directions))
        self._take_apart(work, self._part_overlapping(work, number), number, up)
        kept = precedence.everything & ~encode_set(work.withdrawn)
        names = self._relation.names
        return AssemblyPlan(
            names[number],
            why,
            tuple(
                self._build_step(work, moved & kept, removal, present & kept, base)
                for moved, removal, present, base in reversed(work.removed)
            ),
            tuple(
                (names[inner], *list_names(moved & kept & ~(1 << inner), precedence))
                for inner, moved in reversed(work.subassemblies)
                if (moved & kept).bit_count() > 1
            ),
            tuple(work.stuck[part] for part in sorted(work.stuck)),
            locks,
            work.precedence,
            round(work.cost, 6),
            work.cheapest,
            tuple(names[part] for part in work.withdrawn),
        )

    def _choose_base(
        self, precedence: Precedence, requested: str | None, grounded: Collection[str]
    ) -> tuple[int, str]:
        """Return the base and the reason for it."""
        if requested is not None:
            return self._product.index(requested), "It was asked for."
        masses = np.array([part.mass_kg for part in self._product])
        others = max(1, len(masses) - 1)
        shares = masses / masses.sum()
        touched = np.array([touched_parts.bit_count() for touched_parts in self._touches]) / others
        names, kinds = self._relation.names, [part.kind for part in self._relation.parts]
        scores = shares + touched
        order = sorted(range(len(masses)), key=lambda n: (kinds[n] != "part", -scores[n], n))
        free = [n for n in order if precedence.find_core(fixed=1 << n) == 1 << n]
        first = (free or order)[0]
        alike = [n for n in free or order if scores[n] >= _ALMOST * scores[first]]
        best = next((n for n in alike if names[n] in grounded), first)
        why = (
            f"It has {shares[best]:.0%} of the mass and touches "
            f"{self._touches[best].bit_count()} of the {others} other parts"
        )
        why += ", which all come off it one at a time." if free else "."
        return best, why

    def _take_apart(self, work: _Work, present: int, base: int, up: Vector) -> None:
        """Remove parts until only the base remains; record the stuck parts."""
        while present != 1 << base:
            if self._watch.must_stop():
                work.cheapest = False
            sequencer = Sequencer(
                work.precedence, tuple(work.directions), self._touches, self._stability, self._tools
            )
            sequence = sequencer.sequence(present, base, up)
            for removal in sequence.removals:
                work.removed.append((1 << removal.part, removal, present, base))
                present &= ~(1 << removal.part)
                up = removal.up
            work.cost += sequence.cost
            work.cheapest = work.cheapest and sequence.cheapest
            if present == 1 << base:
                return
            split = find_split(self._relation, work.precedence, present, 1 << base)
            if split is not None:
                self._take_off(work, split.moved, split.direction, present, base, up)
                present = split.left
            elif not self._find_path(work, present, base):
                self._note_stuck(work, present & ~(1 << base), present)
                present &= ~(1 << self._withdraw(work, present, base))

    def _take_off(
        self, work: _Work, moved: int, direction: int, present: int, base: int, up: Vector
    ) -> None:
        """Remove a sub-assembly as one, then disassemble it."""
        vector = work.directions[direction]
        above = up if float(np.dot(up, vector)) > -1e-3 else vector
        first = next(list_members(moved))
        single = Removal(first, direction, above, GRIPPER, above != up, True, False, True)
        work.removed.append((moved, single, present, base))
        inner = self._choose_inner_base(work.precedence, moved)
        work.subassemblies.append((inner, moved))
        self._take_apart(work, moved, inner, above)

    def _choose_inner_base(self, precedence: Precedence, parts: int) -> int:
        """Return the heaviest part, or the next if the others come apart better without it."""
        masses = {n: self._product.parts[n].mass_kg for n in list_members(parts)}
        first, second = sorted(masses, key=lambda n: (-masses[n], n))[:2]
        locked = precedence.find_core(parts, 1 << first)
        if locked == 1 << first:
            return first
        least = min(
            precedence.find_core(parts & ~(1 << n), 1 << first).bit_count()
            for n in list_members(locked & ~(1 << first))
        )
        without = precedence.find_core(parts & ~(1 << first), 1 << second).bit_count()
        return second if without < least else first

    def _part_overlapping(self, work: _Work, base: int) -> int:
        """Leave out parts until no others overlap, as no motion parts these; return the rest.

        Of parts that do not come off one at a time, the one with most overlaps for each part that
        it bears or holds is left out first; ties go to the smallest.
        """
        present, parts = work.precedence.everything, self._product.parts
        while True:
            core = work.precedence.find_core(present, 1 << base)
            overlaps = {n: self._overlaps[n] & core for n in list_members(core & ~(1 << base))}
            rates = {
                (
                    own.bit_count() / (1 + (self._touches[n] & present & ~own).bit_count()),
                    -parts[n].volume_m3,
                    n,
                )
                for n, own in overlaps.items()
                if own
            }
            if not rates:
                return present
            *_, part = max(rates)
            met = self._list_overlaps(part, overlaps[part])
            work.searched[part] = _Search(FreePath("closed", (), 0, False, met), present, 0.0)
            self._note_stuck(work, 1 << part, present)
            work.withdrawn.append(part)
            present &= ~(1 << part)

    @cached_property
    def _overlaps(self) -> tuple[int, ...]:
        """The set of parts that overlap each part, although all are shrunk."""
        overlaps = [0] * len(self._product)
        for contact in self._relation.contacts:
            if contact.interferes:
                first, second = (self._relation.index(name) for name in contact.parts)
                if self._list_overlaps(first, 1 << second):
                    overlaps[first] |= 1 << second
                    overlaps[second] |= 1 << first
        return tuple(overlaps)

    def _list_overlaps(self, part: int, others: int) -> tuple[Met, ...]:
        """Return the parts of a set that overlap a part, although all are shrunk."""
        trees = [self._trees.get(self._product.parts[n]) for n in (part, *list_members(others))]
        return Surroundings(trees[:1], trees[1:]).list_overlaps()

    def _find_path(self, work: _Work, present: int, base: int) -> bool:
        """Search a path for one of the remaining parts, the smallest first, with little work."""
        parts = self._product.parts
        order = sorted(list_members(present & ~(1 << base)), key=lambda n: (parts[n].volume_m3, n))
        return any(
            self._search_part(work, part, present, effort) for effort in _ROUNDS for part in order
        )

    def _search_part(self, work: _Work, part: int, present: int, effort: float) -> bool:
        """Search a path for a part; return True if there is one, which is kept."""
        if not self._needs_search(work, part, present, effort):
            return False
        parts = self._product.parts
        fastener = self._relation.fastener(parts[part].name)
        gripped = encode_set(
            [self._product.index(name) for name in (fastener.threaded_in if fastener else ())]
        )
        standing = [parts[n] for n in list_members(present & ~(1 << part) & ~gripped)]
        path = self._search_path(parts[part], standing, effort)
        if path.outcome != "no effort left" or part not in work.searched:
            work.searched[part] = _Search(path, present, effort)
        if path.outcome != "free":
            return False
        number = len(work.directions)
        offset = np.asarray(path.moves[-1].offset_m)
        length = float(np.linalg.norm(offset))
        along = offset / length if length else np.array([0.0, 0.0, 1.0])
        work.directions.append((float(along[0]), float(along[1]), float(along[2])))
        work.paths[number] = path
        absent = work.precedence.everything & ~present
        work.precedence = work.precedence.with_path(part, number, absent)
        return True

    def _search_path(self, part: Part, standing: Sequence[Part], effort: float) -> FreePath:
        """Search a path with at most the effort that is left."""
        if self._effort <= 0:
            return FreePath("no effort left", (), 0, False, ())
        if self._watch.must_stop():
            return FreePath("not searched", (), 0, False, ())
        effort = min(effort, self._effort)
        with self._watch.examine(f"planning: a way out for {part.name}"):
            path = find_free_path(
                [part], standing, self._tolerance_m, self._budget, True, effort, self._trees
            )
        self._effort -= path.effort
        return path

    def _needs_search(self, work: _Work, part: int, present: int, effort: float) -> bool:
        """Return whether a search can end otherwise than the last one of the part."""
        last = work.searched.get(part)
        if last is None:
            return True
        path = last.path
        met = encode_set([self._relation.index(obstacle.part) for obstacle in path.in_the_way])
        if last.present & ~present & met:
            return True
        return path.outcome == "budget spent" and last.effort <= path.effort < effort

    def _note_stuck(self, work: _Work, stuck: int, present: int) -> None:
        names = work.precedence.names
        for part in list_members(stuck):
            among = list_names(present & ~(1 << part), work.precedence)
            work.stuck.setdefault(part, Stuck(names[part], among, work.searched[part].path))

    def _withdraw(self, work: _Work, present: int, base: int) -> int:
        """Leave out the part without which most others come off; ties go to the smallest."""
        gains = {
            part: -work.precedence.find_core(present & ~(1 << part), 1 << base).bit_count()
            for part in list_members(present & ~(1 << base))
        }
        parts = self._product.parts
        part = max(gains, key=lambda n: (gains[n], -parts[n].volume_m3, n))
        work.withdrawn.append(part)
        return part

    def _build_step(
        self, work: _Work, moved: int, removal: Removal, present: int, base: int
    ) -> Step:
        """Return the assembly step that reverses a removal."""
        held: tuple[int, ...] = () if removal.stays else (removal.part,)
        if len(self._product) <= _MOST_FOR_ALL_FORCES:
            held = self._stability.must_be_held(present, base, removal.up)
        path = work.paths.get(removal.direction)
        vector = np.asarray(work.directions[removal.direction])
        along = tuple(float(component) + 0.0 for component in -vector)
        names = work.precedence.names
        return Step(
            list_names(moved, work.precedence),
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


def add_groups(relation: Relation, plan: AssemblyPlan) -> Relation:
    """Return a relation with the sub-assemblies and stuck parts of a plan."""
    groups = [list_names(lock.parts, plan.precedence) for lock in plan.locks]
    groups += [tuple(sorted(subassembly, key=relation.index)) for subassembly in plan.subassemblies]
    stuck = tuple(sorted((stuck_part.part for stuck_part in plan.stuck), key=relation.index))
    return replace(relation, groups=tuple(dict.fromkeys(groups)), stuck=stuck)


def _tools(relation: Relation) -> Mapping[int, str]:
    """Return the tool of each screw and nut; all other parts are gripped."""
    driven = {
        fastener.part
        for fastener in relation.fasteners
        if fastener.kind in ("screw", "nut") and not fastener.held
    }
    return {relation.index(name): DRIVER for name in driven}
