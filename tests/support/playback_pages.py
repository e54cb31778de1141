"""A small playback and the page that holds it, as `skillplan report` hands them to the player."""

from __future__ import annotations

import base64
import hashlib
import json
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

FRAMES_PER_S = 20
DURATION_S = 24.0
UPRIGHT = (0.0, 0.0, 0.0, 1.0)
PARTS = ("plate", "board", "cover")
COLOURS = ("#4e88c7", "#59a14f", "#c2573f")
TRACKS = ("upper arm", "gripper", *PARTS)


def times_s() -> NDArray[np.float64]:
    """Return when frames are."""
    return np.arange(round(DURATION_S * FRAMES_PER_S) + 1) / FRAMES_PER_S


def tip_at(time_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return where the arm's tip is: to and fro between the feeders and the board, three times."""
    phase = 2 * np.pi * time_s / 8.0
    x = 0.45 * np.cos(phase)
    y = 0.15 * np.sin(phase)
    return np.stack([x, y, 0.25 - 0.15 * np.cos(2 * phase)], axis=-1)


def part_at(index: int, time_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return where a part is: in its feeder, carried by the tip, then at its goal."""
    start, end = 8.0 * index, 8.0 * index + 4.0
    return tip_at(np.clip(time_s, start, end)) - np.array([0, 0, 0.08])


def _poses() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    time_s = times_s()
    tip = tip_at(time_s)
    positions = [tip + np.array([0, 0, 0.25]), tip, *(part_at(index, time_s) for index in range(3))]
    half = 0.25 * np.sin(time_s)
    turned = np.stack([0 * half, 0 * half, np.sin(half), np.cos(half)], axis=-1)
    still = np.tile(UPRIGHT, (len(time_s), 1))
    return np.stack(positions, axis=1), np.stack([turned, turned, still, still, still], axis=1)


def _base64(values: NDArray[Any], kind: str) -> str:
    return base64.b64encode(np.ascontiguousarray(values.astype(kind)).tobytes()).decode()


def _body(name: str, kind: str, shapes: list[dict[str, Any]], **more: Any) -> dict[str, Any]:
    body = {"name": name, "kind": kind, "color": None, "label": True, "shapes": shapes}
    return body | {"pose": [0, 0, 0, *UPRIGHT], "track": None, "goal": None} | more


def _box(*size_m: float, at: tuple[float, float, float] = (0, 0, 0)) -> dict[str, Any]:
    return {"type": "box", "size_m": size_m, "pose": [*at, *UPRIGHT]}


def _round(kind: str, radius_m: float, length_m: float, z_m: float = 0.0) -> dict[str, Any]:
    pose = [0, 0, z_m, *UPRIGHT]
    return {"type": kind, "radius_m": radius_m, "length_m": length_m, "pose": pose}


def _bodies() -> list[dict[str, Any]]:
    table = [_box(1.5, 1.1, 0.04, at=(0, 0, -0.02))]
    rod = [_round("capsule", 0.04, 0.3), {"type": "mesh", "mesh": 0, "pose": [0, 0, 0.2, *UPRIGHT]}]
    bodies = [
        _body("table", "environment", table, label=False),
        _body("base", "base", [_round("cylinder", 0.09, 0.2, 0.1)], pose=[0, 0.4, 0, *UPRIGHT]),
        _body("feeder", "feeder", [_box(0.2, 0.2, 0.02)], pose=[0.45, 0, 0.01, *UPRIGHT]),
        _body("upper arm", "link", rod, track=0, label=False),
        _body("gripper", "tool", [_round("cylinder", 0.03, 0.1, 0.05)], track=1),
    ]
    for index, name in enumerate(PARTS):
        goal = [*part_at(index, np.array(DURATION_S)).tolist(), *UPRIGHT]
        more = {"track": 2 + index, "goal": goal, "color": COLOURS[index]}
        bodies.append(_body(name, "part", [_box(0.12, 0.09, 0.03 + 0.02 * index)], **more))
    return bodies


def _skills() -> list[dict[str, Any]]:
    results = []
    for index, name in enumerate(PARTS):
        for start_s, verb in ((8.0 * index, "pick"), (8.0 * index + 4.0, "place")):
            skill = {"name": f"{verb}({name})", "start_s": start_s, "end_s": start_s + 4.0}
            results.append(skill | {"arm": "arm", "tool": "gripper", "subject": name, "note": None})
    return results


def playback() -> dict[str, Any]:
    """Return a table, an arm of one link, and three parts that it carries from feeder to goal."""
    positions, orientations = _poses()
    low, high = positions.min(axis=(0, 1)), positions.max(axis=(0, 1))
    middle, scale_m = (low + high) / 2, float((high - low).max()) / 2 / 32000
    corners = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]) * 1000
    faces = np.array([(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)])
    tetrahedron = {
        "positions": _base64(corners, "<i2"),
        "scale_m": 1e-4,
        "offset_m": [-0.03, -0.03, 0],
        "triangles": _base64(faces, "<u2"),
        "wide": False,
    }
    path = tip_at(times_s()[::4]).tolist()
    contact = {"time_s": 4.0, "position_m": [-0.45, 0, 0.02], "force_n": [0, 0, 12.5]}
    return {
        "schema": "skillplan.playback/1",
        "title": "three parts",
        "duration_s": DURATION_S,
        "frames_per_s": FRAMES_PER_S,
        "frames": len(times_s()),
        "bodies": _bodies(),
        "meshes": [tetrahedron],
        "tracks": {
            "count": len(TRACKS),
            "position_scale_m": scale_m,
            "position_offset_m": middle.tolist(),
            "positions": _base64(np.round((positions - middle) / scale_m), "<i2"),
            "orientations": _base64(np.round(orientations * 32767), "<i2"),
            "hidden": [[2 + PARTS.index("cover"), 0, 200]],
        },
        "skills": _skills(),
        "contacts": [contact | {"bodies": ["plate", "table"]}],
        "paths": [{"name": "tip", "points_m": path, "kind": "tip"}],
        "arms": [{"name": "arm", "tip_track": 1}],
        "view": None,
    }


GANTT = f"""
<svg viewBox="0 0 240 20" width="240" height="20" role="img" aria-label="Gantt">
<rect x="80" y="5" width="40" height="10" data-seek-s="8" data-skill="2" tabindex="0" id="bar"/>
<line id="gantt-cursor" x1="0" x2="0" y1="0" y2="20" stroke="red" data-x0="0" data-x1="240"/></svg>
<table><tr><td>{PARTS[0]}</td></tr></table>
"""


def with_keys(document: dict[str, Any]) -> dict[str, Any]:
    """Return the same playback with tracks one after the other, each of every fourth frame."""
    tracks, frames = document["tracks"], np.arange(0, document["frames"], 4)

    def kept(name: str, width: int) -> str:
        rows = np.frombuffer(base64.b64decode(tracks[name]), "<i2").reshape(
            -1, tracks["count"], width
        )
        return _base64(rows[frames].swapaxes(0, 1), "<i2")

    sparse = {
        "positions": kept("positions", 3),
        "orientations": kept("orientations", 4),
        "keys": _base64(np.tile(frames, tracks["count"]), "<u2"),
        "key_counts": [len(frames)] * tracks["count"],
    }
    return document | {"tracks": tracks | sparse}


def _hash(text: str) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


STYLE = (
    ":root { color-scheme: light dark; } "
    "body { margin: 8px; font-family: sans-serif; background: Canvas; color: CanvasText; }"
)


def write_page(path: Path, document: dict[str, Any], style: str = STYLE) -> Path:
    """Write a page that holds a playback, and allows nothing but its own script and styles."""
    player = resources.files("skillplan") / "views" / "report" / "player"
    script = (player / "player.js").read_text("utf-8")
    style += (player / "player.css").read_text("utf-8")
    policy = f"default-src 'none'; script-src {_hash(script)}; style-src {_hash(style)}"
    data = json.dumps(document, allow_nan=False).replace("<", "\\u003c")
    path.write_text(
        f"""<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>{document["title"]}</title>
<meta http-equiv="Content-Security-Policy" content="{policy}; img-src data:">
<meta name="viewport" content="width=device-width, initial-scale=1"><style>{style}</style></head>
<body><h1>{document["title"]}</h1>
<div id="playback-root"><p id="static">A still.</p><noscript>No script.</noscript></div>{GANTT}
<script type="application/json" id="playback">{data}</script><script>{script}</script>
</body></html>
""",
        "utf-8",
    )
    return path
