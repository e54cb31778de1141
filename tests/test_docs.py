"""What the README shows is what the program does, and what the program does is in the README."""

import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from pydantic import BaseModel

from skillplan.cli.app import COMMANDS
from skillplan.domains.assembly.board_generator import BoardGenerator
from skillplan.pipeline import registry
from skillplan.pipeline.chain import solve_chain
from skillplan.pipeline.run import solve
from skillplan.pipeline.setup import load_problem
from skillplan.records.result import Status

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text("utf-8")
CONTRIBUTING = (ROOT / "CONTRIBUTING.md").read_text("utf-8")


def blocks(language):
    return re.findall(rf"```{language}\n(.*?)```", README, re.DOTALL)


# pybullet has wheels up to CPython 3.11 only.
TRANSCRIPTS = [
    block.split("\n", 1)
    for block in blocks("console")
    if sys.version_info < (3, 12) or "pybullet" not in block.partition("\n")[0]
]
EXAMPLE = next(block for block in blocks("yaml") if block.startswith("kind: assembly"))
BRACKET = next(block for block in blocks("yaml") if block.startswith("kind: swarmitfix"))


def untimed(text, chain):
    """Return lines without trailing blanks, and with seconds that a machine decides masked.

    In the tables of a chain all figures of three or four decimals are such seconds. Forces after
    a collision depend on the order in which a processor adds up, and so does their length.
    """
    lines = [line.rstrip() for line in text.strip().splitlines()]
    lines = [re.sub(r"\d+\.\d+ s$", "# s", line) for line in lines]
    lines = [re.sub(r"(pressed on \w+ with) [\d.]+ N", r"\1 # N", line) for line in lines]
    lines = [re.sub("─+", "─", line) for line in lines]
    if chain:
        return [re.sub(r"\b\d+\.\d{3,4}\b", "#", line) for line in lines]
    return [re.sub(r" +\d+\.\d{3}   (?=\d+,)", " #   ", line) for line in lines]


@pytest.fixture
def shop(tmp_path):
    """A folder with the configs, the README's example, the same with two faults, and a board."""
    (tmp_path / "configs").symlink_to(ROOT / "configs")
    (tmp_path / "lid.yaml").write_text(EXAMPLE)
    bad = EXAMPLE.replace("goal_on: box                  #", "goal_on: bxo                  #")
    bad = bad.replace("size_m: [0.1, 0.1, 0.01]", "sise_m: [0.1, 0.1, 0.01]")
    assert bad.count("bxo") == bad.count("sise_m") == 1
    (tmp_path / "bad.yaml").write_text(bad)
    (tmp_path / "twenty.yaml").write_text(BoardGenerator(20, 0.3, 3, seed=1).text("any"))
    return tmp_path


@pytest.mark.parametrize(("command", "shown"), TRANSCRIPTS, ids=[c for c, _ in TRANSCRIPTS])
def test_every_transcript_is_what_the_command_prints(shop, command, shown):
    """Run as shown, each command prints the same, times aside."""
    words = shlex.split(command.removeprefix("$ "))
    assert words[0] == "skillplan"
    done = subprocess.run(
        [sys.executable, "-m", *words], cwd=shop, capture_output=True, text=True, check=False
    )
    chain = "swarmitfix" in command
    assert untimed(shown, chain) == untimed(done.stdout + done.stderr, chain)


def test_the_examples_of_the_formats_are_solved(shop):
    """The YAML that the README explains is a task with a proven optimum, or a chain of such."""
    assert solve(load_problem(shop / "lid.yaml").task).status is Status.OPTIMAL
    (shop / "bracket.yaml").write_text(BRACKET)
    assert solve_chain(load_problem(shop / "bracket.yaml"), "exact").proved_by_level


def test_every_command_option_status_and_exit_code_is_in_the_readme():
    """A reader finds every word of the command line."""
    for command in COMMANDS:
        assert f"skillplan {command}" in README
    for status in Status:
        assert f"| `{status.value}` |" in README
    for code in (0, 1, 2, 3, 130):
        assert f"| {code} |" in README
    for option in ("--solver", "--solvers", "--physics", "--collision", "--time-limit", "--gap"):
        assert option in README
    for option in ("--seed", "--out", "--no-cache", "--warm", "--format", "--after", "--sequence"):
        assert option in README
    for option in ("--set", "--part", "--policy", "--from", "--explain-errata", "--resume"):
        assert option in README
    for option in ("--jobs", "--detectors", "--staged", "--picture", "--animate"):
        assert option in README
    for option in ("--video", "--fps", "--speed", "--trace"):
        assert option in README
    for option in ("--runs", "--steps", "--family", "--checkpoint", "--layouts", "--episodes"):
        assert option in README
    for option in ("--parts", "--density", "--tools", "--name"):
        assert option in README
    for option in ("--stall", "--memory-limit", "--start"):
        assert option in README
    for option in ("--temperature", "--task", "--changed-task", "--against", "--dpi"):
        assert option in README


def test_every_plugin_and_kind_is_in_the_readme():
    """What this repository brings is described, and so is how to add to every kind."""
    projects = [ROOT / "pyproject.toml", *(ROOT / "plugins").glob("*/pyproject.toml")]
    entries = [tomllib.loads(path.read_text())["project"]["entry-points"] for path in projects]
    for kind in registry.KINDS:
        for name in (name for one in entries for name in one.get(f"skillplan.{kind}", ())):
            if name != "greedy":
                assert f"`{name}`" in README or f"kind: {name}" in README
        if kind != "solver":
            assert f"`skillplan.{kind}`" in README


def test_the_readme_shows_the_template_as_it_is():
    """The plugin to copy stands in the README to the letter, and has under 40 lines."""
    source = ROOT / "plugins/skillplan-template/src/skillplan_template/greedy.py"
    text = source.read_text("utf-8")
    assert text in README
    assert len(text.splitlines()) < 40


def test_every_key_of_the_format_is_explained():
    """Each key of every kind of task stands in the README."""
    for kind in registry.names("domain"):
        for key in keys_of(registry.load("domain", kind).Config, deep=kind != "assembly"):
            assert f"{key}:" in README or f"`{key}`" in README, f"{kind}: {key}"


def keys_of(model, *, deep):
    """Yield the keys of a schema and, where wanted, of the mappings in it."""
    for name, info in model.model_fields.items():
        yield name
        inner = info.annotation
        # What the project's own tests read is nothing to explain.
        if deep and name != "expect" and isinstance(inner, type) and issubclass(inner, BaseModel):
            yield from keys_of(inner, deep=True)


def test_the_python_snippets_run(shop):
    """The detector and the three lines of Python do what the README says."""
    detector, usage = (b for b in blocks("python") if "NightShift" in b or "load_problem" in b)
    script = f"{detector}\n{usage}"
    script += "\nassert NightShift(task).check(task.skills[14], task.initial).is_infeasible\n"
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=shop, capture_output=True, text=True, check=False
    )
    assert done.stderr == ""
    assert done.stdout.startswith("optimal 1.86708")


def test_the_gymnasium_snippet_prints_what_stands_below_it(shop):
    """The episode ends as the README says."""
    (script,) = (block for block in blocks("python") if "import gymnasium" in block)
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", script],
        cwd=shop,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stderr == ""
    assert f"`{done.stdout.strip()}`" in README


def test_links_lead_somewhere():
    """Every relative link of the two documents names a file."""
    for text in (README, CONTRIBUTING):
        for target in re.findall(r"\]\(([^)#]+)\)", text):
            if "://" not in target:
                assert (ROOT / target).exists(), target
