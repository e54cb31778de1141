"""Faults of workholders and holders: names, orientations without use, and a pivot too low."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace

from skillplan.collision.solid import TOUCH_M
from skillplan.domains.assembly.layout import get_layout
from skillplan.domains.assembly.schema import AssemblyConfig
from skillplan.domains.assembly.vocabulary import list_interchangeable
from skillplan.domains.assembly.workholding import (
    find_workholder,
    list_carried,
    list_orientations,
    list_workholder_orientations,
    turn_pose,
)
from skillplan.errors import Issue, name_hint
from skillplan.task.pose import Pose

_STILL = Pose((0.0, 0.0, 0.0))
# Difference of two motions that are the same [m, or share of a full turn].
_SAME = 1e-6


def find_holding_issues(config: AssemblyConfig) -> Iterator[Issue]:
    """Yield unknown, repeated and contradictory names of workholders, holders and works."""
    if not (config.workholders or config.holders):
        for kind in ("works", "parts", "screws"):
            for name, owner in getattr(config, kind).items():
                if owner.orientation is not None:
                    words = f"no workholder carries {'its part' if kind == 'works' else 'it'}."
                    yield Issue(f"{words} Leave it out.", (kind, name, "orientation"))
        return
    owners: dict[str, str] = {}
    carried: dict[str, str] = {}
    for name, workholder in config.workholders.items():
        here = ("workholders", name)
        yield from _find_unknown(workholder.fixtures, config.fixtures, "fixture", *here, "fixtures")
        yield from _find_taken(workholder.fixtures, owners, name, *here, "fixtures")
        yield from _find_carried_issues(config, name, carried)
        yield from _find_idle_orientations(config, name)
    for name, holder in config.holders.items():
        here = ("holders", name)
        yield from _find_unknown(holder.fixtures, config.fixtures, "fixture", *here, "fixtures")
        yield from _find_taken(holder.fixtures, owners, name, *here, "fixtures")
        yield from _find_held_issues(config, name, carried)
    yield from _find_lying_on_turning(config, owners)
    yield from _find_insertion_issues(config)
    yield from _find_work_issues(config)
    for feeder, entry in config.feeders.items():
        if entry.cycle_s is not None:
            words = "turns and holds take time at a place, which hides when the last was taken."
            yield Issue(f"{words} Leave it out.", ("feeders", feeder, "cycle_s"))


def _find_unknown(
    names: Sequence[str] | None, known: Collection[str], kind: str, *path: str
) -> Iterator[Issue]:
    """Yield names that are unknown or stand twice."""
    listed = list(names or ())
    for index, name in enumerate(listed):
        where: tuple[str | int, ...] = (*path, index) if len(listed) > 1 else path
        if name not in known:
            yield Issue(f"unknown {kind} {name!r}. {name_hint(name, list(known))}", where)
        elif name in listed[:index]:
            yield Issue(f"{name!r} stands twice. Keep one.", where)


def _find_taken(
    names: Sequence[str] | None, owners: dict[str, str], owner: str, *path: str
) -> Iterator[Issue]:
    """Yield names that another workholder or holder has; `owners` learns the others."""
    for name in names or ():
        other = owners.setdefault(name, owner)
        if other != owner:
            yield Issue(f"{name!r} belongs to {other!r}. Name it in one of the two.", path)


def _find_carried_issues(
    config: AssemblyConfig, name: str, carried: dict[str, str]
) -> Iterator[Issue]:
    entry = config.workholders[name]
    path = ("workholders", name, "carries")
    yield from _find_unknown(entry.carries, config.parts, "part", *path)
    parts = [part for part in list_carried(config, name) if part in config.parts]
    where = path if entry.carries is not None else path[:2]
    remedy = "" if entry.carries is not None else " Name the parts of each in 'carries'."
    for part in parts:
        other = carried.setdefault(part, name)
        if other != name:
            words = f"{part!r} is carried by {other!r}."
            yield Issue(f"{words}{remedy or ' Leave it out of one of the two.'}", where)
            return
        if config.parts[part].fixed:
            words = f"{part!r} is fixed, and no turn moves it. Give it as a fixture in 'fixtures'."
            yield Issue(words, where)
        if part in config.joined_in:
            words = f"{part!r} is put together at the start of {config.joined_in[part]!r}."
            yield Issue(f"{words} Name that part.", where)
    buffers = {buffer for part in parts for buffer in config.parts[part].buffers or ()}
    for orientation in buffers & set(entry.orientations):
        words = f"the name {orientation!r} is taken in 'buffers'. Choose another."
        yield Issue(words, ("workholders", name, "orientations", orientation), at_key=True)
    classes = {config.parts[part].interchangeable for part in parts} - {None, False}
    for part, given in config.parts.items():
        if given.interchangeable in classes and part not in parts:
            words = f"{part!r} is interchangeable with parts that it carries. Name it, too."
            yield Issue(words, where)


def _find_idle_orientations(config: AssemblyConfig, name: str) -> Iterator[Issue]:
    """Yield orientations that are the same as an earlier one, or below the table."""
    layout = get_layout(config)
    entry = config.workholders[name]
    seen: dict[str, Pose] = {}
    own = [fixture for fixture in entry.fixtures or () if fixture in config.fixtures]
    start, first = next(iter(entry.orientations.items()))
    given = [key for key in ("rpy_rad", "shift_m") if any(getattr(first, key))]
    for key in given:
        words = f"{start!r} is the one at the start, from which others turn. Leave it out."
        yield Issue(words, ("workholders", name, "orientations", start, key))
    if given:
        return
    for key, orientation in zip(
        entry.orientations, list_workholder_orientations(config, name), strict=True
    ):
        motion = orientation.motion or _STILL
        path = ("workholders", name, "orientations", key)
        same = next((other for other, pose in seen.items() if _is_same(pose, motion)), None)
        if same is not None:
            words = f"is the same as {same!r}. Turn it by 'rpy_rad', or leave it out."
            yield Issue(words, path)
        seen[key] = motion
        for fixture in own if orientation.motion is not None else ():
            solid = layout.fixture(fixture)
            turned = replace(solid, pose=turn_pose(solid.pose, motion))
            deep_m = -turned.box.low[2]
            if deep_m > TOUCH_M and solid.box.low[2] >= -TOUCH_M:
                # The height of a turned point changes with that of the pivot by this share.
                share = 1.0 - motion.rotate((0.0, 0.0, 1.0))[2]
                height_m = entry.pivot_m[2] + deep_m / max(share, _SAME)
                words = (
                    f"{fixture!r} would be {deep_m * 1e3:.1f} mm deep in the table in {key!r}. "
                    f"Raise it, to a height of {height_m:.4g} m at least."
                )
                yield Issue(words, ("workholders", name, "pivot_m"))
                break


def _is_same(first: Pose, second: Pose) -> bool:
    """Return True if two motions take bodies to the same poses."""
    between = first.inverse().then(second)
    x, y, z, _ = between.orientation
    return max(map(abs, (*between.position, x, y, z))) < _SAME


def _find_held_issues(
    config: AssemblyConfig, name: str, carried: dict[str, str]
) -> Iterator[Issue]:
    entry = config.holders[name]
    path = ("holders", name, "parts")
    yield from _find_unknown(entry.parts, config.parts, "part", *path)
    parts = [part for part in entry.parts if part in config.parts]
    goal = None if config.goal is None else set(config.goal)
    for index, part in enumerate(entry.parts):
        given = config.parts.get(part)
        where = (*path, index) if len(entry.parts) > 1 else path
        if given is None:
            continue
        if given.fixed:
            yield Issue(f"{part!r} is fixed and needs no holder. Leave it out.", where)
        elif given.interchangeable:
            words = f"{part!r} may be at another place, as it is interchangeable."
            yield Issue(f"{words} Give it 'interchangeable: false'.", where)
        elif given.other_goals:
            words = f"{part!r} may be at another goal, where the holder is not."
            yield Issue(f"{words} Leave it out, or 'other_goals'.", where)
        elif goal is not None and given.optional and f"placed({part})" not in goal:
            words = f"{part!r} is optional, and 'goal' does not name it: it may never be placed."
            yield Issue(f"{words} Leave it out, or add placed({part}).", where)
        elif config.actions is not None and not any(
            action.startswith((f"place({part})", f"place({part}.", f"place({part}:"))
            for action in config.actions
        ):
            words = f"'actions' lists no place({part}), so it is never placed. Add it."
            yield Issue(words, where)
    on = {carried.get(part) for part in parts}
    if entry.turns and len(on) > 1:
        names = " and ".join(sorted(map(str, on - {None})))
        words = f"some of its parts turn with {names} and others do not. Give each kind a holder."
        yield Issue(words, path)
    if not entry.turns and on == {None}:
        yield Issue(
            "has no effect, as no workholder carries its parts. Leave it out.",
            ("holders", name, "turns"),
        )


def _find_lying_on_turning(config: AssemblyConfig, owners: dict[str, str]) -> Iterator[Issue]:
    """Yield parts and buffers on fixtures that turn, or that are there at times only."""
    for name, part in config.parts.items():
        if part.start_on in owners:
            words = f"{part.start_on!r} belongs to {owners[part.start_on]!r} and does not stay."
            yield Issue(
                f"{words} Let {name!r} lie elsewhere at the start.", ("parts", name, "start_on")
            )
    for name, buffer in config.buffers.items():
        if buffer.stands_on in owners:
            words = f"{buffer.stands_on!r} belongs to {owners[buffer.stands_on]!r} and does not"
            yield Issue(f"{words} stay. Name another.", ("buffers", name, "stands_on"))
    for name, fixture in config.fixtures.items():
        if fixture.stands_on in owners and owners.get(name) != owners[fixture.stands_on]:
            words = f"{fixture.stands_on!r} belongs to {owners[fixture.stands_on]!r} and does not"
            yield Issue(f"{words} stay. Name another.", ("fixtures", name, "stands_on"))


def _find_insertion_issues(config: AssemblyConfig) -> Iterator[Issue]:
    """Yield orientations of parts and screws that do not exist, and orders without any."""
    named: set[str] = set()
    for kind, owners in (("parts", config.parts), ("screws", config.screws)):
        for name, owner in owners.items():
            if owner.orientation is None:
                continue
            path = (kind, name, "orientation")
            on = find_workholder(config, name)
            if on is None:
                yield Issue(f"no workholder carries {name!r}. Leave it out.", path)
                continue
            named.add(on)
            known = list(config.workholders[on].orientations)
            if owner.orientation not in known:
                hint = name_hint(owner.orientation, known)
                yield Issue(f"unknown orientation {owner.orientation!r}. {hint}", path)
            alike = list_interchangeable(config, name) if kind == "parts" else []
            if any(config.parts[other].orientation != owner.orientation for other in alike):
                words = f"parts that are interchangeable with {name!r} have another one."
                yield Issue(f"{words} Give all the same.", path)
    for workholder, entry in config.workholders.items():
        if entry.in_order and workholder not in named:
            words = "has no effect, as no part or screw that it carries has an 'orientation'."
            yield Issue(f"{words} Leave it out.", ("workholders", workholder, "in_order"))


def _find_work_issues(config: AssemblyConfig) -> Iterator[Issue]:
    """Yield works in orientations that do not exist, or in which their place is at a side."""
    for name, work in config.works.items():
        if work.orientation is None or work.part not in config.parts:
            continue
        path = ("works", name, "orientation")
        workholder = find_workholder(config, work.part)
        if workholder is None:
            yield Issue(f"no workholder carries {work.part!r}. Leave it out.", path)
            continue
        known = list(config.workholders[workholder].orientations)
        if work.orientation not in known:
            hint = name_hint(work.orientation, known)
            yield Issue(f"unknown orientation {work.orientation!r}. {hint}", path)
            continue
        motion = list_orientations(config, work.part)[known.index(work.orientation)].motion
        if motion is not None and abs(motion.rotate((0.0, 0.0, 1.0))[2]) < 1 - _SAME:
            words = (
                f"in {work.orientation!r} the place is at a side, and the tool comes from above."
            )
            yield Issue(f"{words} Name another orientation.", path)
