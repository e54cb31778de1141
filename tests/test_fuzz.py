"""No input whatever reaches the user as a traceback.

The same examples in every run, more of them in the whole suite. ``SKILLPLAN_FUZZ=50`` draws fifty
times as many, other ones each time.
"""

import contextlib
import copy
import io
import os
import re
from pathlib import Path

import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from skillplan.cli import COMMANDS, main
from skillplan.pipeline import registry
from skillplan_swarmitfix import SwarmitfixConfig
from thinned import thinned
from yaml_data import yaml_text

ROOT = Path(__file__).parents[1]
BOARD = ROOT / "configs" / "inverter_board.yaml"
FACTOR = int(os.environ.get("SKILLPLAN_FUZZ", "1"))

# A task with something in every section.
TASK = """\
kind: assembly
name: lid-on-box
description: A box and a lid.
robot: {name: arm, base_m: [0, 0, 0], home_m: [0.3, 0.0], reach_m: 0.855, safe_height_m: 0.2,
  travel_speed_m_per_s: 0.25}
durations_s: {pick: 3.0, place: 3.0, load: 5.0, offload: 5.0, fasten: 8.0}
tools:
  gripper: {holder_m: [0.5, 0.3], holder_height_m: 0.05, envelope_m: [0.02, 0.02, 0.1],
    type: gripper, opening_m: 0.08}
  driver: {holder_m: [0.6, 0.3], type: screwdriver}
initial_tool: gripper
tool_change: {style: swap, reload: false}
feeders:
  tray: {position_m: [0.3, -0.3], height_m: 0.0}
parts:
  box: {tool: gripper, mass_kg: 0.1, size_m: [0.1, 0.1, 0.02], start_m: [0.3, 0.2],
    grasp: {type: suction, at_m: [0.0, 0.0]}, start_yaw_rad: 0.0, goal_m: [0.5, 0.0],
    goal_yaw_rad: 0.0}
  lid: {tool: gripper, boxes: [{size_m: [0.08, 0.08, 0.01], centre_m: [0, 0, 0.005]}],
    grasp: [{type: suction}, {approach: [0, 0, -1], type: suction, at_m: [0.0, 0.02]}],
    insert_along: [[0, 0, -1], [1, 0, 0]], insert_m: 0.05, frame: goal,
    start_on: box, goal_m: [0.5, 0.0], goal_on: box}
  plug: {tool: gripper, size_m: [0.02, 0.02, 0.04], grasp: auto, start_m: [0.3, -0.1],
    goal_m: [0.6, 0.1], insert_along: [0, 1, 0]}
  clip: {tool: gripper, cylinder: {diameter_m: 0.01, height_m: 0.01}, feeder: tray,
    grasp: {closing_axis: auto, depth_m: 0.004}, goal_m: [0.4, 0.2]}
screws:
  bolt: {tool: driver, hole_m: [0.5, 0.0], axis: [0, 0, -1], through: lid, feeder: tray,
    head_diameter_m: 0.006, head_height_m: 0.002, mass_kg: 0.001}
goal: [placed(lid), fastened(bolt)]
chart:
  - {before: box, after: [lid]}
actions: [pick(box), place(box), pick(lid), place(lid), load(driver), fasten(bolt)]
observation: [placed(box), not hand_free]
reward: {infeasible: -10, complete: 10, per_cost: -0.1, out_of_time: -10, repeated_tool_change: -2}
step_limit: 9
physics: {kinematic: {}}
collision: {precedence: {hold_back_picks: false}, aabb: {tolerance_m: 0.0002, check_support: true}}
expect: {optimal_cost: 1.0, optimal_actions: [0], costs: [{actions: [0], cost: 1.0}]}
"""

