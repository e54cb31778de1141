"""A precedence relation from evidence."""

import itertools
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from situations import assembly, config_content, fake_back_end, small_assemblies
from skillplan.chart import Order, closure, derive_chart, find_order, reduction
from skillplan.checks import Feasibility
from skillplan.model import SkillModel, replay
from skillplan.pipeline import Setup, make_feasibility, solve
from skillplan.task import Task, Verdict
from thinned import release_case


def derived(task, detector="aabb"):
    return derive_chart(make_feasibility(task, Setup(collision=(detector,), with_chart=False)))


def pairs(chart):
    return {(relation.before, relation.after) for relation in chart.relations}


# Random pairs i < j, so that there is no cycle.
acyclic = st.lists(
    st.tuples(st.integers(0, 7), st.integers(0, 7)).filter(lambda pair: pair[0] < pair[1])
).map(lambda drawn: {(f"n{first}", f"n{other}") for first, other in drawn})


def paths(relation):
    """Return the pairs joined by a path, by Warshall's algorithm."""
    nodes = sorted({node for pair in relation for node in pair})
    joined = set(relation)
    for via, first, other in itertools.product(nodes, repeat=3):
        if (first, via) in joined and (via, other) in joined:
            joined.add((first, other))
    return joined


@given(acyclic)
def test_the_closure_holds_what_follows(relation):
    """Exactly the pairs joined by a path."""
    assert paths(relation) == closure(relation)
    assert closure(closure(relation)) == closure(relation)


@given(acyclic)
def test_the_reduction_is_the_least_relation_with_the_same_closure(relation):
    """Nothing can be left out of it, and nothing follows less."""
    reduced = reduction(relation)
    assert reduced <= relation
    assert closure(reduced) == closure(relation)
    for pair in reduced:
        assert closure(reduced - {pair}) != closure(relation)
    assert reduction(closure(relation)) == reduced


def test_geometry_alone_gives_the_board_its_hand_made_chart(board_task):
    """Nothing is missing, nothing is extra, nothing is impossible or open."""
    chart = derived(board_task)
    assert (chart.missing, chart.extra, chart.impossible) == ((), (), {})
    assert (chart.conditional, chart.undecided) == ({}, ())
    assert reduction(pairs(chart)) == reduction(chart.hand_made)
    assert closure(pairs(chart)) == closure(chart.hand_made)


def test_every_relation_comes_with_its_evidence(board_task):
    """The skill that fails, the stage, the facts, and the bodies."""
    relation = next(
        r for r in derived(board_task).relations if (r.before, r.after) == ("transformer", "brace")
    )
    assert relation.reason == "transformer runs into brace on the approach"
    assert relation.evidence["skill"] == "place(transformer)"
    assert relation.evidence["stage"] == "aabb"
    assert "placed(brace)" in relation.evidence["facts"]


def test_without_a_hand_made_chart_there_is_nothing_to_compare(board_task):
    """None, not an empty one."""
    chart = derived(board_task.replace(chart=()))
    assert (chart.hand_made, chart.missing, chart.extra) == (None, (), ())
    assert ("transformer", "brace") in pairs(chart)


def test_a_wrong_hand_made_chart_is_found_out():
    """A pair too few is extra in the derived one; a pair too many is missing from it."""
    content = config_content("inverter_board")
    content["chart"] = [
        {"before": "pcb", "after": ["switch_1", "switch_2", "clock", "transformer", "brace"]},
        {"before": "brace", "after": ["screw_1", "screw_2"]},
        {"before": "clock", "after": ["switch_1"]},
    ]
    chart = derived(assembly(content))
    assert chart.missing == (("clock", "switch_1"),)
    assert [(r.before, r.after) for r in chart.extra] == [("transformer", "brace")]


def without(content, part):
    """Take a part, and all that the file says of it, away."""
    del content["parts"][part]
    for key in ("actions", "observation", "expect"):
        content.pop(key)
    content["chart"] = []
    return content


def test_a_part_taken_away_takes_its_relations_along():
    """The others are as before."""
    full = pairs(derived(assembly({**config_content("inverter_board"), "chart": []})))
    rest = pairs(derived(assembly(without(config_content("inverter_board"), "transformer"))))
    assert {pair for pair in full if "transformer" not in pair} == rest


