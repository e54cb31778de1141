"""Executions that have to be right for any task: what they rest on, and how they go wrong."""

import copy
import math

import numpy as np
import pybullet
import pytest

from board_situations import imagined
from situations import assembly, config_content
from skillplan.physics import plan_linear_motions
from skillplan.task import Body, Box, Cylinder, Mesh, VerdictStatus
from skillplan_pinocchio import compute_mass_properties
from skillplan_pybullet import PybulletEngine, SimulatedArm, SimulationSettings, World
from skillplan_simulation import ContactPairsDetector, PlannedPaths, SkillRunner
from thinned import slow_case

# A screw's head, and how far above the end of the bit the thicker shank begins.
SCREW_M, BIT_M = 0.002, 0.040


def content(name, **changes):
    """Return what a file says, without a chart, to be ruled on by physics alone."""
    deepcopy = copy.deepcopy(config_content(name))
    for key in ("chart", "collision", "expect"):
        deepcopy.pop(key, None)
    return deepcopy | changes


def after(task, *skills):
    """Return the state after some skills."""
    state = task.initial
    for name in skills:
        state = task.skill(name).prediction_in(state).apply(state)
    return state


@pytest.fixture(scope="module")
def board():
    """Return the paper's board."""
    return assembly(content("inverter_board"))


class TestWhatAVerdictRestsOn:
    @pytest.mark.slow(
        reason="many executions; what verdicts rest on is a property test of every run"
    )
    @pytest.mark.parametrize(
        "holder_m",
        [
            slow_case([0.62, 0.30], reason="two executions; another place in every run"),
            [0.25, 1.20],
        ],
    )
    def test_a_way_that_depends_on_the_tool_rests_on_the_tool(self, holder_m):
        result = content("motor_drive", tool_change={"style": "swap"})
        result["tools"]["suction_cup"]["holder_m"] = holder_m
        task = assembly(result)
        skill, engine = task.skill("load(screwdriver)"), PybulletEngine(task)
        from_gripper, from_cup = task.initial, after(task, "load(suction_cup)")
        first, other = (engine.check(skill, state) for state in (from_gripper, from_cup))
        assert first.is_feasible
        assert other.is_feasible == (holder_m[1] < 1.0)
        assert first.applies_in(from_gripper)
        assert not first.applies_in(from_cup)
        assert other.applies_in(from_cup)
        assert not other.applies_in(from_gripper)

    @pytest.mark.slow(
        reason="several executions; every run finds other collisions on the way of a hand"
    )
    def test_what_stands_above_the_safe_height_is_gone_round_on_the_travel(self):
        results = content("inverter_board")
        results["parts"]["switch_1"]["start_m"] = [0.30, -0.40]
        results["parts"]["mast"] = {
            "tool": "gripper",
            "size_m": [0.03, 0.03, 0.20],
            "start_m": [0.39, -0.23],
            "goal_m": [0.62, 0.16],
        }
        task = assembly(results)
        engine, detector = PybulletEngine(task), ContactPairsDetector(task)
        detector.beside([engine])
        state = after(task, "pick(pcb)", "place(pcb)", "pick(switch_1)")
        question = task.skill("place(switch_1)"), state
        for verdict in (engine.check(*question), detector.check(*question)):
            assert verdict.is_feasible, verdict.reason
            assert {"at_start(mast)", "at(switch_1.start)"} <= set(verdict.facts)
        (travel,) = engine.check(*question).evidence["travels"]
        assert travel["around"] == ["mast"]


class TestScrews:
    @pytest.fixture
    def beside_a_post(self):
        """Return a maker of boards with a post beside a screw, this far below the shank at last."""

        def make(below_m):
            results = content("inverter_board")
            height_m = 0.046 + SCREW_M + BIT_M - below_m
            results["parts"]["post"] = {
                "tool": "gripper",
                "mass_kg": 0.1,
                "size_m": [0.02, 0.006, height_m],
                "start_m": [0.60, 0.20],
                "goal_m": [0.520, -0.056],
                "goal_on": "pcb",
            }
            task = assembly(results)
            engine, detector = PybulletEngine(task), ContactPairsDetector(task)
            detector.beside([engine])
            question = imagined(task, "fasten(screw_1)", "pcb", "transformer", "brace", "post")
            return engine.check(*question), detector.check(*question)

        return make

    @pytest.mark.slow(reason="executions beside a post; what it passes by is none in every run")
    def test_what_the_screwdriver_hits_while_it_presses_is_a_collision(self, beside_a_post):
        _, hit = beside_a_post(-0.0005)
        assert hit.is_infeasible
        assert set(hit.evidence["bodies"]) == {"screwdriver", "post"}
        assert hit.evidence["during"] == "the driving of screw_1"

    @pytest.mark.slow(reason="an execution; a driven screw in every run")
    def test_a_driven_screw_is_solid_for_the_robot_again(self, board):
        skill, state = imagined(board, "fasten(screw_1)")
        (motion,) = plan_linear_motions(board, skill, state)
        settings = SimulationSettings()
        with World(settings.friction) as world:
            arm = SimulatedArm(world, board.scene.robots[0], settings)
            (planned,) = PlannedPaths(board, settings).of(skill, state).motions
            arm.stand(planned.approach[0], 0.04)
            runner = SkillRunner(world, arm, board.scene, settings, motion.tool)
            runner.watch({"screw_1"})
            runner.run(planned)
            world.put("screw_1", runner.tools.tool_pose())
            world.step()
            numbers = world.numbers["screwdriver"], world.numbers["screw_1"]
            assert pybullet.getContactPoints(*numbers, physicsClientId=world.client)

    @pytest.mark.slow(reason="executes a skill; other screws in every run")
    def test_what_it_passes_by_is_none(self, beside_a_post):
        driven, passed = beside_a_post(0.003)
        assert driven.is_feasible, driven.reason
        assert passed.is_feasible, passed.reason


