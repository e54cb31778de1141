"""Sub-assemblies: parts that are put together from others, and then taken as one.

Their members are placed and fastened at a place of their own. Then ``join`` swaps them for one body
with their shapes, which is picked and placed as any part.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from skillplan.domains.assembly.layout import Layout
from skillplan.domains.assembly.part_schema import PartConfig
from skillplan.domains.assembly.schema import AssemblyConfig
from skillplan.errors import Issue, name_hint
from skillplan.task.pose import Pose
from skillplan.task.shape import move_shape


def join_members(config: AssemblyConfig) -> None:
    """Set shape, mass and start of the sub-assemblies of a file that is being read.

    The frame of one has the origin of its first part at its goal, and the axes of the world. Those
    whose members have faults stay without a shape; `find_subassembly_issues` names the faults.
    """
    if any(issue.path[0] == "parts" for issue in find_subassembly_issues(config)):
        return
    waiting = [name for name, part in config.parts.items() if part.made_of]
    while waiting:
        # Members that are sub-assemblies themselves come first.
        name = next(
            name
            for name in waiting
            if not set(_list_parts_needed(config, name)).intersection(waiting)
        )
        waiting.remove(name)
        _join(config, name)


def _join(config: AssemblyConfig, name: str) -> None:
    part, layout = config.parts[name], Layout(config)
    members = part.made_of or []
    parts = [member for member in members if member in config.parts]
    screws = [config.screws[member] for member in members if member in config.screws]
    origin = layout.goal(parts[0]).pose.position
    back = Pose(origin).inverse()
    joined = part.model_copy(
        update={
            "start_m": list(origin),
            "mass_kg": sum(config.parts[n].mass_kg for n in parts) + sum(s.mass_kg for s in screws),
        }
    )
    joined.join(
        {n: (config.parts[n], back.then(layout.goal(n).pose)) for n in parts},
        [
            move_shape(shape, back.then(layout.hole_pose(screw)))
            for screw in screws
            for shape in screw.shapes
        ],
    )
    config.parts[name] = joined


def _list_parts_needed(config: AssemblyConfig, name: str) -> list[str]:
    """Return the parts that the goal and the shape of a sub-assembly follow from."""
    needed: list[str] = []
    todo = [member for member in config.parts[name].made_of or () if member in config.parts]
    while todo:
        part = todo.pop()
        if part not in needed:
            needed.append(part)
            others = (*(config.parts[part].goal_on or ()), *(config.parts[part].made_of or ()))
            todo += [other for other in others if other in config.parts]
    return needed


def find_subassembly_issues(config: AssemblyConfig) -> Iterator[Issue]:
    """Yield faults of sub-assemblies: names, members that cannot go along, and cycles."""
    owners: dict[str, str] = {}
    for name, part in config.parts.items():
        for index, member in enumerate(part.made_of or ()):
            path = ("parts", name, "made_of", index)
            known = [n for n in (*config.moved_parts, *config.screws) if n != name]
            if member not in known:
                yield Issue(f"unknown part or screw {member!r}. {name_hint(member, known)}", path)
                continue
            if member in owners:
                words = "twice" if owners[member] == name else f"part of {owners[member]!r}, too"
                yield Issue(f"{member!r} is {words}. Keep one.", path)
            owners[member] = name
            yield from (Issue(m, path) for m in _find_member_faults(config, name, member))
        if part.made_of and name in _list_parts_needed(config, name):
            words = f"{name!r} is part of itself, or a member stands on it. Name other parts."
            yield Issue(words, ("parts", name, "made_of"))
        elif part.made_of and not any(member in config.parts for member in part.made_of):
            yield Issue("names no part. Name at least one.", ("parts", name, "made_of"))
    for name, workholder in config.workholders.items():
        for index, carried in enumerate(workholder.carries or ()):
            if carried in owners:
                words = f"{carried!r} is put together elsewhere. Name {owners[carried]!r}."
                yield Issue(words, ("workholders", name, "carries", index))
    if owners and config.family is not None:
        yield Issue("a family of layouts has no sub-assemblies. Leave one out.", ("family",))
    for name, part in config.parts.items():
        for index, other in enumerate(part.goal_on or ()):
            owner = owners.get(other)
            if owner is not None and name != owner and owners.get(name) != owner:
                words = f"{other!r} goes away with {owner!r}. Name that."
                yield Issue(words, ("parts", name, "goal_on", index))
        for other in part.fits or {}:
            owner = owners.get(other)
            if owner is not None and name != owner and owners.get(name) != owner:
                words = f"{other!r} goes away with {owner!r}. Name that."
                yield Issue(words, ("parts", name, "fits", other), at_key=True)
    yield from _find_screws_left(config, owners)


def _find_screws_left(config: AssemblyConfig, owners: Mapping[str, str]) -> Iterator[Issue]:
    """Yield screws in members of a sub-assembly that are none themselves."""
    for name, screw in config.screws.items():
        owner = owners.get(screw.through)
        if owner is not None and owners.get(name) != owner:
            words = f"{screw.through!r} goes away with {owner!r}: name {name!r} in its 'made_of'."
            yield Issue(words, ("screws", name, "through"))
            continue
        for index, other in enumerate(screw.into_names):
            owner = owners.get(other)
            if owner is not None and owners.get(name) != owner:
                words = f"{other!r} goes away with {owner!r}. Name that."
                yield Issue(words, ("screws", name, "into", index))


def _find_member_faults(config: AssemblyConfig, owner: str, member: str) -> Iterator[str]:
    members = config.parts[owner].made_of or []
    screw = config.screws.get(member)
    if screw is not None:
        for other in (screw.through, *screw.into_names):
            if other not in members:
                yield f"{member!r} joins {other!r}, which is not part of {owner!r}. Name it, too."
        return
    part: PartConfig = config.parts[member]
    for key in ("optional", "interchangeable", "other_goals", "buffers"):
        if getattr(part, key):
            yield f"{member!r} has {key!r}, which no member has. Leave that out."
