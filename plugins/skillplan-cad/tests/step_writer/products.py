"""The products of which the fixtures are files, each with what is true of it by construction.

``blocked`` says for a direction which part, moved along it without end, runs into which others.
Only the three positive directions are written down: a part that runs into another along +x is what
that other runs into along -x.
"""

from __future__ import annotations

import math

from solids import Product, box, cut, cylinder, fuse, helical_ridge, hexagon, moved, prism


def socket_screw(length, diameter, head, height, socket):
    """Return a socket screw: its head stands on z = 0, its shank goes down [mm]."""
    body = fuse(cylinder(0, 0, 0, head / 2, height), cylinder(0, 0, -length, diameter / 2, length))
    return cut(body, hexagon(0, 0, height / 2, socket, height))


def washer(outer, inner, thickness):
    """Return a washer that lies on z = 0 [mm]."""
    return cut(cylinder(0, 0, 0, outer / 2, thickness), cylinder(0, 0, 0, inner / 2, thickness))


def bracket():
    """Return an angle on a plate, held by two socket screws with washers."""
    holes = [(20, 12), (20, 28)]
    plate = cut(box(0, 0, 0, 60, 40, 8), *(cylinder(x, y, 2, 2, 6) for x, y in holes))
    angle = fuse(box(0, 5, 8, 30, 35, 12), box(0, 5, 12, 4, 35, 40))
    angle = cut(angle, *(cylinder(x, y, 8, 2.25, 4) for x, y in holes))
    ring, screw = washer(9, 4.5, 1), socket_screw(10, 4, 7, 4, 3)
    product = Product("bracket").add("plate", plate).add("angle", angle)
    for k, (x, y) in enumerate(holes, 1):
        product.add("washer M4", ring, (x, y, 12), f"washer_{k}")
        product.add("socket screw M4x10", screw, (x, y, 13), f"screw_{k}")
    both = ["screw_1", "screw_2"]
    return product, {
        "parts": 6,
        "identical": [["screw_1", "screw_2"], ["washer_1", "washer_2"]],
        "fasteners": {
            "screw_1": {"kind": "screw", "axis": [0, 0, -1]},
            "screw_2": {"kind": "screw", "axis": [0, 0, -1]},
            "washer_1": {"kind": "washer", "axis": [0, 0, -1]},
            "washer_2": {"kind": "washer", "axis": [0, 0, -1]},
        },
        "contacts": {
            "plane": [
                ["angle", "plate"],
                ["angle", "washer_1"],
                ["angle", "washer_2"],
                ["screw_1", "washer_1"],
                ["screw_2", "washer_2"],
            ],
            "cylinder": [["plate", "screw_1"], ["plate", "screw_2"]],
        },
        "blocked": {
            "+x": {
                "plate": both,
                "angle": [*both, "washer_1", "washer_2"],
                "washer_1": ["screw_1"],
                "washer_2": ["screw_2"],
                "screw_1": ["plate", "angle", "washer_1"],
                "screw_2": ["plate", "angle", "washer_2"],
            },
            "+y": {
                "plate": both,
                "angle": both,
                "washer_1": ["screw_1", "washer_2", "screw_2"],
                "washer_2": ["screw_2"],
                "screw_1": ["plate", "angle", "washer_1", "washer_2", "screw_2"],
                "screw_2": ["plate", "angle", "washer_2"],
            },
            "+z": {
                "plate": ["angle", "washer_1", "washer_2", *both],
                "angle": ["washer_1", "washer_2", *both],
                "washer_1": ["screw_1"],
                "washer_2": ["screw_2"],
            },
        },
    }


