"""The task of a plan: what stands in `product.yaml`, and the meshes that it names."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import yaml

from skillplan.robots.catalogue import ARMS
from skillplan.task.pose import DOWN
from skillplan_cad.planning.assembly_plan import AssemblyPlan, Step
from skillplan_cad.product import Part, Product
from skillplan_cad.relation import Fastener, Relation
from skillplan_cad.writing.bearing import Bearing
from skillplan_cad.writing.held_part import CUP, GRIPPER, grip_n, held_part
from skillplan_cad.writing.mesh_text import obj_text, pieces_text
from skillplan_cad.writing.names import task_names
from skillplan_cad.writing.pieces_proof import ProvedPieces, proved_pieces
from skillplan_cad.writing.plan_limits import plan_limits
from skillplan_cad.writing.screw_entry import screw_entry
from skillplan_cad.writing.top_grasp import Meshes
from skillplan_cad.writing.tray import HOLDERS, HOME, Item, Tray, tray
from skillplan_cad.writing.upright import Upright, standing

DRIVER = "screwdriver"
_DRIVEN = ("screw", "nut")
_MOST_WAYS = 3
_BELOW_SHANK_M = 0.01
# A direction that points up by less is level.
_LEVEL = 1e-6
_LEAST_SAFE_M = 0.15
_ABOVE_PRODUCT_M = 0.05

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
    pieces
        Convex pieces of the parts, by their names in the product, and what these block wrongly.
    """

    document: Mapping[str, Any]
    files: Mapping[str, str]
    names: Mapping[str, str]
    limits: Mapping[str, tuple[str, ...]]
    upright: Upright
    pieces: ProvedPieces


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
    bearing: Bearing = field(init=False)
    _meshes: dict[str, Meshes] = field(init=False, default_factory=dict)
    _put_down: set[str] = field(init=False, default_factory=set)

    def __post_init__(self) -> None:
        taken = (GRIPPER, CUP, DRIVER, self.robot, "world", "home")
        self.names = task_names((part.name for part in self.product), taken)
        # A part of a sub-assembly has a step of its own before the one in which all come.
        self.steps = {}
        for step in self.plan.steps:
            for part in step.parts:
                self.steps.setdefault(part, step)
        self.upright = standing(self.product, self.plan.up, (0.0, 0.0))
        self.bearing = Bearing(self.product, self.relation, self.upright)

    def task(self) -> WrittenTask:
        """Return it all."""
        up = self.plan.up
        gripped = self._borne()
        self._put_down = {part.name for part in gripped}
        driven = self._joining()
        groups = self._groups([*gripped, *(self._of(name) for name in driven)])
        layout = self._layout(gripped, groups)
        self.upright = standing(self.product, up, layout.product_m)
        files: dict[str, str] = {}
        parts = {self.names[part.name]: self._part(part, layout, groups, files) for part in gripped}
        screws = {
            self.names[name]: self._screw(self._of(name), fastener, groups)
            for name, fastener in driven.items()
        }
        if not parts:
            none = ProvedPieces({}, (), ())
            return WrittenTask({}, {}, self.names, self._limits(), self.upright, none)
        proved = proved_pieces(self.product, self.relation, self._meshes, self.upright)
        for part_name, per_mesh in proved.pieces.items():
            for mesh, pieces in zip(parts[self.names[part_name]]["meshes"], per_mesh, strict=True):
                if pieces:
                    mesh["pieces"] = mesh["file"].removesuffix(".obj") + ".pieces.obj"
                    files[mesh["pieces"]] = pieces_text(pieces)
        for name, words in plan_limits(self.product, self.plan, up):
            self._note(name, words)
        document = {
            "kind": "assembly",
            "name": self._name(),
            "description": f"{len(self.product)} parts of {self.product.name}, from CAD.",
            "robot": self._robot(gripped),
            "tools": self._tools(parts, screws, gripped),
            "initial_tool": GRIPPER,
            "tool_change": {"style": "swap"},
            "feeders": self._feeders(layout, groups),
            "parts": parts,
            "screws": screws,
            "collision": {"swept": None},
        }
        document = {key: value for key, value in document.items() if value not in ({}, None)}
        if GRIPPER not in document["tools"]:
            document["initial_tool"] = next(iter(document["tools"]))
        text = yaml.safe_dump(document, sort_keys=False, default_flow_style=None, width=100)
        files["product.yaml"] = _HEADER + text
        return WrittenTask(document, files, self.names, self._limits(), self.upright, proved)

    def _limits(self) -> Mapping[str, tuple[str, ...]]:
        return {name: tuple(lines) for name, lines in self.limits.items()}

    def _name(self) -> str:
        return next(iter(task_names([self.product.name or "product"]).values()))

    def _driven(self, part: Part) -> Fastener | None:
        """Return the fastener that a part is, if a screwdriver drives it."""
        found = self.relation.fastener(part.name)
        return found if found is not None and found.kind in _DRIVEN and found.joins else None

    def _groups(self, parts: Sequence[Part]) -> Mapping[str, str]:
        """Return for each part that has identical ones the name of their feeder."""
        found: dict[str, str] = {}
        by_shape: dict[int, list[Part]] = {}
        for part in sorted(parts, key=lambda one: self.product.index(one.name)):
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
            if part.name in self._put_down or part.name in groups:
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

    def _feeders(self, layout: Tray, groups: Mapping[str, str]) -> dict[str, Any]:
        """Return where identical parts come from; shanks of screws hang in their feeder."""
        found: dict[str, Any] = {}
        for part in self.product:
            name = groups.get(part.name)
            if name is not None and name in layout.places:
                found[name] = {"position_m": list(layout.places[name])}
                fastener = self._driven(part)
                if fastener is not None:
                    height_m = fastener.length_m + _BELOW_SHANK_M
                    found[name]["height_m"] = math.ceil(height_m * 1e3) / 1e3
        return found

    def _part(
        self, part: Part, layout: Tray, groups: Mapping[str, str], files: dict[str, str]
    ) -> dict[str, Any]:
        """Return the entry of a part, and add its mesh to the files."""
        name, bottom = self.names[part.name], np.array(self.upright.bottom(part))
        local = self.upright.vertices(part) - bottom
        held = held_part(part, local, self._middle(part), self.robot)
        for words in held.limits:
            self._note(part.name, words)
        self._meshes[part.name] = held.meshes
        entry: dict[str, Any] = dict(held.entry)
        entry["mass_kg"] = float(f"{max(part.mass_kg, 1e-6):.4g}")
        entry["meshes"] = []
        for number, (points, triangles) in enumerate(held.meshes, 1):
            path = f"meshes/{name}{f'_{number}' if len(held.meshes) > 1 else ''}.obj"
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
        on = [other for other in self.bearing.flat_on(part.name) if self._comes_before(other, part)]
        if on:
            entry["goal_on"] = [self.names[other] for other in on]
        ways = self._ways(part)
        if ways != [[0.0, 0.0, -1.0]]:
            entry["insert_along"] = ways
        return entry

    def _middle(self, part: Part) -> tuple[float, float]:
        """Return where the centre of mass of a part is beside the centre of its bottom, x y."""
        centre = self.upright.matrix @ np.asarray(part.centre_m) + self.upright.offset_m
        middle = centre - np.array(self.upright.bottom(part))
        return float(middle[0]), float(middle[1])

    def _borne(self) -> list[Part]:
        """Return the parts that a hand puts down; note what is left out, or has to wait."""
        names = [part.name for part in self.product if not self._driven(part)]
        borne = self.bearing.borne(names)
        for name in names:
            if name not in borne:
                into = self.bearing.hangs_in(name)
                words = f"hangs in {', '.join(into)}" if into else "touches nothing"
                self._note(name, f"{words}, with nothing beneath it: it is left out of the task")
        order = sorted(borne, key=self._place)
        for name, later in self.bearing.waits_for(order).items():
            high_mm = self.bearing.height_m(name) * 1e3
            self._note(
                name,
                f"lies on nothing before {later} is there: it needs a stand, its lowest point "
                f"{high_mm:.1f} mm above the table",
            )
        return [part for part in self.product if part.name in borne]

    def _joining(self) -> Mapping[str, Fastener]:
        """Return the screws that join what is in the task, and note which do not."""
        found: dict[str, Fastener] = {}
        for part in self.product:
            fastener = self._driven(part)
            if fastener is None:
                continue
            joined = [one for one in fastener.joins if not self._driven(self._of(one))]
            missing = [one for one in joined if one not in self._put_down]
            if missing:
                self._note(part.name, f"joins {', '.join(missing)}, and is left out with it")
            else:
                found[part.name] = fastener
        return found

    def _place(self, name: str) -> int:
        """Return when a part comes; the base is first."""
        for number, step in enumerate(self.plan.steps):
            if name in step.parts:
                return number + 1
        return 0

    def _comes_before(self, name: str, part: Part) -> bool:
        """Whether another part is there, and is put down, before one."""
        is_put_down = not self._driven(self._of(name)) and name in self._put_down
        return is_put_down and self._place(name) < self._place(part.name)

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
            vectors = [vector for vector in vectors if vector[2] < _LEVEL]
            if vectors:
                best = min(vectors, key=_height)
                if not any(np.allclose(best, one, atol=1e-6) for one in found):
                    found.append(list(best))
        return found[:_MOST_WAYS]

    def _screw(self, part: Part, fastener: Fastener, groups: Mapping[str, str]) -> dict[str, Any]:
        """Return the entry of a screw, and note where it is driven from below."""
        lies = [one for one in fastener.joins if self._driven(self._of(one)) is None]
        through = self.names[lies[0] if lies else fastener.joins[0]]
        entry = screw_entry(part, fastener, self.relation, self.upright)
        if entry.get("axis", DOWN)[2] > _LEVEL:
            self._note(part.name, "is driven from below: the product has to be turned over")
        fed = {"feeder": groups[part.name]} if part.name in groups else {}
        return {"tool": DRIVER, "through": through, **entry, **fed}

    def _of(self, name: str) -> Part:
        return self.product.parts[self.product.index(name)]

    def _robot(self, gripped: list[Part]) -> dict[str, Any]:
        points = np.concatenate([self.upright.vertices(part) for part in self.product])
        height = float(points[:, 2].max())
        tallest = max(float(self.upright.size(part)[2]) for part in gripped)
        safe = max(_LEAST_SAFE_M, height + _ABOVE_PRODUCT_M, tallest + _ABOVE_PRODUCT_M)
        robot = {"name": self.robot, "model": self.robot, "home_m": list(HOME)}
        return {**robot, "safe_height_m": round(safe, 3)}

    def _tools(
        self, parts: Mapping[str, Any], screws: Mapping[str, Any], gripped: Sequence[Part]
    ) -> dict[str, Any]:
        used = {entry["tool"] for entry in (*parts.values(), *screws.values())}
        kinds = {GRIPPER: "gripper", CUP: "suction", DRIVER: "screwdriver"}
        found: dict[str, Any] = {}
        for (name, kind), holder in zip(kinds.items(), HOLDERS, strict=True):
            if name in used:
                found[name] = {"type": kind, "holder_m": list(holder)}
        if GRIPPER in found:
            hand = ARMS[self.robot][1]
            found[GRIPPER]["opening_m"] = hand.opening_m
            held = [p.mass_kg for p in gripped if parts[self.names[p.name]]["tool"] == GRIPPER]
            found[GRIPPER]["force_n"] = grip_n(max(held), hand.force_n)
        return found

    def _note(self, part: str, words: str) -> None:
        self.limits.setdefault(part, []).append(words)


def _height(vector: tuple[float, float, float]) -> float:
    return vector[2]
