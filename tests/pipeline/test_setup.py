"""What back ends that will be asked find wrong with a file, told with its lines."""

import sys

import pytest

from skillplan.cli import main
from skillplan.errors import BackEndError, OptionError, TaskError
from skillplan.pipeline import Setup, load_problem, registry

TASK = """kind: assembly
name: single
robot: {home_m: [0.3, 0.0]}
tools: {hand: {holder_m: [0.5, 0.3]}}
initial_tool: hand
parts:
  plate:
    tool: hand
    size_m: [0.1, 0.1, 0.02]
    start_m: [0.3, 0.2]
    goal_m: [0.5, 0.0]
  pin:
    tool: hand
    size_m: [0.02, 0.02, 0.02]
    start_m: [0.4, -0.2]
    goal_m: [0.5, 0.0]
    goal_on: plate
step_limit: 4
"""

MODULE = '''
"""Engines that find fault, for a test."""
from skillplan.physics.engine import Engine
from skillplan.task.back_end import Options
from skillplan.task.verdict import Verdict

MADE = []

class Narrow(Engine):
    """Holds what is narrow."""

    name = "narrow"

    class Options(Options):
        """How wide the jaws open."""

        opening_m: float = 0.08

    def __init__(self, task, options=None):
        super().__init__(task, options)
        MADE.append(self.name)

    def faults(self):
        found = {}
        for body in self.task.scene.bodies:
            if body.grasp.width_m > self.options.opening_m:
                found[f"placed({body.name})"] = f"{body.name!r} is too wide."
        return found

    def check(self, skill, state):
        return Verdict.feasible(state, self.task.facts.none)

class Clumsy(Narrow):
    """Fails when asked for faults."""

    name = "clumsy"

    def faults(self):
        raise ZeroDivisionError("by design")

class Shy(Narrow):
    """Refuses every task."""

    name = "shy"

    def refuses(self):
        return "it is shy."

class Content(Narrow):
    """Finds no fault with anything."""

    name = "content"

    faults = Engine.faults
'''


@pytest.fixture
def made(tmp_path, monkeypatch):
    """Install the engines for one test; what is made of them, in order."""
    monkeypatch.syspath_prepend(str(tmp_path))
    folder = tmp_path / "faulty_engines-1.0.dist-info"
    folder.mkdir()
    (folder / "METADATA").write_text("Metadata-Version: 2.1\nName: faulty-engines\nVersion: 1.0\n")
    names = {"narrow": "Narrow", "clumsy": "Clumsy", "shy": "Shy", "content": "Content"}
    lines = [f"{name} = faulty_engines:{value}" for name, value in names.items()]
    (folder / "entry_points.txt").write_text("\n".join(["[skillplan.physics]", *lines]))
    (tmp_path / "faulty_engines.py").write_text(MODULE)
    registry.refresh()
    import faulty_engines

    yield faulty_engines.MADE
    registry.refresh()
    del sys.modules["faulty_engines"]


@pytest.fixture
def path(tmp_path):
    """Return the path of a file with a wide part and a narrow one."""
    result = tmp_path / "task.yaml"
    result.write_text(TASK)
    return result


def faults_of(path, **queries):
    """Return the lines about a file, without its name."""
    with pytest.raises(TaskError) as raised:
        load_problem(path, queries)
    return [line.removeprefix(f"{path}:") for line in raised.value.lines()]


def test_a_back_end_that_the_command_line_names_tells_its_faults_with_their_lines(made, path):
    """The part's line; the narrow part has none."""
    assert ["7:3: parts.plate: 'plate' is too wide."] == faults_of(path, physics=["narrow"])
    assert made == ["narrow"]


def test_a_back_end_that_the_file_chooses_tells_its_faults_too(made, path):
    """With the options that the file gives it."""
    path.write_text(TASK + "physics: {narrow: {opening_m: 0.01}}\n")
    both = ["7:3: parts.plate: 'plate' is too wide.", "12:3: parts.pin: 'pin' is too wide."]
    assert both == faults_of(path)
    assert both == faults_of(path, physics=["narrow"])
    assert made == ["narrow", "narrow"]
    path.write_text(TASK + "physics: {narrow: {opening_m: 0.2}}\n")
    assert load_problem(path, {"physics": ["narrow"]}).task.name == "single"


def test_a_back_end_that_is_not_asked_is_not_made(made, path):
    """Nor one that has no faults to tell."""
    load_problem(path)
    path.write_text(TASK + "physics: {narrow: {}}\n")
    load_problem(path, {"physics": ["kinematic"]})
    load_problem(path, {"physics": ["content"]})
    assert made == []


def test_a_fault_that_two_tell_stands_once(made, path):
    """However often it is asked for."""
    once = faults_of(path, physics=["narrow"])
    assert 1 == len(once)
    assert once == faults_of(path, physics=["narrow", "narrow"])


def test_a_refusal_on_the_command_line_is_told_when_it_is_made(made, path):
    """In the words for command lines; loading goes on."""
    task = load_problem(path, {"physics": ["shy"]}).task
    with pytest.raises(OptionError, match="physics 'shy' cannot serve 'single': it is shy"):
        Setup("shy").back_ends(task)


def test_a_back_end_that_fails_to_tell_is_named(made, path):
    """With what it raised; exit code 3."""
    with pytest.raises(BackEndError, match="physics 'clumsy' failed on 'single': ZeroDivision"):
        load_problem(path, {"physics": ["clumsy"]})


def test_the_command_line_says_the_same(made, path, capsys):
    """File, line and column; exit code 2, and no plan."""
    with pytest.raises(SystemExit) as ended:
        main(["search-optimal", str(path), "--physics", "narrow"])
    readouterr = capsys.readouterr()
    line = f"skillplan: error: {path}:7:3: parts.plate: 'plate' is too wide.\n"
    assert (2, "", line) == (ended.value.code, readouterr.out, readouterr.err)


def test_an_unknown_name_is_answered_as_ever(path, capsys):
    """With the nearest."""
    with pytest.raises(SystemExit) as ended:
        main(["search-optimal", str(path), "--physics", "kinematik"])
    assert ended.value.code == 2
    assert "Unknown physics 'kinematik'. Did you mean 'kinematic'?" in capsys.readouterr().err