def threads():
    """Return a cap on a block, held by a hexagon screw whose thread is modelled on both sides."""
    pitch, turns = 0.8, 4
    shank = cylinder(0, 0, -9.0, 2.0, 9.0)
    thread = helical_ridge(0, 0, -8.2, 2.0, 0.4, pitch, turns)
    screw = fuse(shank, hexagon(0, 0, 0, 8, 3), thread)
    core = fuse(cylinder(0, 0, -11, 2.05, 7), helical_ridge(0, 0, -8.2, 2.05, 0.4, pitch, turns))
    block = cut(box(-8, -8, -12, 8, 8, -4), core)
    cap = cut(box(-8, -8, -4, 8, 8, 0), cylinder(0, 0, -4, 2.6, 4))
    product = Product("threads").add("block", block).add("cap", cap)
    product.add("hex bolt M5", screw, (0, 0, 0), "bolt")
    side = {"block": ["bolt"], "cap": ["bolt"], "bolt": ["block", "cap"]}
    return product, {
        "parts": 3,
        "fasteners": {"bolt": {"kind": "screw", "axis": [0, 0, -1]}},
        "thread_pairs": [["block", "bolt"]],
        "blocked": {"+x": side, "+y": side, "+z": {"block": ["cap", "bolt"], "cap": ["bolt"]}},
        "blocked_by_threads": [["bolt", "block", "+z"]],
    }


def tripod(sign):
    """Return a corner with three legs of different lengths, which is not its own mirror image."""
    legs = [box(0, 0, 0, 4, 12, 4), box(0, 0, 0, 4, 4, 8)]
    legs += [box(0, 0, 0, 20, 4, 4)]
    if sign < 0:
        legs = [box(-4, 0, 0, 0, 12, 4), box(-4, 0, 0, 0, 4, 8), box(-20, 0, 0, 0, 4, 4)]
    return fuse(*legs)


def mirrored():
    """Return two like corners and their mirror image on a plate."""
    left = tripod(1)
    product = Product("mirrored").add("plate", box(0, 0, 0, 80, 40, 5))
    product.add("left corner", left, (5, 5, 5), "left_1")
    product.add("left corner", left, (5, 22, 5), "left_2")
    product.add("right corner", tripod(-1), (75, 5, 5), "right")
    return product, {
        "parts": 4,
        "identical": [["left_1", "left_2"]],
        "mirrored": [["left_1", "right"], ["left_2", "right"]],
        "fasteners": {},
        "contacts": {"plane": [["left_1", "plate"], ["left_2", "plate"], ["plate", "right"]]},
        "blocked": {
            "+x": {"left_1": ["right"]},
            "+y": {"left_1": ["left_2"]},
            "+z": {"plate": ["left_1", "left_2", "right"]},
        },
    }


def nested():
    """Return a bed with a carriage twice, of a block and a stud that is of a pin and a cap."""
    pin, cap = cylinder(0, 0, 2, 2.5, 12), cut(cylinder(0, 0, 10, 4, 6), cylinder(0, 0, 10, 2.5, 4))
    stud = Product("stud").add("pin", pin).add("cap", cap)
    block = cut(box(-10, -10, 0, 10, 10, 10), cylinder(0, 0, 2, 2.5, 8))
    carriage = Product("carriage").add("block", block).add("stud", stud)
    product = Product("nested").add("bed", box(0, 0, 0, 100, 40, 5))
    product.add("carriage", carriage, (25, 20, 5), "carriage_1")
    product.add("carriage", carriage, (75, 20, 5), "carriage_2")
    item = {k: f"carriage_1/{p}" for k, p in _CARRIAGE.items()}
    two = {k: f"carriage_2/{p}" for k, p in _CARRIAGE.items()}
    along_x = {}
    for name, by in (("block", "block pin"), ("pin", "block pin cap"), ("cap", "pin cap")):
        inside = [k for k in by.split() if k != name]
        along_x[item[name]] = [item[k] for k in inside] + [two[k] for k in by.split()]
        along_x[two[name]] = [two[k] for k in inside]
    return product, {
        "parts": 7,
        "identical": [[item[k], two[k]] for k in ("block", "cap", "pin")],
        "fasteners": {c["pin"]: {"kind": "pin", "axis": [0, 0, 1]} for c in (item, two)},
        "blocked": {
            "+x": along_x,
            "+y": {
                **{c["block"]: [c["pin"]] for c in (item, two)},
                **{c["pin"]: [c["block"], c["cap"]] for c in (item, two)},
                **{c["cap"]: [c["pin"]] for c in (item, two)},
            },
            "+z": {
                "bed": sorted([*item.values(), *two.values()]),
                **{c["block"]: [c["pin"], c["cap"]] for c in (item, two)},
                **{c["pin"]: [c["cap"]] for c in (item, two)},
            },
        },
    }


