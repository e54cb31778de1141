"""From the feed moves of a program to contours: passes, lead-in, overcut, lead-out.

A tool rarely cuts only the contour. It enters beside it, runs past its start, leaves it, and
repeats it deeper. A strand is a row of feed moves without a gap. It is walked once: whenever it
returns to a point where it has been, the moves since then are a loop. Loops that coincide are
passes over one contour, and the moves outside loops lead to it and away from it.
"""

from __future__ import annotations

import bisect
import itertools
import math
import operator
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from skillplan_swarmitfix.trajectory.path import JOIN_M, Progress, TrajectoryPath, millimetres
from skillplan_swarmitfix.trajectory.path_chain import PointIndex
from skillplan_swarmitfix.trajectory.path_elements import (
    Arc,
    Line,
    Point2,
    circle_of,
    find_point,
    measure_m,
)

MOST_LEAD = 0.5
"""Moves outside loops are leads if they are no longer than this share of the loops."""

_SAME_CURVE_M = 3e-5
_MOST_LEADS = 3
"""A lead that is in line with an edge is looked for in so many moves at either end."""
_PARALLEL = 1e-6
_GRAIN_M = 1e-3
_LEAST_LOBE = 0.25
_SAMPLES = 24
# Samples must not fall on the points of a regular path.
_UNEVEN = (math.sqrt(5) - 1) / 2


@dataclass(frozen=True, slots=True)
class Feed:
    """A feed move in plan.

    Parameters
    ----------
    start
        Its start [m].
    element
        Its line or arc.
    place
        The line of the program.
    heights_m
        Z at its start and at its end; None if the program has not given it [m].
    """

    start: Point2
    element: Line | Arc
    place: str
    heights_m: tuple[float | None, float | None] = (None, None)

    @property
    def end(self) -> Point2:
        """Its end [m]."""
        return self.element.end

    @property
    def length_m(self) -> float:
        """Its length in plan [m]."""
        return measure_m(self.start, self.element)

    @property
    def lowest_m(self) -> float | None:
        """The lower one of its heights [m]."""
        known = [height for height in self.heights_m if height is not None]
        return min(known, default=None)


class Curve:
    """Feed moves end to end, by the length along them."""

    def __init__(self, feeds: Sequence[Feed]) -> None:
        self.feeds = tuple(feeds)
        self.travelled_m = list(
            itertools.accumulate((feed.length_m for feed in feeds), initial=0.0)
        )

    @property
    def length_m(self) -> float:
        """Length of all moves [m]."""
        return self.travelled_m[-1]

    @property
    def is_closed(self) -> bool:
        """Return whether it ends at its start."""
        return math.dist(self.feeds[0].start, self.feeds[-1].end) <= JOIN_M

    def at(self, distance_m: float) -> Point2:
        """Return the point at a distance along it, of a closed one also beyond its end [m]."""
        if self.is_closed:
            distance_m %= self.length_m
        i = bisect.bisect_right(self.travelled_m, distance_m) - 1
        i = min(max(i, 0), len(self.feeds) - 1)
        begin, end = self.travelled_m[i : i + 2]
        share = min(1.0, max(0.0, (distance_m - begin) / (end - begin)))
        return find_point(self.feeds[i].start, self.feeds[i].element, share)

    def locate(self, point: Point2) -> float | None:
        """Return the distance along it at which a point lies [m]; None if it lies beside it."""
        for feed, begin_m in zip(self.feeds, self.travelled_m, strict=False):
            share = _share_of(feed, point)
            if math.dist(find_point(feed.start, feed.element, share), point) <= _SAME_CURVE_M:
                return begin_m + share * feed.length_m
        return None

    def is_like(self, other: Curve) -> bool:
        """Return whether another curve is the same, in either sense, from any start if closed."""
        near_m = _SAME_CURVE_M * (1 + math.sqrt(len(self.feeds)))
        if abs(self.length_m - other.length_m) > near_m or self.is_closed != other.is_closed:
            return False
        begin_m = 0.0
        if self.is_closed:
            located_m = self.locate(other.feeds[0].start)
            if located_m is None:
                return False
            begin_m = located_m
        shares = [(i + _UNEVEN) / _SAMPLES for i in range(_SAMPLES)]
        return any(
            all(
                math.dist(
                    self.at(origin_m + sense * share * self.length_m),
                    other.at(share * other.length_m),
                )
                <= near_m
                for share in shares
            )
            for sense, origin_m in ((1, begin_m), (-1, begin_m or self.length_m))
        )

    @property
    def is_retraced(self) -> bool:
        """Return whether its second half leads back along its first."""
        return all(
            math.dist(self.at(share * self.length_m), self.at((1 - share) * self.length_m))
            <= _SAME_CURVE_M
            for share in ((i + _UNEVEN) / (2 * _SAMPLES) for i in range(_SAMPLES))
        )

    def first_half(self) -> Curve:
        """Return the moves up to the middle, of a curve that is retraced."""
        middle = bisect.bisect_left(self.travelled_m, self.length_m / 2 - _SAME_CURVE_M)
        return Curve(self.feeds[: max(1, middle)])

    def followed_m(self, feeds: Sequence[Feed]) -> float:
        """Return the length for which moves from its start follow it [m]."""
        travelled_m = 0.0
        for feed in feeds:
            length_m = feed.length_m
            if not all(
                math.dist(
                    self.at(travelled_m + share * length_m),
                    find_point(feed.start, feed.element, share),
                )
                <= _SAME_CURVE_M
                for share in (1 / 3, 2 / 3, 1.0)
            ):
                break
            travelled_m += length_m
        return travelled_m


