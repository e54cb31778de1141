"""Read a STEP file with Open CASCADE (OCCT): tree, names, healed and meshed shapes.

Runs in a process of its own, because OCCT may crash, hang or take much memory.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from io import BytesIO
from itertools import combinations
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray
from OCP.BinTools import BinTools
from OCP.Bnd import Bnd_Box
from OCP.BRep import BRep_Builder, BRep_Tool
from OCP.BRepAdaptor import BRepAdaptor_Curve, BRepAdaptor_Surface
from OCP.BRepBndLib import BRepBndLib
from OCP.BRepBuilderAPI import (
    BRepBuilderAPI_MakeSolid,
    BRepBuilderAPI_NurbsConvert,
    BRepBuilderAPI_Sewing,
)
from OCP.BRepGProp import BRepGProp
from OCP.BRepLib import BRepLib
from OCP.BRepMesh import BRepMesh_IncrementalMesh
from OCP.BRepTools import BRepTools_ReShape
from OCP.Geom import Geom_SphericalSurface
from OCP.GeomAbs import GeomAbs_SurfaceType
from OCP.gp import gp_Ax3, gp_Dir
from OCP.GProp import GProp_GProps
from OCP.IFSelect import IFSelect_ReturnStatus
from OCP.IMeshTools import IMeshTools_Parameters
from OCP.ShapeFix import ShapeFix_Face
from OCP.ShapeUpgrade import ShapeUpgrade_ShapeDivideAngle, ShapeUpgrade_ShapeDivideClosed
from OCP.STEPCAFControl import STEPCAFControl_Reader
from OCP.STEPConstruct import STEPConstruct_ExternRefs
from OCP.TCollection import TCollection_AsciiString, TCollection_ExtendedString
from OCP.TDataStd import TDataStd_Name
from OCP.TDF import TDF_Label, TDF_LabelSequence, TDF_Tool
from OCP.TDocStd import TDocStd_Document
from OCP.TopAbs import TopAbs_Orientation, TopAbs_ShapeEnum
from OCP.TopExp import TopExp_Explorer
from OCP.TopLoc import TopLoc_Location
from OCP.TopoDS import TopoDS, TopoDS_Compound, TopoDS_Face, TopoDS_Wire
from OCP.TopTools import TopTools_IndexedMapOfShape
from OCP.XCAFDoc import XCAFDoc_DocumentTool, XCAFDoc_ShapeTool

from skillplan.files.regular_file import read_bytes
from skillplan_cad.product import Face, FaceKind, Vector
from skillplan_cad.reading.mending import compute_volumes_m3, join, mend, merge_equal_vertices
from skillplan_cad.reading.names import clean_name, is_label, says_nothing
from skillplan_cad.reading.raw_part import (
    MOST_PARTS,
    Instance,
    Measure,
    Mended,
    RawPart,
    StepContent,
    compute_area_vectors_m2,
)

# OCCT converts all units to millimetres.
_MM = 1e-3
# Largest angle between chords [rad]; chord_m bounds their distance from the surface.
_TURN_RAD = 0.5
# Tolerances of sewing below the chord [mm].
_SEWING_MM = (1e-5, 1e-3)
# Largest size of a file that another refers to.
MOST_BYTES = 128 * 1024 * 1024
# Largest number of characters in a part's path.
MOST_PATH = 10_000
# Number of points along an edge at which gaps are measured; largest number of such edges.
_ALONG, _MOST_EDGES = 9, 600
# Relative error of the integral of a volume.
_INTEGRAL_ERROR = 1e-3
# Distance of points that are one [mm], relative difference of areas that are, and axes of a sphere
# with its seam that drawings rarely have.
_SAME_MM, _SAME_AREA = 1e-3, 0.01
_SEAMS = (
    ((0.3, 0.5, 0.81), (1.0, 0.1, 0.2)),
    ((0.62, -0.48, 0.3), (0.2, 0.1, -1.0)),
    ((-0.4, 0.33, 0.8), (1.0, 0.1, 0.2)),
    ((0.8, -0.3, 0.4), (0.2, 0.1, -1.0)),
    ((0.1, 0.9, -0.3), (1.0, 0.1, 0.2)),
    ((0.3, 0.5, 0.81), (-1.0, -0.1, -0.2)),
    ((0.62, -0.48, 0.3), (-0.2, -0.1, 1.0)),
    ((-0.4, 0.33, 0.8), (-1.0, -0.1, -0.2)),
)
_NAME = TDataStd_Name.GetID_s()
_EDGE, _WIRE, _FACE, _SHELL, _SOLID = (
    TopAbs_ShapeEnum.TopAbs_EDGE,
    TopAbs_ShapeEnum.TopAbs_WIRE,
    TopAbs_ShapeEnum.TopAbs_FACE,
    TopAbs_ShapeEnum.TopAbs_SHELL,
    TopAbs_ShapeEnum.TopAbs_SOLID,
)
_KINDS: dict[Any, FaceKind] = {
    GeomAbs_SurfaceType.GeomAbs_Plane: "plane",
    GeomAbs_SurfaceType.GeomAbs_Cylinder: "cylinder",
    GeomAbs_SurfaceType.GeomAbs_Cone: "cone",
    GeomAbs_SurfaceType.GeomAbs_Sphere: "sphere",
    GeomAbs_SurfaceType.GeomAbs_Torus: "torus",
}


def read_document(
    path: Path,
    chord_m: float,
    allowed: Sequence[str],
    report: Callable[[str], None],
    left_out: Mapping[int, str] = MappingProxyType({}),
    begin: Callable[[int], None] = lambda shape: None,
) -> StepContent | None:
    """Return the content of a STEP file; None if OCCT cannot read it.

    Parameters
    ----------
    chord_m
        Greatest distance of triangles from curved faces [m].
    allowed
        Names of the files in the folder of `path` that it may refer to.
    report
        Called with progress.
    left_out
        Reasons why shapes are not meshed, by their numbers.
    begin
        Called with the number of each shape before it is meshed.
    """
    reader = STEPCAFControl_Reader()
    for switch in (
        reader.SetColorMode,
        reader.SetLayerMode,
        reader.SetPropsMode,
        reader.SetGDTMode,
    ):
        switch(False)
    reader.SetNameMode(True)
    for name in allowed:
        beside = path.parent / name
        if beside.exists() and b"DOCUMENT_FILE" in read_bytes(beside, MOST_BYTES):
            stray = _find_stray_reference(STEPCAFControl_Reader(), beside, allowed)
            if stray:
                return StepContent(refused=f"refers to {stray!r}, by {name}")
    stray = _find_stray_reference(reader, path, allowed)
    if stray is None:
        return None
    if stray:
        return StepContent(refused=f"refers to {stray!r}")
    report("converting entities")
    document = TDocStd_Document(TCollection_ExtendedString("skillplan"))
    reader.Transfer(document)
    tool = XCAFDoc_DocumentTool.ShapeTool_s(document.Main())
    roots = TDF_LabelSequence()
    tool.GetFreeShapes(roots)
    tree = _Tree()
    labels = [roots.Value(number) for number in range(1, roots.Length() + 1)]
    try:
        name = tree.walk(labels)
    except ValueError as error:
        return StepContent(refused=str(error))
    shapes: list[Mended | str] = []
    for number, (design, label) in enumerate(tree.designs):
        report(f"{number + 1} of {len(tree.designs)} shapes")
        if number in left_out:
            shapes.append(left_out[number])
            continue
        begin(number)
        shapes.append(build_shape(design, XCAFDoc_ShapeTool.GetShape_s(label), chord_m * 1000))
    return StepContent(name, tuple(shapes), tuple(tree.instances), tuple(tree.list_notes()))


def _find_stray_reference(reader: Any, path: Path, allowed: Sequence[str]) -> str | None:
    """Read a file, and return a file it refers to that it may not; None if it cannot be read."""
    if reader.ReadFile(str(path)) != IFSelect_ReturnStatus.IFSelect_RetDone:
        return None
    references = STEPConstruct_ExternRefs(reader.Reader().WS())
    references.LoadExternRefs()
    names = (references.FileName(number) for number in range(1, references.NbExternRefs() + 1))
    return next((name for name in names if name not in allowed), "")


class _Tree:
    """Instances of a document, in the order of its tree."""

    def __init__(self) -> None:
        self.instances: list[Instance] = []
        self.designs: list[tuple[str, Any]] = []
        self._numbers: dict[str, int] = {}
        self._nameless: list[str] = []

    def list_notes(self) -> list[str]:
        """Return the names that were invented."""
        if not self._nameless:
            return []
        shown = ", ".join(self._nameless[:6]) + (" and others" if self._nameless[6:] else "")
        has = "part has" if len(self._nameless) == 1 else "parts have"
        return [f"{len(self._nameless)} {has} no name in the file, and got one: {shown}"]

    def walk(self, roots: Sequence[Any]) -> str:
        """Add all instances below some roots, and return the name of the product.

        Raises
        ------
        ValueError
            If there are too many parts, or paths are too long. The message is a clause.
        """
        only = len(roots) == 1
        named = self._name_siblings(roots)
        product = named[0][1] if only else ""
        above: tuple[str, ...] = () if only else ("",)
        todo = [
            (label, name, above, _read_pose(label), len(name)) for label, name in reversed(named)
        ]
        while todo:
            label, name, path, pose, length = todo.pop()
            if length > MOST_PATH:
                raise ValueError(
                    f"has a part {len(path)} assemblies deep, whose names have more than "
                    f"{MOST_PATH:,} characters"
                )
            design = _resolve(label)
            if not XCAFDoc_ShapeTool.IsAssembly_s(design):
                self._add(design, name, path, pose)
                continue
            components = TDF_LabelSequence()
            XCAFDoc_ShapeTool.GetComponents_s(design, components, False)
            children = [components.Value(number) for number in range(1, components.Length() + 1)]
            # A lone child with a generic name takes that of its assembly.
            if len(children) == 1 and path and _is_generic(children[0]):
                todo.append((children[0], name, path, pose @ _read_pose(children[0]), length))
                continue
            below = (*path, name)
            todo += [
                (child, own, below, pose @ _read_pose(child), length + 1 + len(own))
                for child, own in reversed(self._name_siblings(children))
            ]
        return product

    def _add(self, label: Any, name: str, path: tuple[str, ...], pose: NDArray[np.float64]) -> None:
        entry = TCollection_AsciiString()
        TDF_Tool.Entry_s(label, entry)
        key = entry.ToCString()
        if key not in self._numbers:
            self._numbers[key] = len(self.designs)
            self.designs.append((_read_name(label) or name, label))
        number = self._numbers[key]
        self.instances.append(Instance(number, name, self.designs[number][0], path, pose))
        if len(self.instances) > MOST_PARTS:
            raise ValueError(f"holds more than {MOST_PARTS:,} parts")

    def _name_siblings(self, labels: Sequence[Any]) -> list[tuple[Any, str]]:
        """Return labels with distinct names: their own, those of their designs, or new ones."""
        taken: set[str] = set()
        named = []
        for place, label in enumerate(labels, 1):
            name = _read_name(label)
            if says_nothing(name):
                design = _read_name(_resolve(label))
                name = design if is_label(name) or not says_nothing(design) else name
            if is_label(name):
                name = f"part_{place}"
                self._nameless.append(name)
            stem, number = name, 1
            while name in taken:
                number += 1
                name = f"{stem}#{number}"
            taken.add(name)
            named.append((label, name))
        return named


def _is_generic(label: Any) -> bool:
    names = (_read_name(label), _read_name(_resolve(label)))
    return all(map(says_nothing, names))


def _resolve(label: Any) -> Any:
    """Return the design that a component refers to, or the label itself."""
    design = TDF_Label()
    return design if XCAFDoc_ShapeTool.GetReferredShape_s(label, design) else label


def _read_name(label: Any) -> str:
    """Return the name of a label, without control characters."""
    attribute = TDataStd_Name()
    if not label.FindAttribute(_NAME, attribute):
        return ""
    return clean_name(attribute.Get().ToExtString())


def _read_pose(label: Any) -> NDArray[np.float64]:
    return _read_location(XCAFDoc_ShapeTool.GetLocation_s(label))


def _read_location(location: Any) -> NDArray[np.float64]:
    """Return a location as a matrix in metres."""
    pose = np.eye(4)
    if not location.IsIdentity():
        transformation = location.Transformation()
        pose[:3] = [
            [transformation.Value(row, column) for column in range(1, 5)] for row in range(1, 4)
        ]
        pose[:3, 3] *= _MM
    return pose


def build_shape(name: str, shape: Any, chord_mm: float) -> Mended | str:
    """Return a shape of OCCT as a mesh, healed; text if it has no surface.

    Parameters
    ----------
    chord_mm
        Greatest distance of triangles from curved faces [mm].
    """
    if shape is None or shape.IsNull():
        return "is empty"
    shape, words = _trim_folded_spheres(shape)
    _mesh(shape, chord_mm)
    solids = list(_explore(shape, _SOLID))
    loose = _list_loose(shape)
    bodies = [_build_solid(name, solid, chord_mm) for solid in solids]
    bodies = [body for body in bodies if len(body.part.triangles)]
    if not bodies and loose:
        bodies = _build_skin(name, loose, chord_mm)
        loose = []
    if not bodies:
        curves = any(True for _ in _explore(shape, _EDGE))
        return "holds only curves" if curves else "is empty"
    notes = [f"{name}: {words}"] if words else []
    if loose:
        skins = _build_skin(name, loose, chord_mm)
        bodies += [skin for skin in skins if not skin.open_edges]
        notes = [
            f"{name}: a surface of {_describe_size(skin)} mm beside its solids is left out"
            for skin in skins
            if skin.open_edges
        ]
    whole = join(name, bodies)
    return replace(whole, notes=(*whole.notes, *notes))


def _list_loose(shape: Any) -> list[Any]:
    """Return the shells and faces outside of solids."""
    return [*_explore(shape, _SHELL, _SOLID), *_explore(shape, _FACE, _SHELL)]


def _describe_size(mended: Mended) -> str:
    extents = np.ptp(mended.part.vertices_m, axis=0) * 1000
    return " x ".join(f"{extent:.4g}" for extent in extents if extent > 1e-3)


def _build_solid(name: str, solid: Any, chord_mm: float) -> Mended:
    """Return a solid as a mesh: as it is, or from another parametrisation, or sewn."""
    part, failed = _collect(name, solid)
    drawn = part.faces
    best, closed = merge_equal_vertices(part)
    used, words = solid, ""
    rank = (failed, not closed)
    for remedy, heal in _REMEDIES if rank > (0, False) else ():
        try:
            healed = heal(solid, chord_mm)
            if healed is None:
                continue
            _mesh(healed, chord_mm)
            part, missing = _collect(name, healed)
        except Exception:
            # OCCT fails on some faces, and its errors share no class; the next remedy may not.
            continue
        if heal is _convert:
            part = replace(part, faces=_keep_surfaces(part.faces, solid))
        part, now_closed = merge_equal_vertices(part)
        if (missing, not now_closed) < rank:
            rank, best, used, words = (missing, not now_closed), part, healed, remedy
            closed = now_closed
        if rank == (0, False):
            break
    whole = closed and sum(1 for _ in _explore(used, _SHELL)) == 1
    mended = mend(best, chord_mm * _MM, is_merged=True, is_one_shell=whole)
    if words:
        faces = "a face that was" if failed == 1 else f"{failed} faces that were"
        cause = f"{faces} not meshed as drawn, but" if failed else "its mesh is open as drawn, and"
        off = _compare_volume(mended, solid) if words == _BY_ANGLE else 0.0
        about = f"; its volume is {abs(off):.2g} % {'more' if off > 0 else 'less'} than drawn"
        note = f"{name}: {cause} {'' if failed else 'meshed '}from {words}"
        note += about if off else ""
        mended = replace(mended, notes=(note, *mended.notes))
    # Integrals over NURBS are less exact than those over the surfaces as drawn.
    return _measure(mended, used if words == _SEWN else solid, drawn, chord_mm)


def _trim_folded_spheres(shape: Any) -> tuple[Any, str]:
    """Return a shape without folded faces of spheres, and a clause on those trimmed anew.

    If the border of a face runs along the seam of its sphere, OCCT may take the rest of the sphere
    for it. Then it and its neighbour on the sphere face opposite sides.
    """
    spheres: list[tuple[Any, Any, bool]] = []
    for item in _explore(shape, _FACE):
        face = TopoDS.Face_s(item)
        surface = BRepAdaptor_Surface(face, False)
        if surface.GetType() == GeomAbs_SurfaceType.GeomAbs_Sphere:
            sphere = surface.Sphere()
            turned = face.Orientation() == TopAbs_Orientation.TopAbs_REVERSED
            spheres.append((face, sphere, turned == sphere.Direct()))
    folded: dict[Any, tuple[Any, bool]] = {}
    for (face, sphere, is_hollow), (other, its, is_other_hollow) in combinations(spheres, 2):
        if is_hollow == is_other_hollow:
            continue
        off_mm = sphere.Location().Distance(its.Location()) + abs(sphere.Radius() - its.Radius())
        if off_mm < _SAME_MM and _share_edge(face, other):
            larger = max(face, other, key=_measure_area_mm2)
            folded[larger] = sphere, is_hollow if larger is face else is_other_hollow
    context, count = BRepTools_ReShape(), 0
    for face, (sphere, is_hollow) in folded.items():
        rest = _trim_rest(face, sphere, is_hollow=not is_hollow)
        if rest is not None:
            context.Replace(face, rest)
            count += 1
    if not count:
        return shape, ""
    trimmed = context.Apply(shape)
    solids = [TopoDS.Solid_s(solid) for solid in _explore(trimmed, _SOLID)]
    for solid in solids:
        BRepLib.OrientClosedSolid_s(solid)
    faces = "a face of a sphere was" if count == 1 else f"{count} faces of spheres were"
    words = f"{faces} read as the rest of the sphere, on top of others, and trimmed anew"
    return _make_compound([*solids, *_list_loose(trimmed)]), words


def _share_edge(face: Any, other: Any) -> bool:
    edges = list(_explore(face, _EDGE))
    return any(own.IsSame(edge) for own in _explore(other, _EDGE) for edge in edges)


def _trim_rest(face: Any, sphere: Any, *, is_hollow: bool) -> Any:
    """Return the rest of the sphere of a face, turned over; None if OCCT cannot trim it.

    Parameters
    ----------
    is_hollow
        True if the rest faces the centre.
    """
    rest_mm2 = 4 * math.pi * sphere.Radius() ** 2 - _measure_area_mm2(face)
    tolerance_mm, builder = BRep_Tool.Tolerance_s(face), BRep_Builder()
    for axis, seam in _SEAMS:
        frame = gp_Ax3(sphere.Location(), gp_Dir(*axis), gp_Dir(*seam))
        again, edges = TopoDS_Face(), 0
        builder.MakeFace(again, Geom_SphericalSurface(frame, sphere.Radius()), tolerance_mm)
        for wire in _explore(face, _WIRE):
            border = TopoDS_Wire()
            builder.MakeWire(border)
            for edge in _explore(wire, _EDGE):
                if not BRep_Tool.Degenerated_s(TopoDS.Edge_s(edge)):
                    builder.Add(border, edge)
                    edges += 1
            border.Closed(True)
            # In the shell, edges keep their sense.
            builder.Add(again, border.Reversed() if is_hollow else border)
        fix = ShapeFix_Face(again)
        # It would take the larger side of the border for the face.
        fix.FixOrientationMode = 0
        fix.Perform()
        rest = fix.Result()
        is_whole = sum(1 for _ in _explore(rest, _EDGE)) == edges
        if is_whole and math.isclose(_measure_area_mm2(rest), rest_mm2, rel_tol=_SAME_AREA):
            return rest.Reversed() if is_hollow else rest
    return None


def _measure_area_mm2(face: Any) -> float:
    properties = GProp_GProps()
    BRepGProp.SurfaceProperties_s(face, properties)
    return float(properties.Mass())


def _keep_surfaces(faces: Sequence[Face], solid: Any) -> tuple[Face, ...]:
    """Return the faces of a converted solid with their surfaces as drawn."""
    drawn = [TopoDS.Face_s(face) for face in _explore(solid, _FACE)]
    if len(drawn) != len(faces):
        return tuple(faces)
    return tuple(
        _describe_face(original, face.triangles)
        for original, face in zip(drawn, faces, strict=True)
    )


def _build_skin(name: str, loose: Sequence[Any], chord_mm: float) -> list[Mended]:
    """Return faces outside of solids as bodies, sewn if they close."""
    compound = _make_compound(loose)
    shells, gap_m = list(loose), 0.0
    for tolerance_mm in (*_SEWING_MM, chord_mm):
        sewn = _sew(compound, tolerance_mm)
        if sewn is None:
            continue
        shells = [*_explore(sewn, _SHELL), *_explore(sewn, _FACE, _SHELL)]
        if all(BRep_Tool.IsClosed_s(shell) for shell in shells):
            if tolerance_mm > _SEWING_MM[0]:
                gap_m = _measure_gap_m(compound, tolerance_mm)
            break
    bodies = []
    for shell in shells:
        closed = shell.ShapeType() == _SHELL and BRep_Tool.IsClosed_s(shell)
        shape = _make_solid(shell) if closed else shell
        _mesh(shape, chord_mm)
        part, _ = _collect(name, shape)
        if not len(part.triangles):
            continue
        body = mend(part, chord_mm * _MM)
        bodies.append(_measure(body, shape, part.faces, chord_mm) if closed else body)
    if gap_m and bodies and not any(body.open_edges for body in bodies):
        note = f"{name}: its faces were sewn over gaps of up to {gap_m * 1000:.2g} mm"
        first = bodies[0]
        gap_m = max(gap_m, first.gap_m)
        bodies[0] = replace(first, gap_m=gap_m, notes=(note, *first.notes))
    return bodies


def _mesh(shape: Any, chord_mm: float) -> None:
    parameters = IMeshTools_Parameters()
    parameters.Deflection, parameters.Angle = chord_mm, _TURN_RAD
    parameters.Relative, parameters.InParallel = False, False
    BRepMesh_IncrementalMesh(shape, parameters)


def _explore(shape: Any, kind: Any, avoid: Any = TopAbs_ShapeEnum.TopAbs_SHAPE) -> Iterator[Any]:
    explorer = TopExp_Explorer(shape, kind, avoid)
    while explorer.More():
        yield explorer.Current()
        explorer.Next()


def _collect(name: str, shape: Any) -> tuple[RawPart, int]:
    """Return the triangles of a shape in metres, and the number of faces without triangles."""
    meshed: list[Any] = []
    places: list[Any] = []
    failed = 0
    for item in _explore(shape, _FACE):
        face, location = TopoDS.Face_s(item), TopLoc_Location()
        mesh = BRep_Tool.Triangulation_s(face, location)
        if mesh is None or not mesh.NbTriangles():
            failed += not _is_degenerate(face)
            continue
        meshed.append((face, mesh))
        places.append(location)
    points: list[Any] = [np.zeros((0, 3))]
    triangles: list[Any] = [np.zeros((0, 3), dtype=np.int64)]
    faces: list[Face] = []
    corner = first = 0
    arrays = _read_triangulations([mesh for _, mesh in meshed])
    for (face, _), location, (vertices, corners) in zip(meshed, places, arrays, strict=True):
        turned = face.Orientation() == TopAbs_Orientation.TopAbs_REVERSED
        if not location.IsIdentity():
            pose = _read_location(location)
            vertices = vertices @ pose[:3, :3].T + pose[:3, 3]
            turned ^= bool(np.linalg.det(pose[:3, :3]) < 0)
        points.append(vertices)
        triangles.append((corners[:, ::-1] if turned else corners) + (corner - 1))
        faces.append(_describe_face(face, np.arange(first, first + len(corners))))
        corner += len(vertices)
        first += len(corners)
    whole = RawPart(name, (), np.concatenate(points), np.concatenate(triangles), tuple(faces), name)
    return whole, failed


def _read_triangulations(meshes: Sequence[Any]) -> list[tuple[NDArray[Any], NDArray[Any]]]:
    """Return the corners in metres and the triangles, numbered from 1, of each triangulation.

    OCCT hands its numbers over one by one, which takes twenty times as long as its binary format.
    """
    content = _write_binary(meshes)
    heading = b"\nTriangulations %d\n" % len(meshes)
    if heading not in content:
        # The format stores a triangulation of several faces once.
        content = _write_binary([mesh.Copy() for mesh in meshes])
    at = content.index(heading) + len(heading)
    arrays = []
    for _ in meshes:
        nodes, count, has_parameters, has_normals = struct.unpack_from("<ii??", content, at)
        at += 10 + 8
        vertices = np.frombuffer(content, "<f8", 3 * nodes, at).reshape(-1, 3) * _MM
        at += 24 * nodes + 16 * nodes * has_parameters
        corners = np.frombuffer(content, "<i4", 3 * count, at).reshape(-1, 3).astype(np.int64)
        at += 12 * count + 12 * nodes * has_normals
        arrays.append((vertices, corners))
    return arrays


def _write_binary(meshes: Sequence[Any]) -> bytes:
    """Return triangulations in the binary format of OCCT."""
    builder, whole, stream = BRep_Builder(), TopoDS_Compound(), BytesIO()
    builder.MakeCompound(whole)
    for mesh in meshes:
        face = TopoDS_Face()
        builder.MakeFace(face, mesh)
        builder.Add(whole, face)
    BinTools.Write_s(whole, stream)
    return stream.getvalue()


def _is_degenerate(face: Any) -> bool:
    """Return whether a face is too small for triangles."""
    box = Bnd_Box()
    BRepBndLib.Add_s(face, box)
    return bool(box.IsVoid()) or box.SquareExtent() < 1e-10


def _describe_face(face: Any, triangles: NDArray[np.int64]) -> Face:
    """Return a face with its surface; extents are measured on its triangles later."""
    if BRep_Tool.Surface_s(face) is None:
        return Face("free", triangles)
    surface = BRepAdaptor_Surface(face, False)
    kind = _KINDS.get(surface.GetType(), "free")
    if kind == "free":
        return Face("free", triangles)
    form = getattr(surface, kind.capitalize())()
    placement = form.Position()
    place, axis = placement.Location(), placement.Direction()
    radius = minor = half_angle = 0.0
    if kind in ("cylinder", "sphere"):
        radius = form.Radius() * _MM
    elif kind == "cone":
        radius, half_angle = form.RefRadius() * _MM, form.SemiAngle()
    elif kind == "torus":
        radius, minor = form.MajorRadius() * _MM, form.MinorRadius() * _MM
    origin: Vector = (place.X() * _MM, place.Y() * _MM, place.Z() * _MM)
    direction: Vector = (axis.X(), axis.Y(), axis.Z())
    return Face(kind, triangles, origin, direction, radius, minor, half_angle)


def _divide(solid: Any, _: float) -> Any:
    divider = ShapeUpgrade_ShapeDivideClosed(solid)
    divider.Perform()
    return divider.Result()


def _convert(solid: Any, _: float) -> Any:
    return BRepBuilderAPI_NurbsConvert(solid, True).Shape()


def _divide_by_angle(solid: Any, _: float) -> Any:
    divider = ShapeUpgrade_ShapeDivideAngle(math.pi / 2)
    divider.Init(solid)
    divider.Perform()
    return divider.Result()


def _compare_volume(mended: Mended, solid: Any) -> float:
    """Return the excess of a closed mesh over the volume of its solid as drawn [%]."""
    if mended.open_edges:
        return 0.0
    properties = GProp_GProps()
    BRepGProp.VolumeProperties_s(solid, properties, _INTEGRAL_ERROR)
    drawn_m3 = properties.Mass() * _MM**3
    part = mended.part
    meshed_m3 = float(compute_volumes_m3(part.vertices_m, part.triangles).sum())
    return 100 * (meshed_m3 / drawn_m3 - 1) if drawn_m3 > 0 else 0.0


def _sew_solid(solid: Any, chord_mm: float) -> Any:
    """Return a solid whose faces are sewn anew; None if they do not close."""
    for tolerance_mm in (*_SEWING_MM, chord_mm):
        sewn = _sew(_make_compound(list(_explore(solid, _FACE))), tolerance_mm)
        shells = [] if sewn is None else list(_explore(sewn, _SHELL))
        if shells and all(BRep_Tool.IsClosed_s(shell) for shell in shells):
            return _make_compound([_make_solid(shell) for shell in shells])
    return None


_SEWN, _BY_ANGLE = "sewn faces", "faces divided by 90 degrees"
_REMEDIES = (
    ("divided faces", _divide),
    ("faces converted to NURBS", _convert),
    (_SEWN, _sew_solid),
    (_BY_ANGLE, _divide_by_angle),
)


def _sew(shape: Any, tolerance_mm: float) -> Any:
    sewing = BRepBuilderAPI_Sewing(tolerance_mm)
    sewing.Add(shape)
    try:
        sewing.Perform()
    except Exception:
        # OCCT fails on some faces, and its errors share no class.
        return None
    sewn = sewing.SewedShape()
    return None if sewn is None or sewn.IsNull() else sewn


def _make_solid(shell: Any) -> Any:
    solid = BRepBuilderAPI_MakeSolid(TopoDS.Shell_s(shell)).Solid()
    BRepLib.OrientClosedSolid_s(solid)
    return solid


def _orient(item: Any) -> Any:
    solid = TopoDS.Solid_s(item)
    BRepLib.OrientClosedSolid_s(solid)
    return solid


def _make_compound(shapes: Sequence[Any]) -> Any:
    compound, builder = TopoDS_Compound(), BRep_Builder()
    builder.MakeCompound(compound)
    for shape in shapes:
        builder.Add(compound, shape)
    return compound


def _measure(mended: Mended, shape: Any, faces: Sequence[Face], chord_mm: float) -> Mended:
    """Return a closed body with its exact measures, if they agree with its mesh.

    Parameters
    ----------
    faces
        Faces of the shape as drawn.
    """
    if mended.open_edges or mended.bodies.max(initial=0) > 0:
        return mended
    kinds = {face.kind for face in faces}
    if kinds == {"plane"} or "free" in kinds:
        # The mesh is exact, or not less so than the integral: 0.7 % off for splines of a handle.
        return mended
    properties = GProp_GProps()
    BRepGProp.VolumeProperties_s(shape, properties)
    centre = properties.CentreOfMass()
    volume_m3 = properties.Mass() * _MM**3
    part = mended.part
    meshed_m3 = float(compute_volumes_m3(part.vertices_m, part.triangles).sum())
    area_m2 = np.linalg.norm(compute_area_vectors_m2(part.vertices_m, part.triangles), axis=1).sum()
    # Faulty solids have volumes that their surface does not enclose.
    if not abs(volume_m3 - meshed_m3) <= 2 * chord_mm * _MM * area_m2 + 1e-3 * meshed_m3:
        return mended
    place: Vector = (centre.X() * _MM, centre.Y() * _MM, centre.Z() * _MM)
    return replace(mended, measures=(Measure(volume_m3, place),))


def _measure_gap_m(shape: Any, tolerance_mm: float) -> float:
    """Return the largest distance of a free edge from the others, up to the tolerance [m]."""
    edges = TopTools_IndexedMapOfShape()
    faces: dict[int, list[int]] = {}
    for number, face in enumerate(_explore(shape, _FACE)):
        for edge in _explore(face, _EDGE):
            faces.setdefault(edges.Add(edge), []).append(number)
    lines: list[list[Any]] = []
    owners: list[int] = []
    for number, own in faces.items():
        edge = TopoDS.Edge_s(edges.FindKey(number))
        if len(own) > 1 or BRep_Tool.Degenerated_s(edge) or len(lines) == _MOST_EDGES:
            continue
        curve = BRepAdaptor_Curve(edge)
        places = np.linspace(curve.FirstParameter(), curve.LastParameter(), _ALONG)
        lines.append([curve.Value(float(place)).Coord() for place in places])
        owners += own
    if len(set(owners)) < 2:
        return 0.0
    points, of_face = np.array(lines), np.array(owners)
    gap_mm = 0.0
    for number in np.unique(of_face):
        own_lines, others = points[of_face == number], points[of_face != number]
        ends = others[:, [0, -1]].reshape(-1, 3)
        starts, along = others[:, :-1].reshape(-1, 3), np.diff(others, axis=1).reshape(-1, 3)
        squares = np.maximum((along**2).sum(axis=1), 1e-30)
        for place in range(_ALONG):
            for point in own_lines[:, place]:
                offsets = point - starts
                share = np.clip((offsets * along).sum(axis=1) / squares, 0.0, 1.0)
                off = np.linalg.norm(offsets - share[:, None] * along, axis=1).min()
                if place in (0, _ALONG - 1):
                    # Corners are sewn to corners.
                    corner = np.linalg.norm(point - ends, axis=1).min()
                    off = corner if corner <= 2 * tolerance_mm else off
                if off <= 2 * tolerance_mm:
                    gap_mm = max(gap_mm, float(off))
    return gap_mm * _MM
