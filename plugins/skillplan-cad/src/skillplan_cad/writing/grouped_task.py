"""Write groups of parts as sub-assemblies: built at a station of their own, then placed as one.

The product with each group as one part is written first, and its start is the station. Then the
group is written as a product of its own, and moved to the station. An order of the whole is checked
with all paths; without one, the groups are not written.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from skillplan_cad.planning.assembly_plan import GRIPPER, AssemblyPlan, Step, find_groups
from skillplan_cad.planning.bearing import Bearing, find_bearing
from skillplan_cad.planning.precedence import derive_precedence, list_members
from skillplan_cad.planning.watch import Watch
from skillplan_cad.product import Part, Product, Vector
from skillplan_cad.relation import Blocking, Contact, Fastener, LeftOut, Relation, RelationPart
from skillplan_cad.writing.build_task import build_task
from skillplan_cad.writing.pieces_proof import Cuts, ProvedPieces
from skillplan_cad.writing.task_document import (
    HOLDERS,
    Item,
    TaskNest,
    WrittenTask,
    find_free_name,
    format_task,
    lay_out_table,
)
from skillplan_cad.writing.trial import TaskTrials, list_brought

# Height from which on an item has room for a hand next to it [m].
_TALL_M = 0.05
_DECIMALS = 7
# Largest sine of a level direction.
_LEVEL = 1e-3
_BUILT = (
    "is built into {whole} at a station of its own, which is then placed as one part; that its "
    "parts keep together while they are carried is not checked"
)


@dataclass(frozen=True, slots=True)
class Joined:
    """A product in which each group is one part.

    Parameters
    ----------
    groups
        Names of the parts of each group, the base first, by the name of the whole.
    """

    product: Product
    relation: Relation
    plan: AssemblyPlan
    groups: Mapping[str, tuple[str, ...]]


def build_grouped_task(
    product: Product,
    relation: Relation,
    plan: AssemblyPlan,
    ungrouped: WrittenTask,
    robot: str,
    without: Mapping[str, LeftOut],
    remarks: Mapping[str, Sequence[str]],
    watch: Watch,
    cuts: Cuts,
    *,
    holding: bool,
    nesting: bool,
) -> WrittenTask:
    """Return the task with the groups of a plan as sub-assemblies, or the one without them.

    Parameters
    ----------
    ungrouped
        Task without the parts of groups, which stays unless more parts come with them.
    robot, without, remarks, cuts, holding, nesting
        As for `build_task`.
    """
    up, built = ungrouped.bearing.up, dict[Group, WrittenTask]()
    for group in find_parted_groups(product, relation, ungrouped.bearing, without):
        if {*group.parts} <= ungrouped.names.keys() or watch.must_stop():
            continue
        own = _build_group(product, relation, plan, group, up, robot, remarks, watch, cuts, nesting)
        if own is not None:
            built[group] = own
    if not built:
        return ungrouped
    joined = join_groups(product, relation, plan, built, up)
    left_out = {name: reason for name, reason in without.items() if name in joined.relation.names}
    whole = build_task(
        joined.product,
        joined.relation,
        joined.plan,
        robot,
        find_bearing(joined.product, joined.relation, up, left_out, holding=holding),
        left_out,
        remarks,
        watch=watch,
        cuts=cuts,
        holding=holding,
        nesting=nesting,
    )
    for (name, members), own in zip(joined.groups.items(), built.values(), strict=True):
        if name in whole.names:
            merged = _Merger(joined, product, name, whole, own).merge() if whole.skills else None
            whole = replace(whole, skills=()) if merged is None else _confirm(merged, watch)
        else:
            whole = _explain_members(whole, name, members)
    return whole if len(whole.names) > len(ungrouped.names) and whole.skills else ungrouped


def _explain_members(task: WrittenTask, name: str, members: Iterable[str]) -> WrittenTask:
    """Return a task whose reason for leaving out a whole is that of its parts."""
    reasons = dict(task.left_out)
    why = reasons.pop(name)
    words = f"comes with {name}, which {why.text}"
    reasons |= {part: LeftOut(part, why.kind, words, why.by) for part in members}
    return replace(task, left_out=reasons)


@dataclass(frozen=True, slots=True)
class Group:
    """Parts that come into the product together, along one direction.

    Parameters
    ----------
    parts
        Names of the parts, the heaviest first.
    along
        Unit vector of the move, in the product's frame.
    """

    parts: tuple[str, ...]
    along: Vector


def find_parted_groups(
    product: Product, relation: Relation, bearing: Bearing, without: Collection[str]
) -> list[Group]:
    """Return the smallest sets that leave the part on the table upwards or sideways as one.

    Their parts do not come off one at a time, as a neighbour is in the way of each.

    Parameters
    ----------
    without
        Names of parts that are not there.
    """
    masses_kg = {part.name: part.mass_kg for part in product}
    grounded = [name for name in bearing.order if not bearing.on.get(name)]
    if not grounded:
        return []
    base = max(grounded, key=masses_kg.__getitem__)
    kept = _restrict(relation, {*relation.names} - {*without})
    parting = find_groups(kept, derive_precedence(kept), 1 << kept.index(base))
    groups: list[Group] = []
    taken = {base}
    for split in parting.splits:
        names = {kept.names[number] for number in list_members(split.moved)}
        along = _find_way_down(kept, names, bearing.up)
        if len(names) > 1 and not names & taken and along is not None:
            taken |= names
            order = sorted(names, key=lambda name: (-masses_kg[name], kept.index(name)))
            groups.append(Group(tuple(order), along))
    return groups


def _find_way_down(relation: Relation, names: Collection[str], up: Vector) -> Vector | None:
    """Return the steepest direction in which parts come together, level ones included, or None."""
    free = [
        direction
        for number, direction in enumerate(relation.directions)
        if all({*relation.blockers(name, number)} <= {*names} for name in names)
    ]
    x, y, z = max(free, key=lambda direction: float(np.dot(direction, up)), default=(0.0, 0.0, 0.0))
    return (-x + 0.0, -y + 0.0, -z + 0.0) if free and np.dot((x, y, z), up) > -_LEVEL else None


def _restrict(relation: Relation, kept: Collection[str]) -> Relation:
    """Return the relation of some parts."""
    names = {*kept}
    return replace(
        relation,
        parts=tuple(
            replace(part, identical_to=None, mirror_of=None)
            for part in relation.parts
            if part.name in names
        ),
        blocked=tuple(entry for entry in relation.blocked if {entry.part, entry.by} <= names),
        contacts=tuple(contact for contact in relation.contacts if {*contact.parts} <= names),
        fasteners=tuple(
            fastener
            for fastener in relation.fasteners
            if {fastener.part, *fastener.joins, *fastener.threaded_in} <= names
        ),
        sensitive=(),
        groups=(),
        stuck=(),
    )


def join_groups(
    product: Product, relation: Relation, plan: AssemblyPlan, groups: Iterable[Group], up: Vector
) -> Joined:
    """Return a product, its relation and its plan with each group as one part."""
    taken = {part.name for part in product}
    wholes: dict[str, Group] = {}
    for group in groups:
        wholes[find_free_name(f"{group.parts[0]} group", taken | wholes.keys())] = group
    whole_of = {part: name for name, group in wholes.items() for part in group.parts}
    shape = max(part.shape for part in product)
    joined = {
        name: _join_parts(name, [part for part in product if part.name in group.parts], shape + n)
        for n, (name, group) in enumerate(wholes.items(), 1)
    }
    names = list(dict.fromkeys(whole_of.get(part.name, part.name) for part in product))
    parts = {part.name: part for part in product} | joined
    steps = [step for step in plan.steps if not whole_of.keys() & {*step.parts}]
    steps += [
        Step((name,), plan.base, group.along, (), up, GRIPPER, False, (), False, True)
        for name, group in wholes.items()
    ]
    return Joined(
        replace(product, parts=tuple(parts[name] for name in names)),
        _join_relation(relation, names, joined, whole_of),
        replace(plan, steps=tuple(steps), subassemblies=()),
        {name: group.parts for name, group in wholes.items()},
    )


def _join_parts(name: str, members: Sequence[Part], shape: int) -> Part:
    corner = triangle = 0
    triangles, faces = [], []
    for part in members:
        triangles.append(part.triangles + corner)
        faces += [replace(face, triangles=face.triangles + triangle) for face in part.faces]
        corner += len(part.vertices_m)
        triangle += len(part.triangles)
    volume_m3 = sum(part.volume_m3 for part in members)
    mass_kg = sum(part.mass_kg for part in members)
    masses_kg = [part.mass_kg for part in members]
    centres = np.array([part.centre_m for part in members])
    x, y, z = (float(value) for value in np.average(centres, axis=0, weights=masses_kg))
    return replace(
        members[0],
        name=name,
        vertices_m=np.concatenate([part.vertices_m for part in members]),
        triangles=np.concatenate(triangles),
        faces=tuple(faces),
        volume_m3=volume_m3,
        density_kg_m3=mass_kg / volume_m3,
        centre_m=(x, y, z),
        shape=shape,
        mirrors=None,
        bodies=sum(part.bodies for part in members),
        design="",
    )


def _join_relation(
    relation: Relation,
    names: Sequence[str],
    joined: Mapping[str, Part],
    whole_of: Mapping[str, str],
) -> Relation:
    known = {part.name: part for part in relation.parts}
    known |= {name: RelationPart(name, "part", None, None, joined[name].mass_kg) for name in joined}
    blocked: dict[tuple[str, str, int], Blocking] = {}
    for entry in relation.blocked:
        part, by = (whole_of.get(name, name) for name in (entry.part, entry.by))
        key = (part, by, entry.direction)
        nearest = blocked.get(key)
        if part != by and (nearest is None or entry.distance_m < nearest.distance_m):
            blocked[key] = replace(entry, part=part, by=by)
    order = {name: number for number, name in enumerate(names)}
    return replace(
        relation,
        parts=tuple(replace(known[name], identical_to=None, mirror_of=None) for name in names),
        blocked=tuple(
            sorted(blocked.values(), key=lambda e: (order[e.part], e.direction, order[e.by]))
        ),
        contacts=_join_contacts(relation.contacts, order, whole_of),
        fasteners=tuple(
            _rename_fastener(fastener, whole_of)
            for fastener in relation.fasteners
            if fastener.part not in whole_of
        ),
        sensitive=(),
        groups=(),
        stuck=(),
    )


def _join_contacts(
    contacts: Iterable[Contact], order: Mapping[str, int], whole_of: Mapping[str, str]
) -> tuple[Contact, ...]:
    """Return the contacts of wholes; several between one pair become one."""
    merged: dict[tuple[str, str], Contact] = {}
    for contact in contacts:
        first, second = (whole_of.get(name, name) for name in contact.parts)
        if first == second:
            continue
        normals = contact.normals
        if order[first] > order[second]:
            first, second = second, first
            normals = tuple((-x, -y, -z) for x, y, z in normals)
        own = replace(contact, parts=(first, second), normals=normals)
        other = merged.get(own.parts)
        if other is not None:
            large, small = sorted((own, other), key=lambda item: -item.area_m2)
            own = replace(
                large,
                area_m2=large.area_m2 + small.area_m2,
                normals=tuple(dict.fromkeys((*large.normals, *small.normals))),
                points_m=(*large.points_m, *small.points_m),
            )
        merged[own.parts] = own
    return tuple(merged[pair] for pair in sorted(merged, key=lambda p: (order[p[0]], order[p[1]])))


def _rename_fastener(fastener: Fastener, whole_of: Mapping[str, str]) -> Fastener:
    joins, threaded = (
        tuple(dict.fromkeys(whole_of.get(name, name) for name in names))
        for names in (fastener.joins, fastener.threaded_in)
    )
    return replace(fastener, joins=joins, threaded_in=threaded)


def _build_group(
    product: Product,
    relation: Relation,
    plan: AssemblyPlan,
    group: Group,
    up: Vector,
    robot: str,
    remarks: Mapping[str, Sequence[str]],
    watch: Watch,
    cuts: Cuts,
    nesting: bool,
) -> WrittenTask | None:
    """Return the task that builds a group by itself, or None if one arm cannot."""
    members = group.parts
    kept = {*members}
    parts = tuple(part for part in product if part.name in kept)
    own = _restrict(relation, kept)
    steps = tuple(step for step in plan.steps if len(step.parts) == 1 and {*step.parts} <= kept)
    alone = replace(product, parts=parts)
    task = build_task(
        alone,
        own,
        replace(plan, base=members[0], steps=steps, subassemblies=()),
        robot,
        find_bearing(alone, own, up),
        None,
        remarks,
        watch=watch,
        cuts=cuts,
        nesting=nesting,
    )
    entries = task.document.get("parts", {}).values()
    stays = not any(entry.get("fixed") for entry in entries) and not task.document.get("holders")
    return task if task.skills and len(task.names) == len(members) and stays else None


class _Merger:
    """Merges the task of a product with that of one of its groups.

    Parameters
    ----------
    name
        Name of the group's whole in `whole`.
    own
        Task of the group alone.
    """

    def __init__(
        self, joined: Joined, product: Product, name: str, whole: WrittenTask, own: WrittenTask
    ) -> None:
        self._joined, self._product, self._name = joined, product, name
        self._whole, self._own = whole, own
        self._key = whole.names[name]
        self._members = list_brought(own.skills)
        part = joined.product.part(name)
        self._part, self._station = part, np.asarray(own.upright.bottom(part))
        self._nest = None if own.nest is None else _rename_nest(own.nest, self._name_nest())

    def _name_nest(self) -> str:
        documents = self._whole.document, self._own.document
        nouns = (noun for document in documents for noun in document.values())
        taken = {name for noun in nouns if isinstance(noun, Mapping) for name in noun}
        return find_free_name(f"{self._key}_nest", taken)

    def merge(self) -> WrittenTask | None:
        """Return the merged task, its order unchecked; None if names or places do not fit."""
        document, own = dict(self._whole.document), self._own.document
        entry = dict(document["parts"][self._key])
        places = self._lay_out()
        clash = any(
            document.get(key, {}).keys() & own.get(key, {}).keys()
            for key in ("parts", "screws", "feeders")
        )
        if places is None or clash or "start_m" not in entry:
            return None
        move = np.asarray([*(entry["start_m"][:2] - self._station[:2]), 0.0])
        parts = {
            name: self._move_part(name, member, move, places)
            for name, member in own["parts"].items()
        }
        screws = {
            name: member | {"hole_m": _shift(member["hole_m"], move)}
            for name, member in own.get("screws", {}).items()
        }
        others = {key: value for key, value in document["parts"].items() if key != self._key}
        document["parts"] = others | parts | {self._key: self._build_whole(entry)}
        document["screws"] = document.get("screws", {}) | screws
        feeders = {
            name: feeder | {"position_m": list(places[name])}
            for name, feeder in own.get("feeders", {}).items()
        }
        document["feeders"] = document.get("feeders", {}) | feeders
        if self._nest is not None:
            assert self._own.nest is not None
            fixture = dict(own["fixtures"][self._own.nest.name])
            files = self._nest.entry["files"]
            fixture["meshes"] = [{"file": files["obj"], "pieces": files["pieces_obj"]}]
            fixture["at_m"] = _shift(fixture["at_m"], move)
            document["fixtures"] = document.get("fixtures", {}) | {self._nest.name: fixture}
        document["tools"] = _merge_tools(document["tools"], own["tools"])
        heights = [task["robot"]["safe_height_m"] for task in (document, own)]
        document["robot"] = document["robot"] | {"safe_height_m": max(heights)}
        document = {key: value for key, value in document.items() if value != {}}
        return self._describe(document)

    def _move_part(
        self, name: str, entry: Mapping[str, Any], move: Any, places: Mapping[str, Any]
    ) -> dict[str, Any]:
        moved = {**entry, "goal_m": _shift(entry["goal_m"], move)}
        if self._nest is not None and "goal_on" in entry:
            assert self._own.nest is not None
            renamed = {self._own.nest.name: self._nest.name}
            moved["goal_on"] = [renamed.get(other, other) for other in entry["goal_on"]]
        if "start_m" in entry:
            moved["start_m"] = [*places[name], *entry["start_m"][2:]]
        return moved

    def _build_whole(self, entry: Mapping[str, Any]) -> dict[str, Any]:
        """Return the entry of the whole, whose frame is at its first part's goal."""
        first = self._members[0]
        offset = np.asarray(self._own.document["parts"][first]["goal_m"]) - self._station
        gone = ("mass_kg", "meshes", "start_m", "fits", "grasp")
        built = {key: value for key, value in entry.items() if key not in gone}
        built["goal_m"] = _shift(entry["goal_m"], offset)
        grasps = entry.get("grasp", {})
        if grasps != "auto":
            single = isinstance(grasps, Mapping)
            moved = [
                {**grasp, "at_m": _shift(grasp.get("at_m", (0.0, 0.0)), -offset)}
                for grasp in ([grasps] if single else grasps)
            ]
            built["grasp"] = moved[0] if single else moved
        return {"made_of": list(self._members), **built}

    def _lay_out(self) -> dict[str, tuple[float, float]] | None:
        """Return places for the starts of the group's parts; None if the table has none left."""
        document, upright = self._whole.document, self._whole.upright
        items, places = [], {}
        parts = (*self._product, *self._joined.product)
        sizes = {part.name: upright.size(part) for part in parts}
        for name, key in self._whole.names.items():
            entry = document["parts"].get(key) or document["screws"][key]
            feeder = entry.get("feeder")
            place = document["feeders"][feeder]["position_m"] if feeder else entry.get("start_m")
            if place is not None:
                x, y, z = (float(value) for value in sizes[name])
                if name == self._name:
                    z = max(z, _TALL_M)
                    if self._nest is not None:
                        x, y = (value / 1e3 for value in self._nest.entry["size_mm"][:2])
                items.append(Item(feeder or key, (x, y, z)))
                places[feeder or key] = (float(place[0]), float(place[1]))
        for name, key in self._own.names.items():
            entry = self._own.document["parts"].get(key) or self._own.document["screws"][key]
            part = self._product.part(name)
            x, y, z = (float(value) for value in upright.size(part))
            items.append(Item(entry.get("feeder") or key, (x, y, z)))
        items = list({item.name: item for item in items}.values())
        points = [
            upright.vertices(part)
            for part in self._joined.product
            if part.name in self._whole.names
        ]
        x, y, z = (float(extent) for extent in np.ptp(np.concatenate(points), axis=0))
        tools = _merge_tools(document["tools"], self._own.document["tools"])
        holders = [tuple(tool["holder_m"][:2]) for tool in tools.values() if "holder_m" in tool]
        robot = document["robot"]["model"]
        tray = lay_out_table((x, y, z), items, robot, [*HOLDERS, *holders], places)
        return None if tray.without else tray.places

    def _describe(self, document: dict[str, Any]) -> WrittenTask:
        whole, own, members = self._whole, self._own, self._joined.groups[self._name]
        names = {name: key for name, key in whole.names.items() if name != self._name}
        names |= own.names
        left_out = {name: why for name, why in whole.left_out.items() if name not in members}
        limits = {name: lines for name, lines in whole.limits.items() if name != self._name}
        limits |= own.limits
        for name in members:
            limits[name] = (*limits.get(name, ()), _BUILT.format(whole=self._key))
        meshes = whole.document["parts"][self._key]["meshes"]
        gone = {mesh.get(key) for mesh in meshes for key in ("file", "pieces")}
        files = {path: text for path, text in whole.files.items() if path not in gone}
        files |= {path: text for path, text in own.files.items() if path.startswith("meshes/")}
        nests = whole.station_nests
        if self._nest is not None:
            nests += (self._nest,)
            files |= {
                path: text for path, text in self._nest.files.items() if isinstance(text, str)
            }
        count = f"{len(names)} of {len(self._product)} parts"
        document["product_parts"] = len(self._product)
        document["description"] = f"{count} of {self._product.name}, from CAD."
        files["product.yaml"] = format_task(document, left_out, limits)
        order = [name for name in whole.bearing.order if name != self._name]
        bearing = replace(
            whole.bearing,
            order=(*own.bearing.order, *order),
            on={name: whole.bearing.on.get(name, ()) for name in order} | dict(own.bearing.on),
        )
        kept = whole.pieces.of([name for name in whole.names if name != self._name])
        pieces = ProvedPieces(
            {**kept.pieces, **own.pieces.pieces},
            (*kept.cut_back, *own.pieces.cut_back),
            (*kept.differences, *own.pieces.differences),
            {**kept.fits, **own.pieces.fits},
        )
        skills = (*own.skills, *whole.skills)
        return replace(
            whole,
            document=document,
            files=files,
            names=names,
            limits=limits,
            left_out=left_out,
            pieces=pieces,
            bearing=bearing,
            skills=skills,
            station_nests=nests,
        )


