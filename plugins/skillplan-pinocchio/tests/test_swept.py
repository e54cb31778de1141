"""The detector ``swept`` on situations made for it."""

import random
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from concave_shapes import channel_boxes
from example_count import examples
from situations import assembly
from skillplan.model import SkillModel
from skillplan.pipeline import Setup, make_feasibility, solve
from skillplan.task import AXES, Cylinder, Grasp, GraspKind, VerdictStatus
from skillplan.testing import DetectorSuite, lid_task, reachable_states
from skillplan_pinocchio import SweptDetector


class TestSweptDetector(DetectorSuite):
    detector = "swept"

    @pytest.fixture(autouse=True)
    def _grips(self, gripping):
        self._gripping = gripping

    def task(self):
        return self._gripping(lid_task())

    def queries(self, task):
        """A sample, as the hand is swept for every question."""
        every = list(super().queries(task))
        yield from random.Random(4).sample(every, min(len(every), examples(40, fewest=6)))


def shelf(**changes):
    """Return the content of two blocks far apart and one that is put on the first."""
    content = {
        "kind": "assembly",
        "name": "shelf",
        "robot": {"home_m": [0.35, 0.0], "safe_height_m": 0.15},
        "tools": {"gripper": {"holder_m": [0.6, 0.3]}},
        "initial_tool": "gripper",
        "parts": {
            "base": block([0.4, -0.25], [0.5, 0.0], [0.06, 0.1, 0.02]),
            "top": block([0.4, 0.25], [0.5, 0.0], [0.03, 0.04, 0.03], goal_on="base"),
        },
        "step_limit": 20,
    }
    for key, value in changes.items():
        content[key] = {**content[key], **value} if isinstance(value, dict) else value
    return content


def block(start_m, goal_m, size_m, **more):
    return {"tool": "gripper", "size_m": size_m, "start_m": start_m, "goal_m": goal_m, **more}


def verdict_in(task, skill, *facts, place="home", tool="gripper", **options):
    """Return the verdict on a skill of a task where these facts hold."""
    state = task.facts.of(f"at({place})", f"tool({tool})", *facts)
    return SweptDetector(task, SweptDetector.Options(**options)).check(task.skill(skill), state)


def verdict_of(content, skill, *facts, **more):
    """Return the verdict on a skill of a content where these facts hold."""
    return verdict_in(assembly(content), skill, *facts, **more)


class TestReach:
    def test_what_the_arm_cannot_point_down_at_is_said_in_words(self):
        """Within the reach that the file claims, but beyond what a hand that points down has."""
        content = shelf()
        content["parts"]["base"]["goal_m"] = [0.83, 0.0]
        content["parts"]["top"]["goal_m"] = [0.83, 0.0]
        verdict = verdict_of(content, "place(base)", "held(base)")
        assert verdict.is_infeasible
        assert verdict.reason.startswith("the hand cannot point straight down at (0.830, 0.000,")
        assert verdict.reason.endswith("from the shoulder, beyond what the arm spans")
        assert verdict.evidence["missed_by_m"] > 0.02
        assert verdict.facts == ["tool(gripper)"]

    @pytest.mark.slow(reason="a scene more; what is out of reach in every run")
    def test_a_base_elsewhere_reaches_it(self):
        """The arm stands where the task says."""
        content = shelf(robot={"base_m": [0.3, 0.0, 0.0], "home_m": [0.75, 0.0]})
        content["parts"]["base"]["goal_m"] = [0.83, 0.0]
        content["parts"]["top"]["goal_m"] = [0.83, 0.0]
        assert verdict_of(content, "place(base)", "held(base)").is_feasible
        content["robot"]["base_m"] = [0.0, 0.0, 0.0]
        assert verdict_of(content, "place(base)", "held(base)").is_infeasible