def _share_of(feed: Feed, point: Point2) -> float:
    """Return the share of a move's length at the point of it that is nearest to a point."""
    if isinstance(feed.element, Arc):
        circle = circle_of(feed.start, feed.element)
        angle = math.atan2(point[1] - circle.centre[1], point[0] - circle.centre[0])
        turned = (angle - circle.start_rad) * math.copysign(1.0, circle.sweep_rad) % math.tau
        # Past its end, whichever end is nearer.
        beyond = turned - abs(circle.sweep_rad)
        if beyond > 0:
            return 1.0 if beyond < math.tau - turned else 0.0
        return turned / abs(circle.sweep_rad)
    (ax, ay), (bx, by) = feed.start, feed.end
    along = (point[0] - ax) * (bx - ax) + (point[1] - ay) * (by - ay)
    return min(1.0, max(0.0, along / ((bx - ax) ** 2 + (by - ay) ** 2)))


@dataclass(frozen=True)
class _Loop:
    """Moves that lead back to their start."""

    curve: Curve
    moves: tuple[int, ...]
    node: int


@dataclass(frozen=True)
class Pass:
    """One run along a contour: Z at its start and its end, if the program gives them [m]."""

    from_m: float | None
    to_m: float | None

    @property
    def is_ramp(self) -> bool:
        """Return whether it goes down."""
        return (
            self.from_m is not None and self.to_m is not None and self.from_m - self.to_m > JOIN_M
        )


@dataclass(frozen=True)
class CutContour:
    """A contour, the passes over it, and the moves that lead to it and away.

    Parameters
    ----------
    curve
        Its moves, of the pass that was made first.
    passes
        All runs along it, in order.
    lead_in_m, overcut_m, lead_out_m
        Lengths of the moves before it, past its start, and after it [m].
    retraced_m
        Length of moves out and back along one line, which are left out [m].
    """

    curve: Curve
    passes: tuple[Pass, ...]
    lead_in_m: float = 0.0
    overcut_m: float = 0.0
    lead_out_m: float = 0.0
    retraced_m: float = 0.0

    def path(self) -> TrajectoryPath:
        """Return it as a trajectory, with notes about everything that was left out."""
        feeds = self.curve.feeds
        path = TrajectoryPath.ended(
            feeds[0].start, [feed.element for feed in feeds], [feed.place for feed in feeds]
        )
        return replace(path, notes=tuple(self._notes()))

    def _notes(self) -> list[str]:
        notes = []
        leads = {"lead-in": self.lead_in_m, "overcut": self.overcut_m, "lead-out": self.lead_out_m}
        parts = [f"{name} {millimetres(m)}" for name, m in leads.items() if m > JOIN_M]
        if parts:
            whole_m = self.curve.length_m + sum(leads.values())
            notes.append(f"left out: {', '.join(parts)} mm; {millimetres(whole_m)} mm with them")
        if self.retraced_m > JOIN_M:
            notes.append(f"left out: {millimetres(self.retraced_m)} mm out and back along one line")
        if len(self.passes) > 1:
            notes.append(self._pass_note())
        return notes

    def _pass_note(self) -> str:
        ramps = [run for run in self.passes if run.is_ramp]
        level = [run for run in self.passes if not run.is_ramp]
        heights = [millimetres(run.to_m) for run in level if run.to_m is not None]
        total_m = len(self.passes) * self.curve.length_m
        clauses = []
        if len(level) > 1:
            at = f" at Z {', '.join(dict.fromkeys(heights))} mm" if heights else ""
            clauses.append(f"{len(level)} passes{at} are one contour")
        if ramps:
            high_m = max(run.from_m for run in ramps if run.from_m is not None)
            low_m = min(run.to_m for run in ramps if run.to_m is not None)
            clauses.append(
                f"left out: {len(ramps)} {'turn' if self.curve.is_closed else 'run'}"
                f"{'s' if len(ramps) > 1 else ''} down from Z {millimetres(high_m)} to "
                f"{millimetres(low_m)} mm"
            )
        return f"{'; '.join(clauses)}; {millimetres(total_m)} mm in all"


