"""A pybullet world: the table and the bodies of a scene near a motion."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from types import TracebackType
from typing import Any

import numpy as np
import pybullet
from numpy.typing import NDArray

from skillplan.task.scene import Body, Pose, name_shank
from skillplan.task.shape import Box, Cylinder, Mesh, Shape
from skillplan_pinocchio.mass_properties import MassProperties, compute_mass_properties
from skillplan_pybullet.quiet_output import quiet_output
from skillplan_simulation import simulator
from skillplan_simulation.simulator import (
    CARRIER_KG,
    CARRIER_KG_M2,
    GRAVITY_M_PER_S2,
    ROBOT,
    STEP_S,
    TABLE,
    Touch,
    compute_speeds,
)

_TYPES = {Box: pybullet.GEOM_BOX, Cylinder: pybullet.GEOM_CYLINDER, Mesh: pybullet.GEOM_MESH}
# Minimum moment of inertia of a part: below it, parts between two jaws oscillate at 240 steps a
# second until they fall out.
_LEAST_INERTIA_KG_M2 = 2e-5
# Maximum number of shapes of a body; with more, pybullet writes out of bounds and crashes.
_MOST_SHAPES = 16
_SIDES = 64
# Link of a screw that is its shank.
_SHANK_LINK = 0


def make_body(
    client: int,
    solid: Sequence[Shape],
    *,
    mass_kg: float,
    centre: NDArray[np.float64],
    shank: Shape | None = None,
) -> int:
    """Make a body whose origin is its centre of mass; return its number.

    Parameters
    ----------
    solid
        Collision shapes. Meshes that are not convex collide exactly, but only with mass 0.
    mass_kg
        Mass [kg]; 0 for a fixed body.
    centre
        Centre of mass in the frame of the shapes [m], shape (3,).
    shank
        Shank of a screw: a link of its own, which passes through others than the head does.
    """
    # pybullet reads meshes from files only.
    has_mesh = any(isinstance(shape, Mesh) for shape in solid)
    bundles = _bundle_shapes(solid)
    with (
        TemporaryDirectory()
        if has_mesh or len(solid) > _MOST_SHAPES
        else nullcontext("") as folder,
        quiet_output(),
    ):
        firsts = [bundle[0] for bundle in bundles]
        collision = pybullet.createCollisionShapeArray(
            shapeTypes=[_TYPES[type(shape)] for shape in firsts],
            halfExtents=[[extent / 2 for extent in shape.box.size] for shape in firsts],
            radii=[getattr(shape, "diameter_m", 1.0) / 2 for shape in firsts],
            lengths=[shape.box.size[2] for shape in firsts],
            fileNames=[_write_meshes(bundle, Path(folder)) for bundle in bundles],
            collisionFramePositions=[(_get_origin(shape) - centre).tolist() for shape in firsts],
            flags=[_get_flags(shape) for shape in firsts],
            physicsClientId=client,
        )
        links = {} if shank is None else _make_shank_link(client, shank, centre)
        return int(pybullet.createMultiBody(mass_kg, collision, physicsClientId=client, **links))


def _make_shank_link(
    client: int, shank: Shape, centre: NDArray[np.float64]
) -> dict[str, list[Any]]:
    """Return the arguments that fix a shank to its head."""
    size = shank.box.size
    collision = pybullet.createCollisionShape(
        pybullet.GEOM_CYLINDER, radius=size[0] / 2, height=size[2], physicsClientId=client
    )
    nowhere, unturned = [0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]
    return {
        "linkMasses": [0.0],
        "linkCollisionShapeIndices": [collision],
        "linkVisualShapeIndices": [-1],
        "linkPositions": [(_get_origin(shank) - centre).tolist()],
        "linkOrientations": [unturned],
        "linkInertialFramePositions": [nowhere],
        "linkInertialFrameOrientations": [unturned],
        "linkParentIndices": [0],
        "linkJointTypes": [pybullet.JOINT_FIXED],
        "linkJointAxis": [[0.0, 0.0, 1.0]],
    }


def _bundle_shapes(shapes: Sequence[Shape]) -> list[Sequence[Shape]]:
    """Return shapes one by one; if they are too many, meshes share a file.

    Each object of a file becomes a hull, or all of them one surface if they are not convex. If
    there are too many boxes and cylinders, they become meshes, too.
    """
    if len(shapes) <= _MOST_SHAPES:
        return [(shape,) for shape in shapes]
    simple = [shape for shape in shapes if not isinstance(shape, Mesh)]
    if len(simple) > _MOST_SHAPES - 2:
        shapes = [_convert_to_mesh(shape) for shape in shapes]
        simple = []
    meshes = [shape for shape in shapes if isinstance(shape, Mesh)]
    kinds = [[mesh for mesh in meshes if mesh.convex is convex] for convex in (True, False)]
    return [*((shape,) for shape in simple), *(kind for kind in kinds if kind)]


def _convert_to_mesh(shape: Shape) -> Mesh:
    """Return a shape as a mesh: a box exactly, a cylinder as a prism."""
    if isinstance(shape, Mesh):
        return shape
    if isinstance(shape, Box):
        turns, radii = np.pi / 4 + np.arange(4) * np.pi / 2, np.array(shape.size[:2]) / np.sqrt(2)
    else:
        turns, radii = np.arange(_SIDES) * 2 * np.pi / _SIDES, np.full(2, shape.diameter_m / 2)
    outline = np.stack([radii[0] * np.cos(turns), radii[1] * np.sin(turns)], axis=1)
    half, count = shape.box.size[2] / 2, len(turns)
    rings = [np.column_stack([outline, np.full(count, z)]) for z in (-half, half)]
    corners = np.concatenate(rings) + np.array(shape.centre)
    after = [(number + 1) % count for number in range(count)]
    faces = [(a, b, count + b) for a, b in enumerate(after)]
    faces += [(a, count + b, count + a) for a, b in enumerate(after)]
    faces += [(0, b + 1, b) for b in range(1, count - 1)]
    faces += [(count, count + b, count + b + 1) for b in range(1, count - 1)]
    return Mesh(tuple((float(x), float(y), float(z)) for x, y, z in corners), tuple(faces))


def _get_flags(shape: Shape) -> int:
    """Return pybullet's flags for a shape."""
    is_hollow = isinstance(shape, Mesh) and not shape.convex
    return int(pybullet.GEOM_FORCE_CONCAVE_TRIMESH) if is_hollow else 0


