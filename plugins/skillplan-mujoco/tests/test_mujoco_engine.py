"""What the arm in MuJoCo finds feasible on the paper's board, and that it says so each time."""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from board_situations import BOARD, OPTIMAL, imagined
from example_count import examples
from skillplan.pipeline import load_problem
from skillplan.task import Skill, State, Task, Verdict
from skillplan_mujoco import MujocoEngine
from skillplan_simulation import PairLimits, check_pairs

Query = tuple[Skill, State]


@pytest.fixture(scope="module")
def task():
    return load_problem(BOARD).task


@pytest.fixture(scope="module")
def engine(task):
    return MujocoEngine(task)


def on_the_optimum(task: Task, actions: Iterable[int] = OPTIMAL) -> list[Query]:
    """Return the skills of the optimum, each where it is executed."""
    state, results = task.initial, []
    for action in actions:
        skill = task.skills[action]
        results.append((skill, state))
        state = skill.prediction_in(state).apply(state)
    return results


def contacts(engine: MujocoEngine, query: Query) -> Verdict:
    """Return the verdict of contact-pairs on an execution."""
    parts = [body.name for body in engine.task.scene.bodies]
    return check_pairs(engine.record(*query), PairLimits(), parts)


def test_a_part_is_picked_up_by_suction_and_set_down_within_a_tenth_of_a_millimetre(engine, task):
    """The pose is sensed, and nothing touches that should not."""
    for query in on_the_optimum(task)[:2]:
        verdict = engine.check(*query)
        assert verdict.is_feasible, verdict.reason
        assert not contacts(engine, query).is_infeasible
    assert all(abs(offset) < 0.1 for offset in verdict.evidence["offset_mm"])


def test_parts_of_milligrams_are_listed_as_they_get_more_mass(task):
    bodies = [
        replace(body, mass_kg=2e-5) if body.name == "clock" else body for body in task.scene.bodies
    ]
    light = replace(task, scene=replace(task.scene, bodies=tuple(bodies)))
    (words,) = set(MujocoEngine(light).not_checked()) - set(MujocoEngine(task).not_checked())
    assert words == "parts as light as clock: each has the mass of 0.2 g"


def test_friction_holds_a_part_between_the_jaws(engine, task):
    """A switch is lifted, and is still where the hand has it."""
    verdict = engine.check(*on_the_optimum(task)[2])
    assert verdict.is_feasible, verdict.reason
    assert verdict.evidence["sensed"]["jaw_width_m"] == pytest.approx(0.036, abs=0.001)


def test_a_screw_is_pressed_with_the_force_that_is_commanded(engine, task):
    """To a twentieth."""
    verdict = engine.check(*on_the_optimum(task)[-2])
    assert verdict.is_feasible, verdict.reason
    assert verdict.evidence["sensed"]["fastening_force_n"] == pytest.approx(5.0, rel=0.05)


def test_what_a_part_runs_into_is_named(engine, task):
    """The brace is over where the transformer belongs."""
    query = imagined(task, "place(transformer)", "pcb", "brace")
    bodies = contacts(engine, query).evidence["bodies"]
    assert set(bodies) <= {"transformer", "brace", "robot hand", "left finger", "right finger"}
    assert "brace" in bodies


def digest(engine: MujocoEngine, query: Query) -> str:
    """Return a digest of all that an execution left behind."""
    record = engine.record(*query)
    encoded = json.dumps(engine.check(*query).evidence, sort_keys=True).encode()
    values = [*record.forces_n.values(), *record.pairs_n.values(), *record.moved_m.values()]
    return hashlib.sha256(encoded + b"".join(value.tobytes() for value in values)).hexdigest()


def test_a_check_leaves_nothing_behind(task):
    """All that is recorded is equal to the bit after another check, and by a model of its own."""
    first, second = on_the_optimum(task)[2], on_the_optimum(task)[-1]
    used = MujocoEngine(task)
    used.check(*first)
    assert digest(used, second) == digest(MujocoEngine(task), second)


@pytest.mark.slow(reason="executions in a random order, each again afresh; one in every run")
@settings(max_examples=examples(4, fewest=2), deadline=None)
@given(order=st.lists(st.integers(0, 15), min_size=2, max_size=4))
def test_whatever_was_checked_before_a_fresh_model_records_the_same_to_the_bit(task, order):
    """Of any skills of the optimum, and of one that fails, in any order, also twice."""
    used, queries = MujocoEngine(task), on_the_optimum(task)
    queries.append(imagined(task, "place(transformer)", "pcb", "brace"))
    for number in order:
        message = digest(used, queries[number])
    assert message == digest(MujocoEngine(task), queries[order[-1]])


def elsewhere(number: int, **environment: str) -> list[str]:
    """Return the first digests that a new process comes to."""
    paths = os.pathsep.join([str(Path(__file__).parent), *sys.path])
    run = subprocess.run(
        [sys.executable, "-c", f"import test_mujoco_engine as it; it.main({number})"],
        env={**os.environ, "PYTHONPATH": paths, **environment},
        capture_output=True,
        text=True,
        check=True,
    )
    return run.stdout.split()


def test_a_new_process_with_another_blas_records_the_same_to_the_bit(task, engine):
    """A pick; the oldest kernels of OpenBLAS add up in another order than those in use."""
    message = digest(engine, on_the_optimum(task)[2])
    assert elsewhere(1, OPENBLAS_CORETYPE="Prescott") == [message]


@pytest.mark.slow(reason="processes; one of them in every run")
@pytest.mark.parametrize(
    "environment",
    [
        {"OPENBLAS_CORETYPE": "Prescott"},
        {"OPENBLAS_CORETYPE": "Nehalem"},
        {"NPY_DISABLE_CPU_FEATURES": "X86_V3"},
    ],
    ids=["prescott", "nehalem", "narrow"],
)
def test_no_kernel_of_a_blas_changes_a_bit(task, environment):
    """Of a pick, a place and a screw; nor do numpy's own kernels."""
    assert elsewhere(3, **environment) == digests(task)


def digests(task: Task, number: int = 3) -> list[str]:
    """Return digests of a pick, a place and a screw, or the first of them."""
    engine, queries = MujocoEngine(task), on_the_optimum(task)
    return [digest(engine, queries[index]) for index in (2, 3, -1)[:number]]


def main(number: int) -> None:
    """Write them."""
    sys.stdout.write(" ".join(digests(load_problem(BOARD).task, number)))


@pytest.mark.slow(reason="executions; that of other control is left in every run")
def test_joints_follow_by_position_too(task):
    """A switch is picked up by servos, and a screw pressed as hard as is commanded."""
    engine = MujocoEngine(task, MujocoEngine.Options(control="position"))
    for index in (2, -2):
        verdict = engine.check(*on_the_optimum(task)[index])
        assert verdict.is_feasible, verdict.reason
    assert verdict.evidence["sensed"]["fastening_force_n"] == pytest.approx(5.0, rel=0.2)


@pytest.mark.slow(reason="two plans of four skills; single checks in every run")
def test_a_whole_plan_ends_at_the_same_bits_whatever_was_done_before(task):
    """After a check and after another plan, as in a model of its own."""
    plan = [task.skills[action] for action in OPTIMAL[:4]]
    used = MujocoEngine(task)
    used.check(*on_the_optimum(task)[-1])
    used.perform(plan[:3])
    assert used.perform(plan).arrivals == MujocoEngine(task).perform(plan).arrivals
