"""Grasps that fail with a declared probability: two outcomes of a pick, and what they cost."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest

from situations import assembly, config_content
from skillplan.chart import derive_chart
from skillplan.domains.assembly import AssemblyConfig, AssemblyDomain
from skillplan.errors import TaskError
from skillplan.model import evaluate_policy
from skillplan.pipeline import Setup, load_problem, make_feasibility, make_model, solve
from skillplan.task import Task
from skillplan.testing import DomainSuite, lid_content, reachable_states

CONFIGS = Path(__file__).parents[3] / "configs"
FAILURE = 0.25
LOOK = [0.35, 0.05]


def content_of(look: bool = True, failure: float = FAILURE) -> dict[str, Any]:
    """Return the content of the lid task whose fuse may slip."""
    content = lid_content()
    content["parts"]["fuse"]["grasp_failure"] = failure
    if look:
        content["robot"]["look_m"] = LOOK
    return content


def chancy(look: bool = True, failure: float = FAILURE) -> Task:
    return assembly(content_of(look, failure))


class TestAssemblyDomainUnderChance(DomainSuite):
    domain = "assembly"
    content = content_of()


class TestAssemblyDomainOnTheInverterWhoseGraspsFail(DomainSuite):
    domain = "assembly"
    content = config_content("inverter_grasps")


class TestPick:
    def test_it_has_two_outcomes_the_nominal_first(self):
        """As declared; what no probability is given for is certain."""
        task = chancy()
        assert [1 - FAILURE, FAILURE] == [o.probability for o in task.skill("pick(fuse)").outcomes]
        others = [skill for skill in task.skills if skill.name != "pick(fuse)"]
        assert all(skill.deterministic for skill in others)
        assert not task.deterministic
        assert chancy(failure=0.0).deterministic

    def test_its_prediction_is_that_of_a_grasp_that_cannot_fail(self):
        """Back ends judge the nominal outcome, in which the part is held."""
        sure = assembly(lid_content()).skill("pick(fuse)")
        prediction = chancy(look=False).skill("pick(fuse)").prediction
        assert (set(sure.prediction.add), set(sure.prediction.delete)) == (
            set(prediction.add),
            set(prediction.delete),
        )

    @pytest.mark.parametrize("look", [False, True])
    def test_a_failed_one_changes_nothing_but_where_the_arm_stands(self, look):
        """Over the part, or where it looks for the part; the hand is free, the part lies there."""
        task = chancy(look)
        pick = task.skill("pick(fuse)")
        before = task.skill("load(screwdriver)").prediction.apply(task.initial)
        before = task.skill("load(gripper)").prediction.apply(before)
        after = pick.outcomes[1].apply(before)
        stands = "at(fuse.missed)" if look else "at(fuse.start)"
        assert {stands} == set(after - before)
        assert {"at(gripper.holder)", "changed_tool"} == set(before - after)
        assert pick.applicable(after)

    def test_trying_again_over_the_part_costs_no_way(self):
        """Where the arm has no place to look from, a miss takes time alone."""
        task = chancy(look=False)
        pick = task.skill("pick(fuse)")
        missed = pick.outcomes[1].apply(task.initial)
        assert (0.0, 3.0) == (pick.cost.at(missed), pick.duration_s.at(missed))

    def test_the_way_to_look_and_back_counts(self):
        """Whatever is done next pays for the way to where the arm looks, and from there on."""
        task = chancy()
        pick = task.skill("pick(fuse)")
        missed = pick.outcomes[1].apply(task.initial)
        away_m = math.dist(LOOK, (0.4, 0.2))
        assert pick.cost.at(missed) == pytest.approx(2 * away_m)
        assert pick.duration_s.at(missed) == pytest.approx(3.0 + 2 * away_m / 0.25)
        other = task.skill("pick(box)")
        assert other.cost.at(missed) == pytest.approx(away_m + math.dist(LOOK, (0.4, -0.2)))

    def test_the_arm_stands_where_it_looks(self):
        """At safe height, so that back ends know where it starts from."""
        task = chancy()
        missed = task.skill("pick(fuse)").outcomes[1].apply(task.initial)
        assert ("at(fuse.missed)", (*LOOK, 0.15)) == task.scene.robots[0].place(missed)

    def test_a_file_without_chance_has_no_place_to_look_from(self):
        """The vocabulary is as it was."""
        assert chancy(failure=0.0).facts == assembly(lid_content()).facts

    def test_a_part_that_slips_may_come_from_a_feeder(self):
        """The arm then stays there."""
        content = content_of(look=False)
        content["feeders"] = {"box_of_fuses": {"position_m": [0.4, 0.2]}}
        content["parts"]["fuse"] |= {"feeder": "box_of_fuses", "start_m": None}
        task = assembly(content)
        missed = task.skill("pick(fuse)").outcomes[1].apply(task.initial)
        assert "at(box_of_fuses)" in missed
        assert "at_start(fuse)" in missed


class TestBadInput:
    @pytest.mark.parametrize("failure", ["1.0", "1", "-0.1", "2", ".nan", "often"])
    def test_a_probability_is_below_1(self, tmp_path, failure):
        """One clear line, with its place; a grasp that always fails is no grasp."""
        path = tmp_path / "board.yaml"
        text = (CONFIGS / "inverter_grasps.yaml").read_text("utf-8")
        path.write_text(text.replace("grasp_failure: 0.30", f"grasp_failure: {failure}"), "utf-8")
        with pytest.raises(TaskError) as caught:
            load_problem(path)
        (line,) = str(caught.value).splitlines()
        assert "parts.clock.grasp_failure" in line

    def test_the_place_to_look_from_is_within_reach(self, tmp_path):
        """Else the arm would not come back."""
        path = tmp_path / "board.yaml"
        text = (CONFIGS / "inverter_grasps.yaml").read_text("utf-8")
        path.write_text(text.replace("look_m: [0.307, 0.000]", "look_m: [0.9, 0.0]"), "utf-8")
        with pytest.raises(TaskError, match=r"robot\.look_m: out of reach"):
            load_problem(path)


class TestSolving:
    def test_value_iteration_is_chosen(self):
        """Only where something may fail."""
        domain = AssemblyDomain()
        for failure, chosen in ((FAILURE, "value-iteration"), (0.0, "exact")):
            content = content_of(failure=failure)
            solver = domain.default_solver(AssemblyConfig.model_validate(content))
            assert solve(assembly(content), solver).trace["choice"].startswith(chosen)

    @pytest.mark.parametrize("solver", ["exact", "exhaustive"])
    def test_searches_for_a_sequence_refuse_and_name_it(self, solver):
        """A sequence says nothing of what to do after a miss."""
        result = solve(chancy(), solver)
        assert result.status == "refused"
        assert "under chance take value-iteration" in result.reason

    def test_the_expected_cost_is_that_of_trying_again(self):
        """Where one part may slip and nothing is nearer to the place to look from."""
        result = solve(chancy(), "value-iteration")
        sure = solve(assembly(lid_content()))
        assert sure.cost is not None
        again_m = 2 * math.dist(LOOK, (0.4, 0.2)) * FAILURE / (1 - FAILURE)
        assert result.status == "optimal"
        assert result.cost == pytest.approx(sure.cost + again_m)

    def test_a_miss_over_the_part_costs_time_and_no_way(self):
        """One try more in three, at three seconds."""
        result = solve(chancy(look=False), "value-iteration")
        sure = solve(assembly(lid_content()))
        assert sure.makespan_s is not None
        assert result.cost == pytest.approx(sure.cost)
        assert result.makespan_s == pytest.approx(sure.makespan_s + 3.0 * FAILURE / (1 - FAILURE))

    def test_the_chart_is_that_of_the_board(self):
        """What may stand before what does not depend on chance."""
        setup = Setup(collision=("aabb",))
        charts = [
            derive_chart(make_feasibility(load_problem(CONFIGS / f"{name}.yaml").task, setup))
            for name in ("inverter_board", "inverter_grasps")
        ]
        pairs = [{(r.before, r.after) for r in chart.relations} for chart in charts]
        assert pairs[0] == pairs[1]
        assert ((), ()) == (charts[1].missing, charts[1].extra)


class TestTheInverterWhoseGraspsFail:
    def test_a_miss_changes_what_is_best_to_do_next(self):
        """In some states another part is taken before the one that slipped."""
        task = load_problem(CONFIGS / "inverter_grasps.yaml").task
        policy = solve(task, "value-iteration").policy
        assert policy is not None
        model = make_model(task)
        missed = [
            (state, fact.removeprefix("at(").removesuffix(".missed)"))
            for state in reachable_states(model)
            for fact in state
            if fact.endswith(".missed)") and state in policy
        ]
        other = [s for s, part in missed if policy[s].name != f"pick({part})"]
        assert (84, 41) == (len(missed), len(other))

    def test_the_order_of_the_board_with_tries_until_it_works_is_worse(self):
        """By two and a half percent."""
        task = load_problem(CONFIGS / "inverter_grasps.yaml").task
        order = [
            step.skill for step in solve(load_problem(CONFIGS / "inverter_board.yaml").task).steps
        ]
        done = [task.skill(name).prediction.add for name in order]
        gone = [f"at_start({name[5:-1]})" if name.startswith("pick") else None for name in order]

        def choose(state: Any) -> Any:
            for name, added, start in zip(order, done, gone, strict=True):
                lasting = [f for f in added if f.startswith(("placed", "fastened", "tool"))]
                if start in state if start else any(fact not in state for fact in lasting):
                    return task.skill(name)
            raise AssertionError("The goal is reached before.")

        assert "2.27825" == f"{evaluate_policy(make_model(task), choose).cost:.5f}"