class TestHand:
    def neighbour(self, gap_m, tool=None, width_m=0.03, **more):
        """Return the verdict on a block that is put beside another, so far along the jaws."""
        content = shelf(tools={"gripper": {"holder_m": [0.6, 0.3], **(tool or {})}})
        # The part is 30 mm wide along the jaws.
        x_m = 0.5 + 0.015 + gap_m + width_m / 2
        content["parts"]["post"] = block([0.6, -0.25], [x_m, 0.0], [width_m, 0.04, 0.02])
        content["parts"]["top"]["goal_m"] = [0.5, 0.0]
        del content["parts"]["top"]["goal_on"]
        del content["parts"]["base"]
        return verdict_of(content, "place(top)", "held(top)", "placed(post)", **more)

    @pytest.mark.parametrize(("gap_m", "hits"), [(0.014, True), (0.017, True), (0.019, False)])
    def test_a_finger_needs_room_beside_the_part(self, gap_m, hits):
        """14.4 mm of finger; with 4 mm more it can open, too."""
        verdict = self.neighbour(gap_m)
        assert verdict.is_infeasible is hits
        if hits:
            assert verdict.reason.startswith("a finger runs into post on the ")
            assert verdict.evidence["bodies"] == ["post"]
            assert "placed(post)" in verdict.facts

    def test_jaws_that_hardly_open_need_less_room(self):
        """The clearance is an option, or the tool's; closed, only the fingers count, to 0.02 mm."""
        assert self.neighbour(0.0148, clearance_m=0).is_feasible
        assert self.neighbour(0.0146, clearance_m=0).is_infeasible
        assert self.neighbour(0.017, clearance_m=0.001).is_feasible
        assert self.neighbour(0.017, {"clearance_m": 0.001}).is_feasible
        # Jaws that carry are closed, and would be outside of this post if open.
        verdict = self.neighbour(0.0002, {"clearance_m": 0.001}, width_m=0.0006)
        assert verdict.evidence["during"] == "the approach"
        verdict = self.neighbour(0.017)
        assert verdict.evidence["during"] == "the retreat"
        assert self.neighbour(0.014).evidence["during"] == "the approach"

    @pytest.mark.parametrize(
        ("height_m", "is_held", "hits"),
        [(0.02, False, True), (0.0185, False, False), (0.0185, True, True)],
    )
    def test_a_jaw_is_as_wide_at_its_end_as_engines_have_it(self, height_m, is_held, hits):
        """It ends at 18 mm; a holder gets the part at its goal, others are let go 1 mm above."""
        content = shelf()
        content["parts"]["post"] = block([0.6, -0.25], [0.521, 0.018], [0.01, 0.02, height_m])
        content["parts"]["top"]["goal_m"] = [0.5, 0.0]
        del content["parts"]["top"]["goal_on"], content["parts"]["base"]
        if is_held:
            content["holders"] = {"nest": {"kind": "hold", "parts": ["top"], "stays": True}}
        verdict = verdict_of(content, "place(top)", "held(top)", "placed(post)")
        assert verdict.is_infeasible is hits
        assert not hits or verdict.reason == "a finger runs into post on the approach"

    def test_what_is_across_the_jaws_needs_less_room(self, regrasped):
        """Closing along y leaves the neighbour along x alone."""
        content = shelf()
        content["parts"]["post"] = block([0.6, -0.25], [0.532, 0.0], [0.03, 0.04, 0.06])
        content["parts"]["top"]["goal_m"] = [0.5, 0.0]
        del content["parts"]["top"]["goal_on"]
        del content["parts"]["base"]
        task = assembly(content)
        facts = ("held(top)", "placed(post)")
        assert verdict_in(task, "place(top)", *facts).is_infeasible
        task = regrasped(task, top=Grasp(GraspKind.JAWS, (0.0, 0.0, 0.018), AXES["y"], 0.04))
        assert verdict_in(task, "place(top)", *facts).is_feasible

    def test_jaws_do_not_close_through_another_wall_of_their_part(self, regrasped):
        """Open, they are beyond it; a single wall is held."""
        task = regrasped(
            assembly(shelf()), top=Grasp(GraspKind.JAWS, (0.0015, 0.0, 0.02), AXES["x"], 0.001)
        )
        walls = channel_boxes(0.004, 0.04, 0.03, 0.001)
        for shapes, hits in ((walls, True), (walls[:2], False)):
            bodies = tuple(
                replace(body, shapes=shapes) if body.name == "top" else body
                for body in task.scene.bodies
            )
            changed = replace(task, scene=replace(task.scene, bodies=bodies))
            verdict = verdict_in(changed, "pick(top)", "at_start(top)", "hand_free")
            assert verdict.is_infeasible is hits
            assert not hits or verdict.reason.startswith("a finger ")

    def test_the_hand_is_wider_than_its_fingers(self):
        """A wall as far as 90 mm away, if it is higher than the fingers are long."""
        content = shelf()
        wall = block([0.6, -0.25], [0.595, 0.0], [0.02, 0.04, 0.14])
        content["parts"] = {"wall": wall, "base": content["parts"]["base"]}
        verdict = verdict_of(content, "place(base)", "held(base)", "placed(wall)")
        assert verdict.reason == "the hand runs into wall on the approach"
        content["parts"]["wall"]["size_m"] = [0.02, 0.04, 0.05]
        assert verdict_of(content, "place(base)", "held(base)", "placed(wall)").is_feasible

    def test_a_part_wider_than_the_jaws_open_is_a_fault_of_the_file(self):
        """Under the fact that it is placed, and infeasible if asked all the same."""
        content = shelf()
        content["parts"]["base"]["size_m"] = [0.09, 0.1, 0.02]
        task = assembly(content)
        words = (
            "base is 0.090 m wide between the jaws, and they open 0.080 m; "
            "give it another closing axis, or grasp: {type: suction}"
        )
        assert SweptDetector(task).faults() == {"placed(base)": f"{words}."}
        verdict = verdict_in(task, "pick(base)", "at_start(base)", "hand_free")
        assert verdict.is_infeasible
        assert verdict.reason == words

    def test_the_hand_may_not_run_into_what_it_takes(self, regrasped):
        """A grasp so deep that the part reaches up into the hand."""
        content = shelf()
        content["parts"]["base"]["size_m"] = [0.06, 0.1, 0.08]
        task = assembly(content)
        for tip_m, hits in ((0.02, True), (0.06, False)):
            grasp = Grasp(GraspKind.JAWS, (0.0, 0.0, tip_m), AXES["x"], 0.06)
            changed = regrasped(task, base=grasp)
            verdict = verdict_in(changed, "pick(base)", "at_start(base)", "hand_free")
            assert verdict.is_infeasible is hits
            if hits:
                assert verdict.reason == "the hand runs into base on the approach"
                assert verdict.facts == ["tool(gripper)"]

    def test_fingers_that_reach_below_the_table_are_stopped_by_it(self, regrasped):
        """The table is there in every state."""
        content = shelf()
        task = assembly(content)
        task = regrasped(task, base=Grasp(GraspKind.JAWS, (0.0, 0.0, -0.005), AXES["x"], 0.06))
        verdict = verdict_in(task, "pick(base)", "at_start(base)", "hand_free")
        assert verdict.reason == "a finger runs into the table on the approach"
        assert verdict.evidence["penetration_m"] == pytest.approx(0.005, abs=1e-6)
        assert verdict.facts == ["tool(gripper)"]


