"""Convex pieces that take more than the clearance of a fit: an error of engines, which name it."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from framed_pegs import write_framed_peg
from skillplan import Setup, load_problem, solve
from skillplan.checks import introduce
from skillplan.cli import main
from skillplan.pipeline import make_model

ENGINES = ("pybullet", "mujoco")
WIDER = pytest.mark.slow(reason="four executions; pieces that block the fit in every run")


@pytest.fixture(autouse=True)
def both_engines():
    """Both are there."""
    if sys.version_info >= (3, 12):
        pytest.importorskip("pybullet", reason="pybullet has no wheels for this Python")


def check(capfd: pytest.CaptureFixture[str], path: Path, *words: str) -> tuple[int, list[str], str]:
    """Return the exit code of `check`, its warnings, and what it prints on stderr."""
    with pytest.raises(SystemExit) as ended:
        main(["check", str(path), *words, "--format", "json"])
    out, error = capfd.readouterr()
    code = ended.value.code
    assert isinstance(code, int)
    return code, json.loads(out).get("warnings", []), error


@pytest.mark.parametrize(("clearance_mm", "outside_mm"), [(0.5, 0.0), (0.5, 0.3), (0.8, 0.6)])
def test_pieces_that_leave_a_fit_its_clearance_are_not_named(
    tmp_path, capfd, clearance_mm, outside_mm
):
    path = write_framed_peg(tmp_path, clearance_mm, outside_mm)
    code, warnings, _ = check(capfd, path)
    assert code == 0
    assert not any("convex pieces" in warning for warning in warnings)


@pytest.mark.parametrize(
    ("outside_mm", "figure"),
    [(0.45, "leave 0.05 mm of it"), (0.9, "are 0.40 mm deep in each other")],
)
def test_check_warns_of_a_fit_that_pieces_fill(tmp_path, capfd, outside_mm, figure):
    """With the pair, the clearance of the meshes, and what the pieces make of it."""
    code, warnings, _ = check(capfd, write_framed_peg(tmp_path, 0.5, outside_mm))
    assert code == 0
    (warning,) = [warning for warning in warnings if "convex pieces" in warning]
    assert "'frame'" in warning
    assert "'peg'" in warning
    assert "with 0.50 mm between their meshes" in warning
    assert figure in warning


@pytest.mark.parametrize("engine", ENGINES)
def test_an_engine_refuses_a_file_with_a_fit_that_pieces_block(tmp_path, capfd, engine):
    """A frame with a flange can only come after its peg, whose head is beneath the flange."""
    path = write_framed_peg(tmp_path, 0.5, 0.9, flange=True)
    with pytest.raises(SystemExit) as ended:
        main(["search-optimal", str(path), "--physics", engine, "--no-cache"])
    _, error = capfd.readouterr()
    assert ended.value.code == 2
    assert "'frame' fits 'peg' with 0.50 mm between their meshes" in error
    assert "parts.frame" in error


def test_the_fault_of_an_engine_in_the_task_of_a_result_is_shown(tmp_path, capfd):
    """The task lies beside the result; a file that is no task would not be quoted."""
    path = write_framed_peg(tmp_path, 0.5, 0.6)
    result = str(tmp_path / "plan")
    for command in (["search-optimal", str(path), "--out", result], ["simulate", result]):
        with pytest.raises(SystemExit) as ended:
            main([*command, *(["--physics", "mujoco"] if command[0] == "simulate" else [])])
    _, error = capfd.readouterr()
    assert ended.value.code == 2
    assert "'frame' fits 'peg' with 0.50 mm between their meshes" in error


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize(
    "outside_mm", [pytest.param(0.0, marks=WIDER), pytest.param(0.45, marks=WIDER), 0.6]
)
def test_an_engine_executes_what_it_does_not_refuse(tmp_path, engine, outside_mm):
    """In one order at least: pybullet has the frame exact where it stands, and the peg goes in."""
    path = write_framed_peg(tmp_path, 0.5, outside_mm)
    task = load_problem(path).task
    model = make_model(task, Setup(engine, ("contact-pairs",)))
    verdicts = [
        model.verdict(
            task.facts.of(
                f"placed({other})", f"held({mover})", "tool(gripper)", f"at({mover}.start)"
            ),
            task.skill(f"place({mover})"),
        )
        for mover, other in (("frame", "peg"), ("peg", "frame"))
    ]
    refused = bool(Setup(engine, ("contact-pairs",)).back_ends(task)[0].faults())
    assert refused == (engine == "mujoco" and outside_mm > 0.5)
    assert refused != any(verdict.is_feasible for verdict in verdicts)


POCKET = """kind: assembly
name: flush
robot: {home_m: [0.42, 0.0]}
tools: {gripper: {holder_m: [0.30, 0.35]}}
initial_tool: gripper
parts:
  frame:
    fixed: true
    boxes:
      - {size_m: [0.02, 0.08, 0.02], centre_m: [-0.0201, 0.0, 0.01]}
      - {size_m: [0.02, 0.08, 0.02], centre_m: [0.0201, 0.0, 0.01]}
      - {size_m: [0.0202, 0.0299, 0.02], centre_m: [0.0, -0.02505, 0.01]}
      - {size_m: [0.0202, 0.0299, 0.02], centre_m: [0.0, 0.02505, 0.01]}
    goal_m: [0.42, 0.12]
  block:
    {tool: gripper, size_m: [0.02, 0.02, 0.02], grasp: {closing_axis: y, depth_m: 0.004},
      start_m: [0.42, -0.15], goal_m: [0.42, 0.12], release_m: RELEASE}
"""


@pytest.mark.slow(reason="an execution in each engine")
def test_a_part_flush_with_its_pocket_is_let_go_above_it_and_slides_down(tmp_path):
    """Its fingers have no room beside it; the way down is checked, the slide only by engines."""
    path = tmp_path / "flush.yaml"
    path.write_text(POCKET.replace("RELEASE", "null"), "utf-8")
    refused = solve(load_problem(path).task, "exact", Setup(collision=("swept",)))
    assert "a finger runs into frame" in refused.reason
    path.write_text(POCKET.replace("RELEASE", "0.005"), "utf-8")
    task = load_problem(path).task
    result = solve(task, "exact", Setup(collision=("swept",)))
    assert result.status == "optimal", result.reason
    assert "whether what is let go above its goal slides there: block" in result.not_checked
    for engine in ENGINES:
        created, *_ = introduce(Setup(engine, ()).back_ends(task))
        done = created.perform([task.skill(step.skill) for step in result.steps])
        assert done.failed is None, done.failed.verdict.reason