def _get_origin(shape: Shape) -> NDArray[np.float64]:
    """Return the origin of a shape's geometry; a mesh is in the frame of its body."""
    return np.zeros(3) if isinstance(shape, Mesh) else np.array(shape.centre)


def _write_meshes(bundle: Sequence[Shape], folder: Path) -> str:
    """Write meshes to a file if it does not exist; return its name, or "" for other shapes."""
    meshes = [shape for shape in bundle if isinstance(shape, Mesh)]
    if not meshes:
        return ""
    path = folder / f"{hash(tuple(id(mesh) for mesh in meshes)):x}.obj"
    if not path.exists():
        lines, before = [], 1
        for number, mesh in enumerate(meshes):
            lines += [f"o {number}"] if len(meshes) > 1 else []
            lines += [f"v {x!r} {y!r} {z!r}" for x, y, z in mesh.corners]
            lines += [f"f {a + before} {b + before} {c + before}" for a, b, c in mesh.faces]
            before += len(mesh.corners)
        path.write_text("\n".join(lines) + "\n", "utf-8")
    return str(path)


class PairFilter:
    """Disables collisions of pairs of bodies, or of links of a body.

    Parameters
    ----------
    numbers
        Numbers of the bodies by name, kept up to date.
    """

    def __init__(self, client: int, numbers: Mapping[str, int]) -> None:
        self._client, self._numbers = client, numbers
        # Pairs that pass through each other, and links without collisions.
        self._parted: set[tuple[str, str]] = set()
        self._withdrawn: dict[str, frozenset[int]] = {}
        # Bodies that the shanks of screws pass through.
        self._passes: dict[str, tuple[str, ...]] = {}

    def pass_through(self, screw: str, others: Iterable[str]) -> None:
        """Let the shank of a screw pass through others, also through those added later."""
        self._passes[screw] = tuple(others)

    def has_shank(self, name: str) -> bool:
        """Return whether a body is a screw with a shank."""
        return name in self._passes

    def part(self, name: str, others: Iterable[str]) -> None:
        """Let a body pass through others."""
        for other in others:
            self._parted.add(_sort_pair(name, other))
            self._set_filters(name, self._links(name), other)

    def join(self, name: str, others: Iterable[str]) -> None:
        """Let a body touch others again."""
        for other in others:
            self._parted.discard(_sort_pair(name, other))
            self._set_filters(name, self._links(name), other)

    def withdraw(self, name: str, links: Iterable[int]) -> None:
        """Disable collisions of these links only, also with bodies added later.

        -1 is the link of a body without joints.
        """
        before, now = self._withdrawn.get(name, frozenset()), frozenset(links)
        self._withdrawn[name] = now
        for other in self._numbers:
            if other != name:
                self._set_filters(name, sorted(before ^ now), other)

    def added(self, body: str) -> None:
        """Apply the filters to a new or recreated body."""
        for name, links in self._withdrawn.items():
            for other in self._numbers if name == body else [body]:
                if name != other:
                    self._set_filters(name, sorted(links), other)
        for first, second in sorted(self._parted):
            if body in (first, second):
                self._set_filters(first, self._links(first), second)
        for screw, others in self._passes.items():
            for other in others:
                if body in (screw, other) and {screw, other} <= self._numbers.keys():
                    self._set_filters(screw, [_SHANK_LINK], other)

    def _links(self, name: str) -> range:
        """Return the numbers of a body's links, from -1 for its base."""
        return range(-1, pybullet.getNumJoints(self._numbers[name], physicsClientId=self._client))

    def _set_filters(self, name: str, links: Iterable[int], other: str) -> None:
        """Set which links of a body may touch another."""
        parted = _sort_pair(name, other) in self._parted
        hidden = self._withdrawn.get(name, frozenset())
        others_hidden = self._withdrawn.get(other, frozenset())
        for link in links:
            for other_link in self._links(other):
                may = not parted and link not in hidden and other_link not in others_hidden
                if self._passes:
                    may = may and not self._is_in_hole(name, link, other)
                    may = may and not self._is_in_hole(other, other_link, name)
                pybullet.setCollisionFilterPair(
                    self._numbers[name],
                    self._numbers[other],
                    link,
                    other_link,
                    int(may),
                    physicsClientId=self._client,
                )

    def _is_in_hole(self, name: str, link: int, other: str) -> bool:
        """Return whether a link is a shank that passes through another body."""
        return link == _SHANK_LINK and other in self._passes.get(name, ())


