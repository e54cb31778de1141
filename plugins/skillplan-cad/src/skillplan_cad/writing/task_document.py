"""The task of a plan: what stands in `product.yaml`, and the meshes that it names."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import yaml

from skillplan_cad.planning.assembly_plan import AssemblyPlan, Step
from skillplan_cad.planning.bearing import Bearing, best_bearing
from skillplan_cad.product import Part, Product
from skillplan_cad.relation import Fastener, Relation
from skillplan_cad.writing.accepted import refused
from skillplan_cad.writing.arm_entries import DRIVER, robot_entry, tool_entries
from skillplan_cad.writing.held_part import CUP, GRIPPER, held_part
from skillplan_cad.writing.mesh_text import obj_text, pieces_text
from skillplan_cad.writing.names import task_names
from skillplan_cad.writing.pieces_proof import ProvedPieces, proved_pieces
from skillplan_cad.writing.places import Places, places_of
from skillplan_cad.writing.plan_limits import from_below, not_straight, plan_limits
from skillplan_cad.writing.screw_entry import screw_entry
from skillplan_cad.writing.top_grasp import Meshes
from skillplan_cad.writing.upright import Upright

_MOST_WAYS = 3
_BELOW_SHANK_M = 0.01
# A direction that points up by less is level.
_LEVEL = 1e-6
_COMMENT_WIDTH = 98

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
        Of each part that is in the task its name there.
    limits
        Of parts, by their names in the product, what one arm cannot do about them.
    left_out
        Of parts that are not in the task why they are not, in words that go after a name.
    faults
        What `check` would refuse the task for, in words, and no part left out mends.
    upright
        Where the product stands.
    pieces
        Convex pieces of the parts, by their names in the product, and what these block wrongly.
    """

    document: Mapping[str, Any]
    files: Mapping[str, str]
    names: Mapping[str, str]
    limits: Mapping[str, tuple[str, ...]]
    left_out: Mapping[str, str]
    faults: tuple[str, ...]
    upright: Upright
    pieces: ProvedPieces


def task_of(
    product: Product,
    relation: Relation,
    plan: AssemblyPlan,
    robot: str = "panda",
    bearing: Bearing | None = None,
) -> WrittenTask | None:
    """Return the task of putting a product together with one arm, as `check` accepts it.

    What nothing bears is left out, what no straight move of one part brings, what is driven from
    below, and what `check` refuses after that. None where nothing is left.

    Parameters
    ----------
    product, relation, plan
        What was read and found.
    robot
        Name of an arm that skillplan knows.
    bearing
        What bears the parts; None for that of the side up with which the most parts stand. Where
        nothing is borne at all, no part is left out for that.
    """
    bearing = bearing or best_bearing(product, relation)
    left_out = {**not_straight(plan), **(bearing.why_not if bearing.order else {})}
    left_out |= from_below(relation, bearing.up)
    # Of all parts that are ever tried: leaving some out changes no other's pieces.
    proved: ProvedPieces | None = None
    while True:
        for name in relation.driven - left_out.keys():
            fastener = relation.fastener(name)
            lost = [one for one in fastener.joins if one in left_out] if fastener else []
            if lost:
                left_out[name] = f"goes through or into {lost[0]}, which is left out"
        if all(part.name in left_out or part.name in relation.driven for part in product):
            return None
        writer = _Writer(product, relation, plan, bearing, robot, left_out)
        if writer.places.without:
            words = "finds no place within the arm's reach"
            left_out |= dict.fromkeys(writer.places.without, words)
            continue
        made = writer.task(proved)
        proved = proved or made.pieces
        found = refused(made.document, made.files)
        if not found:
            return made
        owners = {own: name for name, own in made.names.items()}
        more = {
            owners[own]: f"is refused: {words.removesuffix('.')}"
            for own, words in found.items()
            if own
        }
        if not more:
            return replace(made, faults=tuple(found.values()))
        left_out |= more