class TestLoad:
    def roofed(self, height_m):
        """Return the shelf with a roof over the place of the top, so high above the base."""
        content = shelf()
        content["parts"]["roof"] = {
            "tool": "gripper",
            "boxes": [
                {"size_m": [0.06, 0.1, 0.01], "centre_m": [0.0, 0.0, height_m + 0.005]},
                {"size_m": [0.06, 0.01, height_m], "centre_m": [0.0, 0.045, height_m / 2]},
            ],
            "start_m": [0.6, -0.2],
            "goal_m": [0.5, 0.0],
            "goal_on": "base",
        }
        return content

    def test_what_stands_in_the_way_of_the_approach_is_hit(self):
        """With where and how deep, and resting on the fact that it is there."""
        facts = ("held(top)", "placed(base)", "placed(roof)")
        verdict = verdict_of(self.roofed(0.05), "place(top)", *facts)
        assert verdict.reason == "top runs into roof on the approach"
        assert verdict.evidence["moving"] == "top"
        assert verdict.evidence["bodies"] == ["roof"]
        # The roof's top is 80 mm above the table.
        assert verdict.evidence["position_m"][2] == pytest.approx(0.08, abs=0.006)
        assert verdict.evidence["penetration_m"] > 0.01
        assert "placed(roof)" in verdict.facts

    def test_a_blocked_approach_is_refused_without_paths_of_the_arm(self):
        """The early refusal is the one of the check; without an obstacle there is none."""
        task = assembly(self.roofed(0.05))
        facts = ("at(home)", "tool(gripper)", "held(top)", "placed(base)")
        detector, place = SweptDetector(task), task.skill("place(top)")
        refusal = detector.refuse_early(place, task.facts.of(*facts, "placed(roof)"))
        assert refusal == verdict_in(task, "place(top)", *facts[2:], "placed(roof)")
        assert detector.refuse_early(place, task.facts.of(*facts)) is None

    def test_what_is_taken_is_hit_on_its_way_up(self):
        """A part under the lip of another cannot be picked, though the hand gets there."""
        content = shelf()
        content["parts"]["lip"] = {
            "tool": "gripper",
            "boxes": [
                {"size_m": [0.06, 0.03, 0.01], "centre_m": [0.0, 0.0, 0.03]},
                {"size_m": [0.06, 0.01, 0.025], "centre_m": [0.0, 0.01, 0.0125]},
            ],
            "start_m": [0.6, -0.2],
            "goal_m": [0.4, -0.188],
        }
        facts = ("at_start(base)", "hand_free")
        verdict = verdict_of(content, "pick(base)", *facts, "placed(lip)")
        assert verdict.reason == "base runs into lip on the retreat"
        assert verdict_of(content, "pick(base)", *facts).is_feasible

    def test_a_fit_does_not_act_in_a_buffer(self):
        """A part that is put down 5 mm deep in the side of its partner runs into it."""
        content = shelf()
        content["buffers"] = {"bench": {"at_m": [0.5, 0.065]}}
        content["parts"]["top"] |= {
            "grasp": [{"closing_axis": axis} for axis in "xy"],
            "buffers": "bench",
            "fits": {"base": {"kind": "snap", "drawn_m": -0.006, "force_n": 25.0}},
        }
        facts = ("placed(base)", "held(top)", "grasp(top.top_x)")
        verdict = verdict_of(content, "place(top.bench)", *facts, check_arm=False)
        assert "top runs into base on the approach" in verdict.reason
        assert verdict_of(content, "place(top)", *facts, check_arm=False).is_feasible

    def test_parts_that_slide_along_each_other_only_touch(self):
        """Side by side without a gap, across the jaws."""
        content = shelf()
        content["parts"]["left"] = block([0.6, -0.25], [0.5, 0.04], [0.03, 0.04, 0.03])
        content["parts"]["top"]["goal_m"] = [0.5, 0.0]
        del content["parts"]["top"]["goal_on"]
        del content["parts"]["base"]
        facts = ("held(top)", "placed(left)")
        assert verdict_of(content, "place(top)", *facts).is_feasible
        content["parts"]["left"]["goal_m"] = [0.5, 0.039]
        assert verdict_of(content, "place(top)", *facts).is_infeasible
        assert verdict_of(content, "place(top)", *facts, tolerance_m=0.003).is_feasible


