"""What the tests build their situations from: small tasks, random assemblies, counting fakes."""

from __future__ import annotations

import copy
import math
import random
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path

from hypothesis import strategies as st

from skillplan.checks import Feasibility
from skillplan.collision import Detector
from skillplan.domains.assembly import AssemblyConfig, ground
from skillplan.files import parse
from skillplan.model import SkillModel
from skillplan.pipeline import Setup
from skillplan.solvers import Solver, Stop
from skillplan.task import (
    Case,
    Condition,
    ConstantCost,
    Facts,
    Metric,
    Outcome,
    Scene,
    Skill,
    State,
    Task,
    Verdict,
)

CONFIGS = Path(__file__).parents[2] / "configs"


# Tasks made by hand.


def make_skill(facts, name, *, requires=(), forbids=(), add=(), delete=(), cost=1.0, **more):
    """Return a skill without motion; `outcomes` as (probability, add, delete) where given."""
    outcomes = more.pop("outcomes", [(1.0, add, delete)])
    return Skill(
        name=name,
        kind=name.partition("(")[0],
        agents=("robot",),
        precondition=Condition(facts.of(*requires), facts.of(*forbids)),
        outcomes=tuple(Outcome(p, facts.of(*a), facts.of(*d)) for p, a, d in outcomes),
        cost=ConstantCost(cost),
        duration_s=ConstantCost(more.pop("duration_s", 1.0)),
        **more,
    )


def make_task(facts, skills, *, initial=(), goal=(), step_limit=20, **more):
    """Return a task without geometry."""
    return Task(
        name="made-by-hand",
        kind="assembly",
        facts=facts,
        skills=tuple(skills),
        initial=facts.of(*initial),
        goal=Condition(facts.of(*goal), facts.none),
        metric=Metric("effort", "J"),
        step_limit=step_limit,
        scene=more.pop("scene", Scene((), ())),
        **more,
    )


def two_roads_task(**changes):
    """Return a task with a cheap way of three skills and an expensive one of two."""
    facts = Facts(("a", "b", "done"))
    skills = [
        make_skill(facts, "to_a", forbids=("a", "b", "done"), add=("a",), cost=1.0),
        make_skill(facts, "a_to_b", requires=("a",), add=("b",), delete=("a",), cost=1.0),
        make_skill(facts, "to_b", forbids=("a", "b", "done"), add=("b",), cost=3.0),
        make_skill(facts, "finish", requires=("b",), add=("done",), delete=("b",), cost=1.0),
    ]
    return make_task(facts, skills, goal=("done",), **changes)


def retry_task(probability, cost=2.0):
    """Return a task whose only skill works with some probability and may be tried again."""
    facts = Facts(("done",))
    outcomes = [(probability, ("done",), ())]
    if probability < 1:
        outcomes.append((1 - probability, (), ()))
    skills = [make_skill(facts, "try", forbids=("done",), outcomes=outcomes, cost=cost)]
    return make_task(facts, skills, goal=("done",))


def two_places_task():
    """Return a task whose last skill succeeds in 1 of 10 tries at one place, in 9 at the other.

    The optimum goes to the other place first: 1 + 1 / 0.9.
    """
    facts = Facts(("at(a)", "at(b)", "done"), exclusive=(("at(a)", "at(b)"),))

    def case(place, probability):
        done = Outcome(probability, facts.of("done"), facts.none)
        return Case(
            facts.of(place), (done, Outcome(1 - probability, facts.none, facts.none)), facts.none
        )

    attempt = replace(
        make_skill(facts, "try", forbids=("done",)),
        outcomes=(),
        cases=(case("at(a)", 0.1), case("at(b)", 0.9)),
    )
    go = make_skill(facts, "go", requires=("at(a)",), add=("at(b)",), delete=("at(a)",))
    return make_task(facts, [attempt, go], initial=("at(a)",), goal=("done",), step_limit=100)


@st.composite
def small_tasks(draw):
    """Draw a task of a few facts and skills without any structure; many costs tie."""
    rng = random.Random(draw(st.integers(0, 2**32)))
    facts = Facts(tuple(f"f{i}" for i in range(draw(st.integers(4, 7)))))
    skills = []
    for i in range(draw(st.integers(6, 12))):
        # Mostly from a fact to one of the next, so that plans have some length.
        created = 1 + i % (len(facts) - 1)
        needed = {facts.names[created - 1 if rng.random() < 0.8 else max(0, created - 2)]}
        if rng.random() < 0.3:
            needed.add(rng.choice(facts.names))
        others = [name for name in facts.names if name not in needed | {facts.names[created]}]
        more = {
            "requires": needed - {facts.names[created]},
            "forbids": [name for name in others if rng.random() < 0.1],
            "add": [facts.names[created]],
            "delete": [name for name in facts.names[:created] if rng.random() < 0.25],
            "cost": rng.choice([0.0, 0.1, 0.2, 0.3, 1.0]),
        }
        skills.append(make_skill(facts, f"skill_{i}", **more))
    goal = {facts.names[-1], rng.choice(facts.names)}
    limit = draw(st.integers(2, 10))
    return make_task(facts, skills, initial=facts.names[:1], goal=goal, step_limit=limit)


