"""A frame that goes over a peg: a mesh with a hole, and convex pieces that may narrow the hole."""

import yaml

OUTER_MM, THICK_MM, FLANGE_MM, PEG_MM = 50.0, 12.0, 4.0, 16.0


def frame_text(inner_mm, flange=False):
    """Return the OBJ text of a square frame as one closed mesh [mm], the hole closed by a flange.

    With a flange it is a cap: 4 mm of its thickness close the hole at the top.
    """
    if flange:
        return _cap_text(inner_mm)
    rings = []
    for half in (OUTER_MM / 2, inner_mm / 2):
        ring = [(-half, -half), (half, -half), (half, half), (-half, half)]
        rings.append(ring)
    corners = [(x, y, z) for z in (0.0, THICK_MM) for ring in rings for x, y in ring]
    # Indices: outer bottom 0-3, inner bottom 4-7, outer top 8-11, inner top 12-15.
    faces = []
    for i in range(4):
        j = (i + 1) % 4
        faces += [(i, j, j + 8, i + 8), (j + 4, i + 4, i + 12, j + 12)]
        faces += [(j, i, i + 4, j + 4), (i + 8, j + 8, j + 12, i + 12)]
    return _obj(corners, faces)


def _cap_text(inner_mm):
    """Return the OBJ text of a square cap, open at the bottom [mm]."""
    outer, inner = OUTER_MM / 2, inner_mm / 2
    corners = []
    for half, z in ((outer, 0.0), (inner, 0.0), (outer, THICK_MM), (inner, THICK_MM - FLANGE_MM)):
        corners += [(-half, -half, z), (half, -half, z), (half, half, z), (-half, half, z)]
    # Outer bottom 0-3, inner bottom 4-7, outer top 8-11, ceiling of the hole 12-15.
    faces = [(8, 9, 10, 11), (15, 14, 13, 12)]
    for i in range(4):
        j = (i + 1) % 4
        faces += [(i, j, j + 8, i + 8), (j + 4, i + 4, i + 12, j + 12), (j, i, i + 4, j + 4)]
    return _obj(corners, faces)


def pieces_text(inner_mm, flange=False):
    """Return the OBJ text of the boxes of a frame, and of the flange of a cap [mm]."""
    half, inner = OUTER_MM / 2, inner_mm / 2
    spans = [
        ((-half, half), (inner, half)),
        ((-half, half), (-half, -inner)),
        ((inner, half), (-inner, inner)),
        ((-half, -inner), (-inner, inner)),
    ]
    top = THICK_MM - FLANGE_MM if flange else THICK_MM
    boxes = [(*span, (0.0, top)) for span in spans]
    if flange:
        boxes.append(((-half, half), (-half, half), (top, THICK_MM)))
    corners, faces = [], []
    for (x_low, x_high), (y_low, y_high), heights in boxes:
        first = len(corners)
        ring = [(x_low, y_low), (x_high, y_low), (x_high, y_high), (x_low, y_high)]
        corners += [(x, y, z) for z in heights for x, y in ring]
        faces += [tuple(first + k for k in face) for face in [(3, 2, 1, 0), (4, 5, 6, 7)]]
        for i in range(4):
            j = (i + 1) % 4
            faces.append((first + i, first + j, first + j + 4, first + i + 4))
    return _obj(corners, faces)


def _obj(corners, faces):
    lines = ["v {} {} {}".format(*corner) for corner in corners]
    lines += ["f " + " ".join(str(index + 1) for index in face) for face in faces]
    return "\n".join(lines) + "\n"


def write_framed_peg(folder, clearance_mm, outside_mm, *, flange=False):
    """Write the task of a frame that goes over a peg; return its file.

    Parameters
    ----------
    folder
        Where to.
    clearance_mm
        Distance of the frame's mesh from the peg on each side [mm].
    outside_mm
        How far the frame's convex pieces stand out of its mesh into the hole [mm].
    flange
        Whether the hole is closed at the top, where the frame rests on the peg.
    """
    inner_mm = PEG_MM + 2 * clearance_mm
    (folder / "frame.obj").write_text(frame_text(inner_mm, flange))
    (folder / "pieces.obj").write_text(pieces_text(inner_mm - 2 * outside_mm, flange))
    peg = {"size_m": [PEG_MM / 1000, PEG_MM / 1000, 0.03], "mass_kg": 0.2}
    frame = {"meshes": [{"file": "frame.obj", "pieces": "pieces.obj", "scale": 0.001}]}
    content = {
        "kind": "assembly",
        "name": "framed-peg",
        "robot": {"home_m": [0.35, 0.0]},
        "tools": {"gripper": {"holder_m": [0.6, 0.35], "opening_m": 0.08}},
        "initial_tool": "gripper",
        "parts": {
            "peg": {"tool": "gripper", **peg, "start_m": [0.4, 0.2], "goal_m": [0.5, 0.0]},
            "frame": {
                "tool": "gripper",
                "mass_kg": 0.1,
                **frame,
                "grasp": {"at_m": [0.0, 0.0], "depth_m": 0.005},
                "start_m": [0.4, -0.2],
                "goal_m": [0.5, 0.0],
                **({"goal_on": "peg"} if flange else {}),
            },
        },
    }
    path = folder / "board.yaml"
    path.write_text(yaml.safe_dump(content))
    return path
