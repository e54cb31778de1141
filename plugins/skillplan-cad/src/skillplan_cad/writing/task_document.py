"""The task of a plan: what stands in `product.yaml`, and the meshes that it names."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import yaml

from skillplan.robots.catalogue import ARMS
from skillplan_cad.planning.assembly_plan import AssemblyPlan, Step
from skillplan_cad.product import Part, Points, Product
from skillplan_cad.relation import Fastener, Relation
from skillplan_cad.writing.mesh_text import obj_text
from skillplan_cad.writing.names import task_names
from skillplan_cad.writing.suction_spot import suction_spot
from skillplan_cad.writing.top_grasp import Meshes, top_grasp
from skillplan_cad.writing.tray import HOLDERS, HOME, Item, Tray, tray
from skillplan_cad.writing.upright import Upright, standing

GRIPPER, CUP, DRIVER = "gripper", "suction_cup", "screwdriver"
_DRIVEN = ("screw", "nut")
_PLAY_M = 0.004
_MOST_WAYS = 3
_FLAT = 0.999
_LEAST_SAFE_M = 0.15
_ABOVE_PRODUCT_M = 0.05
# What their makers have arms carry, the hand of 0.7 kg included.
_CARRIES_KG = {"panda": 3.0, "ur5e": 5.0}
_HAND_KG = 0.7

_HEADER = """\
# yaml-language-server: $schema=assembly.schema.json
# Written by skillplan import-cad from CAD. Meshes are in metres, in the frame of each part.
# skillplan check FILE, chart FILE and search-optimal FILE --collision swept go on from here.
"""


@dataclass(frozen=True, slots=True)
class WrittenTask:
    """A task, not yet on disk.

    Parameters
    ----------
    document
        What stands in the YAML.
    files
        Contents of all files, by their path within the folder.
    names
        Of each part of the product its name in the task.
    limits
        Of parts, by their names in the product, what one arm cannot do about them.
    upright
        Where the product stands.
    """

    document: Mapping[str, Any]
    files: Mapping[str, str]
    names: Mapping[str, str]
    limits: Mapping[str, tuple[str, ...]]
    upright: Upright


def task_of(
    product: Product, relation: Relation, plan: AssemblyPlan, robot: str = "panda"
) -> WrittenTask:
    """Return the task of putting a product together with one arm.

    Parameters
    ----------
    product, relation, plan
        What was read and found.
    robot
        Name of an arm that skillplan knows.
    """
    return _Writer(product, relation, plan, robot).task()


@dataclass
class _Writer:
    """Writes one task."""

    product: Product
    relation: Relation
    plan: AssemblyPlan
    robot: str
    names: Mapping[str, str] = field(init=False)
    limits: dict[str, list[str]] = field(init=False, default_factory=dict)
    steps: dict[str, Step] = field(init=False)
    upright: Upright = field(init=False)

    def __post_init__(self) -> None:
        taken = (GRIPPER, CUP, DRIVER, self.robot, "world", "home")
        self.names = task_names((part.name for part in self.product), taken)
        # A part of a sub-assembly has a step of its own before the one in which all come.
        self.steps = {}
        for step in self.plan.steps:
            for part in step.parts:
                self.steps.setdefault(part, step)

    def task(self) -> WrittenTask:
        """Return it all."""
        up = self._up()
        self.upright = standing(self.product, up, (0.0, 0.0))
        gripped = [part for part in self.product if not self._driven(part)]
        groups = self._groups()
        layout = self._layout(gripped, groups)
        self.upright = standing(self.product, up, layout.product_m)
        files: dict[str, str] = {}
        parts = {self.names[part.name]: self._part(part, layout, groups, files) for part in gripped}
        screws = {
            self.names[part.name]: self._screw(part, fastener, groups)
            for part in self.product
            if (fastener := self._driven(part)) is not None
        }
        self._note_limits(up)
        document = {
            "kind": "assembly",
            "name": self._name(),
            "description": f"{len(self.product)} parts of {self.product.name}, from CAD.",
            "robot": self._robot(gripped),
            "tools": self._tools(parts, screws),
            "initial_tool": GRIPPER,
            "tool_change": {"style": "swap"},
            "feeders": {
                name: {"position_m": list(layout.places[name])}
                for name in layout.places
                if name in set(groups.values())
            },
            "parts": parts,
            "screws": screws,
            "collision": {"swept": None},
        }
        document = {key: value for key, value in document.items() if value not in ({}, None)}
        if GRIPPER not in document["tools"]:
            document["initial_tool"] = next(iter(document["tools"]))
        text = yaml.safe_dump(document, sort_keys=False, default_flow_style=None, width=100)
        files["product.yaml"] = _HEADER + text
        limits = {name: tuple(lines) for name, lines in self.limits.items()}
        return WrittenTask(document, files, self.names, limits, self.upright)

    def _up(self) -> tuple[float, float, float]:
        """Return what points up in most steps, in the product's frame."""
        ups = [step.up for step in self.plan.steps]
        return max(dict.fromkeys(ups), key=ups.count, default=(0.0, 0.0, 1.0))

    def _name(self) -> str:
        return next(iter(task_names([self.product.name or "product"]).values()))

    def _driven(self, part: Part) -> Fastener | None:
        """Return the fastener that a part is, if a screwdriver drives it."""
        found = self.relation.fastener(part.name)
        return found if found is not None and found.kind in _DRIVEN and found.joins else None

    def _groups(self) -> Mapping[str, str]:
        """Return for each part that has identical ones the name of their feeder."""
        found: dict[str, str] = {}
        by_shape: dict[int, list[Part]] = {}
        for part in self.product:
            by_shape.setdefault(part.shape, []).append(part)
        taken = {*self.names.values(), GRIPPER, CUP, DRIVER}
        for alike in by_shape.values():
            if len(alike) > 1:
                wanted = f"{self.names[alike[0].name]}_feeder"
                name = task_names([wanted], taken)[wanted]
                taken.add(name)
                found |= {part.name: name for part in alike}
        return found

    def _layout(self, gripped: list[Part], groups: Mapping[str, str]) -> Tray:
        items: dict[str, Item] = {}
        for part in self.product:
            name = groups.get(part.name, self.names[part.name])
            if part in gripped or part.name in groups:
                x, y, z = (float(one) for one in self.upright.size(part))
                items.setdefault(name, Item(name, (x, y, z)))
        points = np.concatenate([self.upright.vertices(part) for part in self.product])
        x, y, z = (float(one) for one in np.ptp(points, axis=0))
        layout = tray((x, y, z), list(items.values()), ARMS[self.robot][0].works_within_m)
        for part in self.product:
            if groups.get(part.name, self.names[part.name]) in layout.without:
                self._note(part.name, "finds no place within the arm's reach")
        beside = dict.fromkeys(layout.without, (0.30, -0.55))
        return Tray(layout.product_m, {**layout.places, **beside}, layout.without)

    def _part(
        self, part: Part, layout: Tray, groups: Mapping[str, str], files: dict[str, str]
    ) -> dict[str, Any]:
        """Return the entry of a part, and add its mesh to the files."""
        name, bottom = self.names[part.name], np.array(self.upright.bottom(part))
        local = self.upright.vertices(part) - bottom
        held, meshes = self._held(part, local)
        entry: dict[str, Any] = {**held}
        entry["mass_kg"] = float(f"{max(part.mass_kg, 1e-6):.4g}")
        entry["meshes"] = []
        for number, (points, triangles) in enumerate(meshes, 1):
            path = f"meshes/{name}{f'_{number}' if len(meshes) > 1 else ''}.obj"
            files[path] = obj_text(points, triangles)
            low, high = points.min(axis=0), points.max(axis=0)
            centre = [round(float(one), 7) + 0.0 for one in (low + high) / 2]
            entry["meshes"].append({"file": path, "centre_m": centre})
        feeder = groups.get(part.name)
        if feeder is not None:
            entry["feeder"] = feeder
        else:
            entry["start_m"] = list(layout.places[name])
        entry["goal_m"] = [float(one) for one in bottom]
        on = self._beneath(part)
        if on:
            entry["goal_on"] = on
        ways = self._ways(part)
        if ways != [[0.0, 0.0, -1.0]]:
            entry["insert_along"] = ways
        return entry

    def _held(self, part: Part, local: Points) -> tuple[dict[str, Any], Meshes]:
        """Return tool and grasp of a part, and its meshes: jaws if they open so far, or suction."""
        whole = ((local, part.triangles),)
        size = np.ptp(local, axis=0)
        opening_m = ARMS[self.robot][1].opening_m
        carries_kg = _CARRIES_KG.get(self.robot, min(_CARRIES_KG.values())) - _HAND_KG
        if part.mass_kg > carries_kg:
            words = f"weighs {part.mass_kg:.1f} kg, and {self.robot} carries {carries_kg:.1f} kg"
            self._note(part.name, f"{words} in its hand")
        held = top_grasp(local, part.triangles, opening_m)
        if held is not None:
            grasps = list(held.grasps)
            return {"tool": GRIPPER, "grasp": grasps if len(grasps) > 1 else grasps[0]}, held.meshes
        if float(size.min()) <= opening_m - _PLAY_M:
            return {"tool": GRIPPER, "grasp": "auto"}, whole
        centre = self.upright.matrix @ np.asarray(part.centre_m) + self.upright.offset_m
        middle = centre - np.array(self.upright.bottom(part))
        spot = suction_spot(local, part.triangles, (float(middle[0]), float(middle[1])))
        if spot is None:
            wide_mm = float(size[:2].min()) * 1e3
            self._note(
                part.name,
                f"is {wide_mm:.0f} mm wide, more than jaws open, and has no flat top for a cup",
            )
            return {"tool": CUP}, whole
        return {"tool": CUP, "grasp": {"at_m": list(spot)}}, whole

    def _beneath(self, part: Part) -> list[str]:
        """Return what a part lies on with a flat face, by its name in the task."""
        found = []
        for contact in self.relation.contacts:
            if part.name not in contact.parts or contact.kind != "plane":
                continue
            first = contact.parts[0] == part.name
            other = contact.parts[1] if first else contact.parts[0]
            heights = [self.upright.vector(normal)[2] for normal in contact.normals]
            down = any(height < -0.999 if first else height > 0.999 for height in heights)
            if down and not self._driven(self.product.parts[self.product.index(other)]):
                found.append(self.names[other])
        return found

    def _ways(self, part: Part) -> list[list[float]]:
        """Return the directions in which a part comes: that of the plan, then others it has."""
        step = self.steps.get(part.name)
        if step is None or part.name not in step.parts:
            return [[0.0, 0.0, -1.0]]
        found = [list(self.upright.vector(step.along))]
        directions = self.relation.directions
        number = self.product.index(part.name)
        for alternative in self.plan.precedence.minimal(number):
            vectors = [
                self.upright.vector((-x, -y, -z))
                for direction in alternative.directions
                if direction < len(directions)
                for x, y, z in (directions[direction],)
            ]
            vectors = [vector for vector in vectors if vector[2] < 1e-6]
            if vectors:
                best = min(vectors, key=_height)
                if not any(np.allclose(best, one, atol=1e-6) for one in found):
                    found.append(list(best))
        return found[:_MOST_WAYS]

    def _screw(self, part: Part, fastener: Fastener, groups: Mapping[str, str]) -> dict[str, Any]:
        """Return the entry of a screw."""
        axis = np.asarray(fastener.axis)
        along = part.vertices_m @ axis
        seat = self._seat(part, fastener)
        point = np.asarray(fastener.point_m)
        mouth = point + (seat - float(point @ axis)) * axis
        apart = part.vertices_m - point
        radius = float(np.linalg.norm(apart - np.outer(apart @ axis, axis), axis=1).max())
        into = self.upright.vector((-float(axis[0]), -float(axis[1]), -float(axis[2])))
        entry: dict[str, Any] = {
            "tool": DRIVER,
            "hole_m": list(self.upright.point((float(mouth[0]), float(mouth[1]), float(mouth[2])))),
            "through": self._through(fastener),
            "head_diameter_m": round(2 * radius, 6),
            "head_height_m": round(float(along.max()) - seat, 6),
            "mass_kg": float(f"{max(part.mass_kg, 1e-6):.4g}"),
        }
        if into != (0.0, 0.0, -1.0):
            entry["axis"] = list(into)
            if into[2] > 1e-6:
                self._note(part.name, "is driven from below: the product has to be turned over")
        if part.name in groups:
            entry["feeder"] = groups[part.name]
        return entry

    def _seat(self, part: Part, fastener: Fastener) -> float:
        """Return where along a fastener's axis its head rests: where it touches what it joins."""
        axis = np.asarray(fastener.axis)
        for contact in self.relation.contacts:
            if {part.name, fastener.joins[0]} != set(contact.parts) or not contact.points_m:
                continue
            if any(abs(float(np.dot(normal, axis))) > _FLAT for normal in contact.normals):
                return float(np.median(np.asarray(contact.points_m) @ axis))
        return float((part.vertices_m @ axis).min()) + fastener.length_m

    def _through(self, fastener: Fastener) -> str:
        """Return the part that a head rests on."""
        for name in fastener.joins:
            if self._driven(self.product.parts[self.product.index(name)]) is None:
                return self.names[name]
        return self.names[fastener.joins[0]]

    def _robot(self, gripped: list[Part]) -> dict[str, Any]:
        points = np.concatenate([self.upright.vertices(part) for part in self.product])
        height = float(points[:, 2].max())
        tallest = max(float(self.upright.size(part)[2]) for part in gripped)
        safe = max(_LEAST_SAFE_M, height + _ABOVE_PRODUCT_M, tallest + _ABOVE_PRODUCT_M)
        robot = {"name": self.robot, "model": self.robot, "home_m": list(HOME)}
        return {**robot, "safe_height_m": round(safe, 3)}

    def _tools(self, parts: Mapping[str, Any], screws: Mapping[str, Any]) -> dict[str, Any]:
        used = {entry["tool"] for entry in (*parts.values(), *screws.values())}
        kinds = {GRIPPER: "gripper", CUP: "suction", DRIVER: "screwdriver"}
        found: dict[str, Any] = {}
        for (name, kind), holder in zip(kinds.items(), HOLDERS, strict=True):
            if name in used:
                found[name] = {"type": kind, "holder_m": list(holder)}
        if GRIPPER in found:
            found[GRIPPER]["opening_m"] = ARMS[self.robot][1].opening_m
        return found

    def _note(self, part: str, words: str) -> None:
        self.limits.setdefault(part, []).append(words)

    def _note_limits(self, up: tuple[float, float, float]) -> None:
        """Note what one arm cannot do of the plan."""
        for step in self.plan.steps:
            for part in step.parts:
                if len(step.parts) > 1:
                    others = ", ".join(name for name in step.parts if name != part)
                    self._note(part, f"comes as one with {others}, put together apart before")
                if step.path:
                    self._note(part, f"comes by {len(step.path)} moves, not by a straight one")
                if step.up != up:
                    self._note(part, "comes after the product was turned over")
        for name in (one.name for one in self.product):
            steps = [step for step in self.plan.steps if name in step.held]
            if steps:
                words = [" with ".join(step.parts) for step in (steps[0], steps[-1])]
                until = f" until that of {words[1]}" if len(steps) > 1 else ""
                self._note(name, f"must be held from the step of {words[0]}{until}")
        for stuck in self.plan.stuck:
            self._note(stuck.part, f"cannot be taken out: {stuck.search.outcome}")


def _height(vector: tuple[float, float, float]) -> float:
    return vector[2]
