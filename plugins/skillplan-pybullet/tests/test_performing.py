"""Whole plans in one continuous world, and pictures of it."""

from __future__ import annotations

import math

import pytest

from board_situations import BOARD, OPTIMAL, state_after
from situations import assembly
from skillplan.physics import HEIGHT, WIDTH
from skillplan.pipeline import choose_variants, load_problem
from skillplan.testing import lid_content
from skillplan_pybullet import PybulletEngine, SimulationSettings
from skillplan_simulation import PlannedPaths
from thinned import slow_case
from way_boards import pin_content


@pytest.fixture(scope="module")
def task():
    return load_problem(BOARD).task


def plate():
    """Return the task of a plate with one screw, and all that there is to do."""
    content = lid_content()
    lid = content["parts"]["lid"] | {"start_m": [0.45, -0.15]}
    del lid["goal_on"]
    content["parts"] = {"lid": lid}
    content["chart"] = [{"before": "lid", "after": ["screw"]}]
    task = assembly(content)
    names = ("pick(lid)", "place(lid)", "load(screwdriver)", "fasten(screw)")
    return task, [task.skill(name) for name in names], {"lid", "screw"}


def board():
    """Return the paper's board, and its optimum."""
    task = load_problem(BOARD).task
    return task, [task.skills[action] for action in OPTIMAL], set(task.operations)


@pytest.fixture(
    scope="module",
    params=[plate, slow_case(board, reason="15 skills; a plan of four in every run")],
    ids=lambda document: document.__name__,
)
def performance(request):
    """A plan that was executed, its bodies, what was found, and the trace."""
    task, plan, bodies = request.param()
    samples = []
    perform = PybulletEngine(task).perform(plan, note=samples.append)
    return [skill.name for skill in plan], bodies, perform, samples


@pytest.mark.slow(reason="executes a whole plan; single skills are executed in every run")
def test_the_optimum_is_executed_without_a_break(performance):
    plan, _, result, _ = performance
    assert result.failed is None
    assert [skill.skill for skill in result.skills] == plan


def test_every_part_arrives_within_half_a_millimetre_and_one_and_a_half_degrees(performance):
    _, bodies, result, _ = performance
    assert {item.body for item in result.arrivals} == bodies
    for arrival in result.arrivals:
        assert arrival.offset_m < 0.0005, arrival
        assert arrival.tilt_rad < math.radians(1.5), arrival


def test_every_screw_is_pressed_with_three_newtons_at_least(performance):
    _, bodies, result, _ = performance
    forces = [
        skill.verdict.evidence["sensed"]["fastening_force_n"]
        for skill in result.skills
        if skill.skill.startswith("fasten")
    ]
    assert len(forces) == sum(body.startswith("screw") for body in bodies)
    assert min(forces) >= 3.0


def test_the_trace_has_sixty_rows_a_second_and_touches_nothing_unexpected(performance):
    *_, result, samples = performance
    assert len(samples) == pytest.approx(60 * result.simulated_s, abs=2)
    assert max(sample.contact_n for sample in samples) < 0.05
    times = [sample.time_s for sample in samples]
    assert times == sorted(times)


def test_the_hand_acts_for_the_dwells_of_the_task(performance):
    """Dwells are counted to a frame; at rest nothing is simulated, and nothing moves."""
    plan, _, result, samples = performance
    tip = {round(60 * sample.time_s): sample.tip for sample in samples}
    kinds = {"pick": 3.0, "place": 3.0, "load": 5.0, "fasten": 8.0}
    if "place(pcb)" in plan:
        kinds["load"] = 10.0
    for skill in result.skills:
        kind = skill.skill.partition("(")[0]
        dwells_s = kinds[kind] + (5.0 if kind == "load" else 0.0)
        assert skill.acting_s == pytest.approx(dwells_s, abs=2 / 60), skill.skill
        frames = range(round(60 * skill.begin_s) + 1, round(60 * skill.end_s) - 1)
        still = sum(tip[frame] == tip[frame + 1] for frame in frames)
        assert 60 * (dwells_s - 2.5) < still < 60 * dwells_s
    assert result.simulated_s - result.held_s == pytest.approx(result.steps / 240)


@pytest.mark.slow(reason="executes a wrong plan; a part that ends below its goal in every run")
def test_a_plan_ends_at_the_first_skill_that_fails_or_goes_on_without_its_part(task):
    names = ["pick(switch_1)", "place(switch_1)", "pick(pcb)", "place(pcb)", "fasten(screw_1)"]
    wrong = [task.skill(name) for name in names]
    perform = PybulletEngine(task).perform(wrong[:3])
    assert [skill.skill for skill in perform.skills] == names[:2]
    assert perform.failed is not None
    assert "6.0 mm below its goal" in perform.failed.verdict.reason
    going_on = PybulletEngine(task).perform(wrong, keeps_going=True)
    assert going_on.taken_away == ("switch_1",)
    offsets_m = {arrival.body: arrival.offset_m for arrival in going_on.arrivals}
    assert offsets_m["pcb"] < 5e-4
    assert "switch_1" not in offsets_m
    is_feasible = [skill.verdict.is_feasible for skill in going_on.skills]
    assert is_feasible == [True, False, True, True, False]
    assert going_on.skills[4].verdict.reason.startswith("needs ")