def _rename_nest(nest: TaskNest, name: str) -> TaskNest:
    """Return a nest with another name of its fixture and its files."""

    def rename(path: str) -> str:
        return path.replace(f"/{nest.name}.", f"/{name}.")

    paths = {kind: rename(path) for kind, path in nest.entry["files"].items()}
    entry = {**nest.entry, "name": name, "files": paths}
    files = {rename(path): content for path, content in nest.files.items()}
    return replace(nest, name=name, files=files, entry=entry)


def _confirm(task: WrittenTask, watch: Watch) -> WrittenTask:
    """Return a task with its order if `swept` accepts the whole of it; without skills if not."""
    with TaskTrials(watch) as trials:
        trial = trials.confirm(task.document, task.files, list_brought(task.skills))
    return replace(task, skills=trial.skills, doubt=trial.doubt)


def _merge_tools(tools: Mapping[str, Any], others: Mapping[str, Any]) -> dict[str, Any]:
    """Return the tools of two tasks; jaws press with the larger force, sockets are as flat."""
    merged = {name: dict(tool) for name, tool in (*tools.items(), *others.items())}
    for name in tools.keys() & others.keys():
        if "force_n" in merged[name]:
            merged[name]["force_n"] = max(tools[name]["force_n"], others[name]["force_n"])
        both = tools[name], others[name]
        depths_m = [tool["socket_depth_m"] for tool in both if "socket_depth_m" in tool]
        if depths_m:
            merged[name]["socket_depth_m"] = min(depths_m)
    return merged


def _shift(point: Sequence[float], by: Any) -> list[float]:
    return [
        round(float(value + step), _DECIMALS) + 0.0 for value, step in zip(point, by, strict=False)
    ]
