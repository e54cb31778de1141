"""Parts that go in with a stated force: by swept and by both engines."""

from __future__ import annotations

from pathlib import Path

import pytest

from skillplan import TaskError
from skillplan.pipeline import Setup, load_problem, make_model
from thinned import slow_case

CONFIG = Path(__file__).parents[3] / "configs" / "cell_fits.yaml"
FIT = "parts.bushing.fits.housing"


def verdict_on_place(part, setup, **changes):
    """Return the verdict on a place, with the part in the hand and all others at their start."""
    keys = {key.replace("__", "."): value for key, value in changes.items()}
    task = load_problem(CONFIG, changes=keys).task
    others = [f"at_start({name})" for name in ("bushing", "clip", "seal", "magnet", "key")]
    facts = [fact for fact in others if fact != f"at_start({part})"]
    known = (f"held({part})", "placed(housing)", "tool(gripper)", f"at({part}.start)", *facts)
    state = task.facts.of(*known)
    stages = make_model(task, setup).feasibility.stages(task.skill(f"place({part})"), state)
    return next(verdict for verdict in stages if verdict.stage in ("swept", setup.physics))


SWEPT = Setup(collision=("swept",))
ENGINES = [slow_case("mujoco", reason="an engine"), slow_case("pybullet", reason="an engine")]


def test_swept_allows_the_overlap_and_no_more():
    assert verdict_on_place("clip", SWEPT).is_feasible
    bare = {"parts.clip.goal_m": "[0.46, 0.15, 0.01]", "parts.clip.fits.housing.drawn_m": "-0.0001"}
    with pytest.raises(TaskError, match=r"fit states 0\.1 mm"):
        verdict_on_place("clip", SWEPT, **bare)


def test_swept_asks_what_stops_a_part():
    """Two millimetres above the floor nothing does, unless the arm stops there itself."""
    higher = {"parts.bushing.goal_m": "[0.42, 0.15, 0.012]"}
    verdict = verdict_on_place("bushing", SWEPT, **higher)
    assert "nothing stops bushing at its goal" in verdict.reason
    assert "housing is 2.0 mm ahead" in verdict.reason
    by_arm = {f"{FIT}.stop": "arm"}
    assert verdict_on_place("bushing", SWEPT, **higher, **by_arm).is_feasible


@pytest.mark.parametrize("engine", ENGINES)
def test_engines_push_with_the_stated_force(engine):
    """The part stays at its goal; a grip that cannot bear the force slips."""
    setup = Setup(physics=engine, collision=("contact-pairs",))
    sensed = verdict_on_place("bushing", setup).evidence["sensed"]
    assert sensed["fit_force_n"] == 30.0
    weak = verdict_on_place("bushing", setup, tools__gripper__force_n="8.0")
    assert "slips in the jaws under the 30 N" in weak.reason


@pytest.mark.parametrize("engine", ENGINES)
def test_engines_refuse_a_part_that_misses_its_lead_in(engine):
    setup = Setup(physics=engine, collision=("contact-pairs",))
    verdict = verdict_on_place("clip", setup, **{"parts.clip.fits.housing.lead_in_m": "0.0"})
    assert "meets the rim of housing" in verdict.reason
