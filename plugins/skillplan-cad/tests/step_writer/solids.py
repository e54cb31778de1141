"""Solids of which the fixtures consist, and how a product of them is written as STEP.

Needs OCP, which skillplan-cad brings.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path

from OCP.BRepAlgoAPI import BRepAlgoAPI_Cut, BRepAlgoAPI_Fuse
from OCP.BRepBuilderAPI import (
    BRepBuilderAPI_MakeEdge,
    BRepBuilderAPI_MakeFace,
    BRepBuilderAPI_MakePolygon,
    BRepBuilderAPI_MakeWire,
    BRepBuilderAPI_Transform,
)
from OCP.BRepLib import BRepLib
from OCP.BRepOffsetAPI import BRepOffsetAPI_MakePipeShell
from OCP.BRepPrimAPI import BRepPrimAPI_MakeBox, BRepPrimAPI_MakeCylinder, BRepPrimAPI_MakePrism
from OCP.Geom import Geom_CylindricalSurface
from OCP.Geom2d import Geom2d_Line
from OCP.gp import gp_Ax2, gp_Ax3, gp_Dir, gp_Dir2d, gp_Pnt, gp_Pnt2d, gp_Trsf, gp_Vec
from OCP.Interface import Interface_Static
from OCP.ShapeUpgrade import ShapeUpgrade_UnifySameDomain
from OCP.STEPCAFControl import STEPCAFControl_Writer
from OCP.STEPControl import STEPControl_StepModelType
from OCP.TCollection import TCollection_ExtendedString
from OCP.TDataStd import TDataStd_Name
from OCP.TDocStd import TDocStd_Document
from OCP.TopLoc import TopLoc_Location
from OCP.XCAFDoc import XCAFDoc_DocumentTool


def box(x0, y0, z0, x1, y1, z1):
    """Return the box between two corners [mm]."""
    return BRepPrimAPI_MakeBox(gp_Pnt(x0, y0, z0), gp_Pnt(x1, y1, z1)).Shape()


def cylinder(x, y, z, radius, height, axis=(0, 0, 1)):
    """Return the cylinder that begins at a point and goes along an axis [mm]."""
    frame = gp_Ax2(gp_Pnt(x, y, z), gp_Dir(*axis))
    return BRepPrimAPI_MakeCylinder(frame, radius, height).Shape()


def prism(corners, vector):
    """Return what a polygon in space passes over when it is moved by a vector [mm]."""
    polygon = BRepBuilderAPI_MakePolygon()
    for corner in corners:
        polygon.Add(gp_Pnt(*corner))
    polygon.Close()
    face = BRepBuilderAPI_MakeFace(polygon.Wire()).Face()
    return BRepPrimAPI_MakePrism(face, gp_Vec(*vector)).Shape()


def cut(shape, *others):
    """Return a solid less others."""
    for other in others:
        shape = BRepAlgoAPI_Cut(shape, other).Shape()
    return merged(shape)


def fuse(shape, *others):
    """Return solids as one."""
    for other in others:
        shape = BRepAlgoAPI_Fuse(shape, other).Shape()
    return merged(shape)


def merged(shape):
    """Return a solid whose faces in one surface are one face."""
    unify = ShapeUpgrade_UnifySameDomain(shape)
    unify.Build()
    return unify.Shape()


def hexagon(x, y, z, across, height):
    """Return an upright hexagonal prism by its width across flats [mm]."""
    radius = across / math.sqrt(3)
    turns = [math.pi / 3 * k for k in range(6)]
    corners = [(x + radius * math.cos(t), y + radius * math.sin(t), z) for t in turns]
    return prism(corners, (0, 0, height))


def helical_ridge(x, y, z, radius, depth, pitch, turns):
    """Return a ridge of triangular section along a helix on a cylinder [mm]."""
    frame = gp_Ax3(gp_Pnt(x, y, z), gp_Dir(0, 0, 1))
    surface = Geom_CylindricalSurface(frame, radius)
    slope = gp_Dir2d(2 * math.pi, pitch)
    length = turns * math.hypot(2 * math.pi, pitch)
    line = Geom2d_Line(gp_Pnt2d(0, 0), slope)
    edge = BRepBuilderAPI_MakeEdge(line, surface, 0.0, length).Edge()
    BRepLib.BuildCurves3d_s(edge)
    spine = BRepBuilderAPI_MakeWire(edge).Wire()
    half = 0.4 * pitch
    inside = radius - 0.1 * depth
    profile = BRepBuilderAPI_MakePolygon()
    for r, dz in ((inside, -half), (radius + depth, 0.0), (inside, half)):
        profile.Add(gp_Pnt(x + r, y, z + dz))
    profile.Close()
    pipe = BRepOffsetAPI_MakePipeShell(spine)
    pipe.SetMode(gp_Dir(0, 0, 1))
    pipe.Add(profile.Wire())
    pipe.Build()
    pipe.MakeSolid()
    return pipe.Shape()


def moved(shape, x, y, z):
    """Return a copy of a shape that is moved [mm]."""
    move = gp_Trsf()
    move.SetTranslation(gp_Vec(x, y, z))
    return BRepBuilderAPI_Transform(shape, move, True).Shape()


@dataclass
class Product:
    """An assembly: solids or assemblies by name, each at its places."""

    name: str
    members: list = field(default_factory=list)

    def add(self, name, shape, at=(0, 0, 0), instance=None):
        """Add a solid or an assembly; one that is added again is another instance of it."""
        self.members.append((name, shape, at, instance or name))
        return self


def _name(label, text):
    TDataStd_Name.Set_s(label, TCollection_ExtendedString(text))


def _label(tool, product, document):
    """Return the label of an assembly, and make those of its members as they are first met."""
    assembly = tool.NewShape()
    _name(assembly, product.name)
    for name, shape, at, instance in product.members:
        if id(shape) not in document:
            if isinstance(shape, Product):
                document[id(shape)] = _label(tool, shape, document)
            else:
                document[id(shape)] = tool.AddShape(shape, False)
                _name(document[id(shape)], name)
        move = gp_Trsf()
        move.SetTranslation(gp_Vec(*at))
        component = tool.AddComponent(assembly, document[id(shape)], TopLoc_Location(move))
        _name(component, instance)
    return assembly


def write_step(product, path, unit="MM", parts=""):
    """Write a product as a STEP file, in millimetres or in inches, with no date in it.

    With a prefix in `parts`, each part is a file of its own beside it.
    """
    document = TDocStd_Document(TCollection_ExtendedString("skillplan"))
    tool = XCAFDoc_DocumentTool.ShapeTool_s(document.Main())
    _label(tool, product, {})
    tool.UpdateAssemblies()
    writer = STEPCAFControl_Writer()
    Interface_Static.SetCVal_s("write.step.unit", unit)
    Interface_Static.SetCVal_s("write.step.schema", "AP214IS")
    if parts:
        mode = STEPControl_StepModelType.STEPControl_AsIs
        writer.Transfer(document, mode, str(path.parent / parts))
    else:
        writer.Transfer(document)
    writer.Write(str(path))
    Interface_Static.SetCVal_s("write.step.unit", "MM")
    _without_origin(Path(path))


def _without_origin(path):
    """Take out of a file's header when and by what it was written, so that bytes repeat."""
    lines = path.read_text(encoding="ascii").splitlines()
    kept, header = [], []
    for line in lines:
        if header or line.startswith("FILE_NAME"):
            header.append(line)
            if line.endswith(";"):
                kept.append(f"FILE_NAME('{path.stem}','',(''),(''),'','','');")
                header = []
                continue
        else:
            kept.append(line)
    path.write_text("\n".join(kept) + "\n", encoding="ascii")