@dataclass
class _Writer:
    """Writes one task."""

    product: Product
    relation: Relation
    plan: AssemblyPlan
    bearing: Bearing
    robot: str
    left_out: Mapping[str, str]
    names: Mapping[str, str] = field(init=False)
    kept: tuple[Part, ...] = field(init=False)
    limits: dict[str, list[str]] = field(init=False, default_factory=dict)
    steps: dict[str, Step] = field(init=False)
    gripped: list[Part] = field(init=False)
    places: Places = field(init=False)
    upright: Upright = field(init=False)
    _meshes: dict[str, Meshes] = field(init=False, default_factory=dict)

    def __post_init__(self) -> None:
        taken = {GRIPPER, CUP, DRIVER, self.robot, "world", "home"}
        names = task_names((part.name for part in self.product), taken)
        self.names = {name: own for name, own in names.items() if name not in self.left_out}
        self.kept = tuple(part for part in self.product if part.name in self.names)
        # A part of a sub-assembly has a step of its own before the one in which all come.
        self.steps = {}
        for step in self.plan.steps:
            for part in step.parts:
                self.steps.setdefault(part, step)
        self.gripped = [part for part in self.kept if not self._driven(part)]
        known, up = taken | set(self.names.values()), self.bearing.up
        self.places = places_of(self.kept, self.gripped, self.names, known, up, self.robot)
        self.upright = self.places.upright

    def task(self, proved: ProvedPieces | None = None) -> WrittenTask:
        """Return it all; convex pieces are made unless they are known."""
        up, gripped = self.bearing.up, self.gripped
        files: dict[str, str] = {}
        parts = {self.names[part.name]: self._part(part, files) for part in gripped}
        screws = {
            self.names[part.name]: self._screw(part, fastener)
            for part in self.kept
            if (fastener := self._driven(part)) is not None
        }
        if proved is None:
            proved = proved_pieces(self.product, self.relation, self._meshes, self.upright)
        proved = proved.of(self._meshes)
        for part_name, per_mesh in proved.pieces.items():
            for mesh, pieces in zip(parts[self.names[part_name]]["meshes"], per_mesh, strict=True):
                if pieces:
                    mesh["pieces"] = mesh["file"].removesuffix(".obj") + ".pieces.obj"
                    files[mesh["pieces"]] = pieces_text(pieces)
        for name, words in plan_limits(self.product, self.plan, up):
            self._note(name, words)
        for name in [one for one in self.names if one in self.bearing.why_not]:
            self._note(name, self.bearing.why_not[name])
        document = {
            "kind": "assembly",
            "name": self._name(),
            "description": f"{self._count()} of {self.product.name}, from CAD.",
            "robot": robot_entry(self.robot, self.kept, gripped, self.upright),
            "tools": tool_entries(self.robot, (*parts.values(), *screws.values())),
            "initial_tool": GRIPPER,
            "tool_change": {"style": "swap"},
            "feeders": self._feeders(),
            "parts": parts,
            "screws": screws,
            "collision": {"swept": None},
        }
        document = {key: value for key, value in document.items() if value not in ({}, None)}
        if GRIPPER not in document["tools"]:
            document["initial_tool"] = next(iter(document["tools"]))
        text = yaml.safe_dump(document, sort_keys=False, default_flow_style=None, width=100)
        limits = {name: tuple(lines) for name, lines in self.limits.items()}
        files["product.yaml"] = _HEADER + _comments(self.left_out, limits) + text
        return WrittenTask(
            document, files, self.names, limits, self.left_out, (), self.upright, proved
        )

    def _count(self) -> str:
        count, all_of_them = len(self.kept), len(self.product)
        return f"{count} parts" if count == all_of_them else f"{count} of {all_of_them} parts"

    def _name(self) -> str:
        return next(iter(task_names([self.product.name or "product"]).values()))

    def _driven(self, part: Part) -> Fastener | None:
        """Return the fastener that a part is, if a screwdriver drives it."""
        return self.relation.fastener(part.name) if part.name in self.relation.driven else None

    def _feeders(self) -> dict[str, Any]:
        """Return where identical parts come from; shanks of screws hang in their feeder."""
        groups, layout = self.places.feeders, self.places.tray
        found: dict[str, Any] = {}
        for part in self.kept:
            name = groups.get(part.name)
            if name is not None and name in layout.places:
                found[name] = {"position_m": list(layout.places[name])}
                fastener = self._driven(part)
                if fastener is not None:
                    height_m = fastener.length_m + _BELOW_SHANK_M
                    found[name]["height_m"] = math.ceil(height_m * 1e3) / 1e3
        return found

    def _part(self, part: Part, files: dict[str, str]) -> dict[str, Any]:
        """Return the entry of a part, and add its mesh to the files."""
        name, bottom = self.names[part.name], np.array(self.upright.bottom(part))
        local = self.upright.vertices(part) - bottom
        ways = self._ways(part)
        down = ways == [[0.0, 0.0, -1.0]]
        sunk_m = max(0.0, self._sunk_m(part) - float(bottom[2])) if down else 0.0
        centre = self.upright.matrix @ np.asarray(part.centre_m) + self.upright.offset_m - bottom
        held = held_part(part, local, (float(centre[0]), float(centre[1])), self.robot, sunk_m)
        for words in held.limits:
            self._note(part.name, words)
        meshes = held.meshes
        self._meshes[part.name] = meshes
        entry: dict[str, Any] = {**held.entry}
        entry["mass_kg"] = float(f"{max(part.mass_kg, 1e-6):.4g}")
        entry["meshes"] = []
        for number, (points, triangles) in enumerate(meshes, 1):
            path = f"meshes/{name}{f'_{number}' if len(meshes) > 1 else ''}.obj"
            files[path] = obj_text(points, triangles)
            low, high = points.min(axis=0), points.max(axis=0)
            centre = [round(float(one), 7) + 0.0 for one in (low + high) / 2]
            entry["meshes"].append({"file": path, "centre_m": centre})
        feeder = self.places.feeders.get(part.name)
        if feeder is not None:
            entry["feeder"] = feeder
        else:
            entry["start_m"] = list(self.places.tray.places[name])
        entry["goal_m"] = [float(one) for one in bottom]
        on = [self.names[one] for one in self.bearing.on.get(part.name, ()) if one in self.names]
        if on:
            entry["goal_on"] = on
        if not down:
            entry["insert_along"] = ways
        return entry

    def _sunk_m(self, part: Part) -> float:
        """Return up to which height a part is in what came before it, 0 for on the table [m]."""
        order = self.bearing.order
        before = order[: order.index(part.name)] if part.name in order else ()
        heights = [
            self.upright.point(point)[2]
            for contact in self.relation.contacts
            if part.name in contact.parts and any(other in before for other in contact.parts)
            for point in contact.points_m
        ]
        return max(heights, default=0.0)

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

    def _screw(self, part: Part, fastener: Fastener) -> dict[str, Any]:
        """Return the entry of a screw or nut."""
        lies = [one for one in fastener.joins if self._driven(self._of(one)) is None]
        through = self.names[lies[0] if lies else fastener.joins[0]]
        entry = screw_entry(part, fastener, self.relation, self.upright)
        feeders = self.places.feeders
        fed = {"feeder": feeders[part.name]} if part.name in feeders else {}
        return {"tool": DRIVER, "through": through, **entry, **fed}

    def _of(self, name: str) -> Part:
        return self.product.parts[self.product.index(name)]

    def _note(self, part: str, words: str) -> None:
        self.limits.setdefault(part, []).append(words)


def _comments(left_out: Mapping[str, str], limits: Mapping[str, tuple[str, ...]]) -> str:
    """Return as comments what is left out, and what one arm cannot do."""
    told = [f"Left out: {name} {words}." for name, words in left_out.items()]
    told += [f"Beware: {name} {words}." for name, lines in limits.items() for words in lines]
    wrapped = [textwrap.wrap(line, _COMMENT_WIDTH, break_long_words=False) for line in told]
    return "".join(f"# {line}\n" for lines in wrapped for line in lines)


def _height(vector: tuple[float, float, float]) -> float:
    return vector[2]
