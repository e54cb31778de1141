"""Test all pairs of a product for blocking, along all directions."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing

import numpy as np
from numpy.typing import NDArray

from skillplan.errors import BackEndError
from skillplan.workers.executor import Answer, Ended, Worker, pack_content
from skillplan.workers.local_processes import LocalProcesses
from skillplan_cad.blocking.pair_lattice import (
    Block,
    Outline,
    PairLattice,
    Side,
    find_first_contact,
    list_mesh_edges,
)
from skillplan_cad.blocking.ray_mesh import Floats, RayMesh, RayView
from skillplan_cad.product import Product, Vector
from skillplan_cad.relation import Blocking, Sensitive

Answers = tuple[list[Blocking], list[Sensitive]]


class BlockingTest:
    """Ray test of a product.

    Parameters
    ----------
    tolerance_m
        Smallest radius of a disc that counts as blocked [m].
    """

    def __init__(self, product: Product, tolerance_m: float) -> None:
        self._product = product
        self._tolerance_mm = tolerance_m * 1000
        self._chord_mm = product.chord_m * 1000
        bounds = np.stack([part.bounds_m for part in product.parts])
        self.middle_m = (bounds[:, 0].min(axis=0) + bounds[:, 1].max(axis=0)) / 2
        self.meshes = [RayMesh(part, self.middle_m) for part in product.parts]
        self._edges = [list_mesh_edges(part.triangles) for part in product.parts]

    def find_blockings(self, direction: Vector, number: int, opposite: int) -> Answers:
        """Return the blockings along a direction and against it.

        Parameters
        ----------
        number, opposite
            Numbers of the direction and of its opposite.
        """
        frame = build_frame(direction)
        sides = self._view_parts(frame)
        blockings: list[Blocking] = []
        doubtful: list[Sensitive] = []
        for first, second in self._iterate_overlapping(sides):
            lattice = PairLattice(sides[first], sides[second], self._chord_mm)
            for sign in (1, -1):
                block = lattice.find_block(sign, self._list_radii())
                if block is not None:
                    entries, unsure = self._build_entries(
                        (first, second), sides, sign, block, frame, (number, opposite)
                    )
                    blockings += entries
                    doubtful += unsure
        return blockings, doubtful

    def find_blocked_pairs(
        self, direction: Vector, tested: NDArray[np.bool_]
    ) -> list[tuple[int, int]]:
        """Return the pairs whose first part is blocked by the second along a direction.

        Parameters
        ----------
        tested
            Mask of the pairs to test, shape (parts, parts).
        """
        sides = self._view_parts(build_frame(direction))
        pairs = []
        for first, second in self._iterate_overlapping(sides):
            if not (tested[first, second] or tested[second, first]):
                continue
            lattice = PairLattice(sides[first], sides[second], self._chord_mm)
            for sign, pair in ((1, (first, second)), (-1, (second, first))):
                if not tested[pair]:
                    continue
                block = lattice.find_block(sign, self._list_radii())
                if block is not None and block.radius_mm > self._list_radii()[-1]:
                    pairs.append(pair)
        return pairs

    def _view_parts(self, frame: Floats) -> list[Side]:
        """Return all parts as seen along the last row of a frame."""
        views = [RayView(mesh, frame) for mesh in self.meshes]
        return [
            Side(view, Outline(mesh, view, edges), view.flat.min(axis=0), view.flat.max(axis=0))
            for mesh, view, edges in zip(self.meshes, views, self._edges, strict=True)
        ]

    def _list_radii(self) -> tuple[float, ...]:
        """Return double, whole and half the tolerance [mm]."""
        return tuple(share * self._tolerance_mm for share in (2.0, 1.0, 0.5))

    def _iterate_overlapping(self, sides: Sequence[Side]) -> Iterator[tuple[int, int]]:
        low = np.stack([side.low for side in sides])
        high = np.stack([side.high for side in sides])
        for first in range(len(sides)):
            shared = np.minimum(high, high[first]) - np.maximum(low, low[first])
            for second in np.flatnonzero((shared > self._tolerance_mm).all(axis=1)):
                if second > first:
                    yield first, int(second)

    def _build_entries(
        self,
        pair: tuple[int, int],
        sides: Sequence[Side],
        sign: int,
        block: Block,
        frame: Floats,
        numbers: tuple[int, int],
    ) -> Answers:
        """Return both entries of a block: one part moved forwards, or the other backwards."""
        number, opposite = numbers if sign > 0 else numbers[::-1]
        names = [self._product.parts[part].name for part in pair]
        double, whole, half = self._list_radii()
        pairs = ((names[0], names[1], number), (names[1], names[0], opposite))
        if block.radius_mm == half:
            return [], [
                Sensitive(*names_and_direction, False, half / 1000) for names_and_direction in pairs
            ]
        sensitive = block.radius_mm == whole
        low, high = pair if sign > 0 else pair[::-1]
        distance, there, here = find_first_contact(
            sides[low].view, sides[high].view, block.points, frame
        )
        # The lower part is met at its own contact point, the upper one at its counterpart.
        met = (there, here) if sign > 0 else (here, there)
        entries = [
            Blocking(
                *names_and_direction,
                distance / 1000,
                block.width_mm / 1000,
                self._point_m(place),
                sensitive,
            )
            for names_and_direction, place in zip(pairs, met, strict=True)
        ]
        return entries, [
            Sensitive(*names_and_direction, True, double / 1000)
            for names_and_direction in pairs
            if sensitive
        ]

    def _point_m(self, point_mm: Floats) -> Vector:
        x, y, z = (float(value) for value in point_mm / 1000 + self.middle_m)
        return x, y, z


def build_frame(direction: Vector) -> Floats:
    """Return two directions across a direction, and the direction itself, one per row."""
    along = np.asarray(direction, dtype=np.float64)
    along = along / np.linalg.norm(along)
    across = np.eye(3)[int(np.argmin(np.abs(along)))]
    across = across - (across @ along) * along
    across /= np.linalg.norm(across)
    return np.stack([across, np.cross(along, across), along])


def merge_answers(product: Product, answers: Iterable[Answers]) -> Answers:
    """Merge answers, sorted by direction, part and blocker."""
    blockings: list[Blocking] = []
    doubtful: list[Sensitive] = []
    for entries, unsure in answers:
        blockings += entries
        doubtful += unsure
    order = {part.name: number for number, part in enumerate(product.parts)}
    blockings.sort(key=lambda entry: (entry.direction, order[entry.part], order[entry.by]))
    doubtful.sort(key=lambda entry: (entry.direction, order[entry.part], order[entry.by]))
    return blockings, doubtful


_WHAT = "blocking"

Job = tuple[Vector, int, int]


def compute_answers(
    product: Product, tolerance_m: float, lines: Sequence[Job], jobs: int
) -> Iterator[Answers]:
    """Yield the blockings along each line and against it, as answers arrive.

    Parameters
    ----------
    tolerance_m
        Smallest radius of a disc that counts as blocked [m].
    lines
        Direction, its number and that of its opposite.
    jobs
        Number of processes; 1 to use this one.

    Raises
    ------
    BackEndError
        If a process dies without an answer.
    """
    if jobs == 1 or len(lines) == 1:
        test = BlockingTest(product, tolerance_m)
        for line in lines:
            yield test.find_blockings(*line)
        return
    content = pack_content((product, tolerance_m), _WHAT)
    with closing(LocalProcesses(min(jobs, len(lines)))) as executor:
        left = list(lines)
        busy: list[Worker] = []
        while left and len(busy) < executor.slots:
            worker = executor.start(_prepare_job, content, _WHAT)
            worker.take(left.pop(0))
            busy.append(worker)
        while busy:
            for ready in executor.first_ready(busy):
                answer = ready.answer()
                if isinstance(answer, Ended):
                    if not answer.started and not answer.killed:
                        raise ready.not_started()
                    raise BackEndError(f"a process that tested blocking ended by {answer.how}")
                if not isinstance(answer, Answer):
                    continue
                yield answer.content
                if left:
                    ready.take(left.pop(0))
                else:
                    busy.remove(ready)
                    ready.end()


def _prepare_job(content: tuple[Product, float]) -> Callable[[Job], Answers]:
    """Return the job of a process, which tests one line."""
    test = BlockingTest(*content)
    return lambda line: test.find_blockings(*line)