# One for every job of a bench, with something in every section.
BENCHES = {
    "trajectory": """\
kind: swarmitfix
name: curve
description: A curve on a small bench.
bench: {rows: 6, cols: 13, pitch_m: 0.34, actions: 11}
trajectory:
  closed: false
  start_m: [0.4, 0.6]
  path:
    - {arc_to_m: [0.8, 1.0], through_m: [0.45, 0.9]}
    - {line_to_m: [1.2, 1.0]}
    - {spline_through_m: [[1.5, 0.9], [1.8, 0.6]]}
  chord_tolerance_m: 0.01
heads: {side_m: 0.1, max_gap_m: 0.25, step_m: 0.1, orientations: 1, reorientation_cost: 0.1}
base: {home: C53, arm_length_m: 0.472, safe_distance_m: 0.286, reach_m: [0.333, 0.451],
  side: right, goal_choice: whole-trajectory}
pkm: {leg_limits_m: {A: [0.24, 0.32], B: [0.24, 0.32], C: [0.24, 0.32]}, sheet_height_m: 0.85}
timings: {swing_s: {"60": 7.5, "120": 11.6, "180": 15.8}, retract_s: 0.3, park_s: 0.5,
  approach_s: 0.5, support_s: 0.3}
step_limit: 50
physics: {kinematic: {}}
collision: {aabb: {}}
expect: {goals: [C56], makespans: [2], supports: 3, steps: 2, relaxed: 0, split: 0, csp: solved}
""",
    "divided": """\
kind: swarmitfix
name: divided
trajectory: {closed: true, vertices_m: [[0.4, 0.35], [1.2, 1.6], [2.0, 0.35]]}
heads: {subdivisions: [2, 2, 2]}
base: {home: C66, side: inward, goal_choice: fewest-steps}
""",
    "goals": """\
kind: swarmitfix
name: goals
bench: {rows: 2, cols: 5}
base: {home: C1, goals: [C9, C9, C3]}
""",
    "robots": """\
kind: swarmitfix
name: fleet
bench: {rows: 3, cols: 9, pitch_m: 1, actions: 13}
robots: {one: {home: C1, goal: C27}, two: {home: C9, goal: C19}}
expect: {swings: 4, parallel_makespan: 2}
""",
}

HOSTILE = st.one_of(
    st.sampled_from(
        [
            *(None, True, False, "", " ", "~", "<<", "*", "[key]", "box", "lid", "bolt", "home"),
            *("world", "placed(box)", "not placed(box)", "C1", "C78", "C99", "B1", "left"),
            *("outward", "a.csv", "a.dxf", "../a.nc", "not", "a" * 70, "\n", "\x85", "\u2028"),
            *("\u202e", "\N{PILE OF POO}", "1e999", ".nan", "0x1F", -0.0, 0, -1, 1, 2, 5e-324),
            *(1e-300, 1e-6, 1e-9, 1e300, 10.0, 100_000, 2**63, 10**30, 10**40, float("inf")),
            *(float("nan"), [], {}, [[]], [[[[[0]]]]], {"": {}}, {"kind": "assembly"}, [0, 0]),
            *([None] * 3, [0.0] * 3, [1e-300] * 3, [1e-6] * 3, [10] * 3),
        ]
    ),
    st.integers(),
    st.floats(),
    st.floats(-1, 1),
    st.text(max_size=8),
)

# Files that a trajectory is read from, and how a valid one begins.
FILES = {
    ".csv": b"x_m,y_m\n0.4,0.4\n0.9,0.9\n",
    ".nc": b"G21 G90\nG0 X400 Y400\nG1 X900 Y900\n",
    ".dxf": b"0\nSECTION\n2\nENTITIES\n0\nLINE\n5\n2F\n8\n0\n10\n0\n20\n0\n11\n1\n21\n1\n",
}

STRUCTURES = st.recursive(
    HOSTILE,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=6), inner),
    max_leaves=12,
)


