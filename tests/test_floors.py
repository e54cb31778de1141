"""Who may open files, start processes, and do neither: read from the source."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from sources import parsed

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "src" / "skillplan"
PLUGINS = ROOT / "plugins"
MODULES = sorted([*SOURCE.rglob("*.py"), *PLUGINS.glob("*/src/**/*.py")])

# Calls by which a file is opened, by their last name; of some modules only.
OPENING = {"open", "fdopen", "read_text", "read_bytes", "write_text", "write_bytes"}
OPENING |= {"readfile", "saveas", "save_file", "load_file", "memmap", "fromfile", "tofile"}
OPENING_OF = {
    "json": {"load", "dump"},
    "pickle": {"load", "dump"},
    "np": {"load", "save", "savez", "savez_compressed", "loadtxt", "savetxt", "genfromtxt"},
    "trimesh": {"load", "load_mesh", "load_path"},
    "os": {"replace", "rename", "link", "symlink", "truncate", "mkfifo"},
}
OPENING_MODULES = {"tempfile", "shutil", "fcntl", "mmap", "filelock", "fileinput"}

# Who opens something that no user handed over, and why.
OPENS = {
    "robots/arm_description.py": "arms and shapes of robots that lie in its package",
    "workers/processes.py": "the process file system of Linux",
    "workers/local_processes.py": "the null device, for what libraries print",
    "workers/supervisor.py": "the lists of processes of Linux; a pipe that ends with its parent",
    "domains/assembly/mesh_files.py": "a 3MF, an archive in memory",
    "domains/domain.py": "the starter that lies in the package of a domain",
    "views/report/page.py": "the style sheet and the player that lie in its package",
    "pipeline/examples.py": "task files and meshes that come with skillplan",
    "plugins/installed.py": "what pip wrote of a distribution",
    "cli/commands/warm_up.py": "a board of its own, in a folder of its own",
    "views/figures/hulls_figure.py": "a picture that it drew itself, in memory",
    "cli/writing.py": "the null device, once stdout or stderr is gone; a copy of stdout",
    "skillplan_pybullet/quiet_output.py": "the null device, for what pybullet prints",
    "skillplan_pybullet/world.py": "meshes for pybullet, in a folder of its own",
    "skillplan_pybullet/robot_file.py": "the arm for pybullet, in a folder of its own",
    "skillplan_simulation/execution/skill_runner.py": "opens the jaws of a hand",
    "skillplan_pinocchio/planning/travel.py": "the null device, for what OMPL says at its end",
    "training/family_training.py": "boards of its own, in a folder of its own",
    "benchmark/instances.py": "a task of its own, in a folder of its own",
    "training/groups.py": "a folder of its own for what a training elsewhere keeps",
    "judge/fast_downward.py": "a folder of its own for a planner",
    "skillplan_ray/access.py": "the token of a cluster, and a folder of its own for its session",
    "skillplan_ray/fingerprint.py": "the process file system, and the sources of packages",
    "skillplan_cad/reading/step_file.py": "a folder of its own, in which OCCT reads",
    "skillplan_cad/writing/trial.py": "a task to be checked, in a folder of its own",
    "skillplan_ros2/exporter.py": "a bag of its own, in a folder of its own",
}

STARTING_MODULES = {"multiprocessing", "subprocess", "concurrent", "pty", "asyncio"}
STARTING_OF_OS = {"fork", "forkpty", "system", "popen", "posix_spawn", "posix_spawnp", "startfile"}

IO_MODULES = OPENING_MODULES | STARTING_MODULES
IO_MODULES |= {"os", "io", "pathlib", "sys", "socket", "logging", "sqlite3", "urllib", "glob"}


def place(path: Path) -> str:
    """Return a module's path from its package on."""
    if path.is_relative_to(SOURCE):
        return path.relative_to(SOURCE).as_posix()
    return path.as_posix().partition("/src/")[2]


@cache
def nodes(path: Path) -> list[ast.AST]:
    """Return all that a module holds of calls and imports; read once."""
    kinds = (ast.Call, ast.Import, ast.ImportFrom)
    tree = ast.walk(parsed(path))
    return [node for node in tree if isinstance(node, kinds)]


def calls(path: Path) -> Iterator[tuple[str, str]]:
    """Yield for every call what it is called on, if that is a name, and its own name."""
    for node in nodes(path):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            yield "", node.func.id
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            holder = node.func.value
            yield holder.id if isinstance(holder, ast.Name) else "?", node.func.attr


def imports(path: Path) -> set[str]:
    """Return the top-level modules that a module imports, wherever it does."""
    result: set[str] = set()
    for node in nodes(path):
        if isinstance(node, ast.Import):
            result |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module is not None:
            result.add(node.module.partition(".")[0])
    return result


def opening(path: Path) -> set[str]:
    """Return by what a module opens, replaces or links files."""
    result = OPENING_MODULES & imports(path)
    for holder, name in calls(path):
        # By its bare name only `open`: the others are functions of the floor `files`.
        if name in OPENING_OF.get(holder, ()) or (name in OPENING if holder else name == "open"):
            result.add(f"{holder}.{name}" if holder else name)
    return result


def starting(path: Path) -> set[str]:
    """Return by what a module starts processes."""
    result = STARTING_MODULES & imports(path)
    return result | {
        name
        for holder, name in calls(path)
        if holder == "os" and (name in STARTING_OF_OS or name.startswith(("exec", "spawn")))
    }


def test_only_the_floor_of_files_opens_files():
    """Whoever else opens anything is listed, with what it is."""
    results = {place(path): opening(path) for path in MODULES}
    openers = {name for name, by in results.items() if by and not name.startswith("files/")}
    assert set(OPENS) == openers, {name: results.get(name) for name in openers ^ set(OPENS)}


def test_only_the_floor_of_workers_starts_processes():
    """No exception: programs of others are started there, too."""
    results = {place(path): starting(path) for path in MODULES}
    starters = {"processes", "local_processes", "supervisor"}
    assert {f"workers/{name}.py" for name in starters} == {
        name for name, by in results.items() if by
    }


def test_tasks_are_pure_data():
    """The floor `task` neither reads nor writes, nor knows where anything lies."""
    modules = sorted((SOURCE / "task").glob("*.py"))
    assert modules
    for path in modules:
        assert set() == IO_MODULES & imports(path), path.name
        assert set() == opening(path), path.name
        assert set() == {"print", "input"} & {name for _, name in calls(path)}, path.name


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ("open('a')", {"open"}),
        ("Path('a').open()", {"?.open"}),
        ("path.read_text()", {"path.read_text"}),
        ("import numpy as np\nnp.load('a')", {"np.load"}),
        ("def f():\n    import shutil", {"shutil"}),
        ("from tempfile import mkdtemp", {"tempfile"}),
        ("import os\nos.replace('a', 'b')", {"os.replace"}),
        ("text.replace('a', 'b')\njson.loads(text)\nread_text(path)", set()),
    ],
)
def test_the_search_finds_what_opens(tmp_path, source, expected):
    """So that the lists above mean something."""
    path = tmp_path / "module.py"
    path.write_text(source)
    assert expected == opening(path)
