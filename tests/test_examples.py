"""The examples run as they stand, and print what they say."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))


def run(name: str, *words: str) -> list[str]:
    """Return the lines an example prints; it must be silent on stderr."""
    command = [sys.executable, "-W", "error", str(ROOT / "examples" / name), *words]
    done = subprocess.run(command, capture_output=True, text=True)
    assert (0, "") == (done.returncode, done.stderr)
    return done.stdout.splitlines()


def test_solve_board_prints_the_proved_sequence():
    """Fifteen steps and what they cost."""
    title, *steps = run("solve_board.py")
    assert "inverter-board: optimal, 1.86709 m" == title
    assert [
        "pick(pcb)",
        "place(pcb)",
        "pick(switch_1)",
        "place(switch_1)",
        "pick(switch_2)",
        "place(switch_2)",
        "pick(transformer)",
        "place(transformer)",
        "pick(brace)",
        "place(brace)",
        "pick(clock)",
        "place(clock)",
        "load(screwdriver)",
        "fasten(screw_1)",
        "fasten(screw_2)",
    ] == [line.split()[1] for line in steps]
    assert sum(float(line.split()[2]) for line in steps) == pytest.approx(1.86709, abs=1e-4)


@pytest.mark.slow(reason="a process; the same script with the board in every run")
def test_solve_board_takes_another_task():
    """The larger board, by its path."""
    title, *steps = run("solve_board.py", str(ROOT / "configs" / "motor_drive.yaml"))
    assert "motor-drive: optimal, 11.58291 m" == title
    assert 41 == len(steps)


@pytest.mark.slow(reason="a process; the detector beside the built-in ones in every run")
def test_own_solver_is_judged_like_any_other():
    """Its plan is valid, costs more than the optimum, and no proof is granted."""
    own, exact = run("own_solver.py")
    assert own.startswith("nearest-first: solved, ")
    assert exact.startswith("exact: optimal, 1.86709 m, 15 skills, ")
    assert float(own.split()[2]) > 1.86709


def test_own_solver_is_short():
    """A stranger's solver needs less than 40 lines."""
    text = (ROOT / "examples" / "own_solver.py").read_text("utf-8")
    body = text[text.index("class NearestFirst") : text.index("def main")]
    assert 40 > len(body.strip().splitlines())


def test_own_detector_works_beside_built_in_ones():
    """All are asked; the clock now goes before the transformer, which costs more."""
    built_in, first, combined, second = run("own_detector.py")
    assert "kinematic, precedence, aabb" == built_in
    assert {"kinematic", "precedence", "aabb", "shadow"} == set(combined.split(", "))
    assert first.split()[0] == "1.86709"
    assert float(second.split()[0]) > 1.86709
    assert first.index("place(transformer)") < first.index("place(clock)")
    assert second.index("place(clock)") < second.index("place(transformer)")


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_every_example_says_how_to_run_it(path):
    """In its docstring; and each is tested above."""
    text = path.read_text("utf-8")
    assert f"``python examples/{path.name}" in text
    assert f'run("{path.name}"' in Path(__file__).read_text("utf-8")