def _sort_pair(name: str, other: str) -> tuple[str, str]:
    return min(name, other), max(name, other)


# Rolling friction, per unit of the other body's friction [m]: a few tenths of a millimetre on
# plastics and metals. Without it a released round part rolls away, because pybullet keeps the point
# of contact.
_ROLLING_M = 5e-4

_TABLE_HALF_M = (1.5, 1.5, 0.05)
_SOLVER_ITERATIONS = 100
# Greatest distance [m] and speed [m/s] of a body in a simulation that has not blown up.
_FAR_M = 10.0
_FAST_M_PER_S = 50.0
# Distance below which bodies bear on each other [m]; index of the distance in pybullet's points.
_NEAR_M = 0.0005
_DISTANCE = 8
# Indices in pybullet's contacts: bodies, links, position on the first body, position and normal on
# the second, normal force, and two friction forces with their directions.
_FIRST, _SECOND, _FIRST_LINK, _SECOND_LINK, _OWN_PLACE, _PLACE = 1, 2, 3, 4, 5, 6
_NORMAL, _FORCE, _FRICTION, _OTHER_FRICTION = 7, 9, 10, 12


class World(simulator.World):
    """A table and bodies under gravity, advanced 240 times a simulated second.

    A context manager: it frees the simulator's memory at the end.
    """

    def __init__(self, friction: float) -> None:
        super().__init__(friction)
        self.names: dict[int, str] = {}
        # Names of the arm's links that handle parts.
        self.link_names: dict[int, str] = {}
        self._properties: dict[str, MassProperties] = {}
        # Bodies that are not convex, and whether they are fixed.
        self._hollow: dict[str, tuple[Body, bool]] = {}
        # Bodies that a task fixes.
        self._still: set[str] = set()
        self._pushes: dict[str, NDArray[np.float64]] = {}
        self._carrier: int | None = None
        with quiet_output():
            self.client = pybullet.connect(pybullet.DIRECT)
            pybullet.setTimeStep(STEP_S, physicsClientId=self.client)
            pybullet.setGravity(0, 0, -GRAVITY_M_PER_S2, physicsClientId=self.client)
            pybullet.setPhysicsEngineParameter(
                numSolverIterations=_SOLVER_ITERATIONS, physicsClientId=self.client
            )
            table = pybullet.createMultiBody(
                0,
                pybullet.createCollisionShape(
                    pybullet.GEOM_BOX, halfExtents=_TABLE_HALF_M, physicsClientId=self.client
                ),
                basePosition=(0, 0, -_TABLE_HALF_M[2]),
                physicsClientId=self.client,
            )
        pybullet.changeDynamics(table, -1, lateralFriction=friction, physicsClientId=self.client)
        self.filters: PairFilter = PairFilter(self.client, self.numbers)
        self.name(table, TABLE)

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        with quiet_output():
            pybullet.disconnect(physicsClientId=self.client)

    def name(self, number: int, name: str) -> None:
        """Give a body of the simulator a name."""
        self.numbers[name] = number
        self.names[number] = name

    def renew(self, name: str) -> None:
        """Apply the collision filters to a body that was loaded anew."""
        self.filters.added(name)

    def step(self) -> None:
        """Advance by 1/240 s."""
        for name, force_n in self._pushes.items():
            pybullet.applyExternalForce(
                self.numbers[name],
                -1,
                force_n.tolist(),
                self.centre(name).tolist(),
                pybullet.WORLD_FRAME,
                physicsClientId=self.client,
            )
        pybullet.stepSimulation(physicsClientId=self.client)
        self.steps += 1

    def add(self, body: Body, pose: Pose, *, stands: bool = False) -> int:
        """Put a body at a pose.

        A fixed body that is not convex has its exact shape; moving ones consist of convex pieces.
        """
        properties = compute_mass_properties(body).at_least(_LEAST_INERTIA_KG_M2)
        is_fixed = body.fixed or (stands and bool(body.surfaces))
        number = make_body(
            self.client,
            body.exact_shapes if is_fixed else body.shapes,
            mass_kg=0.0 if is_fixed else body.mass_kg,
            centre=properties.centre,
            shank=None if body.shank is None else body.shank.shape,
        )
        if body.shank is not None:
            self.filters.pass_through(body.name, body.shank.unchecked)
        self._properties[body.name], self._masses[body.name] = properties, body.mass_kg
        self._hollow.pop(body.name, None)
        self._still.discard(body.name)
        if body.fixed:
            self._still.add(body.name)
        elif body.surfaces:
            self._hollow[body.name] = (body, is_fixed)
        self.name(number, body.name)
        self.filters.added(body.name)
        self.put(body.name, pose)
        details = {} if is_fixed else {"localInertiaDiagonal": properties.inertia_kg_m2.tolist()}
        if is_fixed and body.surfaces:
            # Otherwise Bullet pushes against parts that pass the edges of a hole within its play.
            details["contactProcessingThreshold"] = 0.0
        pybullet.changeDynamics(
            number,
            -1,
            **details,
            lateralFriction=self.friction,
            spinningFriction=0.001,
            rollingFriction=_get_rolling_m(body),
            restitution=0.0,
            frictionAnchor=1,
            collisionMargin=0.0,
            physicsClientId=self.client,
        )
        return number

    @property
    def fixed(self) -> frozenset[str]:
        """Bodies that are fixed now."""
        standing = {name for name, (_, fixed) in self._hollow.items() if fixed}
        return frozenset(standing | self._still)

    def stand(self, moving: Iterable[str]) -> None:
        """Fix all bodies except those to be moved; see `add`."""
        free = set(moving)
        for name, (body, is_fixed) in list(self._hollow.items()):
            if is_fixed == (name in free):
                self._remake(body, stands=not is_fixed)

    def remove(self, name: str) -> None:
        """Take a body out of the world, with all its fastenings."""
        self._release_all(name)
        number = self.numbers.pop(name)
        del self.names[number], self._properties[name], self._masses[name]
        self._hollow.pop(name, None)
        self._still.discard(name)
        with quiet_output():
            pybullet.removeBody(number, physicsClientId=self.client)

    def _remake(self, body: Body, *, stands: bool) -> None:
        """Recreate a body in place, with its fastenings."""
        pose, name = self.pose(body.name), body.name
        fastened = self._release_all(name)
        number = self.numbers.pop(name)
        del self.names[number]
        with quiet_output():
            pybullet.removeBody(number, physicsClientId=self.client)
        self.add(body, pose, stands=stands)
        for part, bearing in fastened:
            self.fasten(part, bearing)

    def push(self, name: str, force_n: NDArray[np.float64]) -> None:
        """Push the centre of a body in every step until further notice [N], shape (3,)."""
        self._pushes[name] = force_n
        if not force_n.any():
            del self._pushes[name]

    def pushed_n(self, name: str) -> NDArray[np.float64]:
        """Return the force of `push` on a body [N], shape (3,)."""
        return self._pushes.get(name, np.zeros(3))

    def put(self, name: str, pose: Pose) -> None:
        """Move a body to a pose, at rest."""
        position, orientation = self._centre_pose(name, pose)
        pybullet.resetBasePositionAndOrientation(
            self.numbers[name], position, orientation, physicsClientId=self.client
        )
        pybullet.resetBaseVelocity(
            self.numbers[name], (0, 0, 0), (0, 0, 0), physicsClientId=self.client
        )

    def pose(self, name: str) -> Pose:
        """Return the pose of the centre of a body's bottom."""
        position, orientation = pybullet.getBasePositionAndOrientation(
            self.numbers[name], physicsClientId=self.client
        )
        rotation = self.rotation(orientation)
        origin = np.array(position) - rotation @ self._properties[name].centre
        norm = float(np.linalg.norm(orientation))
        x, y, z, w = (value / norm for value in orientation)
        return Pose((float(origin[0]), float(origin[1]), float(origin[2])), (x, y, z, w))

    def centre(self, name: str) -> NDArray[np.float64]:
        """Return the centre of mass of a body [m], shape (3,)."""
        position, _ = pybullet.getBasePositionAndOrientation(
            self.numbers[name], physicsClientId=self.client
        )
        return np.array(position)

    def velocity(self, name: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the velocity of a body's centre of mass [m/s] and its angular velocity [rad/s]."""
        linear, angular = pybullet.getBaseVelocity(self.numbers[name], physicsClientId=self.client)
        return np.array(linear), np.array(angular)

    def is_sane(self) -> bool:
        """Return whether every body has a finite position and a plausible speed."""
        for name in self._properties:
            position, _ = pybullet.getBasePositionAndOrientation(
                self.numbers[name], physicsClientId=self.client
            )
            linear, _ = pybullet.getBaseVelocity(self.numbers[name], physicsClientId=self.client)
            values = np.array([*position, *linear])
            if not np.isfinite(values).all() or np.abs(values[:3]).max() > _FAR_M:
                return False
            if np.abs(values[3:]).max() > _FAST_M_PER_S:
                return False
        return True

    def inertia_kg_m2(self, name: str) -> NDArray[np.float64]:
        """Return the inertia tensor about the centre of mass in world axes, shape (3, 3)."""
        _, orientation = pybullet.getBasePositionAndOrientation(
            self.numbers[name], physicsClientId=self.client
        )
        rotation = self.rotation(orientation)
        inertia: NDArray[np.float64] = rotation * self._properties[name].inertia_kg_m2 @ rotation.T
        return inertia

    def weigh(self, name: str, mass_kg: float) -> None:
        """Change the mass of a body temporarily; its shape stays."""
        properties = self._properties[name]
        factor = mass_kg / self._masses[name]
        pybullet.changeDynamics(
            self.numbers[name],
            -1,
            mass=mass_kg,
            localInertiaDiagonal=(factor * properties.inertia_kg_m2).tolist(),
            physicsClientId=self.client,
        )
        self._masses[name] = mass_kg
        self._properties[name] = replace(
            properties, inertia_kg_m2=factor * properties.inertia_kg_m2
        )

    def hold(self, name: str) -> int:
        """Fix a body in place; return the constraint for `release`."""
        number = self.numbers[name]
        position, orientation = pybullet.getBasePositionAndOrientation(
            number, physicsClientId=self.client
        )
        return int(
            pybullet.createConstraint(
                number,
                -1,
                -1,
                -1,
                pybullet.JOINT_FIXED,
                (0, 0, 0),
                (0, 0, 0),
                position,
                (0, 0, 0, 1),
                orientation,
                physicsClientId=self.client,
            )
        )

    def nearest(self, name: str, others: Iterable[str] | None = None) -> str | None:
        """Return the body that touches or is nearest to another within 0.5 mm, or None."""
        close: list[tuple[float, str]] = []
        for other in self.others(name) if others is None else sorted(others):
            points = self._find_closest(name, other, _NEAR_M)
            close += [(point[_DISTANCE], other) for point in points]
        return min(close)[1] if close else None

    def is_near(self, name: str, other: str, distance_m: float) -> bool:
        """Return whether two bodies are within a distance [m]."""
        return bool(self._find_closest(name, other, distance_m))

    def _find_closest(self, name: str, other: str, distance_m: float) -> Sequence[Any]:
        """Return the closest points of two bodies; the shanks of screws do not count."""
        numbers = self.numbers[name], self.numbers[other]
        heads = {
            f"linkIndex{side}": -1
            for side, body in (("A", name), ("B", other))
            if self.filters.has_shank(body)
        }
        points: Sequence[Any] = pybullet.getClosestPoints(
            *numbers, distance_m, physicsClientId=self.client, **heads
        )
        return points

    def touches(self) -> list[Touch]:
        """Return the contacts of the last step."""
        points = pybullet.getContactPoints(physicsClientId=self.client)
        return [self._touch(point, _PLACE) for point in points if point[_FORCE] > 0.0]

    def points_on(self, name: str) -> list[Touch]:
        """Return the contacts of a body, as it feels them, with zero forces included."""
        points = pybullet.getContactPoints(self.numbers[name], physicsClientId=self.client)
        return [self._touch(point, _OWN_PLACE) for point in points]

    def _touch(self, point: Sequence[Any], place: int) -> Touch:
        return Touch(
            self._named(point[_FIRST], point[_FIRST_LINK]),
            self._named(point[_SECOND], point[_SECOND_LINK]),
            np.array(point[place]),
            np.array(point[_NORMAL]),
            point[_FORCE],
            _compute_force(point),
        )

    def pulled_n(self, name: str, constraint: int) -> NDArray[np.float64]:
        """Return the force of a constraint on its body, fixed to the robot [N], shape (3,)."""
        pull = pybullet.getConstraintState(constraint, physicsClientId=self.client)[:3]
        # pybullet returns the force of the body on the hand, along the body's axes.
        turn, still = self.pose(name).orientation, (0.0, 0.0, 0.0, 1.0)
        turned, _ = pybullet.multiplyTransforms((0, 0, 0), turn, pull, still)
        return -np.array(turned)

    def _named(self, number: int, link: int) -> str:
        name = self.names[number]
        if name == ROBOT:
            return self.link_names.get(link, ROBOT)
        return name_shank(name) if link == _SHANK_LINK else name

    def carry(self, names: Iterable[str], pose: Pose) -> None:
        """Fix bodies to a heavy carrier at a pose, which `drive` moves."""
        if self._carrier is None:
            self._carrier = int(pybullet.createMultiBody(CARRIER_KG, physicsClientId=self.client))
            pybullet.changeDynamics(
                self._carrier,
                -1,
                localInertiaDiagonal=[CARRIER_KG_M2] * 3,
                linearDamping=0.0,
                angularDamping=0.0,
                physicsClientId=self.client,
            )
        pybullet.resetBasePositionAndOrientation(
            self._carrier, pose.position, pose.orientation, physicsClientId=self.client
        )
        self._carried += [self._bond(self.numbers[name], self._carrier) for name in names]

    def drive(self, pose: Pose, after: Pose) -> None:
        """Set the pose of the carrier, and its speed to the pose after the next step."""
        assert self._carrier is not None
        velocity, spin = compute_speeds(pose, after)
        pybullet.resetBasePositionAndOrientation(
            self._carrier, pose.position, pose.orientation, physicsClientId=self.client
        )
        pybullet.resetBaseVelocity(self._carrier, velocity, spin, physicsClientId=self.client)
        pybullet.applyExternalForce(
            self._carrier,
            -1,
            (0.0, 0.0, CARRIER_KG * GRAVITY_M_PER_S2),
            pose.position,
            pybullet.WORLD_FRAME,
            physicsClientId=self.client,
        )

    def set_down(self) -> None:
        """Release all bodies from the carrier."""
        super().set_down()
        if self._carrier is not None:
            with quiet_output():
                pybullet.removeBody(self._carrier, physicsClientId=self.client)
            self._carrier = None

    def fix(self, name: str, other: str) -> int:
        """Fix a body to another in its current pose; return the constraint for `release`."""
        return self._bond(self.numbers[name], self.numbers[other])

    def _bond(self, number: int, bearing: int) -> int:
        """Fix a body to another in its current pose; return the constraint."""
        here, there = (
            pybullet.getBasePositionAndOrientation(body, physicsClientId=self.client)
            for body in (number, bearing)
        )
        offset, turn = pybullet.multiplyTransforms(*pybullet.invertTransform(*there), *here)
        return int(
            pybullet.createConstraint(
                bearing,
                -1,
                number,
                -1,
                pybullet.JOINT_FIXED,
                (0, 0, 0),
                offset,
                (0, 0, 0),
                turn,
                (0, 0, 0, 1),
                physicsClientId=self.client,
            )
        )

    def release(self, constraint: int) -> None:
        """Remove a constraint."""
        pybullet.removeConstraint(constraint, physicsClientId=self.client)

    @staticmethod
    def rotation(orientation: tuple[float, float, float, float]) -> NDArray[np.float64]:
        """Return a quaternion (x, y, z, w) as a matrix of shape (3, 3)."""
        return np.array(pybullet.getMatrixFromQuaternion(orientation)).reshape(3, 3)

    def _centre_pose(
        self, name: str, pose: Pose
    ) -> tuple[list[float], tuple[float, float, float, float]]:
        rotation = self.rotation(pose.orientation)
        centre = np.array(pose.position) + rotation @ self._properties[name].centre
        return centre.tolist(), pose.orientation


def _get_rolling_m(body: Body) -> float:
    """Return the rolling friction of a body; 0 for boxes, which is faster."""
    return 0.0 if all(isinstance(shape, Box) for shape in body.shapes) else _ROLLING_M


def _compute_force(point: Sequence[Any]) -> NDArray[np.float64]:
    """Return the force of the second body of a contact on the first [N]."""
    # The normal points from the second body to the first.
    force: NDArray[np.float64] = point[_FORCE] * np.array(point[_NORMAL])
    for index in (_FRICTION, _OTHER_FRICTION):
        force = force + point[index] * np.array(point[index + 1])
    return force
