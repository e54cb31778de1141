"""What the simulated arm finds feasible on the paper's board, and that it says so each time."""

from __future__ import annotations

import dataclasses
import json
import subprocess
import sys

import pytest

from board_situations import BOARD, OPTIMAL, imagined, state_after
from skillplan.errors import TaskError
from skillplan.pipeline import load_problem
from skillplan.task import AXES, Grasp, GraspKind, Task, Verdict, VerdictStatus
from skillplan_pybullet import PybulletEngine
from thinned import slow_case


@pytest.fixture(scope="module")
def task():
    return load_problem(BOARD).task


@pytest.fixture(scope="module")
def engine(task):
    return PybulletEngine(task)


class TestThePapersBoard:
    @pytest.mark.slow(reason="the same executions, read by detectors, in every run")
    def test_every_skill_of_the_optimum_is_feasible(self, task, engine):
        state = task.initial
        for action in OPTIMAL:
            skill = task.skills[action]
            verdict = engine.check(skill, state)
            assert verdict.is_feasible, verdict
            state = skill.prediction.apply(state)

    @pytest.mark.parametrize(
        "part",
        [
            "pcb",
            slow_case("brace", reason="another part in every run"),
            *(
                slow_case(part, reason="two parts in every run")
                for part in ("switch_1", "transformer", "clock")
            ),
        ],
    )
    def test_parts_come_to_rest_within_a_tenth_of_a_millimetre(self, task, engine, part):
        done = () if part == "pcb" else ("pcb",)
        verdict = engine.check(*imagined(task, f"place({part})", *done))
        assert verdict.is_feasible, verdict
        assert max(abs(value) for value in verdict.evidence["offset_mm"]) < 0.1
        assert verdict.evidence["tilt_deg"] < 0.5
        assert verdict.evidence["sensed"]["tip_error_m"] < 0.001

    def test_a_part_put_down_without_the_board_ends_below_its_goal(self, task, engine):
        verdict = engine.check(*imagined(task, "place(switch_1)"))
        assert verdict.is_infeasible
        assert verdict.reason == "switch_1 came to rest 6.0 mm below its goal"
        assert "placed(pcb)" in (verdict.absent or ())

    @pytest.mark.slow(reason="an execution; a part put through another in every run")
    def test_the_transformer_does_not_go_under_the_brace(self, task, engine):
        verdict = engine.check(*imagined(task, "place(transformer)", "pcb", "brace"))
        assert verdict.is_infeasible
        assert "placed(brace)" in (verdict.present or ())

    def test_the_brace_stands_without_the_transformer(self, task, engine):
        assert engine.check(*imagined(task, "place(brace)", "pcb")).is_feasible

    def test_a_screw_without_a_brace_presses_on_nothing(self, task, engine):
        verdict = engine.check(*imagined(task, "fasten(screw_1)", "pcb", "transformer"))
        assert verdict.reason == "screw_1 was pressed with 0.0 N, where 3.0 N are needed"

    @pytest.mark.parametrize(
        "screw", ["screw_1", slow_case("screw_2", reason="the other one in every run")]
    )
    def test_a_screw_is_driven_with_three_newtons_and_more(self, task, engine, screw):
        skill, state = imagined(task, f"fasten({screw})", "pcb", "transformer", "brace")
        verdict = engine.check(skill, state)
        assert verdict.is_feasible, verdict
        assert 3.0 <= verdict.evidence["sensed"]["fastening_force_n"] <= 10.0

    def test_a_state_that_cannot_be_is_not_executed(self, task, engine):
        verdict = engine.check(*imagined(task, "place(pcb)", "switch_1"))
        assert verdict.is_infeasible
        assert verdict.reason.startswith("switch_1 has nothing beneath it")
        assert list(verdict.present or ()) == ["placed(switch_1)"]

    def test_a_picked_part_is_felt_between_the_jaws(self, task, engine):
        verdict = engine.check(task.skill("pick(transformer)"), task.initial)
        assert verdict.is_feasible
        # The fingers' outline is a millimetre larger in the simulator than on paper.
        assert verdict.evidence["sensed"]["jaw_width_m"] == pytest.approx(0.052, abs=0.0025)

    @pytest.mark.slow(reason="an execution; a whole plan in every run")
    def test_a_tool_is_sensed_to_be_attached(self, task, engine):
        verdict = engine.check(task.skill("load(screwdriver)"), task.initial)
        assert verdict.evidence["sensed"]["tool_attached"] == "screwdriver"

    def test_what_is_far_off_is_not_rested_on(self, task, engine):
        verdict = engine.check(task.skill("pick(transformer)"), task.initial)
        assert list(verdict.present or ()) == ["at_start(transformer)"]