@pytest.mark.slow(reason="five skills executed before; the first skill that fails in every run")
def test_a_plan_that_collides_ends_there(task):
    wrong = [task.skills[action] for action in (0, 1, 10, 11, 8, 9)]
    perform = PybulletEngine(task).perform(wrong)
    assert perform.failed is not None
    assert perform.failed.skill == "place(transformer)"


@pytest.mark.slow(reason="an execution; the plan that ends at the first failure in every run")
def test_it_stops_after_the_skill_under_way(task):
    perform = PybulletEngine(task).perform([task.skills[a] for a in OPTIMAL], stopped=lambda: True)
    assert [skill.skill for skill in perform.skills] == ["pick(pcb)"]


@pytest.mark.slow(
    reason="renders a skill in the simulation; every run shows the end of a feasible skill"
)
def test_the_moment_of_a_collision_shows_the_culprits_in_red(task):
    engine = PybulletEngine(task)
    image = engine.picture(task.skill("place(transformer)"), state_after(task, (0, 1, 10, 11, 8)))
    assert (image.width, image.height) == (WIDTH, HEIGHT)
    assert red_pixels(image) > 1000


@pytest.mark.slow(reason="executes and draws; the drawing of a collision is in every run")
def test_the_end_of_a_feasible_skill_shows_nothing_in_red(task):
    image = PybulletEngine(task).picture(task.skill("pick(brace)"), task.initial)
    assert red_pixels(image) == 0


@pytest.mark.slow(reason="renders a skill in the simulation; every run renders its end")
def test_footage_shows_the_whole_skill(task):
    images = list(PybulletEngine(task).footage(task.skill("pick(clock)"), task.initial, 2.0))
    assert 4 <= len(images) <= 8
    assert len({image.rgb for image in images}) == len(images)


def red_pixels(image) -> int:
    """Return how many pixels are of the colour of alarm."""
    pixels = zip(image.rgb[0::3], image.rgb[1::3], image.rgb[2::3], strict=True)
    return sum(red > 130 and green < 50 and blue < 50 for red, green, blue in pixels)


def test_the_trace_shows_what_presses_on_what_and_where(performance):
    """A screw that is driven bears on what it is driven into, from above."""
    _, _, result, samples = performance
    driven = next(skill for skill in result.skills if skill.skill.startswith("fasten"))
    touching = [
        contact
        for sample in samples
        if driven.begin_s <= sample.time_s <= driven.end_s
        for contact in sample.contacts
        if any(body.startswith("screw") for body in contact.bodies)
    ]
    strongest = max(touching, key=lambda contact: abs(contact.force_n[2]))
    assert abs(strongest.force_n[2]) >= 3.0
    screw = next(body for body in strongest.bodies if body.startswith("screw"))
    at = next(arrival.goal.position for arrival in result.arrivals if arrival.body == screw)
    assert math.dist(strongest.position[:2], at[:2]) < 0.02


# A plan with several grasps to choose from, executed by the one that is granted.


GRANTED = "grasp top closing along x"


def test_pick_and_place_by_one_grasp_have_the_hand_turned_alike():
    """And each grasp has a turn of its own."""
    task = assembly(pin_content())
    paths = PlannedPaths(task, SimulationSettings())
    pick, place = task.skill("pick(pin)"), task.skill("place(pin)")
    for taken, left in zip(pick.ways, place.ways, strict=True):
        rotations = []
        for skill, way in ((pick, taken), (place, left)):
            state = skill.precondition.requires | task.facts.of("at(home)")
            (motion,) = paths.of(skill.by(way), state).motions
            rotations.append(motion.rotation)
        assert rotations[0] == pytest.approx(rotations[1], abs=1e-9)


@pytest.mark.slow(reason="executes four skills; the turns of the hand in every run")
def test_the_grasp_that_is_free_at_the_goal_is_performed():
    """By the other, a finger would meet the wall."""
    task = assembly(pin_content())
    engine = PybulletEngine(task)
    plan = ["pick(wall)", "place(wall)", "pick(pin)", "place(pin)"]
    named = [None, None, GRANTED, GRANTED]
    skills = choose_variants(task, [task.skill(name) for name in plan], [engine], named)
    perform = engine.perform(skills)
    assert perform.failed is None
    assert perform.skills[-1].skill == f"place(pin) {GRANTED}"
    assert all(arrival.offset_m < 5e-4 for arrival in perform.arrivals)