class TestSimulationsThatSayNothing:
    @pytest.mark.parametrize(
        "speed_m_per_s",
        [
            slow_case(math.nan, reason="another speed in every run"),
            60.0,
            slow_case(1e200, reason="two speeds in every run"),
        ],
    )
    def test_a_blow_up_is_unknown_with_a_reason(self, board, monkeypatch, speed_m_per_s):
        step = World.step

        def upset(world):
            if world.steps == 150:
                pybullet.resetBaseVelocity(
                    world.numbers["switch_1"],
                    (speed_m_per_s, 0, 0),
                    (0, 0, 0),
                    physicsClientId=world.client,
                )
            step(world)

        monkeypatch.setattr(World, "step", upset)
        engine = PybulletEngine(board)
        verdict = engine.check(
            board.skill("pick(switch_1)"), after(board, "pick(pcb)", "place(pcb)")
        )
        assert verdict.status is VerdictStatus.UNKNOWN
        assert "blew up" in verdict.reason
        plan = [board.skill(name) for name in ("pick(pcb)", "place(pcb)", "pick(switch_1)")]
        performance = engine.perform(plan)
        assert performance.failed is not None
        assert performance.failed.verdict.status is VerdictStatus.UNKNOWN


class TestHands:
    @pytest.mark.parametrize(
        "part",
        [
            slow_case(
                "capacitor_1",
                reason="an execution of the larger board; parts that come to rest in every run",
            ),
            slow_case("capacitor_2", reason="the other in every run"),
        ],
    )
    def test_light_parts_stay_between_the_jaws_that_take_them_over(self, part):
        task = assembly(content("motor_drive"))
        held = task.facts.of(
            "placed(housing)",
            "placed(power_board)",
            f"held({part})",
            "tool(gripper)",
            f"at({part}.start)",
        )
        verdict = PybulletEngine(task).check(task.skill(f"place({part})"), held)
        assert verdict.is_feasible, verdict.reason

    @pytest.mark.parametrize(
        "height_m",
        [
            slow_case(0.0, reason="another height in every run"),
            slow_case(0.003, reason="its ends in every run"),
            0.02,
        ],
    )
    def test_from_how_high_a_part_is_let_go_takes_nothing_out_of_the_world(self, board, height_m):
        engine = PybulletEngine(board, PybulletEngine.Options(drop_height_m=height_m))
        state = after(board, "pick(pcb)", "place(pcb)", "pick(switch_1)")
        verdict = engine.check(board.skill("place(switch_1)"), state)
        assert verdict.is_feasible, verdict.reason
        assert "placed(pcb)" in verdict.facts


class TestMassProperties:
    def test_a_wedge_is_heavy_where_it_is_thick(self):
        corners = ((0, 0, 0), (6, 0, 0), (0, 2, 0), (6, 2, 0), (0, 0, 3), (0, 2, 3))
        faces = ((0, 2, 1), (1, 2, 3), (0, 1, 4), (2, 5, 3), (0, 4, 2), (2, 4, 5), (1, 3, 4))
        mass_properties = compute_mass_properties(
            Body("wedge", (Mesh(corners, (*faces, (3, 5, 4))),), (), 1.0)
        )
        assert mass_properties.centre == pytest.approx([2.0, 1.0, 1.0])
        # Of a triangle, by its side: a^2 / 18 along each; of the width, w^2 / 12.
        spread = np.array([36 / 18, 4 / 12, 9 / 18])
        assert mass_properties.inertia_kg_m2 == pytest.approx(spread.sum() - spread)

    def test_a_box_weighs_the_same_as_a_mesh(self):
        box = Box((0.02, 0.03, 0.05), (0.01, 0.0, 0.025))
        corners = tuple(
            (0.01 + x * 0.01, y * 0.015, 0.025 + z * 0.025)
            for x in (-1, 1)
            for y in (-1, 1)
            for z in (-1, 1)
        )
        sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
        faces = tuple(face for a, b, c, d in sides for face in ((a, b, c), (a, c, d)))
        first, other = (
            compute_mass_properties(Body("box", shapes, (), 0.2))
            for shapes in ((box,), (Mesh(corners, faces),))
        )
        assert first.centre == pytest.approx(other.centre)
        assert first.inertia_kg_m2 == pytest.approx(other.inertia_kg_m2)

    def test_a_cylinder_turns_as_the_textbook_says(self):
        mass_properties = compute_mass_properties(
            Body("pin", (Cylinder(0.04, 0.1, (0.0, 0.0, 0.05)),), (), 2.0)
        )
        across = 2.0 * (3 * 0.02**2 + 0.1**2) / 12
        assert mass_properties.inertia_kg_m2 == pytest.approx([across, across, 2.0 * 0.02**2 / 2])