def many(count):
    """Return settings for `count` examples in the whole suite, and a twentieth in every run."""
    thorough = settings.get_current_profile_name() == "thorough"
    return settings(
        max_examples=(count if thorough else max(6, count // 20)) * FACTOR,
        derandomize=FACTOR == 1,
        deadline=None,
        database=None,
        suppress_health_check=list(HealthCheck),
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder of its own to be in."""
    here = tmp_path_factory.mktemp("fuzz")
    with contextlib.chdir(here):
        yield here


def survives(*words):
    """Run the command line in this process and hold it to its word; return the exit code."""
    out = io.TextIOWrapper(io.BytesIO(), "utf-8", write_through=True)
    err = io.TextIOWrapper(io.BytesIO(), "utf-8", "backslashreplace", write_through=True)
    with (
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
        pytest.raises(SystemExit) as ended,
    ):
        main([str(word) for word in words])
    message = err.buffer.getvalue().decode()
    assert (False, False) == ("Traceback" in message, "internal error" in message), (words, message)
    assert ended.value.code in {0, 1, 2}, (words, message)
    if ended.value.code == 2:
        # A line that names no command is answered by the help, which goes to stdout.
        assert message.strip() or b"COMMAND [ARGS]..." in out.buffer.getvalue(), words
    return ended.value.code


def survives_check(folder, content):
    """Check a content, and go on with what is valid."""
    path = folder / "task.yaml"
    path.write_bytes(content if isinstance(content, bytes) else content.encode("utf-8", "replace"))
    if survives("check", path) == 0:
        quick = ("--time-limit", "0.05", "--format", "json")
        survives("search-optimal", path, *quick)
        survives("search-optimal", path, *quick, "--collision", "aabb", "--solver", "exhaustive")
        survives("evaluate", path, "--sequence", "0,1,0", *quick)
        survives("explain", path, "0", "--format", "json")


# Files.


@many(150)
@given(content=st.binary(max_size=200) | st.text(max_size=200))
def test_no_bytes_are_too_odd(folder, content):
    """Of which few are YAML."""
    survives_check(folder, content)


@many(150)
@given(
    content=st.text(st.sampled_from("ab1.:-?[]{},&*!|>'\"%@`#\\ \n\t~<=_\0\x07\u00e4"), max_size=60)
)
def test_no_punctuation_is_too_odd(folder, content):
    """Of which much is nearly YAML."""
    survives_check(folder, content)
    survives_check(folder, f"kind: assembly\nname: {content}\n")


@many(100)
@given(content=STRUCTURES)
def test_no_structure_is_too_odd(folder, content):
    """YAML, but no task."""
    survives_check(folder, yaml.safe_dump(content, allow_unicode=True))


@many(100)
@given(content=st.dictionaries(st.sampled_from(sorted(yaml_text(TASK))), STRUCTURES))
def test_no_section_is_too_odd(folder, content):
    """The right keys with the wrong values."""
    survives_check(folder, yaml.safe_dump({**content, "kind": "assembly"}, allow_unicode=True))


def nodes(value, path=()):
    """Yield the path of every node beneath a value."""
    items = value.items() if isinstance(value, dict) else enumerate(value)
    for key, inner in items:
        yield (*path, key)
        if isinstance(inner, (dict, list)):
            yield from nodes(inner, (*path, key))


def mutated(content, path, change, value):
    """Return a copy in which one node is deleted, replaced, renamed, doubled or added to."""
    result = copy.deepcopy(content)
    holder = result
    for key in path[:-1]:
        holder = holder[key]
    last = path[-1]
    if change == "delete":
        del holder[last]
    elif change == "replace":
        holder[last] = value
    elif change == "insert" and isinstance(holder[last], dict):
        holder[last][value if isinstance(value, str) else "extra"] = value
    elif change == "insert" and isinstance(holder[last], list):
        holder[last].append(value)
    elif change == "rename" and isinstance(holder, dict):
        holder[value if isinstance(value, str) else "extra"] = holder.pop(last)
    elif change == "double" and isinstance(holder, list):
        holder.append(holder[last])
    return result


CHANGES = st.sampled_from(["delete", "replace", "insert", "rename", "double"])


def test_the_unspoilt_task_is_valid(folder):
    """Else the mutations would find nothing."""
    path = folder / "task.yaml"
    path.write_text(TASK)
    assert survives("check", path) == 0


@many(120)
@given(data=st.data())
def test_no_mutation_of_a_task_is_too_odd(folder, data):
    """One to three nodes of a valid task are spoilt."""
    content = yaml_text(TASK)
    for _ in range(data.draw(st.integers(1, 3))):
        path = data.draw(st.sampled_from(list(nodes(content))))
        content = mutated(content, path, data.draw(CHANGES), data.draw(HOSTILE))
        if not content:
            break
    survives_check(folder, yaml.safe_dump(content, allow_unicode=True, sort_keys=False))


def survives_bench(folder, content):
    """Check a content, and go on with what is valid."""
    path = folder / "task.yaml"
    path.write_bytes(content.encode("utf-8", "replace"))
    if survives("check", path) == 0:
        quick = ("--time-limit", "0.05", "--format", "json")
        survives("search-optimal", path, *quick)
        survives("search-optimal", path, *quick, "--solver", "csp")
        survives("evaluate", path, "--sequence", "0,1,0", "--part", "base-1", *quick)
        survives("explain", path, "1", "--part", "base-1", "--format", "json")


@pytest.mark.parametrize(
    "job", thinned(sorted(BENCHES), "divided", why="another bench in every run")
)
def test_the_unspoilt_benches_are_valid(folder, job):
    """And can be solved."""
    path = folder / "task.yaml"
    path.write_text(BENCHES[job])
    assert survives("check", path) == 0
    assert survives("search-optimal", path) == 0


@many(150)
@given(data=st.data(), job=st.sampled_from(sorted(BENCHES)))
def test_no_mutation_of_a_bench_is_too_odd(folder, data, job):
    """One to three nodes of a valid file of one of the jobs are spoilt."""
    content = yaml_text(BENCHES[job])
    for _ in range(data.draw(st.integers(1, 3))):
        path = data.draw(st.sampled_from(list(nodes(content))))
        content = mutated(content, path, data.draw(CHANGES), data.draw(HOSTILE))
        if not content:
            break
    survives_bench(folder, yaml.safe_dump(content, allow_unicode=True, sort_keys=False))


BENCH_SCHEMA = SwarmitfixConfig.model_json_schema(by_alias=True)
TEXTS = st.sampled_from(["C1", "C42", "C78", "C99", "one", "two", "a.csv", "kinematic", "x"])


def drawn_from(schema):
    """Return a strategy for values that a part of the schema lets through; numbers are small."""
    if "$ref" in schema:
        return st.deferred(lambda: drawn_from(BENCH_SCHEMA["$defs"][schema["$ref"].split("/")[-1]]))
    if "anyOf" in schema:
        return st.one_of(*map(drawn_from, schema["anyOf"]))
    if "const" in schema or "enum" in schema:
        return st.sampled_from(schema.get("enum") or [schema["const"]])
    kind = schema.get("type")
    if kind == "number" and schema.get("minimum") == -1000:
        # A coordinate, on the bench of the paper.
        return st.floats(0.2, 1.7)
    if kind in ("integer", "number"):
        maximum = max(schema.get("minimum", schema.get("exclusiveMinimum", -3)), -3)
        most = max(maximum, min(schema.get("maximum", schema.get("exclusiveMaximum", 13)), 13))
        if kind == "integer":
            return st.integers(int(maximum), int(most))
        return st.floats(maximum, most, exclude_min="exclusiveMinimum" in schema)
    if kind == "array":
        maximum = schema.get("minItems", 0)
        most = max(maximum, min(schema.get("maxItems", 4), 4))
        return st.lists(drawn_from(schema["items"]), min_size=maximum, max_size=most)
    if kind == "object":
        values = {key: drawn_from(item) for key, item in schema.get("properties", {}).items()}
        needed = schema.get("required", ())
        if values:
            return st.fixed_dictionaries({key: values.pop(key) for key in needed}, optional=values)
        inner = schema.get("additionalProperties")
        return st.dictionaries(
            TEXTS, drawn_from(inner) if isinstance(inner, dict) else HOSTILE, max_size=3
        )
    return {"boolean": st.booleans(), "null": st.none(), "string": TEXTS}.get(kind, HOSTILE)


JOBS = ("trajectory", "robots", "base")


@many(200)
@given(
    content=drawn_from({**BENCH_SCHEMA, "required": ["kind"]}),
    job=st.sampled_from(JOBS),
    data=st.data(),
)
def test_no_bench_that_the_schema_lets_through_is_too_odd(folder, content, job, data):
    """Every key has a value of its type, and there is one job as a rule."""
    for other in JOBS:
        if other != job:
            content.pop(other, None)
    if content.get(job) is None:
        content[job] = data.draw(drawn_from(BENCH_SCHEMA["properties"][job]))
    content["name"] = "drawn"
    survives_bench(folder, yaml.safe_dump(content, allow_unicode=True, sort_keys=False))


@many(60)
@given(
    content=st.binary(max_size=120) | st.text(max_size=120), suffix=st.sampled_from(sorted(FILES))
)
def test_no_trajectory_file_is_too_odd(folder, content, suffix):
    """Bytes, of which few are a drawing, a table or a program."""
    raw = content if isinstance(content, bytes) else content.encode("utf-8", "replace")
    for head in (b"", FILES[suffix]):
        (folder / f"a{suffix}").write_bytes(head + raw)
        survives_bench(folder, f"kind: swarmitfix\nname: a\ntrajectory: {{file: a{suffix}}}\n")


TOKENS = re.findall(r"[\w.-]+|\s+|.", BOARD.read_text())
SPLINTERS = st.sampled_from(
    [
        *("", " ", "\n", "\n  ", "\t", ":", ": ", "- ", "? ", "[", "]", "{", "}", ",", "---\n"),
        *("&a ", "*a", "!", "!!int ", "|", ">", "'", '"', "#", "%", "@", "...", "<<: ", "~"),
        *("0", "-1", "-0.0", "1e9", "1e999", ".nan", "\0", "\x1b", "\ufeff"),
        *("pcb", "brace", "load(", ")", "place(pcb)"),
    ]
)


@pytest.mark.slow(reason="250 edits; other oddities in every run")
@many(250)
@given(
    edits=st.lists(
        st.tuples(
            st.integers(0, len(TOKENS) - 1), SPLINTERS, st.sampled_from(["put", "add", "swap"])
        ),
        min_size=1,
        max_size=4,
    )
)
def test_no_slip_of_the_pen_is_too_odd(folder, edits):
    """Words and signs of the inverter board are replaced, added and swapped."""
    tokens = list(TOKENS)
    for index, splinter, kind in edits:
        if kind == "put":
            tokens[index] = splinter
        elif kind == "add":
            tokens[index] += splinter
        else:
            tokens[index - 1], tokens[index] = tokens[index], tokens[index - 1]
    path = folder / "task.yaml"
    path.write_text("".join(tokens))
    survives("check", path)


# Command lines.

WORDS = st.one_of(
    st.sampled_from(
        [
            *("", " ", ",", "0", "-1", "0,1", "0,,1", "99", "1e9", "1e999", "0x1", "9" * 5000),
            *("nan", "inf", "-inf", "\u0661", "\u00b2", "pick(box)", "pick(", "a" * 5000),
            *("exact", "exact,exact", "exhaustive", "aabb", "aabb,precedence", "kinematic"),
            *("exact.max_labels=1", "max_labels=0", "max_labels=1e999", "exact.dives=maybe"),
            *("aabb.tolerance_m=.nan", "aabb.tolerance_m=0x1", "=", ".=", "exact.=1", "a.b.c=d"),
            *("[key]=1", "a=b", "--", "--help", "-h", "json", "csv", "md", "task.yaml", ".."),
            *("assembly", "solver", "collision", "physics", "domain", "%s", "{}", "$(ls)"),
            *("\ud800", "\udcff", "\0", "\n", "\x1b[31m", "\N{PILE OF POO}"),
        ]
    ),
    st.integers().map(str),
    st.floats().map(str),
    st.text(max_size=12),
)
OPTIONS = [
    *("--sequence", "--after", "-O", "--solver", "--solvers", "--collision", "--physics", "--gap"),
    *("--seed", "--format", "--no-cache", "--warm", "--nonsense"),
]


@pytest.fixture(scope="module")
def small(folder):
    """A valid task."""
    (folder / "small.yaml").write_text(TASK)
    return folder


# What keeps a valid line from searching or learning for minutes.
SHORT = {
    **dict.fromkeys(("search-optimal", "compare", "evaluate"), ("--time-limit", "0.05")),
    "train": ("--steps", "100", "--runs", "2"),
}


@many(300)
@given(
    command=st.sampled_from(sorted(COMMANDS)),
    task=st.just("small.yaml") | WORDS,
    words=st.lists(
        st.tuples(st.sampled_from(OPTIONS), WORDS).map(list) | WORDS.map(lambda word: [word]),
        max_size=3,
    ),
)
def test_no_command_line_is_too_odd(small, command, task, words):
    """Any option with any value, in any number."""
    given_words = [word for group in words for word in group]
    survives(command, *SHORT.get(command, ()), task, *given_words)


REQUIRED = {
    "search-optimal": (),
    "evaluate": ("--sequence", "0,1"),
    "compare": ("--solvers", "exact"),
    "explain": ("0",),
    "chart": (),
}


@many(400)
@given(command=st.sampled_from(sorted(REQUIRED)), option=st.sampled_from(OPTIONS), word=WORDS)
def test_no_value_of_an_option_is_too_odd(small, command, option, word):
    """One option of a command line that is valid without it."""
    limit = SHORT.get(command, ())
    survives(command, "small.yaml", *REQUIRED[command], *limit, f"{option}={word}")


@pytest.mark.parametrize("name", ["", "..", ".", "small.yaml", "a\0b", "a" * 5000, "\ud800", "new"])
def test_no_folder_for_results_is_too_odd(small, name):
    """None that exists is written to."""
    survives("search-optimal", "small.yaml", f"--out={name}")


@many(60)
@given(word=WORDS)
def test_no_time_limit_is_too_odd(small, word):
    """A large one is no danger on a small task."""
    survives("search-optimal", "small.yaml", f"--time-limit={word}")


@many(100)
@given(sequence=st.lists(st.integers(-1, 7).map(str) | WORDS, max_size=8).map(",".join))
def test_no_sequence_is_too_odd(small, sequence):
    """Of numbers, names and what is neither."""
    survives("evaluate", "small.yaml", f"--sequence={sequence}", "--time-limit", "0.05")
    survives("explain", "small.yaml", "0", f"--after={sequence}")


@many(60)
@given(kind=st.sampled_from(sorted(registry.KINDS)) | WORDS, name=WORDS)
def test_no_kind_or_name_of_a_plugin_is_too_odd(folder, kind, name):
    """Known kinds with unknown names, and the reverse."""
    survives("plugins", "--", kind, name)
    survives("schema", "--", name)


@many(60)
@given(words=st.lists(st.sampled_from([*COMMANDS, "--version", "--help"]) | WORDS, max_size=4))
def test_no_words_are_too_odd(folder, words):
    """Not even a command is given for sure."""
    if words[:1] not in (["search-optimal"], ["compare"], ["warm-up"]):
        survives(*words)