def find_contours(feeds: Sequence[Feed], progress: Progress) -> list[CutContour]:
    """Return the contours that feed moves cut, in their order.

    Parameters
    ----------
    feeds
        In order; each one longer than `SAME_POINT_M`. A move that starts elsewhere than the one
        before it ended, by more than `JOIN_M`, starts a strand.
    """
    strands: list[list[Feed]] = []
    for feed in feeds:
        if strands and math.dist(strands[-1][-1].end, feed.start) <= JOIN_M:
            strands[-1].append(feed)
        else:
            strands.append([feed])
    cuts: list[CutContour] = []
    alike: dict[tuple[int, ...], list[int]] = {}
    for number, strand in enumerate(strands):
        progress.report(number, len(strands), "cut")
        for cut in _split(_with_leads_cut_off(strand)):
            _merge(cuts, alike, cut)
    return cuts


def _merge(
    cuts: list[CutContour], alike: dict[tuple[int, ...], list[int]], cut: CutContour
) -> None:
    """Add a contour, or its passes to an equal contour."""
    keys = _keys(cut.curve)
    for i in dict.fromkeys(i for key in keys for i in alike.get(key, ())):
        if cuts[i].curve.is_like(cut.curve):
            cuts[i] = replace(cuts[i], passes=cuts[i].passes + cut.passes)
            return
    alike.setdefault(keys[0], []).append(len(cuts))
    cuts.append(cut)


def _keys(curve: Curve) -> list[tuple[int, ...]]:
    """Return keys of the curves that may be like one, its own first.

    They hold the length and the centroid, which do not depend on how a curve is written.
    """
    x_m = y_m = 0.0
    for feed in curve.feeds:
        length_m = feed.length_m
        x, y = _centroid(feed)
        x_m += length_m * x / curve.length_m
        y_m += length_m * y / curve.length_m
    own = tuple(math.floor(measure / _GRAIN_M) for measure in (curve.length_m, x_m, y_m))
    steps = itertools.product((0, 1, -1), repeat=3)
    return [tuple(map(operator.add, own, step)) for step in steps]


def _centroid(feed: Feed) -> Point2:
    if isinstance(feed.element, Line):
        return find_point(feed.start, feed.element, 0.5)
    circle = circle_of(feed.start, feed.element)
    half = abs(circle.sweep_rad) / 2
    x, y = circle.at(0.5)
    share = math.sin(half) / half
    return (
        circle.centre[0] + share * (x - circle.centre[0]),
        circle.centre[1] + share * (y - circle.centre[1]),
    )


def _walk(strand: Sequence[Feed]) -> tuple[list[_Loop], list[int], list[int]]:
    """Return the loops of a strand, the moves outside loops, and the node before each of these."""
    index = PointIndex()
    loops: list[_Loop] = []
    nodes, moves = [index.at(strand[0].start)], list[int]()
    position = {nodes[0]: 0}
    for i, feed in enumerate(strand):
        node = index.at(feed.end)
        moves.append(i)
        begin = position.get(node)
        if begin is None:
            position[node] = len(nodes)
            nodes.append(node)
            continue
        cycle = moves[begin:]
        loops.append(_Loop(Curve([strand[k] for k in cycle]), tuple(cycle), node))
        for gone in nodes[begin + 1 :]:
            del position[gone]
        del nodes[begin + 1 :], moves[begin:]
    return loops, moves, nodes