IN_A_PROCESS_OF_ITS_OWN = """
import json, sys
from skillplan.pipeline.setup import load_problem
from skillplan_pybullet.engine import PybulletEngine
task = load_problem(sys.argv[1]).task
for name, actions in json.loads(sys.argv[2]):
    state = task.initial
    for action in actions:
        state = task.skills[action].prediction.apply(state)
    verdict = PybulletEngine(task).check(task.skill(name), state)
    facts = [str(verdict.present), str(verdict.absent)]
    print(json.dumps([verdict.status, verdict.reason, *facts, dict(verdict.evidence)]))
"""


def _text(verdict: Verdict) -> str:
    facts = [str(verdict.present), str(verdict.absent)]
    return json.dumps([verdict.status, verdict.reason, *facts, dict(verdict.evidence)])


class TestDeterminism:
    QUESTIONS = (
        ("load(screwdriver)", ()),
        ("place(switch_1)", (0, 1, 2)),
        ("place(transformer)", (0, 1, 10, 11, 8)),
        ("fasten(screw_1)", (0, 1, 8, 9, 10, 11, 13)),
    )

    @pytest.mark.parametrize(
        "questions",
        [
            slow_case(
                QUESTIONS[:2], reason="six executions; in every run bodies far off change no digit"
            ),
            slow_case(QUESTIONS, reason="two of four in every run"),
        ],
        ids=["two", "four"],
    )
    def test_a_verdict_is_the_same_bit_for_bit_in_any_order_and_process(self, task, questions):
        engine = PybulletEngine(task)
        forward = [_text(engine.check(task.skill(s), state_after(task, a))) for s, a in questions]
        another = PybulletEngine(task)
        backward = [
            _text(another.check(task.skill(s), state_after(task, a))) for s, a in questions[::-1]
        ]
        assert forward == backward[::-1]
        elsewhere = subprocess.run(
            [sys.executable, "-c", IN_A_PROCESS_OF_ITS_OWN, str(BOARD), json.dumps(questions)],
            capture_output=True,
            text=True,
            check=True,
        )
        assert elsewhere.stdout.splitlines() == forward

    @pytest.mark.slow(reason="two executions; the same twice in every run")
    def test_bodies_far_off_change_no_digit(self, task):
        engine = PybulletEngine(task)
        skill = task.skill("pick(transformer)")
        here = engine.check(skill, task.initial)
        there = engine.check(skill, state_after(task, (0, 1, 10, 11)))
        assert _text(here) == _text(there)


