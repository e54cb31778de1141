"""Whatever is wrong with a task file is told in one line each: where, what, what instead.

The corpus in ``bad_input`` holds one fault a file; what is expected stands in its first line.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from skillplan.cli import main
from skillplan.errors import TaskError
from skillplan.files import MAX_BYTES, MAX_VALUES
from skillplan.pipeline import load_problem
from thinned import release_case, slow_case

CORPUS = sorted((Path(__file__).parent / "bad_input").glob("*.yaml"))
BOARD = Path(__file__).parents[1] / "configs" / "inverter_board.yaml"
MARK = b"# expect "

# A box on its own: what most of the tests below spoil.
BOX = """kind: assembly
name: box
robot: {home_m: [0.3, 0.0]}
tools: {gripper: {holder_m: [0.5, 0.3]}}
initial_tool: gripper
parts:
  box: {tool: gripper, size_m: [0.1, 0.1, 0.1], start_m: [0.3, 0.2], goal_m: [0.5, 0.0]}
step_limit: 2
"""


def expected_lines(path):
    """Return the lines that a file of the corpus says it is to be answered with."""
    lines = [line for line in path.read_bytes().split(b"\n") if line.startswith(MARK)]
    return [f"skillplan: error: {path}:{line[len(MARK) :].decode()}" for line in lines]


@pytest.fixture
def run(capsys):
    """Run the command line in this process: exit code, stdout, stderr."""

    def call(*words):
        with pytest.raises(SystemExit) as ended:
            main([str(word) for word in words])
        captured = capsys.readouterr()
        return ended.value.code, captured.out, captured.err

    return call


@pytest.fixture
def faults_of(tmp_path, run):
    """Return what `check` says of a text, without the file's name."""

    def check(text):
        path = tmp_path / "task.yaml"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        code, out, err = run("check", path)
        assert (2, "") == (code, out)
        return [line.removeprefix(f"skillplan: error: {path}:") for line in err.splitlines()]

    return check


def test_the_corpus_is_large():
    """At least seventy files for every kind of task, each with one fault."""
    benches = [path for path in CORPUS if path.stem.startswith("swarmitfix_")]
    assert len(benches) >= 70
    assert len(CORPUS) - len(benches) >= 70
    assert dict.fromkeys(CORPUS, 1) == {path: len(expected_lines(path)) for path in CORPUS}


@pytest.mark.parametrize("path", CORPUS, ids=lambda path: path.stem)
def test_every_fault_is_told_in_one_line_with_its_place(path, run):
    """Exit code 2, file:line:column: path: message on stderr, nothing on stdout."""
    code, out, err = run("check", path)
    assert (2, "", expected_lines(path)) == (code, out, err.splitlines())
    assert all(line.isprintable() for line in err.splitlines())