def test_a_part_moved_from_under_the_brace_is_free_of_it():
    """Beside the board's other parts it may come before or after the brace."""
    content = {**config_content("inverter_board"), "chart": []}
    before = pairs(derived(assembly(content)))
    content["parts"]["transformer"]["goal_m"] = [0.452, 0.050]
    after = pairs(derived(assembly(content)))
    assert before - after == {("transformer", "brace")}
    assert after <= before


def test_a_part_moved_under_the_brace_has_to_come_before_it():
    """A low one that the approach of the brace does not touch."""
    content = {**config_content("inverter_board"), "chart": []}
    del content["parts"]["transformer"]
    for key in ("actions", "observation", "expect"):
        content.pop(key)
    before = pairs(derived(assembly(content)))
    content["parts"]["clock"]["goal_m"] = [0.520, 0.0]
    assert pairs(derived(assembly(content))) - before == {("clock", "brace")}


def test_a_stack_is_taken_from_the_top():
    """What lies on another at the start is placed before it can be picked."""
    content = {**config_content("inverter_board"), "chart": []}
    before = pairs(derived(assembly(content)))
    clock = content["parts"]["clock"]
    del clock["start_m"]
    clock["start_on"] = "switch_2"
    assert pairs(derived(assembly(content))) - before == {("clock", "switch_2")}


def test_a_part_in_the_way_of_another_at_its_start_is_moved_first():
    """Without standing on it: a bridge over it in the tray."""
    content = {**config_content("inverter_board"), "chart": []}
    content["parts"]["clock"]["start_m"] = list(content["parts"]["brace"]["start_m"])
    chart = derived(assembly(content))
    assert ("brace", "clock") in pairs(chart)


def test_a_part_that_never_fits_is_impossible():
    """With the reason; nothing is derived from it."""
    content = {**config_content("inverter_board"), "chart": []}
    content["parts"]["clock"]["goal_on"] = None
    content["parts"]["clock"]["goal_m"] = [0.7, 0.3]
    content["parts"]["switch_1"]["goal_m"] = [0.7, -0.3]
    chart = derived(assembly(content))
    assert chart.impossible == {"place(switch_1)": "aabb: switch_1 has nothing beneath it"}


def test_two_supports_that_both_have_to_come_first_are_no_alternatives():
    """Either would bear the clock, but neither can be put beneath it afterwards."""
    content = {**config_content("inverter_board"), "chart": []}
    content["parts"]["clock"]["goal_on"] = "switch_1"
    content["parts"]["switch_1"] |= {"size_m": [0.022, 0.08, 0.02], "goal_m": [0.45, 0.03]}
    content["parts"]["switch_2"] |= {"size_m": [0.022, 0.08, 0.02], "goal_m": [0.472, 0.03]}
    content["parts"]["clock"] |= {"size_m": [0.04, 0.02, 0.015], "goal_m": [0.461, 0.03]}
    chart = derived(assembly(content))
    assert {("switch_1", "clock"), ("switch_2", "clock")} <= pairs(chart)
    assert chart.conditional == {}


def test_a_skill_that_needs_either_of_two_needs_neither_in_particular(lid_task):
    """That is no precedence relation, and is said."""
    facts = lid_task.facts

    def answer(skill, state):
        if skill.name != "place(lid)":
            return Verdict.feasible(facts.none, facts.none)
        for fact in ("placed(box)", "placed(fuse)"):
            if fact in state:
                return Verdict.feasible(facts.of(fact), facts.none)
        return Verdict.infeasible("nothing", facts.none, facts.of("placed(box)", "placed(fuse)"))

    chart = derive_chart(Feasibility(lid_task, [fake_back_end(lid_task, answer)]))
    assert chart.relations == ()
    assert chart.conditional == {"place(lid)": ("not placed(box)", "not placed(fuse)")}
    assert chart.undecided == ()


