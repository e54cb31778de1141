"""How much is read before it is refused: a table made of the constants that refuse it."""

from __future__ import annotations

import importlib
from typing import Any

# What is limited, in words with a place for each constant, and where the constants are.
ROWS: list[tuple[str, str, list[str]]] = [
    (
        "task file in YAML",
        "{bytes}, {} levels, {} values",
        ["files.yaml:MAX_BYTES", "files.yaml:MAX_DEPTH", "files.yaml:MAX_VALUES"],
    ),
    (
        "SOP and TSPLIB",
        "{bytes}, {} nodes, a cost of {power}",
        [
            "domains.sop:SopDomain.max_bytes",
            "domains.sop.problem:MOST_NODES",
            "domains.sop.problem:MOST_COST",
        ],
    ),
    (
        "mesh (OBJ, STL, PLY, GLB, 3MF, STEP)",
        "{bytes}, {} corners, {} m, {} convex pieces",
        [
            "domains.assembly.mesh_files:MAX_BYTES",
            "domains.assembly.mesh_files:MAX_CORNERS",
            "domains.assembly.mesh_files:_MOST_EXTENT_M",
            "domains.assembly.mesh_files:MAX_PIECES",
        ],
    ),
    (
        "arm (URDF)",
        "{bytes}, {} elements, {} levels, {} links, {} shapes with {bytes} of meshes, {} m",
        [
            "domains.assembly.arm_files:MAX_BYTES",
            "xml_tree:MAX_ELEMENTS",
            "xml_tree:MAX_DEPTH",
            "robots.urdf:_MOST_LINKS",
            "robots.urdf:_MOST_SHAPES",
            "domains.assembly.arm_files:MAX_MESH_BYTES",
            "robots.urdf:MOST_LENGTH_M",
        ],
    ),
    (
        "CAD (STEP, 3MF, GLB, folder of meshes)",
        "{bytes} a file, {bytes} a folder, {} parts, {} triangles, names of {} characters",
        [
            "skillplan_cad.reading.step_file:MOST_BYTES",
            "skillplan_cad.reading.mesh_folder:MOST_BYTES_TOGETHER",
            "skillplan_cad.reading.raw_part:MOST_PARTS",
            "skillplan_cad.reading.raw_part:MOST_TRIANGLES",
            "skillplan_cad.reading.occt_reader:MOST_PATH",
        ],
    ),
    (
        "product in CAD",
        "{} m long, {} times `--tolerance`; {} m thick at least",
        [
            "skillplan_cad.reading.product_reader:MOST_EXTENT_M",
            "skillplan_cad.importing.findings:MOST_TOLERANCES",
            "skillplan_cad.reading.product_reader:LEAST_THICKNESS_M",
        ],
    ),
    (
        "plan (CSV, JSON, PDDL, behaviour tree)",
        "{bytes}, {} skills, {} elements, {} levels",
        [
            "exporters.plan_files:MAX_BYTES",
            "exporters.plan_files:MOST_SKILLS",
            "xml_tree:MAX_ELEMENTS",
            "xml_tree:MAX_DEPTH",
        ],
    ),
    (
        "trajectory (DXF, CSV, G-code)",
        "{bytes}, {} m, {} control points of a spline, {} lines of a program, {} calls deep",
        [
            "skillplan_swarmitfix.trajectory.files:MAX_BYTES",
            "skillplan_swarmitfix.trajectory.units:_MOST_EXTENT_M",
            "skillplan_swarmitfix.trajectory.dxf_entities:_MOST_CONTROL_POINTS",
            "skillplan_swarmitfix.trajectory.program_lines:MOST_LINES",
            "skillplan_swarmitfix.trajectory.program_lines:MOST_NESTED",
        ],
    ),
    (
        "bench",
        "{} robots, {} heads on a segment, {} places of all robots",
        [
            "skillplan_swarmitfix.schema:MOST_ROBOTS",
            "skillplan_swarmitfix.heads.grid:MOST_HEADS",
            "skillplan_swarmitfix.faults:MOST_PLACES",
        ],
    ),
    ("steps of an assembly", "{}", ["domains.assembly.grounding:MOST_STEPS"]),
    ("`--set`", "{} steps of a path", ["domains.load:_MOST_STEPS"]),
    (
        "result and other documents in JSON",
        "{bytes}, {} levels",
        ["files.json_file:_MOST_BYTES", "files.json_file:MAX_DEPTH"],
    ),
    ("document that `report` is given", "{bytes}", ["cli.report_inputs:_MOST_BYTES"]),
    (
        "`product.yaml` that `explain` is given",
        "{bytes}",
        ["records.stored.product_relation:_MOST_BYTES"],
    ),
    (
        "visual mesh of a link, in a report",
        "{bytes}",
        ["views.playback.meshes:_MOST_BYTES"],
    ),
    ("table beside a result", "{bytes}", ["pipeline.record_check:_MOST_BYTES"]),
    (
        "manifest of a training",
        "{} runs, paths of {} characters",
        ["records.training.run_folder:MOST_RUNS", "records.training.run_folder:MOST_PATH"],
    ),
    ("plans of a chain that `verify` makes anew", "{}", ["pipeline.certification:MOST_REPLANS"]),
    ("agent in a file (`benchmark FILE.py:NAME`)", "{bytes}", ["benchmark.agents:_MOST_BYTES"]),
    ("policy in JSON", "{bytes}", ["records.stored.policy_file:_MOST_BYTES"]),
    (
        "policy of a network (safetensors)",
        "{bytes}",
        ["records.training.network_policy_file:_MOST_BYTES"],
    ),
    (
        "policy that carries over (safetensors)",
        "{bytes}",
        ["records.training.relational_file:_MOST_BYTES"],
    ),
    ("metrics of a run", "{bytes}", ["records.training.run_folder:_MOST_BYTES"]),
    (
        "checkpoint",
        "{bytes}, and the free memory",
        ["training.run_files:MOST_BYTES"],
    ),
    ("file of a parameter study", "{bytes}", ["sweep.study_folder:_MOST_BYTES"]),
    ("kept verdict", "{bytes}", ["checks.verdict_files:_MOST_BYTES"]),
    (
        "kept convex pieces of a mesh",
        "{bytes}",
        ["collision.decomposition:_MOST_BYTES"],
    ),
    (
        "source of a plugin, hashed for kept verdicts",
        "{bytes} a file",
        ["checks.verdict_files:_MOST_SOURCE_BYTES"],
    ),
    (
        "a solver that does not poll",
        "{} s beyond its limits",
        ["pipeline.separate_process:GRACE_S"],
    ),
    ("errors of a file on stderr", "{}", ["cli.error_report:_MOST_LINES"]),
]
_UNITS = [(1024**3, "GiB"), (1024**2, "MiB"), (1024, "KiB")]
_SUPERSCRIPTS = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")


def page() -> str:
    """Return the table."""
    rows = [f"| {what} | {text(words, places)} |" for what, words, places in ROWS]
    return "\n".join(["| input | limit |", "|---|---|", *rows])


def text(words: str, places: list[str]) -> str:
    """Return words with the constants in their places."""
    for place in places:
        start = words.index("{")
        end = words.index("}", start) + 1
        words = words[:start] + _written(words[start:end], constant(place)) + words[end:]
    return words


def constant(place: str) -> Any:
    """Return a constant by its place, as ``files.yaml:MAX_BYTES``; plugins go by their module."""
    module, _, path = place.partition(":")
    prefix = "" if module.startswith("skillplan_") else "skillplan."
    found: Any = importlib.import_module(f"{prefix}{module}")
    for name in path.split("."):
        found = getattr(found, name)
    return found


def _written(form: str, value: float) -> str:
    if form == "{bytes}":
        size, unit = next(one for one in _UNITS if value % one[0] == 0)
        return f"{value // size:,} {unit}"
    if form == "{power}":
        return f"2{str(int(value).bit_length() - 1).translate(_SUPERSCRIPTS)}"
    return f"{value:,g}" if value < 1_000_000 else f"{value:,.0f}"