_CARRIAGE = {"block": "block", "pin": "stud/pin", "cap": "stud/cap"}


def dovetail():
    """Return a slide in the dovetail of a rail."""
    rail = cut(
        box(-20, 0, 0, 20, 50, 10),
        prism([(-10, 0, 5), (10, 0, 5), (6, 0, 10), (-6, 0, 10)], (0, 50, 0)),
    )
    tail = prism([(-10, 0, 5), (10, 0, 5), (6, 0, 10), (-6, 0, 10)], (0, 50, 0))
    slide = fuse(tail, box(-15, 0, 10, 15, 50, 14))
    product = Product("dovetail").add("rail", rail).add("slide", slide)
    both = {"rail": ["slide"], "slide": ["rail"]}
    return product, {
        "parts": 2,
        "fasteners": {},
        "contacts": {"plane": [["rail", "slide"]]},
        "blocked": {"+x": both, "+y": {}, "+z": both},
    }


def l_slot():
    """Return a key at the end of an L-shaped tunnel: two moves take it out, no single one does."""
    body = cut(box(0, 0, 0, 40, 40, 12), box(5, 5, 3, 35, 15, 9), box(25, 5, 3, 35, 40, 9))
    product = Product("l_slot").add("body", body).add("key", box(6, 6, 3, 14, 14, 9))
    both = {"body": ["key"], "key": ["body"]}
    return product, {
        "parts": 2,
        "fasteners": {},
        "blocked": {"+x": both, "+y": both, "+z": both},
        "freed": {"key": {"by": "translations", "moves": 2}},
    }


def bayonet():
    """Return a shaft whose lug was turned under the rim of a bush: a quarter turn frees it."""
    bush = cut(
        cylinder(0, 0, 0, 15, 20),
        cylinder(0, 0, 5, 8, 15),
        cylinder(0, 0, 5, 11.5, 4),
        box(0, -2.4, 5, 11.4, 2.4, 20),
    )
    shaft = fuse(cylinder(0, 0, 5, 7.5, 20), box(-2, 0, 5, 2, 11, 8.6))
    product = Product("bayonet").add("bush", bush).add("shaft", shaft)
    both = {"bush": ["shaft"], "shaft": ["bush"]}
    return product, {
        "parts": 2,
        "fasteners": {},
        "blocked": {"+x": both, "+y": both, "+z": both},
        "freed": {"shaft": {"by": "rotations", "axis": [0, 0, 1]}},
    }


def interlocked():
    """Return two closed links of a chain, which nothing takes apart."""
    lying = cut(box(-15, -15, -2.5, 15, 15, 2.5), box(-10, -10, -2.5, 10, 10, 2.5))
    upright = cut(box(4, -2.5, -10, 21, 2.5, 10), box(8, -2.5, -6, 17, 2.5, 6))
    product = Product("interlocked").add("lying", lying).add("upright", upright)
    both = {"lying": ["upright"], "upright": ["lying"]}
    return product, {
        "parts": 2,
        "fasteners": {},
        "floating": ["upright"],
        "blocked": {"+x": both, "+y": both, "+z": both},
        "freed": {},
        "groups": [["lying", "upright"]],
    }


def floating():
    """Return a block on a plate, and one that touches nothing."""
    product = Product("floating").add("plate", box(0, 0, 0, 60, 40, 5))
    product.add("block", box(5, 5, 5, 25, 25, 20)).add("balloon", box(35, 8, 25, 55, 22, 35))
    return product, {
        "parts": 3,
        "fasteners": {},
        "floating": ["balloon"],
        "contacts": {"plane": [["block", "plate"]]},
        "blocked": {"+x": {}, "+y": {}, "+z": {"plate": ["block", "balloon"]}},
    }


