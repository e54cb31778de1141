"""A product with every kind of fastener, and a plain plug that is none; what is true of it."""

from __future__ import annotations

from solids import Product, box, cut, cylinder, fuse, hexagon


def fastened():
    """Return a cover on a base: a hexagon bolt with washer and nut, two dowel pins, and a plug.

    The nut sits in a counterbore of the base; its hole is drawn as wide as the core of its thread.
    """
    pins, plug_at, bolt_at = ((10, 10), (50, 30)), (48, 8), (30, 20)
    base = cut(
        box(0, 0, 0, 60, 40, 20),
        cylinder(*bolt_at, 0, 8, 8),
        cylinder(*bolt_at, 8, 3.3, 12),
        cylinder(*plug_at, 14, 4, 6),
        *(cylinder(x, y, 12, 2, 8) for x, y in pins),
    )
    cover = cut(
        box(0, 0, 20, 60, 40, 26),
        cylinder(*bolt_at, 20, 3.3, 6),
        cylinder(*plug_at, 20, 4, 6),
        *(cylinder(x, y, 20, 2, 6) for x, y in pins),
    )
    ring = cut(cylinder(0, 0, 0, 6, 1.6), cylinder(0, 0, 0, 3.2, 1.6))
    bolt = fuse(cylinder(0, 0, -26.6, 3, 26.6), hexagon(0, 0, 0, 10, 4))
    nut = cut(hexagon(0, 0, 0, 10, 5), cylinder(0, 0, 0, 2.5, 5))
    pin = cylinder(0, 0, 0, 2, 14)
    product = Product("fastened").add("base", base).add("cover", cover)
    product.add("washer M6", ring, (*bolt_at, 26), "washer")
    product.add("hex bolt M6x27", bolt, (*bolt_at, 27.6), "bolt")
    product.add("hex nut M6", nut, (*bolt_at, 3), "nut")
    for number, (x, y) in enumerate(pins, 1):
        product.add("dowel pin 4x14", pin, (x, y, 12), f"pin_{number}")
    product.add("plug", cylinder(0, 0, 0, 4, 18), (*plug_at, 14))
    fitted = ["pin_1", "pin_2", "plug"]
    return product, {
        "parts": 8,
        "identical": [["pin_1", "pin_2"]],
        "fasteners": {
            "washer": {"kind": "washer", "axis": [0, 0, -1]},
            "bolt": {"kind": "screw", "axis": [0, 0, -1]},
            "nut": {"kind": "nut", "axis": [0, 0, 1]},
            "pin_1": {"kind": "pin", "axis": [0, 0, -1]},
            "pin_2": {"kind": "pin", "axis": [0, 0, -1]},
        },
        "contacts": {
            "plane": [["base", "cover"], ["cover", "washer"], ["bolt", "washer"], ["base", "nut"]],
            "cylinder": [["bolt", "nut"]],
        },
        "blocked": {
            "+x": {
                "base": ["bolt", "nut", *fitted],
                "cover": ["bolt", *fitted],
                "washer": ["bolt"],
                "bolt": ["base", "cover", "washer", "nut"],
                "nut": ["base", "bolt"],
                "pin_1": ["base", "cover", "plug"],
                "pin_2": ["base", "cover"],
                "plug": ["base", "cover"],
            },
            "+y": {
                "base": ["bolt", "nut", *fitted],
                "cover": ["bolt", *fitted],
                "washer": ["bolt"],
                "bolt": ["base", "cover", "washer", "nut"],
                "nut": ["base", "bolt"],
                "pin_1": ["base", "cover"],
                "pin_2": ["base", "cover"],
                "plug": ["base", "cover", "pin_2"],
            },
            "+z": {
                "base": ["cover", "washer", "bolt", *fitted],
                "cover": ["washer", "bolt"],
                "washer": ["bolt"],
                "nut": ["base", "cover", "washer", "bolt"],
            },
        },
        "blocked_by_threads": [["bolt", "nut", "+z"]],
    }
