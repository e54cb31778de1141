"""Products that go into one another from any side, executed: how exactly they are put together."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import yaml

from skillplan.cli.app import main
from skillplan.pipeline.run import solve
from skillplan.pipeline.setup import Setup, load_problem

pytest.importorskip("skillplan_pinocchio", reason="plans are found by swept hulls")

FOLDER = Path(__file__).parents[3] / "configs"
PHYSICS = Setup(physics="pybullet", collision=("contact-pairs",), screening=True)
EVERY = [
    pytest.param(
        path.stem,
        marks=pytest.mark.slow(reason="a whole plan; single skills in every run")
        if path.stem == "drawer_module"
        else pytest.mark.release(reason="the plan of every shipped product"),
    )
    for path in sorted(FOLDER.glob("*.yaml"))
    if "\nkind: assembly\n" in path.read_text("utf-8") and path.stem != "inverter_grasps"
]
NEW = ["mini_pc", "gear_unit", "drawer_module"]


@pytest.fixture
def call(capfd: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Return what runs a command and gives its document."""
    monkeypatch.setenv("SKILLPLAN_CACHE_DIR", str(tmp_path / "cache"))

    def run(*words: str) -> Any:
        with pytest.raises(SystemExit) as ended:
            main([*words, "--format", "json"])
        out, error = capfd.readouterr()
        assert ended.value.code == 0, error or out[-2000:]
        return json.loads(out)

    return run


@pytest.mark.parametrize("name", EVERY)
def test_bodies_end_within_half_a_millimetre_and_a_degree(
    name: str, call: Any, tmp_path: Path
) -> None:
    """And screws are pressed with 3 N or more."""
    out = str(tmp_path / "plan")
    call("search-optimal", str(FOLDER / f"{name}.yaml"), "--out", out)
    done = call("simulate", out)
    assert done["complete"]
    assert done["largest_offset_mm"] < 0.5
    assert done["largest_tilt_deg"] < 1.0
    pressed = [
        skill["evidence"]["sensed"]["fastening_force_n"]
        for skill in done["skills"]
        if skill["skill"].startswith("fasten(")
    ]
    assert all(force_n >= 3.0 for force_n in pressed)


@pytest.mark.release(reason="half a minute; a part that does not creep, nor roll, in every run")
def test_the_product_to_begin_from_is_put_together_as_its_file_expects(call: Any) -> None:
    """A shaft of which the last skill lets go lies in its hole, and does not roll there."""
    file = FOLDER.parent / "examples" / "sensor_box.yaml"
    plan = ",".join(map(str, yaml.safe_load(file.read_text("utf-8"))["expect"]["optimal_actions"]))
    done = call("simulate", str(file), "--sequence", plan)
    assert done["complete"]
    assert done["largest_offset_mm"] < 0.5
    assert done["largest_tilt_deg"] < 1.0


@pytest.mark.release(reason="minutes of executions")
@pytest.mark.parametrize("name", NEW)
def test_physics_proves_the_optimum_that_hulls_prove(name: str) -> None:
    task = load_problem(FOLDER / f"{name}.yaml").task
    simulated, swept = solve(task, setup=PHYSICS), solve(task)
    assert simulated.status == "optimal"
    assert simulated.cost == pytest.approx(swept.cost)