@pytest.mark.slow(reason="executions with other options; the defaults in every run")
class TestOptions:
    def made(self, task: Task, **options: object) -> PybulletEngine:
        return PybulletEngine(task, PybulletEngine.Options.model_validate(options))

    @pytest.mark.parametrize(
        ("dynamics", "control"),
        [
            ("pybullet", "osc"),
            ("pinocchio", "position"),
            *(
                slow_case(*both, reason="each with another in every run")
                for both in (("pybullet", "position"), ("pinocchio", "osc"))
            ),
        ],
    )
    def test_either_control_ends_a_move_within_a_millimetre(self, task, control, dynamics):
        if dynamics == "pinocchio":
            pytest.importorskip("pinocchio", reason="pinocchio is optional here")
        engine = self.made(task, control=control, dynamics=dynamics)
        verdict = engine.check(*imagined(task, "place(switch_1)", "pcb"))
        assert verdict.is_feasible, verdict
        assert verdict.evidence["sensed"]["tip_error_m"] < 0.001

    @pytest.mark.slow(
        reason="an execution; a part let go from there in test_executions.py of every run"
    )
    def test_a_drop_from_two_centimetres_still_arrives(self, task):
        engine = self.made(task, drop_height_m=0.02)
        assert engine.check(*imagined(task, "place(clock)", "pcb")).is_feasible

    @pytest.mark.parametrize(
        "control", [slow_case("osc", reason="the other control in every run"), "position"]
    )
    def test_either_control_drives_a_screw_with_the_force_asked_for(self, task, control):
        engine = self.made(task, control=control, press_force_n=8.0)
        verdict = engine.check(*imagined(task, "fasten(screw_1)", "pcb", "transformer", "brace"))
        assert verdict.is_feasible, verdict
        assert 6.0 <= verdict.evidence["sensed"]["fastening_force_n"] <= 9.5

    @pytest.mark.slow(reason="an execution; a screw that presses on nothing in every run")
    def test_a_screw_that_has_to_be_pressed_harder_is_not_driven(self, task):
        engine = self.made(task, min_fastening_force_n=20.0)
        verdict = engine.check(*imagined(task, "fasten(screw_1)", "pcb", "transformer", "brace"))
        assert verdict.is_infeasible
        assert "where 20.0 N are needed" in verdict.reason

    @pytest.mark.slow(reason="two executions; a part that ends below its goal in every run")
    def test_an_exact_tolerance_refuses_what_a_loose_one_grants(self, task):
        question = imagined(task, "place(switch_1)", "pcb")
        assert self.made(task, position_tolerance_m=1e-6).check(*question).is_infeasible
        assert self.made(task, position_tolerance_m=1e-3).check(*question).is_feasible


class TestFaults:
    def test_a_part_too_wide_for_the_hand_is_named_with_its_line(self):
        with pytest.raises(TaskError) as caught:
            load_problem(
                BOARD,
                {"physics": ("pybullet",)},
                {
                    "parts.switch_1.grasp": "{closing_axis: y}",
                    "parts.switch_1.size_m": "[0.02, 0.12, 0.04]",
                },
            )
        assert "switch_1" in str(caught.value)

    def test_the_engine_itself_knows_what_its_hand_holds(self, task):
        bodies = tuple(
            dataclasses.replace(
                body, grasps=(Grasp(GraspKind.JAWS, (0.0, 0.0, 0.02), AXES["x"], 0.1),)
            )
            if body.name == "clock"
            else body
            for body in task.scene.bodies
        )
        wide = task.replace(scene=dataclasses.replace(task.scene, bodies=bodies))
        faults = PybulletEngine(wide).faults()
        assert list(faults) == ["placed(clock)"]
        assert "0.100 m wide" in faults["placed(clock)"]
        assert PybulletEngine(task).faults() == {}

    def test_a_goal_beyond_the_arm_is_unreachable_in_words(self, task):
        far = load_problem(
            BOARD, changes={"robot.reach_m": "2.0", "parts.clock.start_m": "[0.95, -0.3]"}
        ).task
        verdict = PybulletEngine(far).check(far.skill("pick(clock)"), far.initial)
        assert verdict.is_infeasible
        assert "beyond what the arm spans" in verdict.reason

    def test_a_simulation_that_blows_up_is_unknown(self, task, monkeypatch):
        from skillplan_pybullet import World

        monkeypatch.setattr(World, "is_sane", lambda self: False)
        verdict = PybulletEngine(task).check(task.skill("pick(clock)"), task.initial)
        assert verdict.status is VerdictStatus.UNKNOWN
        assert verdict.reason == "the simulation blew up"
