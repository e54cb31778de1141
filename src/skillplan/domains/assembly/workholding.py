"""What workholders carry and holders hold: facts, skills, and motions by orientation."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

from skillplan.domains.assembly.part_schema import PartConfig
from skillplan.domains.assembly.schema import AssemblyConfig
from skillplan.domains.assembly.screw_schema import ScrewConfig
from skillplan.task.motion import Visit
from skillplan.task.pose import Pose, unit
from skillplan.task.scene import Holder, Placement, Workholder
from skillplan.task.state import AND


class Orientation(NamedTuple):
    """An orientation of a workholder.

    Parameters
    ----------
    label
        Suffix of skills and places: empty in the first orientation.
    fact
        Fact that holds in it; None for a component that no workholder carries.
    motion
        Motion from the first orientation; None there.
    """

    label: str
    fact: str | None
    motion: Pose | None


_STILL = Orientation("", None, None)


def name_turned(workholder: str, orientation: str) -> str:
    """Return the fact that a workholder is in an orientation."""
    return f"turned({workholder}.{orientation})"


def name_holding(holder: str, part: str) -> str:
    """Return the fact that a holder holds a part."""
    return f"holds({holder}.{part})"


def name_open(holder: str) -> str:
    """Return the fact that a holder holds nothing."""
    return f"open({holder})"


def list_carried(config: AssemblyConfig, workholder: str) -> list[str]:
    """Return the parts and screws that turn with a workholder."""
    given = config.workholders[workholder].carries
    # Members of sub-assemblies are put together elsewhere.
    moved = [name for name in config.moved_parts if name not in config.joined_in]
    parts = moved if given is None else given
    screws = (name for name, screw in config.screws.items() if screw.through in parts)
    return [*parts, *screws]


def find_workholder(config: AssemblyConfig, component: str) -> str | None:
    """Return the workholder that carries a part, a screw or a fixture, or None."""
    for name, workholder in config.workholders.items():
        if component in (workholder.fixtures or ()) or component in list_carried(config, name):
            return name
    return None


def list_workholder_orientations(config: AssemblyConfig, workholder: str) -> list[Orientation]:
    """Return the orientations of a workholder, the first one at the start."""
    entry = config.workholders[workholder]
    pivot = (entry.pivot_m[0], entry.pivot_m[1], entry.pivot_m[2])
    return [
        Orientation(
            f".{name}" if number else "",
            name_turned(workholder, name),
            orientation.build_motion(pivot) if number else None,
        )
        for number, (name, orientation) in enumerate(entry.orientations.items())
    ]


def list_orientations(config: AssemblyConfig, component: str) -> list[Orientation]:
    """Return the orientations in which a part, screw or fixture may be on its workholder."""
    workholder = find_workholder(config, component) if config.workholders else None
    return [_STILL] if workholder is None else list_workholder_orientations(config, workholder)


def list_insertion_orientations(config: AssemblyConfig, component: str) -> list[Orientation]:
    """Return the orientations in which a part or screw may be put into the product."""
    orientations = list_orientations(config, component)
    owner = config.parts.get(component) or config.screws[component]
    if owner.orientation is None or orientations[0].fact is None:
        return orientations
    given = f".{owner.orientation})"
    return [item for item in orientations if str(item.fact).endswith(given)] or orientations


def list_goal_poses(config: AssemblyConfig, part: str, pose: Pose) -> list[Pose]:
    """Return the poses of a part at its goal when it is put there, from that in the first one."""
    return [turn_pose(pose, turn.motion) for turn in list_insertion_orientations(config, part)]


def find_holder_workholder(config: AssemblyConfig, holder: str) -> str | None:
    """Return the workholder that a holder turns along with, or None."""
    entry = config.holders[holder]
    carried = (find_workholder(config, part) for part in entry.parts)
    return next((name for name in carried if name is not None), None) if entry.turns else None


def list_holds(config: AssemblyConfig) -> Iterator[tuple[str, str, str]]:
    """Yield each holder with a part that it can hold, and the suffix of the skills' names.

    Holders that stay have no skills.
    """
    seen: set[str] = set()
    for name, holder in config.holders.items():
        if holder.stays:
            continue
        for part in holder.parts:
            yield name, part, f":{name}" if part in seen else ""
            seen.add(part)


def turn_placements(
    placements: Sequence[Placement], orientations: Sequence[Orientation]
) -> tuple[Placement, ...]:
    """Return placements in the first orientation as they are in each one."""
    if orientations[0].fact is None:
        return tuple(placements)
    return tuple(
        replace(
            placement,
            fact=AND.join(fact for fact in (placement.fact, orientation.fact) if fact),
            pose=turn_pose(placement.pose, orientation.motion),
        )
        for placement in placements
        for orientation in orientations
    )


def turn_pose(pose: Pose, motion: Pose | None) -> Pose:
    """Return a pose after a motion from the first orientation."""
    return pose if motion is None else motion.then(pose)


def turn_visit(visit: Visit, motion: Pose | None) -> Visit:
    """Return a visit to the product after a motion from the first orientation."""
    if motion is None:
        return visit
    return replace(visit, pose=motion.then(visit.pose), along=unit(motion.rotate(visit.along)))


def list_fixture_placements(
    config: AssemblyConfig, fixture: str, pose: Pose
) -> tuple[Placement, ...]:
    """Return the placements of a fixture of a workholder or holder; empty for another fixture."""
    for name, entry in config.workholders.items():
        if fixture in (entry.fixtures or ()):
            return turn_placements(
                (Placement("", pose),), list_workholder_orientations(config, name)
            )
    placements: list[Placement] = []
    for name, holder in config.holders.items():
        if fixture in (holder.fixtures or ()):
            workholder = find_holder_workholder(config, name)
            orientations = (
                [_STILL] if workholder is None else list_workholder_orientations(config, workholder)
            )
            closed = [Placement(name_holding(name, part), pose) for part in holder.parts]
            placements += turn_placements(closed, orientations)
    return tuple(placements)


def list_turn_targets(config: AssemblyConfig, workholder: str) -> list[str]:
    """Return the orientations that turns of a workholder lead to."""
    entry = config.workholders[workholder]
    return list(entry.orientations)[int(entry.in_order) :]


def list_turn_origins(config: AssemblyConfig, workholder: str, orientation: str) -> list[str]:
    """Return the facts of the orientations from which a workholder turns to another one."""
    entry = config.workholders[workholder]
    names = list(entry.orientations)
    before = names.index(orientation)
    origins = names[before - 1 : before] if entry.in_order else names
    return [name_turned(workholder, other) for other in origins if other != orientation]


def list_turn_needs(config: AssemblyConfig, workholder: str, orientation: str) -> list[str]:
    """Return the facts that a turn to an orientation needs, if orientations are in order."""
    entry = config.workholders[workholder]
    if not entry.in_order:
        return []
    names = list(entry.orientations)
    earlier = names[: names.index(orientation)]
    carried = list_carried(config, workholder)
    parts = ((name, part) for name, part in config.parts.items() if not part.fixed)
    facts = [f"placed({name})" for name, part in parts if _goes_in(part, name, carried, earlier)]
    screws = config.screws.items()
    facts += [f"fastened({name})" for name, s in screws if _goes_in(s, name, carried, earlier)]
    return [*list_turn_origins(config, workholder, orientation), *facts]


def _goes_in(
    owner: PartConfig | ScrewConfig, name: str, carried: Sequence[str], orientations: Sequence[str]
) -> bool:
    """Return whether a part or screw has to be in before orientations end."""
    return name in carried and not owner.optional and owner.orientation in orientations


def list_ties(config: AssemblyConfig, workholder: str) -> list[str]:
    """Return the facts that tie parts on a workholder to something that does not turn along."""
    entry = config.workholders[workholder]
    turning = {*list_carried(config, workholder), *(entry.fixtures or ())}
    facts = [
        name_holding(name, part)
        for name, holder in config.holders.items()
        for part in holder.parts
        if part in turning and not holder.turns
    ]
    for name, screw in config.screws.items():
        joined = {screw.through, *screw.into_names}
        if joined & turning and joined - turning:
            facts.append(f"fastened({name})")
    for name, part in config.parts.items():
        into = {other for other, fit in (part.fits or {}).items() if fit.holds}
        if not part.fixed and into and len({other in turning for other in (name, *into)}) > 1:
            facts.append(f"placed({name})")
    return facts


def build_workholders(config: AssemblyConfig) -> tuple[Workholder, ...]:
    """Return the workholders of the scene."""
    return tuple(
        Workholder(
            name,
            (entry.pivot_m[0], entry.pivot_m[1], entry.pivot_m[2]),
            {
                str(orientation.fact): orientation.motion or Pose((0.0, 0.0, 0.0))
                for orientation in list_workholder_orientations(config, name)
            },
            (*list_carried(config, name), *_list_turning_jaws(config, name)),
            tuple(entry.fixtures or ()),
        )
        for name, entry in config.workholders.items()
    )


def _list_turning_jaws(config: AssemblyConfig, workholder: str) -> Iterator[str]:
    for name, holder in config.holders.items():
        if find_holder_workholder(config, name) == workholder:
            yield from holder.fixtures or ()


def build_holders(config: AssemblyConfig) -> tuple[Holder, ...]:
    """Return the holders of the scene."""
    return tuple(
        Holder(
            name,
            entry.kind,
            {part: name_holding(name, part) for part in entry.parts},
            find_holder_workholder(config, name),
            entry.force_n,
            tuple(entry.fixtures or ()),
        )
        for name, entry in config.holders.items()
    )