def interfering():
    """Return a pin of 6.4 mm in a hole of 6 mm."""
    block = cut(box(-10, -10, 0, 10, 10, 10), cylinder(0, 0, 0, 3.0, 10))
    product = Product("interfering").add("block", block)
    product.add("pin", cylinder(0, 0, -2, 3.2, 14))
    overlap = math.pi * (3.2**2 - 3.0**2) * 10
    return product, {
        "parts": 2,
        "interference": [{"parts": ["block", "pin"], "overlap_mm3": round(overlap, 3)}],
    }


def eight():
    """Return eight parts: a cover over a tunnel, on posts, with screws, and a slide from the side.

    Made for one arm: no part is wider than jaws where these close, and all fits are loose.
    """
    base = fuse(box(-60, -50, 0, 60, 50, 12), box(-10, -26, 12, 44, 26, 32))
    base = cut(base, box(-10, -20, 12, 40, 20, 28), cylinder(-45, 30, 4, 6.5, 8))
    slide = fuse(box(-22, -19, 12, 38, 19, 26), box(-32, -10, 12, -22, 10, 40))
    post = cut(box(-8, -8, 0, 8, 8, 30), cylinder(0, 0, 16, 2, 14))
    cover = cut(box(8, -50, 42, 32, 50, 47), *(cylinder(20, y, 42, 2.25, 5) for y in (40, -40)))
    screw = socket_screw(12, 4, 7, 4, 3)
    product = Product("eight").add("base", base).add("slide", slide)
    for k, y in ((1, 40), (2, -40)):
        product.add("post", post, (20, y, 12), f"post_{k}")
    product.add("cover", cover).add("plug", cylinder(-45, 30, 4, 6, 30))
    for k, y in ((1, 40), (2, -40)):
        product.add("socket screw M4x12", screw, (20, y, 47), f"screw_{k}")
    both = ["screw_1", "screw_2"]
    above = ["slide", "post_1", "post_2", "cover", "plug", *both]
    return product, {
        "parts": 8,
        "identical": [["post_1", "post_2"], ["screw_1", "screw_2"]],
        "fasteners": {name: {"kind": "screw", "axis": [0, 0, -1]} for name in both},
        "contacts": {
            "plane": [
                ["base", "plug"],
                ["base", "post_1"],
                ["base", "post_2"],
                ["base", "slide"],
                ["cover", "post_1"],
                ["cover", "post_2"],
                ["cover", "screw_1"],
                ["cover", "screw_2"],
            ],
            "cylinder": [["post_1", "screw_1"], ["post_2", "screw_2"]],
        },
        "blocked": {
            "+x": {
                "base": ["plug"],
                "slide": ["base"],
                "post_1": ["screw_1"],
                "post_2": ["screw_2"],
                "plug": ["base", "post_1"],
                "cover": both,
                "screw_1": ["post_1", "cover"],
                "screw_2": ["post_2", "cover"],
            },
            "+y": {
                "base": ["plug", "slide", "post_1"],
                "slide": ["base", "post_1"],
                "post_1": ["screw_1"],
                "post_2": ["base", "slide", "post_1", *both],
                "plug": ["base"],
                "cover": both,
                "screw_1": ["post_1", "cover"],
                "screw_2": ["post_2", "cover", "post_1", "screw_1"],
            },
            "+z": {
                "base": above,
                "slide": ["base", "cover"],
                "post_1": ["cover", "screw_1"],
                "post_2": ["cover", "screw_2"],
                "cover": both,
            },
        },
    }


def placed(product, at=(0.0, 0.0, 0.0), path=""):
    """Yield the leaves of a product: path of instances, and the solid where it stands."""
    for _, shape, offset, instance in product.members:
        there = tuple(a + b for a, b in zip(at, offset, strict=True))
        if isinstance(shape, Product):
            yield from placed(shape, there, f"{path}{instance}/")
        else:
            yield f"{path}{instance}", moved(shape, *there)


PRODUCTS = {
    make.__name__: make
    for make in (
        bracket,
        threads,
        mirrored,
        nested,
        dovetail,
        l_slot,
        bayonet,
        interlocked,
        floating,
        interfering,
        eight,
    )
}