class TestSupport:
    def test_what_is_placed_needs_something_beneath_it(self):
        """The verdict names what could bear it, and rests on its absence."""
        verdict = verdict_of(shelf(), "place(top)", "held(top)")
        assert verdict.is_infeasible
        assert verdict.reason == "top has nothing beneath it"
        assert verdict.evidence == {"body": "top", "bodies": [], "possible_supports": ["base"]}
        assert "not placed(base)" in verdict.facts
        assert verdict_of(shelf(), "place(top)", "held(top)", "placed(base)").is_feasible

    def test_supports_are_not_looked_for_if_not_wanted(self):
        """An option."""
        assert verdict_of(shelf(), "place(top)", "held(top)").is_infeasible
        assert verdict_of(shelf(), "place(top)", "held(top)", check_support=False).is_feasible

    @pytest.mark.parametrize(("overhang_m", "tips"), [(0.029, False), (0.031, True)])
    def test_a_part_tips_once_its_centre_is_beyond_the_edge(self, overhang_m, tips):
        """The base ends 30 mm from its centre."""
        content = shelf()
        content["parts"]["top"]["goal_m"] = [0.5 + overhang_m, 0.0]
        verdict = verdict_of(content, "place(top)", "held(top)", "placed(base)")
        assert verdict.is_infeasible is tips
        if tips:
            assert verdict.reason == "top would tip off base"

    def test_a_screw_that_would_press_on_nothing_is_not_driven(self):
        """The part it goes through has to be there."""
        content = shelf()
        content["screws"] = {"screw": {"tool": "gripper", "hole_m": [0.5, 0.0], "through": "base"}}
        verdict = verdict_of(content, "fasten(screw)", "hand_free")
        assert verdict.reason == "screw has nothing beneath it"
        assert verdict_of(content, "fasten(screw)", "hand_free", "placed(base)").is_feasible