@pytest.mark.parametrize("path", CORPUS[:: len(CORPUS) // 8], ids=lambda path: path.stem)
def test_in_json_the_error_is_the_one_document_on_stdout(path, run):
    """With the same file, line, column and message as on stderr."""
    code, out, err = run("search-optimal", path, "--format", "json")
    document = json.loads(out)
    assert (2, expected_lines(path)) == (code, err.splitlines())
    assert ("skillplan.error/1", "TaskError", 2) == (
        document["schema"],
        document["error"],
        document["exit_code"],
    )
    (issue,) = document["issues"]
    place = f"skillplan: error: {issue['file']}:{issue['line']}:{issue['column']}: "
    (line,) = err.splitlines()
    assert (True, True) == (line.startswith(place), line.endswith(issue["message"]))


@pytest.mark.parametrize(
    "words",
    [
        ("search-optimal",),
        ("evaluate", "--sequence", "0"),
        ("compare", "--solvers", "exact,exhaustive"),
        ("explain", "0"),
        ("chart",),
    ],
    ids=lambda words: words[0],
)
def test_every_command_tells_the_same(words, run):
    """Not only `check` validates."""
    path = next(path for path in CORPUS if path.stem == "unknown_goal_on")
    command, *rest = words
    code, out, err = run(command, path, *rest)
    assert (2, "", expected_lines(path)) == (code, out, err.splitlines())


@pytest.mark.parametrize(
    "stem", [slow_case("alias_bomb", reason="another file in every run"), "tag_python_object"]
)
def test_a_process_of_its_own_says_the_same(stem):
    """No traceback, on whatever way the error leaves the process."""
    path = next(path for path in CORPUS if path.stem == stem)
    done = subprocess.run(
        [sys.executable, "-m", "skillplan", "check", str(path)],
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    assert (2, "", expected_lines(path)) == (done.returncode, done.stdout, done.stderr.splitlines())


# What cannot say in its first line what is expected.


def test_an_empty_file_is_refused(faults_of):
    """With how to start."""
    assert ["1:1: is empty. Start it with 'kind:'."] == faults_of("")


@pytest.mark.parametrize("encoding", ["utf-16", "utf-32"])
def test_another_encoding_is_refused(faults_of, encoding):
    """At the first byte."""
    expected = ["1:1: byte 0xff is not UTF-8. Save the file as UTF-8."]
    assert expected == faults_of(BOX.encode(encoding))


def test_utf_16_without_a_mark_is_refused(faults_of):
    """Which is UTF-8 with a NUL at every other place."""
    expected = ["1:2: character U+0000 is not allowed in YAML. Remove it."]
    assert expected == faults_of(BOX.encode("utf-16-le"))


def test_a_byte_order_mark_does_no_harm(tmp_path):
    """Editors of some systems write one before UTF-8."""
    path = tmp_path / "task.yaml"
    path.write_bytes(b"\xef\xbb\xbf" + BOX.encode())
    assert "box" == load_problem(path).name


def test_a_column_counts_characters(faults_of):
    """Not bytes, of which an umlaut has two."""
    assert ["3:9: byte 0xff is not UTF-8. Save the file as UTF-8."] == faults_of(
        "kind: assembly\n# \u00e4\n# \u00e4\u00f6\u00fc\u00df \u00e4".encode() + b"\xff\n"
    )


def test_a_file_may_be_as_large_as_the_limit_and_no_larger(tmp_path, run):
    """One byte more is refused before it is parsed."""
    path = tmp_path / "task.yaml"
    path.write_text(BOX + "#" * (MAX_BYTES - len(BOX)))
    assert "box" == load_problem(path).name
    path.write_text(BOX + "#" * (MAX_BYTES - len(BOX) + 1))
    message = f"is larger than the {MAX_BYTES:,} bytes that a task file may have."
    assert (2, "", f"skillplan: error: {path}: {message}\n") == run("check", path)


# All at once.


def test_faults_of_spelling_are_told_at_once_in_the_order_of_the_file(faults_of):
    """Keys, types, ranges, back ends: five faults, five lines."""
    text = (
        BOX.replace("name: box", "name: a box")
        .replace("home_m: [0.3, 0.0]", "home_m: [0.3, .nan]")
        .replace("initial_tool: gripper", "initial_tool: gripper\ninitial_tool: none")
        .replace("start_m:", "mass: 1, start_m:")
        + "collision: {aabb: {tolerance: 1}}\n"
    )
    assert [
        "2:7: name: 'a box' is not a name. Use letters, digits, '_' and '-', a letter first, "
        "at most 64.",
        "3:23: robot.home_m[1]: must be a finite number, not .nan.",
        "6:1: initial_tool: key 'initial_tool' stands twice, first in line 5. Keep one.",
        "8:49: parts.box.mass: unknown key 'mass'. Did you mean 'mass_kg'?",
        "10:20: collision.aabb.tolerance: 'aabb' has no option 'tolerance'. "
        "Did you mean 'tolerance_m'?",
    ] == faults_of(text)


def test_faults_of_a_bench_are_told_at_once_in_the_order_of_the_file(faults_of):
    """Positions, sides, mounts and the trajectory: five faults, five lines."""
    assert [
        "3:27: trajectory.vertices_m[0]: the point (-0.1, 0) m is off the bench, whose outline is "
        "x 0 to 2.38 m, y 0 to 1.76669182 m; move it onto the bench.",
        "3:46: trajectory.vertices_m[2]: two consecutive points are the same, (1, 1) m, which "
        "makes a segment of zero length; leave one of them out.",
        "4:14: base.home: position 'C79' is not on a bench of 6 x 13, which has C1 to C78. "
        "Did you mean 'C78'?",
        "4:25: base.side: an open trajectory has no inward side. Give left or right.",
        "5:23: pkm.sheet_height_m: must be above 0.5, the height of the machine's base, not 0.4.",
    ] == faults_of(
        "kind: swarmitfix\nname: bench\ntrajectory: {vertices_m: [[-0.1, 0], [1, 1], [1, 1]]}\n"
        "base: {home: C79, side: inward}\npkm: {sheet_height_m: 0.4}\n"
    )


def test_a_fault_of_all_tasks_of_a_chain_is_told_once(faults_of):
    """Not once for each of them."""
    goals = ", ".join(f"C{i}" for i in range(1, 40))
    expected = [
        "4:13: collision.precedence: cannot serve this task: the task file has no 'chart:'. "
        "Add one, or use --collision aabb."
    ]
    assert expected == faults_of(
        f"kind: swarmitfix\nname: bench\nbase: {{goals: [{goals}]}}\n"
        "collision: {precedence: {}}\n"
    )


def test_a_drawing_that_is_none_is_told_in_one_line(tmp_path, faults_of):
    """Whatever the library that reads it says of it."""
    text = "kind: swarmitfix\nname: bench\ntrajectory: {file: a.dxf}\n"
    for content in (
        b"no drawing\n",
        b"\0" * 100,
        b"0\nSECTION\n",
        b"  0\nSECTION\n  2\nENTITIES\n",
    ):
        (tmp_path / "a.dxf").write_bytes(content)
        (line,) = faults_of(text)
        assert line.startswith("3:20: trajectory.file: a.dxf: ")
        assert line.isprintable()


def test_a_file_s_name_cannot_break_the_line(faults_of):
    """It is shown in one line, and cut."""
    for name in ('"a\\nb.csv"', f'"{"a" * 4000}.csv"', '"\\u202e.csv"', '"a\\0.csv"'):
        (line,) = faults_of(f"kind: swarmitfix\nname: bench\ntrajectory: {{file: {name}}}\n")
        assert line.startswith("3:20: trajectory.file: ")
        assert line.isprintable()
        assert len(line) < 500


def test_faults_of_meaning_are_told_at_once_in_the_order_of_the_file(faults_of):
    """References, circles, lists, limits, back ends: five faults, five lines."""
    text = BOX.replace("initial_tool: gripper", "initial_tool: griper").replace(
        "goal_m: [0.5, 0.0]", "goal_m: [0.5, 0.0], goal_on: box"
    ).replace("step_limit: 2", "step_limit: 1") + (
        "goal: [placed(bx)]\ncollision: {aabbb: {}}\nobservation: [not hand_fee]\n"
    )
    assert [
        "5:15: initial_tool: unknown tool 'griper'. Did you mean 'gripper'?",
        "7:99: parts.box.goal_on: 'box' cannot lie on itself. Name another part.",
        "9:8: goal[0]: unknown fact 'placed(bx)'. Did you mean 'placed(box)'?",
        "10:13: collision.aabbb: unknown collision back end 'aabbb'. Did you mean 'aabb'?",
        "11:15: observation[0]: unknown fact 'hand_fee'. Did you mean 'hand_free'?",
    ] == faults_of(text)


def test_a_slip_in_a_key_that_is_needed_is_one_fault(faults_of):
    """Not also that the part has no shape."""
    expected = ["7:24: parts.box.sise_m: unknown key 'sise_m'. Did you mean 'size_m'?"]
    assert expected == faults_of(BOX.replace("size_m", "sise_m"))


def test_a_thousand_faults_are_not_all_printed(faults_of):
    """Two hundred lines, and how many more there are."""
    lines = faults_of(BOX + "".join(f"key_{i}: 1\n" for i in range(999)))
    assert 201 == len(lines)
    assert "skillplan: and 799 more faults" == lines[-1]


# Back ends of the file's choice.


def test_a_back_end_that_is_replaced_need_not_be_installed(tmp_path, run):
    """So that a task made for a plugin runs without it."""
    path = tmp_path / "task.yaml"
    path.write_text(BOX + "collision: {not-installed: {depth_m: 1}}\n")
    code, out, err = run("search-optimal", path, "--collision", "aabb", "--format", "json")
    assert (0, "", "optimal") == (code, err, json.loads(out)["status"])
    code, _, err = run("search-optimal", path)
    assert (2, True) == (code, "unknown collision back end 'not-installed'" in err)


# Paths.


@pytest.fixture
def shop(tmp_path, monkeypatch):
    """A folder with two task files, where one works."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "lid.yaml").write_text(BOX)
    (tmp_path / "board.yaml").write_text(BOX)
    (tmp_path / "empty").mkdir()
    (tmp_path / "loop.yaml").symlink_to("loop.yaml")
    os.mkfifo(tmp_path / "pipe.yaml")
    return tmp_path


@pytest.mark.parametrize(
    ("path", "message"),
    [
        ("bord.yaml", "no such file. Did you mean 'board.yaml'?"),
        ("xyz.yaml", "no such file. There are board.yaml, lid.yaml, loop.yaml, pipe.yaml."),
        ("empty/a.yaml", "no such file. There is no task file in 'empty'."),
        ("nowhere/a.yaml", "no such file. There is no folder 'nowhere'."),
        ("empty", "is a folder. Give the path of a task file."),
        ("/", "is a folder. Give the path of a task file."),
        ("pipe.yaml", "is not a regular file. Give the path of a task file."),
        ("/dev/zero", "is not a regular file. Give the path of a task file."),
        ("/dev/null", "is not a regular file. Give the path of a task file."),
        ("lid.yaml/a.yaml", "cannot be read: Not a directory."),
        ("loop.yaml", "cannot be read: Too many levels of symbolic links."),
        ("a" * 5000, "cannot be read: File name too long."),
        ("a\0b", "cannot be read: embedded null byte."),
    ],
    ids=lambda text: repr(text[:20]),
)
def test_a_path_that_is_no_task_file_is_one_clear_message(shop, run, path, message):
    """Nothing hangs, whatever the path leads to."""
    shown = path.replace("\0", "\\x00")
    assert (2, "", f"skillplan: error: {shown}: {message}\n") == run("check", path)


def test_an_empty_path_is_one_clear_message(run):
    """A variable of a script that was not set."""
    message = "skillplan: error: '': is not a path. Give the path of a task file.\n"
    assert (2, "", message) == run("check", "")


def test_a_file_that_must_not_be_read_is_one_clear_message(shop, run, monkeypatch):
    """Root may read everything, so that the refusal is played here."""

    def refuse(*_, **__):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("skillplan.files.regular_file.open_regular", refuse)
    message = "skillplan: error: lid.yaml: cannot be read: Permission denied.\n"
    assert (2, "", message) == run("check", "lid.yaml")


# No file hangs or exhausts memory.


def board(count, boxes=1, extra=""):
    """Return a task with many parts on a grid, each of some boxes."""
    lines = [
        "kind: assembly",
        "name: large",
        "robot: {home_m: [0.3, 0.0], reach_m: 5}",
        "tools: {gripper: {holder_m: [0.5, 0.4]}}",
        "initial_tool: gripper",
        "parts:",
    ]
    for i in range(count):
        x_m, y_m = i % 16 * 0.05, i // 16 * 0.05
        shape = "size_m: [0.01, 0.01, 0.01]"
        if boxes > 1:
            rows = [
                "{size_m: [0.001, 0.001, 0.001], centre_m: "
                f"[{j % 8 * 0.001:.3f}, {j // 8 * 0.001:.3f}, 0.0005]}}"
                for j in range(boxes)
            ]
            shape = f"boxes: [{', '.join(rows)}]"
        lines.append(
            f"  p{i}: {{tool: gripper, {shape}, start_m: [{x_m:.3f}, {y_m + 0.5:.3f}], "
            f"goal_m: [{x_m:.3f}, {y_m - 1.5:.3f}]}}"
        )
    return "\n".join([*lines, f"step_limit: {2 * count}", extra])


def chart_of(count):
    """Return every pair of parts as a line of a chart."""
    lines = [
        f"  - {{before: p{i}, after: [{', '.join(f'p{j}' for j in range(i + 1, count))}]}}"
        for i in range(count - 1)
    ]
    return "\n".join(["chart:", *lines])


def zigzag(count):
    """Return an open trajectory of many vertices."""
    rows = [f"[{0.1 + 2.1 * (i % 2):.1f}, {0.05 + 1.6 * i / count:.6f}]" for i in range(count)]
    return f"{BENCH}trajectory: {{vertices_m: [{', '.join(rows)}]}}\n"


def fleet(rows, cols):
    """Return eight robots on a bench."""
    robots = [f"r{i}: {{home: C{10 * i}, goal: C{10 * i + 500}}}" for i in range(1, 9)]
    return f"{BENCH}bench: {{rows: {rows}, cols: {cols}}}\nrobots: {{{', '.join(robots)}}}\n"


HEAD = "kind: assembly\nname: large\n"
BENCH = "kind: swarmitfix\nname: large\n"
LINE = "trajectory: {vertices_m: [[0.4, 0.4], [1.9, 0.9]]}\n"
MILLION = 1_000_000
PATHOLOGICAL = {
    "brackets": (2, "[" * MILLION),
    "braces": (2, "{a: " * (MILLION // 4)),
    "questions": (2, "? " * (MILLION // 2)),
    "questions_in_lines": (2, "? \n" * (MILLION // 3)),
    "dashes": (2, "- " * (MILLION // 2)),
    "steps": (2, "\n".join(" " * i + "a:" for i in range(1400))),
    "documents": (2, "---\n" * (MILLION // 4)),
    "tags": (2, HEAD + "x:\n" + "- !!str a\n" * 90_000),
    "anchors": (2, HEAD + "x:\n" + "".join(f"- &a{i} 1\n" for i in range(70_000))),
    "aliases": (2, HEAD + "x:\n- &a [1, 1, 1, 1]\n" + "- *a\n" * 150_000),
    "bomb": (
        2,
        HEAD
        + "a0: &a0 [1]\n"
        + "".join(f"a{i}: &a{i} [{f'*a{i - 1}, ' * 9}]\n" for i in range(1, 31)),
    ),
    "keys": (2, "".join(f"k{i}: 1\n" for i in range(90_000))),
    "unknown_keys": (2, HEAD + "".join(f"k{i}: 1\n" for i in range(70_000))),
    "equal_keys": (2, HEAD + "a: 1\n" * 90_000),
    "number_keys": (2, HEAD + "".join(f"{i}: 1\n" for i in range(90_000))),
    "long_key": (2, HEAD + f'"{"k" * 900_000}": 1\n'),
    "long_text": (2, HEAD + f"kinds: {'k' * 900_000}\n"),
    "long_number": (2, HEAD + f"step_limit: {'9' * 900_000}\n"),
    "long_fraction": (2, HEAD + f"step_limit: 1.{'9' * 900_000}\n"),
    "long_exponent": (2, HEAD + f"step_limit: 1e{'9' * 900_000}\n"),
    "long_list": (2, HEAD + f"parts: [{'1, ' * 90_000}]\n"),
    "large_flow": (2, "{" + '"a": 1, ' * 110_000 + "}"),
    "colons": (2, HEAD + "x: " + "a:" * 450_000),
    "comments": (2, "#\n" * (MILLION // 2)),
    "parts_256": (0, board(256)),
    "parts_257": (2, board(257)),
    "boxes_1024": (0, board(16, boxes=64)),
    "boxes_1088": (2, board(17, boxes=64)),
    "one_place": (2, board(256).replace("0.7", "0.5").replace("0.6", "0.5")),
    "long_chart": (0, board(256, extra=chart_of(256))),
    "chart_circle": (2, board(256, extra=chart_of(256) + "\n  - {before: p255, after: [p0]}\n")),
    "goals_unknown": (
        2,
        board(256, extra=f"goal: [{', '.join(f'plced(p{i})' for i in range(4096))}]"),
    ),
    "goals_many": (2, board(256, extra=f"goal: [{'placed(p1), ' * 30_000}]")),
    "back_ends_many": (
        2,
        board(9, extra=f"collision: {{{', '.join(f'aab{i}: {{}}' for i in range(20_000))}}}"),
    ),
    "bench_large": (0, BENCH + "bench: {rows: 4, cols: 499}\nbase: {goals: [C1996]}\n"),
    "bench_larger": (2, BENCH + "bench: {rows: 1000, cols: 2001}\nbase: {goals: [C1]}\n"),
    "bench_goals": (
        2,
        f"{BENCH}bench: {{rows: 10, cols: 999}}\nbase: {{goals: [{', '.join(['C1'] * 1000)}]}}\n",
    ),
    "goals_500": (0, f"{BENCH}base: {{goals: [{', '.join(['C1', 'C2'] * 250)}]}}\n"),
    "vertices_many": (2, zigzag(10_000)),
    "supports_many": (2, f"{BENCH}{LINE}heads: {{subdivisions: [1000000]}}\n"),
    "heads_many": (2, f"{BENCH}{LINE}heads: {{step_m: 1e-300}}\n"),
    "chords_many": (
        2,
        BENCH
        + "trajectory: {start_m: [0, 0], chord_tolerance_m: 0.000001, path: [{arc_to_m: [1, 0], "
        + "through_m: [0.5, 0.000001]}]}\nbench: {pitch_m: 1e-300}\n",
    ),
    "fleet_large": (0, fleet(10, 67)),
    "fleet_larger": (2, fleet(10, 999)),
    "options_many": (
        2,
        board(9, extra=f"collision: {{aabb: {{{', '.join(f't{i}: 1' for i in range(40_000))}}}}}"),
    ),
}

# Runs `check` on each file under a limit on memory; says the exit code and the time of each.
HARNESS = """
import contextlib, io, json, resource, sys, time
limit = 1 << 30
resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
from skillplan.cli.app import main
found = {}
for path in sys.argv[1:]:
    begin_s, errors = time.perf_counter(), io.StringIO()
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(errors):
        try:
            main(["check", path])
        except SystemExit as ended:
            code = ended.code
    found[path] = [code, time.perf_counter() - begin_s, errors.getvalue()]
print(json.dumps(found))
"""


# A second or more each; the others are refused, or accepted, in the same places.
EXPENSIVE = {
    *("back_ends_many", "bench_large", "boxes_1024", "equal_keys", "goals_unknown", "keys"),
    *("number_keys", "options_many", "tags", "vertices_many"),
    *("aliases", "anchors", "chart_circle", "fleet_large", "long_chart", "long_list"),
    *("unknown_keys", "bench_goals", "goals_500", "large_flow", "parts_256"),
}


@pytest.mark.parametrize(
    "names",
    [
        slow_case(
            sorted(set(PATHOLOGICAL) - EXPENSIVE),
            reason="a process of its own with all of them; the corpus, with its bomb of "
            "aliases, in every run",
        ),
        release_case(
            sorted(EXPENSIVE), reason="21 of them, a second each; the others in the whole suite"
        ),
    ],
    ids=["quick", "expensive"],
)
def test_no_file_hangs_or_exhausts_memory(tmp_path, names):
    """Seconds at most, within a gigabyte of addresses; refused in words, if it is refused."""
    for name in names:
        (tmp_path / f"{name}.yaml").write_text(PATHOLOGICAL[name][1])
    paths = [str(tmp_path / f"{name}.yaml") for name in names]
    done = subprocess.run(
        [sys.executable, "-c", HARNESS, *paths],
        capture_output=True,
        text=True,
        check=True,
        timeout=300,
    )
    results = {Path(path).stem: answer for path, answer in json.loads(done.stdout).items()}
    expected = {name: PATHOLOGICAL[name][0] for name in names}
    assert expected == {name: code for name, (code, _, _) in results.items()}
    assert [] == [(name, seconds) for name, (_, seconds, _) in results.items() if seconds > 20]
    for _, _, err in results.values():
        lines = err.splitlines()
        in_words = ("skillplan: error: ", "skillplan: and ")
        assert [] == [line for line in lines if not line.startswith(in_words)]


@pytest.mark.slow(reason="waits for the limit; time limits of searches are in every run")
@pytest.mark.parametrize(
    "parts", [40, *(slow_case(parts, reason="40 parts in every run") for parts in (96, 256))]
)
def test_a_search_on_a_large_task_heeds_its_time_limit(tmp_path, parts):
    """Preparing it included: many parts, each pair of them in the chart."""
    path = tmp_path / "task.yaml"
    path.write_text(board(parts, extra=chart_of(parts)))
    done = subprocess.run(
        [sys.executable, "-m", "skillplan", "search-optimal", str(path), "--time-limit", "0.3"],
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    assert (True, "") == (done.returncode in (0, 1), done.stderr)


@pytest.mark.slow(reason="files of 400,000 values; the alias bomb in every run")
def test_more_values_than_allowed_are_refused_however_they_come(faults_of):
    """Written out or by aliases."""
    written = HEAD + f"x: [{'1,' * (MAX_VALUES + 100_001)}]\n"
    assert [f"3:399991: holds more than {MAX_VALUES:,} values."] == faults_of(written)
    by_alias = HEAD + "x: [&a [1,1,1,1,1,1,1,1,1,1]" + ",*a" * (MAX_VALUES // 10) + "]\n"
    (line,) = faults_of(by_alias)
    assert "grows too large once its aliases are expanded" in line


def test_an_error_carries_its_issues(tmp_path):
    """For those who load a task from Python."""
    path = tmp_path / "task.yaml"
    path.write_text(BOX.replace("step_limit: 2", "step_limit: two"))
    with pytest.raises(TaskError) as raised:
        load_problem(path)
    (issue,) = raised.value.issues
    assert (("step_limit",), 8, 13) == (issue.path, issue.line, issue.column)
    assert "must be a whole number, not 'two'." == issue.message