@given(small_assemblies())
def test_the_chart_detector_gives_back_the_chart(content):
    """What was drawn, and what lies on what at the start: no more and no less."""
    stacked = {
        (name, part["start_on"]) for name, part in content["parts"].items() if "start_on" in part
    }
    task = assembly(content)
    if task.chart:
        chart = derived(task, "precedence")
        assert (chart.missing, chart.impossible, chart.conditional) == ((), {}, {})
        assert closure(pairs(chart)) == closure(stacked | set(chart.hand_made))


def test_exactly_the_orders_that_respect_the_derived_relation_can_be_carried_out(board_task):
    """All 720 orders of the board's six parts."""
    relation = pairs(derived(board_task))
    feasibility = make_feasibility(board_task, Setup(collision=("aabb",), with_chart=False))
    parts = [name for name in board_task.operations if "screw" not in name]
    possible = 0
    for order in itertools.permutations(parts):
        when = {part: i for i, part in enumerate(order)}
        respects = all(
            when[first] < when[other] for first, other in relation if {first, other} <= set(when)
        )
        state, feasible = board_task.initial, True
        for part in order:
            for kind in ("pick", "place"):
                skill = board_task.skill(f"{kind}({part})")
                feasible = feasible and feasibility.verdict(skill, state).is_feasible
                state = skill.prediction.apply(state)
        assert respects == feasible
        possible += feasible
    assert possible == 60


@pytest.mark.parametrize(
    "name", ["inverter_board", release_case("motor_drive", reason="the smaller board in every run")]
)
def test_an_optimal_plan_respects_the_relation(name):
    """Derived from the same back ends that the plan was checked with."""
    task = assembly({**config_content(name), "chart": []})
    result = solve(task, "exact", Setup(collision=("aabb",)))
    names = [step.skill for step in result.steps]
    when = {
        element: next(
            i for i, name in enumerate(names) if name in (f"place({element})", f"fasten({element})")
        )
        for element in task.operations
    }
    relation = pairs(derived(task))
    assert relation
    for first, other in relation:
        assert when[first] < when[other]


def test_relations_on_a_circle_stay_and_the_circle_is_named():
    """A part that lies on what it is to be put under has no order."""
    content = config_content("inverter_board")
    content["parts"]["switch_1"].pop("start_m")
    content["parts"]["switch_1"]["start_on"] = "pcb"
    task = assembly(content)
    chart = derive_chart(make_feasibility(task, Setup(collision=("aabb",))))
    pairs = [(relation.before, relation.after) for relation in chart.relations]
    assert {("pcb", "switch_1"), ("switch_1", "pcb")} <= reduction(pairs)
    assert {"pcb", "switch_1"} == set(chart.cycle)
    assert chart.obstacle(task).startswith("pcb before switch_1 before pcb: ")


def test_unknown_is_no_relation(lid_task):
    """What a back end does not know is undecided."""
    facts = lid_task.facts

    def answer(skill, state):
        if skill.name == "place(lid)" and "placed(fuse)" in state:
            return Verdict.unknown("too slow")
        return Verdict.feasible(facts.none, facts.of("placed(fuse)") - state)

    chart = derive_chart(Feasibility(lid_task, [fake_back_end(lid_task, answer)]))
    assert chart.undecided == ("place(lid)",)
    assert all(relation.after != "lid" for relation in chart.relations)


# An order of all parts of a task, or the parts that are in none.


BY_BOXES = Setup(collision=("aabb",))
ROOM_M = 0.02


def part(size_m: list[float], goal_m: list[float], **more: Any) -> dict[str, Any]:
    return {"tool": "cup", "size_m": size_m, "goal_m": goal_m, "grasp": {"type": "suction"}, **more}