# Assemblies.


def assembly(content, sha256=""):
    """Return the task of an assembly file's content."""
    return ground(AssemblyConfig.model_validate(content), sha256)


def fetching_board(
    height_m=0.0, *, beneath_m=None, wall_m=None, head_mm=(6.0, 2.0), envelope_m=None
):
    """Return the content of a plate with a screw from a feeder at [0.45, 0.25].

    Parameters
    ----------
    height_m
        Height of the feeder [m].
    beneath_m
        Height of a tray under the feeder [m]; None for no tray.
    wall_m
        Distance of a low wall from the middle of the feeder along x [m]; None for no wall.
    head_mm
        Diameter and height of the screw's head [mm].
    envelope_m
        Envelope of the screwdriver [m]; None for none.
    """
    block = {"tool": "gripper", "mass_kg": 0.2}

    def fixture(x_m, size_m):
        return {**block, "size_m": size_m, "start_m": [x_m, 0.25], "goal_m": [x_m, 0.25]}

    fixtures = {}
    if beneath_m is not None:
        fixtures["tray"] = fixture(0.45, [0.06, 0.06, beneath_m])
    if wall_m is not None:
        fixtures["wall"] = fixture(0.45 + wall_m + 0.005, [0.01, 0.06, 0.004])
    plate = {**block, "size_m": [0.1, 0.06, 0.01], "start_m": [0.4, -0.2], "goal_m": [0.5, 0.0]}
    driver = {"type": "screwdriver", "holder_m": [0.6, 0.25]}
    diameter_mm, head_height_mm = head_mm
    return {
        "kind": "assembly",
        "name": "fetching",
        "robot": {"home_m": [0.3, 0.0]},
        "tools": {
            "gripper": {"type": "gripper", "holder_m": [0.6, -0.25]},
            "screwdriver": driver | ({"envelope_m": envelope_m} if envelope_m else {}),
        },
        "initial_tool": "gripper",
        "feeders": {"magazine": {"position_m": [0.45, 0.25], "height_m": height_m}},
        "parts": {"plate": plate, **fixtures},
        "screws": {
            "screw": {
                "tool": "screwdriver",
                "hole_m": [0.52, 0.0],
                "through": "plate",
                "feeder": "magazine",
                "head_diameter_m": diameter_mm / 1000,
                "head_height_m": head_height_mm / 1000,
            }
        },
        "goal": ["placed(plate)", "fastened(screw)"],
    }


def config_content(name):
    """Return the content of a file in configs/, to be changed freely."""
    return copy.deepcopy(_parsed(name))


@cache
def _parsed(name):
    path = CONFIGS / f"{name}.yaml"
    return parse(path.read_text("utf-8"), str(path)).data


@st.composite
def small_assemblies(draw):
    """Draw the content of an assembly of 2 to 4 parts, in the plane, with a random chart."""
    rng = random.Random(draw(st.integers(0, 2**32)))
    count = draw(st.integers(2, 4))
    tools = [f"tool_{i}" for i in range(draw(st.integers(1, 3)))]
    style = draw(st.sampled_from(["swap", "separate"]))
    on_grid = draw(st.booleans())

    def where():
        if on_grid:
            # Few distinct places: many plans cost the same.
            return [0.3 + 0.1 * rng.randrange(3), 0.1 * rng.randrange(2)]
        return [round(rng.uniform(0.25, 0.7), 3), round(rng.uniform(-0.3, 0.3), 3)]

    parts = {}
    for i in range(count):
        part = {"tool": rng.choice(tools), "size_m": [0.02, 0.02, 0.02], "goal_m": where()}
        chance = rng.random()
        if i and chance < 0.15 and "feeder" not in parts["part_0"]:
            part["start_on"] = "part_0"
        elif chance > 0.85:
            part["feeder"] = "feeder"
        else:
            part["start_m"] = where()
        parts[f"part_{i}"] = part
    screws = {
        f"screw_{i}": {"tool": rng.choice(tools), "hole_m": where(), "through": "part_0"}
        for i in range(draw(st.integers(0, 1 if count == 4 else 2)))
    }
    elements = [*parts, *screws]
    rng.shuffle(elements)
    chart = [
        {"before": element, "after": [other]}
        for i, element in enumerate(elements)
        for other in elements[i + 1 :]
        if rng.random() < 0.25
    ]
    bare = draw(st.booleans())
    return {
        "kind": "assembly",
        "name": "random",
        "robot": {"home_m": where()},
        "tools": {tool: {"holder_m": where()} for tool in tools},
        "initial_tool": None if bare else rng.choice(tools),
        "tool_change": {"style": style, "reload": draw(st.booleans())},
        "feeders": {"feeder": {"position_m": where()}},
        "parts": parts,
        "screws": screws,
        "chart": chart,
        "step_limit": 2 * count + len(screws) + draw(st.integers(0, 6)),
    }


