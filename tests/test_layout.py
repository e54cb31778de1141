"""The repository itself: what starting costs, names, docstrings, sizes, versions, exports."""

from __future__ import annotations

import ast
import importlib
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from functools import cache
from importlib.metadata import version
from pathlib import Path

import pytest

import skillplan
from skillplan import errors
from sources import parsed, statements
from thinned import slow_case

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "src" / "skillplan"
MODULES = sorted(SOURCE.rglob("*.py"))
BOARD = ROOT / "configs" / "inverter_board.yaml"
PLUGIN_MODULES = sorted(ROOT.glob("plugins/*/src/**/*.py"))
MOST_LINES = 100

HEAVY = (
    "numpy",
    "torch",
    "pybullet",
    "pinocchio",
    "coal",
    "toppra",
    "ompl",
    "numba",
    "gymnasium",
    "highspy",
    "ortools",
    "ray",
)


def imported_by(statement: str) -> set[str]:
    """Return the top-level modules that a fresh interpreter has loaded after a statement."""
    code = f"""
import sys
sys.argv = ["skillplan"]
try:
    {statement}
except SystemExit as ended:
    assert not ended.code, ended.code
print(*sorted({{name.partition(".")[0] for name in sys.modules}}), file=sys.stderr)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(done.stderr.split())


def a_command(*words: str) -> str:
    return f"from skillplan.cli.app import main; main({list(words)!r})"


class TestStarting:
    @pytest.mark.parametrize(
        "statement",
        [
            "import skillplan",
            "import skillplan.cli.app",
            a_command("--help"),
            a_command("--version"),
        ],
        ids=["import", "import of the command line", "--help", "--version"],
    )
    def test_help_loads_nothing_heavy(self, statement):
        """Neither what computes nor what validates."""
        assert set() == {*HEAVY, "pydantic", "yaml"} & imported_by(statement)

    @pytest.mark.parametrize("statement", ["import skillplan", "import skillplan.cli.app"])
    def test_what_draws_panels_and_tables_is_loaded_when_it_draws(self, statement):
        """Help is drawn, an import is not."""
        assert "rich" not in imported_by(statement)

    @pytest.mark.parametrize("words", [("--help",), ("train", "--help")], ids=["all", "train"])
    def test_help_loads_nothing_that_it_never_prints(self, words):
        """It holds neither Markdown nor code with its syntax in colour."""
        loaded = imported_by(a_command(*words))
        assert set() == {"markdown_it", "pygments"} & loaded
        assert "rich" in loaded

    @pytest.mark.parametrize(
        "command",
        [
            "search-optimal",
            slow_case("check", reason="one command in every run"),
            slow_case("evaluate", reason="one command in every run"),
        ],
    )
    def test_help_of_a_command_loads_nothing_heavy(self, command):
        """What a command needs is loaded when it runs."""
        loaded = imported_by(a_command(command, "--help"))
        assert set() == {*HEAVY, "pydantic", "yaml"} & loaded

    def test_the_board_needs_no_arrays(self):
        """A search by the chart loads no numerics, and in JSON no tables either.

        `check` and `chart` derive the order by the geometric detector that is installed.
        """
        loaded = imported_by(a_command("search-optimal", str(BOARD), "--format", "json"))
        assert set() == {*HEAVY, "rich"} & loaded
        assert "yaml" in loaded

    @pytest.mark.slow(reason="a process; the board needs no arrays in every run")
    def test_the_optimum_beside_a_sequence_of_the_board_needs_none(self):
        """It is small, so that exact search proves it."""
        sequence = ("--sequence", "0,1,2,3,4,5,8,9,10,11,6,7,13,14,15")
        loaded = imported_by(a_command("evaluate", str(BOARD), *sequence, "--format", "json"))
        assert set() == {*HEAVY, "rich"} & loaded

    def test_the_core_depends_on_nothing_heavy(self):
        """What pip installs with skillplan is light; the heavy lives in plugins."""
        project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
        names = {re.split(r"[<>=!~ \[]", entry)[0].lower() for entry in project["dependencies"]}
        assert set() == names & {
            "torch",
            "pybullet",
            "pin",
            "pinocchio",
            "coal",
            "toppra",
            "ompl",
            "ortools",
            "ray",
        }


class TestFiles:
    def test_file_names_say_what_is_inside(self):
        """No file is a drawer for odds and ends."""
        drawers = {"utils", "util", "helpers", "helper", "misc", "common", "tools", "base"}
        assert set() == drawers & {path.stem for path in MODULES}
        assert all(re.fullmatch(r"[a-z][a-z0-9_]*|__[a-z]+__", path.stem) for path in MODULES)

    def test_no_tracked_file_names_a_path_of_a_machine(self):
        """Nor does any file that would be tracked."""
        listing = ["git", "ls-files", "--cached", "--others", "--exclude-standard"]
        try:
            done = subprocess.run(listing, cwd=ROOT, capture_output=True, text=True, check=True)
        except (OSError, subprocess.CalledProcessError):
            pytest.skip("not a git checkout")
        home = re.compile(r"(?<![\w.-])/(?:home|root|work|Users|mnt|opt|srv)/[a-z]")
        own = str(ROOT)
        for name in done.stdout.splitlines():
            path = ROOT / name
            if path == Path(__file__) or not path.is_file():
                continue
            text = path.read_bytes().decode("utf-8", "replace")
            assert own not in text, name
            assert home.search(text) is None, name


def lines_of_functions(path: Path) -> Iterator[tuple[str, int]]:
    """Yield every function of a module and how many lines its body has without its docstring."""
    for node in statements(path):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            body = node.body[ast.get_docstring(node) is not None :]
            if body:
                yield node.name, (body[-1].end_lineno or 0) - body[0].lineno + 1


def test_a_function_has_a_hundred_lines_at_most():
    """Plugins included."""
    long = {
        f"{path.relative_to(ROOT)}:{name}": lines
        for path in (*MODULES, *PLUGIN_MODULES)
        for name, lines in lines_of_functions(path)
        if lines > MOST_LINES
    }
    assert {} == long


def public_definitions(path: Path) -> Iterator[tuple[str, ast.AST]]:
    """Yield every public class, function and method of a module, and the module."""
    tree = parsed(path)
    yield "the module", tree
    stack: list[tuple[str, ast.AST]] = [("", tree)]
    while stack:
        prefix, node = stack.pop()
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
                if child.name.startswith("_"):
                    continue
                yield prefix + child.name, child
                if isinstance(child, ast.ClassDef):
                    stack.append((f"{prefix}{child.name}.", child))


def is_a_sentence(text: str | None) -> bool:
    """Return whether a docstring is there, and its first line ends as one of ours does."""
    return bool(text) and str(text).strip().splitlines()[0].rstrip().endswith((".", "?", ":"))


def test_everything_public_has_a_docstring():
    """One line at least, ending with a full stop, a question mark or an example."""
    without = [
        f"{path.relative_to(SOURCE)}: {name}"
        for path in MODULES
        for name, node in public_definitions(path)
        if not (path.name == "__main__.py" and name == "the module")
        and not is_a_sentence(ast.get_docstring(node))  # type: ignore[arg-type]
    ]
    assert [] == without


# A face is a package whose `__init__.pyi` lists the names that tests and others import from it.
PACKAGES = {
    ".".join(path.relative_to(root).parts): path
    for root in (ROOT / "src", *ROOT.glob("plugins/*/src"))
    for path in sorted({path.parent for path in root.rglob("__init__.py")})
}
FACES = {name: path for name, path in PACKAGES.items() if (path / "__init__.pyi").is_file()}
TESTS = sorted(
    path
    for root in (ROOT / "tests", *ROOT.glob("plugins/*/tests"))
    for path in (*root.rglob("*.py"), ROOT / "conftest.py")
)

# What tests import from elsewhere, besides modules that they patch: whole modules that they read
# or call by name, functions that only their own module needs, and functions that a module or a
# folder of the face hides.
DEEP_IMPORTS = {
    "skillplan.cli.writing",
    "skillplan.domains.load._hash_content",
    "skillplan.exporters.plan_table._escape",
    "skillplan.judge.fast_downward",
    "skillplan.pipeline.obstacles",
    "skillplan.pipeline.solving",
    "skillplan.pipeline.solving.search",
    "skillplan.plugins.installed",
    "skillplan.records.schemas",
    "skillplan.robots.home_posture._Solids",
    "skillplan.robots.panda_hand",
    "skillplan.solvers.kernels",
    "skillplan.solvers.ordering.local_search.iterated_descent._added",
    "skillplan.solvers.ordering.local_search.iterated_descent._exchange",
    "skillplan.solvers.ordering.relaxation.precedence_cuts",
    "skillplan.solvers.stop",
    "skillplan.task.back_end",
    "skillplan_cad.importing.import_cad",
    "skillplan_cad.nests.make_nest",
    "skillplan_mujoco.simulator.drawing_context",
    "skillplan_ray.access",
    "skillplan_ray.executor",
    "skillplan_ray.fingerprint.fingerprint",
    "skillplan_swarmitfix.trajectory.workpiece.faults",
}


@cache
def names_of_stub(face: str) -> dict[str, str]:
    """Return the names that a face lists, with the module that each comes from."""
    return {
        alias.name: node.module or ""
        for node in parsed(FACES[face] / "__init__.pyi").body
        if isinstance(node, ast.ImportFrom) and node.level == 1
        for alias in node.names
    }


def bindings(path: Path) -> set[str]:
    """Return the names that a module binds outside functions and classes."""
    names: set[str] = set()
    stack: list[ast.AST] = [parsed(path)]
    while stack:
        for node in ast.iter_child_nodes(stack.pop()):
            if isinstance(node, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
                names.add(node.name)
            elif isinstance(node, ast.Import | ast.ImportFrom):
                names |= {alias.asname or alias.name for alias in node.names}
            elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
                names.add(node.id)
            else:
                stack.append(node)
    return names


def is_module(name: str) -> bool:
    """Return whether a dotted name is a package or a module of ours."""
    package, _, last = name.rpartition(".")
    return name in PACKAGES or (
        package in PACKAGES and (PACKAGES[package] / f"{last}.py").is_file()
    )


@cache
def imports_of_product(path: Path) -> frozenset[tuple[str, str]]:
    """Return the module and the name of everything of ours that a file imports."""
    ours = {name.partition(".")[0] for name in PACKAGES}
    imports: set[tuple[str, str]] = set()
    for node in statements(path):
        if isinstance(node, ast.ImportFrom) and node.module and not node.level:
            imports |= {(node.module, alias.name) for alias in node.names}
        elif isinstance(node, ast.Import):
            imports |= {(alias.name, "") for alias in node.names}
    return frozenset((module, name) for module, name in imports if module.partition(".")[0] in ours)


def is_of_a_face(module: str, name: str) -> bool:
    """Return whether an import names a face and what it lists, or a module beside the faces."""
    if name in ("", "__version__"):
        return module in FACES
    single = {"skillplan.errors", "skillplan.xml_tree"}
    if module in single or f"{module}.{name}" in single | set(FACES):
        return True
    return module in FACES and name in names_of_stub(module)


def patched(path: Path, name: str) -> bool:
    """Return whether a test patches the module that it imports by a name."""
    verbs = "setattr|setitem|delattr|object"
    return re.search(rf"\b(?:{verbs})\(\s*{name}\b", path.read_text("utf-8")) is not None


class TestFaces:
    def test_there_are_about_forty(self):
        """The top packages of the core, a few folders in them, and one for each plugin."""
        assert 35 <= len(FACES) <= 45
        top = {path.name for path in SOURCE.iterdir() if (path / "__init__.py").is_file()}
        assert {f"skillplan.{name}" for name in top} <= set(FACES)

    @pytest.mark.parametrize("face", sorted(FACES))
    def test_every_name_is_where_the_face_says(self, face):
        """Read from the sources, so that no plugin needs to be installed."""
        names = names_of_stub(face)
        assert names
        for name, module in names.items():
            path = FACES[face].joinpath(*(module or name).split("."))
            path = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
            assert path.is_file(), f"{face} imports {name} from {module}, which does not exist"
            assert not module or name in bindings(path), f"{face}: {module} has no {name}"

    @pytest.mark.parametrize("face", sorted(FACES))
    def test_it_lists_its_names_once_more_for_type_checkers(self, face):
        """`__all__` is what is imported, and all of `__init__.py` comes from that list."""
        stub = parsed(FACES[face] / "__init__.pyi")
        (listed,) = [
            ast.literal_eval(node.value)
            for node in stub.body
            if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__"
        ]
        assert set(names_of_stub(face)) == set(listed)
        assert "attach_stub(__name__, __file__)" in (FACES[face] / "__init__.py").read_text("utf-8")

    def test_no_name_hides_a_module_that_is_imported_as_one(self):
        """lazy_loader keeps a function that is named like its own module, and no other."""
        imports = {
            pair for path in (*MODULES, *PLUGIN_MODULES) for pair in imports_of_product(path)
        }
        for face in FACES:
            for name, module in names_of_stub(face).items():
                if module and is_module(f"{face}.{name}"):
                    assert module.partition(".")[0] == name, f"{face}: {name} is a module, too"
                    assert (face, name) not in imports, f"{face}: {name} is imported as a module"

    def test_tests_import_from_faces(self):
        """So that files move without touching tests; modules to patch and a short list excepted."""
        deep = {
            f"{module}.{name}": path
            for path in TESTS
            for module, name in imports_of_product(path)
            if not is_of_a_face(module, name)
            and not (is_module(f"{module}.{name}") and patched(path, name))
        }
        assert {} == {name: path for name, path in deep.items() if name not in DEEP_IMPORTS}

    def test_they_are_sorted_and_all_there(self):
        """`from skillplan import *` gives exactly what is promised, in order."""
        assert sorted(names_of_stub("skillplan")) == skillplan.__all__
        assert "solve_problem" in skillplan.__all__

    @pytest.mark.parametrize("name", skillplan.__all__)
    def test_each_comes_from_where_the_list_says(self, name):
        """Found by attribute, by home, and in `dir`."""
        home = importlib.import_module(f"skillplan.{names_of_stub('skillplan')[name]}")
        assert getattr(home, name) is getattr(skillplan, name)
        assert name in dir(skillplan)

    def test_an_unknown_name_is_an_attribute_error(self):
        """As of any module."""
        with pytest.raises(AttributeError, match="No skillplan attribute sovle"):
            getattr(skillplan, "sovle")  # noqa: B009

    def test_it_is_typed(self):
        """The marker for type checkers is there."""
        assert (SOURCE / "py.typed").is_file()


# A module that is shorter, has one importer and is no entry point is better part of that importer.
LEAST_LINES = 120

# Smaller modules with one importer, and why they are modules of their own.
SMALL_MODULES = {
    "skillplan.cli.back_end_comparison": "loaded if `compare` has engines or detectors only",
    "skillplan.domains.assembly.workholder_schema": "the keys of two sections of the file",
    "skillplan.domains.assembly.alternatives": "the checks of what a file leaves to the search",
    "skillplan.domains.assembly.layout_family": "a subject of its own: random layouts",
    "skillplan.env.sb3_vec_env": "loaded by users of Stable-Baselines3 only",
    "skillplan.env.skill_env": "the public environment",
    "skillplan.pipeline.examples": "what comes with skillplan, for `init` and the benchmark",
    "skillplan.pipeline.gymnasium_entry": "named in the registry of Gymnasium",
    "skillplan.robots.panda_hand": "the data of the hand, as arms are data",
    "skillplan.views.figures.arm_figure": "one module for each figure",
    "skillplan.views.figures.profile_figure": "one module for each figure",
    "skillplan.views.tables.arm": "loaded if `check` describes a robot or a tool alone",
    "skillplan_cad.nests.planned_nests": "the orientations of a plan; its importer writes the task",
    "skillplan_cad.nests.task_nest": "the nest of a base; its importer tries it with the arm",
    "skillplan_cad.writing.heading": "how the product stands; its importer writes the task",
    "skillplan_cad.writing.verdict_memory": "compares tasks; its importer tries one",
    "skillplan_ortools.watched_search": "the only module that imports OR-Tools",
    "skillplan_pinocchio.timing.toppra_problem": "the only import of toppra, if needed",
    "skillplan_pinocchio.holds": "measures surfaces; its importer sweeps convex pieces",
    "skillplan_ray.access": "secrets of a cluster are in one place",
    "skillplan_simulation.execution.zone_watch": "geometry; its importer moves the robot",
    "skillplan_ros2.timed_paths": "plans paths; the exporter only writes them",
    "skillplan_swarmitfix.base.goals_task": "one module for each task of a chain",
    "skillplan_swarmitfix.trajectory.files": "loaded if a task names a file",
    "skillplan_swarmitfix.trajectory.path_chain": "an algorithm; its importer reads entities",
}


def dotted(path: Path) -> str:
    """Return the name by which a module or package is imported."""
    name = ".".join(path.with_suffix("").parts[path.parts.index("src") + 1 :])
    return name.removesuffix(".__init__")


@cache
def entry_points() -> frozenset[str]:
    """Return the modules that distributions register, and those of the commands."""
    modules = {dotted(path) for path in (SOURCE / "cli" / "commands").glob("*.py")}
    for path in (ROOT / "pyproject.toml", *ROOT.glob("plugins/*/pyproject.toml")):
        project = tomllib.loads(path.read_text("utf-8"))["project"]
        groups = [project.get("scripts", {}), *project.get("entry-points", {}).values()]
        for value in (value for group in groups for value in group.values()):
            module, _, name = value.partition(":")
            modules.add(module)
            if module in FACES:
                modules.add(f"{module}.{names_of_stub(module)[name]}")
    return frozenset(modules)


def importers() -> dict[str, set[str]]:
    """Return the modules that import each module, or name it in a text; no packages, no tests."""
    users: dict[str, set[str]] = {dotted(path): set() for path in (*MODULES, *PLUGIN_MODULES)}
    for path in (*MODULES, *PLUGIN_MODULES):
        if path.name == "__init__.py":
            continue
        names = {module for module, _ in imports_of_product(path)}
        names |= {f"{module}.{name}" for module, name in imports_of_product(path)}
        names |= set(re.findall(r"""["'](skillplan[\w.]+)[:"']""", path.read_text("utf-8")))
        for name in names & set(users) - {dotted(path)}:
            users[name].add(dotted(path))
    return users


def code_lines(path: Path) -> int:
    """Return the number of lines that are neither blank, comment nor docstring."""
    text = path.read_text("utf-8")
    left_out: set[int] = set()
    for node in (parsed(path), *statements(path)):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(
            node
        ):
            left_out |= set(range(node.body[0].lineno, (node.body[0].end_lineno or 0) + 1))
    return sum(
        number not in left_out and bool(line.strip()) and not line.strip().startswith("#")
        for number, line in enumerate(text.splitlines(), 1)
    )


def test_a_small_module_has_two_importers_or_a_reason():
    """Entry points, commands, packages and `__main__` are left out."""
    users = importers()
    small = {
        dotted(path): sorted(users[dotted(path)])
        for path in (*MODULES, *PLUGIN_MODULES)
        if not path.name.startswith("__")
        and dotted(path) not in entry_points()
        and len(users[dotted(path)]) < 2
        and code_lines(path) < LEAST_LINES
    }
    assert {} == {name: by for name, by in small.items() if name not in SMALL_MODULES}


class TestVersion:
    def test_the_installed_version_is_that_of_the_source(self):
        """pyproject.toml reads it from the package."""
        assert skillplan.__version__ == version("skillplan")
        project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
        assert ["version"] == project["project"]["dynamic"]
        assert "src/skillplan/__init__.py" == project["tool"]["hatch"]["version"]["path"]

    def test_the_changelog_knows_it(self):
        """The newest released heading is this version; before the first there is none."""
        text = (ROOT / "CHANGELOG.md").read_text("utf-8")
        headings = re.findall(r"^## \[(.+?)\]", text, re.MULTILINE)
        assert "Unreleased" == headings[0]
        released = headings[1:]
        assert all(re.fullmatch(r"\d+\.\d+\.\d+", heading) for heading in released)
        assert released[:1] in ([], [skillplan.__version__])
        ordered = sorted(released, key=lambda text: [int(n) for n in text.split(".")], reverse=True)
        assert ordered == released


class TestErrors:
    @pytest.mark.parametrize(
        ("name", "code"),
        [
            ("SkillplanError", 2),
            ("TaskError", 2),
            ("OptionError", 2),
            ("PluginError", 2),
            ("ModelTooLarge", 2),
            ("NotASequencing", 2),
            ("BackEndError", 3),
        ],
    )
    def test_each_carries_its_exit_code(self, name, code):
        """The command line looks nowhere else."""
        error = getattr(errors, name)
        assert issubclass(error, errors.SkillplanError)
        assert code == error.exit_code

    @pytest.mark.parametrize(
        ("outcome", "code"),
        [
            ({}, 0),
            ({"solved": False}, 1),
            ({"wrong": True, "solved": False}, 2),
            ({"wrong": True, "back_end_failed": True, "solved": False}, 3),
            ({"back_end_failed": True, "solved": False}, 3),
            ({"interrupted": True, "wrong": True, "back_end_failed": True}, 130),
            ({"error": errors.OptionError("x")}, 2),
            ({"error": errors.BackEndError("x"), "interrupted": True}, 3),
            ({"error": KeyboardInterrupt()}, 130),
            ({"error": errors.SearchStopped()}, 130),
            ({"error": ZeroDivisionError()}, 3),
        ],
        ids=str,
    )
    def test_one_function_turns_an_outcome_into_an_exit_code(self, outcome, code):
        """What an error says counts most, then an interruption, then what is wrong."""
        assert code == errors.exit_code(**outcome)

    def test_no_other_module_chooses_an_exit_code_by_its_name(self):
        """Commands say what happened; which code that is stands in `errors` alone."""
        named = {
            path.relative_to(ROOT).as_posix()
            for path in (*MODULES, *PLUGIN_MODULES)
            if re.search(r"\bEXIT_[A-Z]", path.read_text("utf-8"))
        }
        assert {"src/skillplan/errors.py"} == named

    def test_the_tree_in_the_docstring_is_complete(self):
        """Each error class is drawn there."""
        classes = {
            name
            for name, value in vars(errors).items()
            if isinstance(value, type) and issubclass(value, errors.SkillplanError)
        }
        drawn = set(re.findall(r"^\W*(\w+) {2,}\S", errors.__doc__ or "", re.MULTILINE))
        assert classes == drawn & classes