def garage(apart_m: float = 0.08) -> Task:
    """Return the task of two roofs on posts, with a car below both of them.

    Parameters
    ----------
    apart_m
        Half of the distance between the centres of the roofs, which are 0.1 m wide [m].
    """
    posts = {
        f"post_{side}": part(
            [0.02, 0.3, ROOM_M + 0.01], [0.5 + x, 0.0, 0.0], start_m=[0.3 + x, -0.3]
        )
        for side, x in (("left", -0.1), ("right", 0.1))
    }
    roofs = {
        f"roof_{side}": part(
            [0.2, 0.1, 0.01],
            [0.5, y, ROOM_M + 0.01],
            start_m=[0.2, 2 * y + 0.2],
            goal_on=list(posts),
        )
        for side, y in (("front", -apart_m), ("back", apart_m))
    }
    return assembly(
        {
            "kind": "assembly",
            "name": "garage",
            "robot": {"home_m": [0.3, 0.0], "safe_height_m": 0.25},
            "tools": {"cup": {"type": "suction", "holder_m": [0.7, 0.3]}},
            "initial_tool": "cup",
            "parts": posts
            | roofs
            | {"car": part([0.05, 0.2, ROOM_M], [0.5, 0.0, 0.0], start_m=[0.6, -0.3])},
            "step_limit": 30,
        }
    )


def order_of(task: Task) -> Order:
    needs = dict.fromkeys(("roof_front", "roof_back"), ("post_left", "post_right"))
    roofs_first = ("post_left", "post_right", "roof_front", "roof_back", "car")
    return find_order(task, make_feasibility(task, BY_BOXES), roofs_first, needs)


def test_a_part_that_two_others_cover_goes_in_before_both():
    """Neither of them alone is to blame, so no exchange of two parts helps."""
    task = garage()
    order = order_of(task)
    assert order.ended
    assert not order.conflicts
    assert set(order.parts[-2:]) == {"roof_front", "roof_back"}
    plan = replay(SkillModel(make_feasibility(task, BY_BOXES)), order.skills)
    assert plan.feasible
    assert plan.complete


def test_of_parts_that_shut_each_other_out_only_one_is_left_out():
    """Roofs that overlap meet, whichever comes first."""
    order = order_of(garage(apart_m=0.03))
    (name,) = order.conflicts
    assert name in ("roof_front", "roof_back")
    assert set(order.conflicts[name].by) == {"roof_front", "roof_back"} - {name}
    assert set(order.parts) == {"post_left", "post_right", "car", *order.conflicts[name].by}
    assert order.ended


def test_a_part_that_cannot_follow_a_known_order_is_left_out_and_none_of_that_order():
    task = garage(apart_m=0.03)
    known = ("post_left", "post_right", "car", "roof_back")
    listed = (*known, "roof_front")
    order = find_order(task, make_feasibility(task, BY_BOXES), listed, {}, kept=known)
    assert order.parts == known
    assert set(order.conflicts) == {"roof_front"}


def test_after_a_known_order_no_more_parts_are_left_out_than_need_be():
    """The car goes in before either roof, of which there is room for one."""
    task = garage()
    names = ("roof_front", "roof_back")
    both = task.facts.of("placed(roof_front)") | task.facts.of("placed(roof_back)")

    def answer(skill, state):
        for name in names:
            fact = f"placed({name})"
            if skill.kind == "place" and name not in skill.name and fact in state:
                there = task.facts.of(fact)
                return Verdict.infeasible(f"runs into {name}", there, task.facts.none)
        return Verdict.feasible(both & state, both - state)

    feasibility = Feasibility(task, [fake_back_end(task, answer)])
    known = ("post_left", "post_right")
    listed = (*known, "roof_front", "roof_back", "car")
    order = find_order(task, feasibility, listed, {}, kept=known)
    (name,) = order.conflicts
    assert order.parts == (*known, "car", *{*names} - {name})


def test_a_part_that_leans_on_another_goes_in_after_it_and_before_its_roof():
    """Both are absent where it falls, and with both of them it does not go in."""
    task = garage()
    post, roof = task.facts.of("placed(post_right)"), task.facts.of("placed(roof_front)")

    def answer(skill, state):
        if skill.name == "place(car)" and "placed(roof_front)" in state:
            return Verdict.infeasible("runs into roof_front", roof, task.facts.none)
        if skill.name == "place(car)" and "placed(post_right)" not in state:
            return Verdict.infeasible("falls", task.facts.none, post | roof)
        return Verdict.feasible(task.facts.none, (post | roof) - state)

    feasibility = Feasibility(task, [fake_back_end(task, answer)])
    order = find_order(task, feasibility, ("car", "roof_front"), {})
    assert order.ended
    assert not order.conflicts
    number = order.parts.index
    assert number("post_right") < number("car") < number("roof_front")