class TestTravel:
    def tower(self, **options):
        """Return the verdict on a travel past a tower, and on the same from the other side."""
        content = shelf()
        content["parts"]["tower"] = block([0.45, -0.12], [0.6, 0.3], [0.03, 0.03, 0.25])
        facts = ("held(base)", "at_start(tower)")
        return [
            verdict_of(content, "place(base)", *facts, place=place, **options)
            for place in ("base.start", "top.start")
        ]

    def test_what_is_taller_than_the_safe_height_is_gone_round(self):
        """With the path as evidence; where the arm comes from is one of the facts."""
        round_it, straight = self.tower()
        assert round_it.is_feasible
        assert straight.is_feasible
        assert straight.evidence == {}
        (travel,) = round_it.evidence["travels"]
        assert travel["around"] == ["tower"]
        assert travel["to"] == "base"
        assert len(travel["nodes_rad"]) > 2
        assert {"at(base.start)", "at_start(tower)"} <= set(round_it.facts)
        assert "at(top.start)" in straight.facts

    def test_a_way_that_is_not_found_within_the_budget_is_unknown(self):
        """Never infeasible."""
        verdict, _ = self.tower(travel_checks=3)
        assert verdict.status is VerdictStatus.UNKNOWN
        assert verdict.reason.startswith("base runs into tower on the straight travel, and no way")
        assert verdict.evidence["bodies"] == ["tower"]
        assert "at_start(tower)" in verdict.facts

    def test_what_stands_where_a_travel_ends_is_a_proof(self):
        """Hand and load are there however the arm gets to it."""
        content = shelf()
        content["parts"]["tower"] = block([0.5, -0.05], [0.6, 0.3], [0.03, 0.03, 0.25])
        facts = ("held(base)", "at_start(tower)")
        verdict = verdict_of(content, "place(base)", *facts)
        assert verdict.is_infeasible
        assert "runs into tower" in verdict.reason

    def test_where_nothing_is_tall_it_does_not_matter_where_the_arm_comes_from(self):
        """One verdict serves all places, so that few checks are made."""
        verdict = verdict_of(shelf(), "place(base)", "held(base)", "at_start(top)")
        assert not any(fact.startswith("at(") for fact in verdict.facts)


class TestLinks:
    def screened(self, size_m, **options):
        """Return the verdict on a place behind a screen."""
        content = shelf(robot={"home_m": [0.5, 0.02]})
        content["parts"]["screen"] = block([0.6, 0.3], [0.25, 0.0], size_m)
        return verdict_of(content, "place(base)", "held(base)", "placed(screen)", **options)

    @pytest.mark.slow(reason="plans past a wide screen; past a narrow one in every run")
    def test_the_arm_runs_into_what_stands_between_it_and_its_target(self):
        """No elbow leads past a wide screen before the base."""
        verdict = self.screened([0.04, 0.6, 0.55])
        assert verdict.is_infeasible
        assert verdict.reason.startswith("link ")
        assert " of the arm runs into screen on " in verdict.reason
        assert "placed(screen)" in verdict.facts

    def test_the_elbow_swings_past_a_narrow_one(self):
        """Round a pillar."""
        assert self.screened([0.04, 0.04, 0.55]).is_feasible

    def test_links_are_not_looked_at_if_not_wanted(self):
        """An option."""
        assert self.screened([0.04, 0.6, 0.55], check_arm=False).is_feasible


