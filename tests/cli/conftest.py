"""Situations of the command line: a call in this process, and plugins put on the path."""

from __future__ import annotations

import contextlib
import io
import json
import os
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from textwrap import dedent
from typing import Any

import pytest

from skillplan.cli import main
from skillplan.domains.assembly import BoardGenerator
from skillplan.pipeline import registry

ROOT = Path(__file__).parents[2]
BOARD = str(ROOT / "configs" / "inverter_board.yaml")
MOTOR = str(ROOT / "configs" / "motor_drive.yaml")
# Heads, goals and ways of a base, three of each: the smallest chain with all its stages.
CORNER = """\
kind: swarmitfix
name: corner
trajectory: {vertices_m: [[0.56, 0.60], [0.72, 0.85], [0.88, 1.10]]}
heads: {side_m: 0.10, max_gap_m: 0.25, step_m: 0.05, orientations: 2, reorientation_cost: 0.1}
base: {home: C66, side: right}
"""
PYTHON = (sys.executable, "-m", "skillplan")


@dataclass(frozen=True)
class Outcome:
    """What a call of the command line came to."""

    code: int
    out: str
    err: str

    @property
    def document(self) -> Any:
        """The one JSON document on stdout; anything beside it is a fault."""
        return json.loads(self.out)

    @property
    def refusal(self) -> str:
        """The message of a call that was refused: exit code 2, and nothing on stdout."""
        assert (2, "") == (self.code, self.out)
        return self.err


Cli = Callable[..., Outcome]
Install = Callable[..., Path]
Solved = Callable[..., Path]


@pytest.fixture
def board():
    """The paper's inverter board."""
    return BOARD


@pytest.fixture
def root():
    """The root of the repository."""
    return ROOT


@pytest.fixture
def motor():
    """The larger board, whose sequences cannot be enumerated."""
    return MOTOR


@pytest.fixture
def cli(capsys):
    """The real entry point, in this process."""

    def call(*words: str) -> Outcome:
        capsys.readouterr()
        with pytest.raises(SystemExit) as ended:
            main(words)
        captured = capsys.readouterr()
        assert isinstance(ended.value.code, int)
        return Outcome(ended.value.code, captured.out, captured.err)

    return call


@pytest.fixture(scope="session")
def solved():
    """Saves a result in a folder, for fixtures that several tests share."""

    def solve(folder: Path, *words: str) -> Path:
        with contextlib.redirect_stdout(io.StringIO()), pytest.raises(SystemExit) as ended:
            main(("search-optimal", *words, "--out", str(folder)))
        assert 0 == ended.value.code
        return folder

    return solve


@pytest.fixture(scope="session")
def solved_board(solved, tmp_path_factory):
    """The proved optimum of the inverter board; to be copied by whoever changes it."""
    return solved(tmp_path_factory.mktemp("board") / "run", BOARD, "--solver", "exact")


@pytest.fixture(scope="session")
def seven(tmp_path_factory):
    """A board of seven parts, whose first plan is not its best one of 5.19890 m."""
    path = tmp_path_factory.mktemp("seven") / "seven.yaml"
    path.write_text(BoardGenerator(parts=7, density=0.2, tools=2, seed=1).text(), "utf-8")
    return str(path)


@pytest.fixture(scope="session")
def solved_within_a_gap(solved, seven, tmp_path_factory):
    """A plan of seven parts that is not the best, and its bound; to be copied by who changes it."""
    folder = tmp_path_factory.mktemp("gap") / "run"
    return solved(folder, seven, "--solver", "exact", "--gap", "0.4")


@pytest.fixture(scope="session")
def corner(tmp_path_factory):
    """A task file: a short trajectory, its heads, the goals of the base and its ways."""
    path = tmp_path_factory.mktemp("corner") / "corner.yaml"
    path.write_text(CORNER, "utf-8")
    return str(path)


@pytest.fixture(scope="session")
def solved_corner(solved, corner, tmp_path_factory):
    """The corner, solved by exact search; to be copied by whoever changes it."""
    return solved(tmp_path_factory.mktemp("corner") / "chain", corner, "--solver", "exact")


@pytest.fixture
def install(tmp_path, monkeypatch):
    """Puts a distribution with one plugin on the path, here and in child processes."""
    folder = tmp_path / "site"
    folder.mkdir()
    monkeypatch.syspath_prepend(str(folder))
    before = filter(None, [os.environ.get("PYTHONPATH")])
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(folder), *before]))
    installed: list[str] = []

    def put(kind: str, name: str, value: str, source: str) -> Path:
        module = value.partition(":")[0]
        (folder / f"{module}.py").write_text(dedent(source), "utf-8")
        info = folder / f"{module}-1.5.dist-info"
        info.mkdir()
        title = module.replace("_", "-")
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {title}\nVersion: 1.5\n")
        (info / "entry_points.txt").write_text(f"[skillplan.{kind}]\n{name} = {value}\n")
        installed.append(module)
        registry.refresh()
        return folder

    yield put
    for module in installed:
        sys.modules.pop(module, None)
    registry.refresh()


@pytest.fixture
def bursting_detector(install):
    """A collision detector that raises instead of ruling."""
    source = '''
        from skillplan import Detector

        class Bursting(Detector):
            """Burst on the first question."""

            name = "bursting"

            def check(self, skill, state):
                raise RuntimeError("the simulator has gone away")
    '''
    install("collision", "bursting", "bursting_detector:Bursting", source)
    return "bursting"


@pytest.fixture
def deaf_solver(install):
    """A solver that heeds no stop."""
    source = '''
        import time

        from skillplan import Solver

        class Deaf(Solver):
            """Sleep for ever."""

            name = "deaf"

            def solve(self, model, *, seed=0):
                print("asleep", flush=True)
                while True:
                    time.sleep(0.01)
    '''
    install("solver", "deaf", "deaf_solver:Deaf", source)
    return "deaf"


@pytest.fixture
def lying_solver(install):
    """A solver that claims an impossible cost."""
    source = '''
        from skillplan import Plan, Solution, Solver

        class Liar(Solver):
            """Claim that the plan is free."""

            name = "liar"

            def solve(self, model, *, seed=0):
                return Solution(Plan(("pick(pcb)",), 0.0), 0.0, proved=True)
    '''
    install("solver", "liar", "lying_solver:Liar", source)
    return "liar"


@pytest.fixture
def choosy_solver(install):
    """A solver that serves no task."""
    source = '''
        from skillplan import Solution, Solver

        class Choosy(Solver):
            """Refuse everything."""

            name = "choosy"

            def refuses(self, model):
                return "it is Monday"

            def solve(self, model, *, seed=0):
                return Solution(None)
    '''
    install("solver", "choosy", "choosy_solver:Choosy", source)
    return "choosy"


@pytest.fixture
def no_way(tmp_path):
    """The board with a chart that wants the screws before the brace: no plan."""
    text = Path(BOARD).read_text("utf-8")
    old = "  - {before: brace, after: [screw_1, screw_2]}\n"
    assert text.count(old) == 1
    text = text.replace(old, "  - {before: screw_1, after: [brace]}\n")
    text = text.replace("collision: {precedence: {}}", "collision: {precedence: {}, aabb: {}}")
    path = tmp_path / "no_way.yaml"
    path.write_text(text, "utf-8")
    return str(path)


@pytest.fixture
def environment():
    """The environment of a child process without what would colour its output."""
    left_out = ("COLUMNS", "LINES", "FORCE_COLOR", "NO_COLOR", "TTY_COMPATIBLE", "TTY_INTERACTIVE")
    return {key: value for key, value in os.environ.items() if key not in left_out}