def _with_leads_cut_off(strand: Sequence[Feed]) -> Sequence[Feed]:
    """Return a strand in which a lead that runs on as an edge of the contour is a move of its own.

    A tool that enters in line with the first edge makes one move of both, and then the contour ends
    within that move. It may leave in line with the last edge, too. A strand is left as it is unless
    that makes it one contour, with leads that are short enough.
    """
    before_m = sum(strand[i].length_m for i in _walk(strand)[1])
    if len(strand) < 3 or before_m <= JOIN_M:
        return strand
    cut = next(_cut_strands(strand), None)
    if cut is None:
        return strand
    loops, outside, _ = _walk(cut)
    contours = _grouped([loop for loop in loops if not loop.curve.is_retraced])
    leads_m = sum(cut[i].length_m for i in outside)
    is_one = len(contours) == 1 and leads_m <= MOST_LEAD * contours[0][0].curve.length_m
    return cut if is_one and leads_m < before_m - JOIN_M else strand


def _cut_strands(strand: Sequence[Feed]) -> Iterator[list[Feed]]:
    """Yield a strand with one of its first or last moves cut where the others meet it."""
    last = len(strand) - 1
    ends, starts = [feed.end for feed in strand], [feed.start for feed in strand]
    first_moves = ((i, ends[:i:-1]) for i in range(min(_MOST_LEADS, last)))
    last_moves = ((i, starts[:i]) for i in range(last, max(last - _MOST_LEADS, 0), -1))
    for i, points in itertools.chain(first_moves, last_moves):
        parts = _cut_at(strand[i], points)
        if parts:
            yield [*strand[:i], *parts, *strand[i + 1 :]]
    crossing = _crossing(strand[0], strand[-1])
    if crossing is not None:
        head, tail = (_cut_at(strand[i], [crossing]) or [strand[i]] for i in (0, -1))
        yield [*head, *strand[1:-1], *tail]


def _cut_at(feed: Feed, points: Sequence[Point2]) -> list[Feed]:
    """Return both parts of a move, cut at the first of the points within it; none without one."""
    for point in points:
        share = _share_of(feed, point)
        if min(share, 1 - share) * feed.length_m <= JOIN_M:
            continue
        if math.dist(find_point(feed.start, feed.element, share), point) <= JOIN_M:
            break
    else:
        return []
    low, high = feed.heights_m
    middle = None if low is None or high is None else low + share * (high - low)
    if isinstance(feed.element, Line):
        parts: list[Line | Arc] = [Line(point), feed.element]
    else:
        halves = (share / 2, (1 + share) / 2)
        first, second = (find_point(feed.start, feed.element, half) for half in halves)
        parts = [Arc(point, first), Arc(feed.end, second)]
    return [
        Feed(feed.start, parts[0], feed.place, (low, middle)),
        Feed(point, parts[1], feed.place, (middle, high)),
    ]


def _crossing(first: Feed, other: Feed) -> Point2 | None:
    """Return the point at which two straight moves cross; None if they do not."""
    if not (isinstance(first.element, Line) and isinstance(other.element, Line)):
        return None
    (ax, ay), (bx, by) = first.start, first.end
    (cx, cy), (dx, dy) = other.start, other.end
    slope = (bx - ax) * (dy - cy) - (by - ay) * (dx - cx)
    if abs(slope) <= _PARALLEL * first.length_m * other.length_m:
        return None
    share = ((cx - ax) * (dy - cy) - (cy - ay) * (dx - cx)) / slope
    along = ((cx - ax) * (by - ay) - (cy - ay) * (bx - ax)) / slope
    if not (0 < share < 1 and 0 < along < 1):
        return None
    return ax + share * (bx - ax), ay + share * (by - ay)


