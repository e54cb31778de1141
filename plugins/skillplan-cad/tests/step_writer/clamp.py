"""A clamp as it is delivered: the product of the tutorial on CAD, with its usual problems."""

from __future__ import annotations

from OCP.BRep import BRep_Builder
from OCP.BRepAdaptor import BRepAdaptor_Surface
from OCP.GeomAbs import GeomAbs_SurfaceType
from OCP.TopAbs import TopAbs_FACE
from OCP.TopExp import TopExp_Explorer
from OCP.TopoDS import TopoDS, TopoDS_Shell
from solids import Product, box, cut, cylinder, fuse, hexagon

# Height of the feet, of the plate's top, and of the support's top [mm].
_FOOT, _PLATE, _SUPPORT = 6, 16, 36


def clamp():
    """Return a plate on feet with a support, a bought-in cylinder, two pins and a cover.

    The rod cannot leave its cylinder, the stop is drawn deeper in its slot than any press fit of
    ISO 286, the locator as a press fit, and a face of the cover's hole is missing.
    """
    holes = [cylinder(-45, 0, _FOOT, 2.75, 10), cylinder(45, 22, _FOOT, 5, 10)]
    slot = box(40, -27, _FOOT, 50, -17, _PLATE)
    plate = cut(box(-70, -37, _FOOT, 70, 37, _PLATE), *holes, slot)
    support = cut(box(-60, -15, _PLATE, -30, 15, _SUPPORT), cylinder(-45, 0, _PLATE, 2.75, 20))
    body = cut(
        box(-15, -20, _PLATE, 25, 20, 51),
        cylinder(0, 0, 33, 12, 25 - 8, (1, 0, 0)),
        cylinder(-15, 0, 33, 5, 40, (1, 0, 0)),
    )
    rod = fuse(cylinder(4, 0, 33, 11.8, 10, (1, 0, 0)), cylinder(-22, 0, 33, 4.9, 30, (1, 0, 0)))
    bolt = fuse(cylinder(0, 0, -32, 2.5, 32), hexagon(0, 0, 0, 8, 3.5))
    nut = cut(hexagon(0, 0, 0, 8, 4), cylinder(0, 0, 0, 2.5, 4))
    product = Product("clamp").add("plate", plate)
    foot = cylinder(0, 0, 0, 8, _FOOT)
    for number, (x, y) in enumerate(((-60, -27), (-60, 27), (60, -27), (60, 27)), 1):
        product.add("foot", foot, (x, y, 0), f"foot_{number}")
    product.add("support", support).add("hex bolt M5x32", bolt, (-45, 0, _SUPPORT), "bolt")
    product.add("hex nut M5", nut, (-45, 0, 2), "nut")
    product.add("cylinder_body", body).add("cylinder_rod", rod)
    product.add("locator", cylinder(45, 22, _FOOT, 5.02, 22))
    product.add("stop", box(39.85, -27, _FOOT, 50.15, -17, 28))
    lid = cut(box(-13, -18, 51, 23, 18, 54), cylinder(5, 0, 51, 4, 3))
    return product.add("cover", _without_hole(lid))


def _without_hole(shape):
    """Return a solid as a shell without its cylindrical faces."""
    builder, shell = BRep_Builder(), TopoDS_Shell()
    builder.MakeShell(shell)
    faces = TopExp_Explorer(shape, TopAbs_FACE)
    while faces.More():
        face = TopoDS.Face_s(faces.Current())
        if BRepAdaptor_Surface(face).GetType() != GeomAbs_SurfaceType.GeomAbs_Cylinder:
            builder.Add(shell, face)
        faces.Next()
    return shell