@st.composite
def crowded_assemblies(draw, odd_turns=True):
    """Draw the content of an assembly in which much collides: tall, turned, stacked and close.

    No care is taken that it can be built; what a verdict rests on must be right all the same.
    """
    rng = random.Random(draw(st.integers(0, 2**32)))
    style = draw(st.sampled_from(["swap", "separate"]))
    tall = draw(st.booleans())
    enveloped = draw(st.booleans())

    def where():
        return [round(rng.uniform(0.4, 0.52), 3), round(rng.uniform(-0.06, 0.06), 3)]

    tools = {}
    for i in range(draw(st.integers(1, 3))):
        tools[f"tool_{i}"] = {"holder_m": where(), "holder_height_m": rng.choice([0.0, 0.05])}
        if enveloped and rng.random() < 0.7:
            tools[f"tool_{i}"]["envelope_m"] = [0.06, 0.04, 0.1]
    parts = {}
    for i in range(draw(st.integers(2, 5))):
        height_m = rng.choice([0.2, 0.3] if tall and rng.random() < 0.4 else [0.01, 0.02, 0.04])
        part = {"tool": rng.choice(list(tools)), "goal_m": where()}
        if rng.random() < 0.3:
            part["boxes"] = [
                {"size_m": [0.06, 0.05, 0.004], "centre_m": [0.0, 0.0, height_m + 0.002]},
                {"size_m": [0.01, 0.05, height_m], "centre_m": [-0.025, 0.0, height_m / 2]},
                {"size_m": [0.01, 0.05, height_m], "centre_m": [0.025, 0.0, height_m / 2]},
            ]
        else:
            part["size_m"] = [rng.choice([0.02, 0.05]), rng.choice([0.02, 0.05]), height_m]
        chance = rng.random()
        below = f"part_{rng.randrange(i)}" if i else None
        if below and chance < 0.3 and "feeder" not in parts[below]:
            part["start_on"] = below
        elif chance > 0.8:
            part["feeder"] = "feeder"
        else:
            part["start_m"] = where()
        if below and rng.random() < 0.6:
            part["goal_on"] = below
            if rng.random() < 0.6:
                part["goal_m"] = list(parts[below]["goal_m"])
        for key in ("start_yaw_rad", "goal_yaw_rad"):
            part[key] = rng.choice([0.0, 0.0, math.pi / 2, 0.4 if odd_turns else math.pi])
        parts[f"part_{i}"] = part
    screws = {
        f"screw_{i}": {
            "tool": rng.choice(list(tools)),
            "hole_m": list(parts["part_0"]["goal_m"]),
            "through": "part_0",
            "feeder": rng.choice([None, "feeder"]),
        }
        for i in range(draw(st.integers(0, 2)))
    }
    names = [*parts, *screws]
    return {
        "kind": "assembly",
        "name": "crowded",
        "robot": {"home_m": [0.35, 0.0], "reach_m": rng.choice([0.855, 0.5])},
        "tools": tools,
        "initial_tool": rng.choice([None, *tools]),
        "tool_change": {"style": style, "reload": draw(st.booleans())},
        "feeders": {"feeder": {"position_m": where(), "height_m": 0.02}},
        "parts": parts,
        "screws": screws,
        "chart": [
            {"before": name, "after": [other]}
            for i, name in enumerate(names)
            for other in names[i + 1 :]
            if rng.random() < 0.3
        ],
        "step_limit": 50,
    }


def imagined_state(task, skill, rng, present=(), absent=()):
    """Return a random state that respects the exclusive groups and in which `skill` applies.

    Some facts may be wished present or absent. The arm stands somewhere and its hand is in
    some state, but nothing else ties facts together: most such states are out of reach. None
    where the wishes cannot be met.
    """
    facts = task.facts
    entries = {*present, *skill.precondition.requires}
    banned = {*absent, *skill.precondition.forbids}
    chosen = set(entries)
    grouped = {fact for group in facts.exclusive for fact in group}
    complete = [g for g in facts.exclusive if any(f.startswith(("at(", "tool(")) for f in g)]
    groups = list(facts.exclusive)
    rng.shuffle(groups)
    for group in groups:
        if any(fact in chosen for fact in group):
            continue
        taken = {f for other in facts.exclusive for f in other if set(other) & chosen}
        open_ones = [fact for fact in group if fact not in banned and fact not in taken]
        if open_ones and (group in complete or rng.random() < 0.8):
            chosen.add(rng.choice(open_ones))
    chosen |= {f for f in facts.names if f not in grouped | banned and rng.random() < 0.5}
    if chosen & banned:
        return None
    if any(sum(fact in chosen for fact in group) > 1 for group in facts.exclusive):
        return None
    if any(not any(fact in chosen for fact in group) for group in complete):
        return None
    return facts.of(*chosen)