@pytest.fixture(scope="module")
def tall_shelf():
    """Return a shelf with towers that are moved, too."""
    content = shelf()
    content["parts"]["tower"] = block([0.45, -0.12], [0.6, 0.15], [0.03, 0.03, 0.25])
    content["parts"]["pole"] = block([0.5, 0.12], [0.6, -0.15], [0.03, 0.03, 0.3])
    return assembly(content)


class TestReuse:
    @pytest.mark.slow(reason="many states; travels among what is tall in every run")
    @settings(max_examples=examples(60))
    @given(data=st.data())
    def test_a_verdict_holds_in_every_state_that_agrees_on_its_facts(self, data, board):
        """Also in states that nothing leads to; the same reason and evidence, by a fresh one."""
        skill = data.draw(st.sampled_from(board.skills))
        state = data.draw(situations_of(board, skill))
        verdict = SweptDetector(board).check(skill, state).grounded(state, "swept")
        assert verdict.applies_in(state)
        other = data.draw(situations_of(board, skill, like=verdict))
        assert verdict.applies_in(other)
        assert SweptDetector(board).check(skill, other).grounded(other, "swept") == verdict

    @settings(max_examples=examples(25))
    @given(data=st.data())
    def test_so_does_one_on_travels_among_what_is_tall(self, data, tall_shelf):
        """Planned round what stands there, in any state that agrees on the bodies that it met."""
        skill = data.draw(st.sampled_from(tall_shelf.skills))
        state = data.draw(situations_of(tall_shelf, skill))
        verdict = SweptDetector(tall_shelf).check(skill, state).grounded(state, "swept")
        assert verdict.applies_in(state)
        other = data.draw(situations_of(tall_shelf, skill, like=verdict))
        assert verdict.applies_in(other)
        assert SweptDetector(tall_shelf).check(skill, other).grounded(other, "swept") == verdict

    def test_a_part_that_stands_elsewhere_is_not_asked_about(self, board):
        """Picking rests on the tool alone where nothing is near."""
        verdict = SweptDetector(board).check(board.skill("pick(clock)"), board.initial)
        assert verdict.is_feasible
        assert not any("pcb" in fact for fact in verdict.facts)


@st.composite
def situations_of(draw, task, skill, like=None):
    """Draw a state in which a skill is applicable, and that agrees on the facts of a verdict."""
    names = list(task.facts.names)
    groups = [list(group) for group in task.facts.exclusive]
    chosen = set()
    for group in groups:
        values = [fact for fact in group if like is not None and fact in like.present]
        required = [fact for fact in group if fact in skill.precondition.requires]
        free = [
            fact
            for fact in group
            if fact not in skill.precondition.forbids
            and not (like is not None and fact in like.absent)
        ]
        chosen.add(draw(st.sampled_from(values or required or free)))
    grouped = {fact for group in groups for fact in group}
    for fact in names:
        if fact in grouped or fact in skill.precondition.forbids:
            continue
        forced = fact in skill.precondition.requires or (like is not None and fact in like.present)
        barred = like is not None and fact in like.absent
        if forced or (not barred and draw(st.booleans())):
            chosen.add(fact)
    return task.facts.of(*chosen)


