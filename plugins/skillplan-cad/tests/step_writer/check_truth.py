"""What exact solids overlap when they are moved in steps, against a truth written by hand."""

from __future__ import annotations

import itertools

from OCP.Bnd import Bnd_Box
from OCP.BRepAlgoAPI import BRepAlgoAPI_Common
from OCP.BRepBndLib import BRepBndLib
from OCP.BRepGProp import BRepGProp
from OCP.GProp import GProp_GProps
from products import placed
from solids import moved

AXES = {"+x": (1, 0, 0), "+y": (0, 1, 0), "+z": (0, 0, 1)}
STEP_MM = 1.3
LEAST_MM3 = 0.05


def volume(shape):
    """Return the volume of a shape [mm3]."""
    properties = GProp_GProps()
    BRepGProp.VolumeProperties_s(shape, properties)
    return properties.Mass()


def extent(shape):
    """Return the box about a shape: three least and three greatest coordinates [mm]."""
    about = Bnd_Box()
    BRepBndLib.AddOptimal_s(shape, about, False, False)
    return about.Get()


def meets(moving, standing, axis, reach):
    """Return whether a solid moved along an axis in steps overlaps another by more than a trace."""
    move = 0.2
    other = extent(standing)
    while move < reach:
        at = moved(moving, *(move * a for a in axis))
        here = extent(at)
        near = all(here[k] < other[k + 3] and other[k] < here[k + 3] for k in range(3))
        if near and volume(BRepAlgoAPI_Common(at, standing).Shape()) > LEAST_MM3:
            return True
        move += STEP_MM
    return False


def differences(product, truth):
    """Yield in words where the truth about a product differs from what its solids overlap."""
    solids = dict(placed(product))
    yield from [] if len(solids) == truth["parts"] else [f"{len(solids)} parts"]
    waived = {(a, b, d) for a, b, d in truth.get("blocked_by_threads", [])}
    for direction, blocked in truth.get("blocked", {}).items():
        for a, b in itertools.permutations(solids, 2):
            message = b in blocked.get(a, []) or (a, b, direction) in waived
            result = meets(solids[a], solids[b], AXES[direction], 150.0)
            if message != result:
                yield f"{a} along {direction} by {b}: said {message}, found {result}"