# Fakes.


def fake_back_end(task, answer=None, *, name="fake", base=Detector, **attributes):
    """Return a back end that gives a fixed verdict, or what a function says, and counts.

    Like real ones, fakes of one kind, name and attributes are of one class.
    """
    key = (name, base, *sorted((key, repr(value)) for key, value in attributes.items()))
    if key not in _FAKES:
        _FAKES[key] = type("Fake", (base,), {"name": name, "check": _check, **attributes})
    created = _FAKES[key](task)
    created.asked = []
    created.answer = answer or Verdict.feasible(task.facts.none, task.facts.none)
    return created


def _check(self, skill, state):
    self.asked.append((skill.name, state))
    return self.answer(skill, state) if callable(self.answer) else self.answer


_FAKES = {}


@dataclass(frozen=True)
class FakeSetup(Setup):
    """A setup that asks the given back ends instead of installed ones."""

    make: object = field(default=lambda task: [])

    def back_ends(self, task, spare=None):
        """Return what was given."""
        return self.make(task)


def model_of(task, *back_ends):
    """Return the model of a task under the given back ends."""
    return SkillModel(Feasibility(task, back_ends))


def solver_that(act, name="fake"):
    """Return a solver whose `solve` is the function act(self, model)."""

    def solve(self, model, *, seed=0):
        return act(self, model)

    kind = type("FakeSolver", (Solver,), {"name": name, "solve": solve})
    return kind()


# References, independent of the solvers under test.


def graph_of(model, *, feasible_only=True):
    """Return the arrows (skill name, cost, next state) of every reachable state."""
    arrows = {}
    todo = [model.initial]
    while todo:
        state = todo.pop()
        if state in arrows:
            continue
        arrows[state] = []
        if model.is_goal(state):
            continue
        for skill in model.task.skills:
            if not skill.precondition.holds(state):
                continue
            if feasible_only and not model.verdict(state, skill).is_feasible:
                continue
            following = skill.prediction.apply(state)
            arrows[state].append((skill.name, skill.cost.at(state), following))
            todo.append(following)
    return arrows


def cheapest_by_length(model):
    """Return the least cost of a plan by its number of skills, up to the step limit.

    A dynamic program over (state, number of skills) that knows no bound and no dominance.
    """
    arrows = graph_of(model)
    layer = {model.initial: 0.0}
    minimum = {}
    for length in range(model.step_limit + 1):
        following = {}
        for state, cost in layer.items():
            if model.is_goal(state):
                minimum[length] = min(cost, minimum.get(length, math.inf))
                continue
            for _, step_cost, target in arrows[state]:
                total = cost + step_cost
                if total < following.get(target, math.inf):
                    following[target] = total
        layer = following
    return minimum


def optimum(by_length, tie=1e-10):
    """Return the least cost, and the least number of skills at that cost; None without a plan."""
    if not by_length:
        return None
    cost = min(by_length.values())
    return cost, min(length for length, value in by_length.items() if value <= cost + tie)


def costs_to_go(model):
    """Return the true least cost and number of skills from every reachable state to the goal.

    Bellman's equations on the explicit graph, by relaxation until nothing changes.
    """
    arrows = graph_of(model)
    cost = {state: 0.0 if model.is_goal(state) else math.inf for state in arrows}
    steps = dict(cost)
    changed = True
    while changed:
        changed = False
        for state, leaving in arrows.items():
            for _, step_cost, target in leaving:
                if step_cost + cost[target] < cost[state] - 1e-13:
                    cost[state] = step_cost + cost[target]
                    changed = True
                if 1 + steps[target] < steps[state]:
                    steps[state] = 1 + steps[target]
                    changed = True
    return arrows, cost, steps


def any_state(facts: Facts, bits: int) -> State:
    """Return a state from any integer."""
    return facts.state(bits & facts.all_bits)


class PatientStop(Stop):
    """Is interrupted at the n-th poll."""

    def __init__(self, polls):
        super().__init__()
        self.polls = polls

    def __call__(self):
        self.polls -= 1
        if self.polls <= 0:
            self.interrupt()
        return super().__call__()