def _split(strand: Sequence[Feed]) -> list[CutContour]:
    """Return the contours of one strand."""
    loops, outside, nodes = _walk(strand)
    folded = [loop for loop in loops if loop.curve.is_retraced]
    retraced_m = sum(loop.curve.length_m for loop in folded)
    groups = _grouped([loop for loop in loops if not loop.curve.is_retraced])
    if not groups:
        return _open(strand, outside, folded)
    total_m = sum(group[0].curve.length_m for group in groups)
    outside_m = sum(strand[i].length_m for i in outside)
    largest_m = max(group[0].curve.length_m for group in groups)
    dropped = {i for loop in folded for i in loop.moves}
    dropped |= {i for group in groups for loop in group[1:] for i in loop.moves}
    one_closed = not outside and len(groups) > 1 and largest_m < (1 - _LEAST_LOBE) * total_m
    if outside_m > MOST_LEAD * total_m or one_closed:
        # Closed by lobes that meet in a point, or open and touching itself.
        whole = Curve([strand[i] for i in range(len(strand)) if i not in dropped])
        count = min(map(len, groups)) if not outside else 1
        return [CutContour(whole, (_pass(whole),) * count, retraced_m=retraced_m)]
    if not outside and largest_m < total_m:
        # The tool starts and ends off the contour, at one point: the rest leads there and back.
        main = max(groups, key=lambda group: group[0].curve.length_m)
        others = [group for group in groups if group is not main]
        if not any(loop.node == main[0].node for group in others for loop in group):
            before = sum(
                strand[i].length_m
                for group in others
                for i in group[0].moves
                if i < main[0].moves[0]
            )
            after = sum(group[0].curve.length_m for group in others) - before
            return [
                CutContour(
                    main[0].curve,
                    tuple(_pass(loop.curve) for loop in main),
                    lead_in_m=before,
                    lead_out_m=after,
                    retraced_m=retraced_m,
                )
            ]
    return [
        _led(strand, group, outside, nodes, retraced_m if group is groups[0] else 0.0)
        if len(groups) == 1
        else CutContour(group[0].curve, tuple(_pass(loop.curve) for loop in group))
        for group in groups
    ]


def _led(
    strand: Sequence[Feed],
    group: Sequence[_Loop],
    outside: Sequence[int],
    nodes: Sequence[int],
    retraced_m: float,
) -> CutContour:
    """Return the only contour of a strand, with the moves before and after it as leads."""
    loop = group[0]
    at = nodes.index(loop.node) if loop.node in nodes else len(outside)
    before, after = outside[:at], [strand[i] for i in outside[at:]]
    overcut_m = loop.curve.followed_m(after)
    out_m = sum(feed.length_m for feed in after)
    return CutContour(
        loop.curve,
        tuple(_pass(each.curve) for each in group),
        lead_in_m=sum(strand[i].length_m for i in before),
        overcut_m=overcut_m,
        lead_out_m=out_m - overcut_m,
        retraced_m=retraced_m,
    )


def _open(
    strand: Sequence[Feed], outside: Sequence[int], folded: Sequence[_Loop]
) -> list[CutContour]:
    """Return the contours of a strand without loops but for moves out and back."""
    if outside:
        curve = Curve([strand[i] for i in outside])
        rest_m = sum(loop.curve.length_m for loop in folded)
        runs = 1 + round(rest_m / curve.length_m)
        if runs > 1 and abs(rest_m - (runs - 1) * curve.length_m) <= _SAME_CURVE_M * len(strand):
            return [CutContour(curve, _runs(strand, runs))]
        return [CutContour(curve, (_pass(curve),), retraced_m=rest_m)]
    whole = Curve(strand)
    if whole.is_retraced:
        # To and fro an even number of times.
        return [replace(cut, passes=cut.passes * 2) for cut in _split(whole.first_half().feeds)]
    halves = [loop.curve.first_half() for loop in folded]
    return [CutContour(half, (_pass(half),)) for half in halves]


def _runs(strand: Sequence[Feed], runs: int) -> tuple[Pass, ...]:
    """Return the passes of a strand that runs to and fro."""
    each = max(1, len(strand) // runs)
    parts = [strand[i * each : (i + 1) * each] or strand[-1:] for i in range(runs)]
    return tuple(_pass(Curve(part)) for part in parts)


def _grouped(loops: Sequence[_Loop]) -> list[list[_Loop]]:
    """Return loops by contour."""
    groups: list[list[_Loop]] = []
    alike: dict[tuple[int, ...], list[int]] = {}
    for loop in loops:
        keys = _keys(loop.curve)
        near = dict.fromkeys(i for key in keys for i in alike.get(key, ()))
        same = next((i for i in near if groups[i][0].curve.is_like(loop.curve)), None)
        if same is None:
            alike.setdefault(keys[0], []).append(len(groups))
            groups.append([loop])
        else:
            groups[same].append(loop)
    return groups


def _pass(curve: Curve) -> Pass:
    return Pass(curve.feeds[0].heights_m[0], curve.feeds[-1].heights_m[1])