class TestTimes:
    def test_they_depend_on_where_the_arm_stands_and_on_nothing_else(self, board):
        """In any two reachable states that agree on place and tool."""
        detector = SweptDetector(board)
        model = SkillModel(make_feasibility(board))
        results = {}
        for state in reachable_states(model, 300):
            for skill in model.applicable(state):
                place, _ = board.scene.robots[0].place(state)
                tool = board.scene.robots[0].tool(state)
                key = (skill.name, place, tool.name)
                taken_s = detector.duration_s(skill, state)
                assert taken_s is not None
                assert 0.5 < taken_s < 20
                assert results.setdefault(key, taken_s) == taken_s
        fresh = SweptDetector(board)
        state = board.initial
        assert (
            fresh.duration_s(board.skill("pick(brace)"), state)
            == results[("pick(brace)", "at(home)", "gripper")]
        )

    def test_a_longer_way_takes_longer(self):
        """From beside the part or from far off."""
        task = assembly(shelf())
        detector = SweptDetector(task)
        taken_s = {}
        for place in ("base.start", "top.start", "home"):
            state = task.facts.of(f"at({place})", "tool(gripper)", "hand_free", "at_start(base)")
            taken_s[place] = detector.duration_s(task.skill("pick(base)"), state)
        assert taken_s["base.start"] < taken_s["home"] < taken_s["top.start"]

    def test_full_speed_is_faster(self):
        """The share of the limits is an option."""
        task = assembly(shelf())
        times_s = [
            SweptDetector(task, SweptDetector.Options(speed_fraction=share)).duration_s(
                task.skill("pick(base)"), task.initial
            )
            for share in (0.25, 0.5, 1.0)
        ]
        assert times_s == sorted(times_s, reverse=True)

    def test_what_the_arm_cannot_do_has_no_time(self):
        """The task's figure counts."""
        content = shelf()
        content["parts"]["base"]["goal_m"] = [0.83, 0.0]
        content["parts"]["top"]["goal_m"] = [0.83, 0.0]
        task = assembly(content)
        state = task.facts.of("at(home)", "tool(gripper)", "held(base)")
        assert SweptDetector(task).duration_s(task.skill("place(base)"), state) is None


class TestShapes:
    def test_a_cylinder_is_round(self, regrasped):
        """A drum fits where a square post of its width does not."""
        content = shelf()
        content["parts"]["post"] = block([0.6, -0.25], [0.52, 0.055], [0.02, 0.02, 0.05])
        content["parts"]["base"]["size_m"] = [0.07, 0.07, 0.02]
        content["parts"]["base"]["goal_m"] = [0.48, 0.02]
        del content["parts"]["top"]
        task = assembly(content)
        grasp = Grasp(GraspKind.SUCTION, (0.0, 0.0, 0.02))
        facts = ("held(base)", "placed(post)")
        task = regrasped(task, base=grasp)
        verdict = verdict_in(task, "place(base)", *facts)
        assert verdict.reason == "base runs into post on the approach"
        bodies = tuple(
            replace(body, shapes=(Cylinder(0.07, 0.02, (0.0, 0.0, 0.01)),))
            if body.name == "base"
            else body
            for body in task.scene.bodies
        )
        task = replace(task, scene=replace(task.scene, bodies=bodies))
        assert verdict_in(task, "place(base)", *facts).is_feasible


def test_a_task_without_an_arm_is_refused():
    """In words."""
    task = assembly(shelf())
    task = replace(task, scene=replace(task.scene, robots=()))
    detector = SweptDetector(task)
    assert detector.refuses() == "it models one arm, and the task 'shelf' has 0"
    assert detector.faults() == {}


@pytest.mark.slow(reason="searches the board by hulls; battery_module in every run")
def test_the_board_is_solved_with_it(board):
    """To the same optimum as with the chart, in the time that the arm takes."""
    result = solve(board, "exact", Setup(collision=("swept",)))
    assert result.status == "optimal"
    assert result.cost == pytest.approx(1.86709, abs=5e-6)
    assert [board.skills.index(board.skill(step.skill)) for step in result.steps] == [
        *(0, 1, 2, 3, 4, 5, 8, 9, 10, 11, 6, 7, 13, 14, 15)
    ]
    detector = SweptDetector(board)
    state, total_s = board.initial, 0.0
    for step in result.steps:
        skill = board.skill(step.skill)
        total_s += detector.duration_s(skill, state)
        state = skill.prediction.apply(state)
    assert result.makespan_s == pytest.approx(total_s)
