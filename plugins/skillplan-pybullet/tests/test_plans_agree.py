"""What holds of single skills holds of the whole plan: same contacts expected, same limits."""

import json
import random
import re
from pathlib import Path

import pytest
import yaml

from situations import assembly, config_content
from skillplan.checks import introduce
from skillplan.cli import main
from skillplan.domains.assembly import AssemblyConfig, BoardGenerator, draw_layouts, ground
from skillplan.pipeline import Setup, choose_variants, load_problem, solve
from skillplan_pybullet import PybulletEngine
from skillplan_simulation import ContactPairsDetector

PHYSICS = Setup(physics="pybullet", collision=("contact-pairs",))
FOLDER = Path(__file__).parents[3] / "configs"
TEXTS = {path.stem: path.read_text("utf-8") for path in sorted(FOLDER.glob("*.yaml"))}
CONFIGS = [name for name, text in TEXTS.items() if "\nkind: assembly\n" in text]


def content(parts, *, safe_height_m=0.15, **more):
    """Return a board of parts that jaws take, some of them from a feeder on the table."""
    return {
        "kind": "assembly",
        "name": "memory",
        "robot": {"home_m": [0.307, 0.0], "safe_height_m": safe_height_m},
        "tools": {"gripper": {"type": "gripper", "opening_m": 0.08, "holder_m": [0.6, -0.3]}},
        "initial_tool": "gripper",
        "feeders": {"chute": {"position_m": [0.4, -0.15]}},
        "parts": {name: {"tool": "gripper", **part} for name, part in parts.items()},
        "step_limit": 3 * len(parts),
        **more,
    }


def ram(goal_m, **more):
    """Return a module 8 mm thick of 10 g, from the feeder."""
    part = {"mass_kg": 0.01, "size_m": [0.012, 0.03, 0.008], "goal_m": goal_m}
    return {**part, "feeder": "chute", **more}


def memory(**more):
    """Return the content of two thin modules from a feeder at the height of the table."""
    return content({"ram_1": ram([0.5, 0.0]), "ram_2": ram([0.5, 0.06])}, **more)


def small_board(seed):
    """Return the content of three parts at random, thin or thick, from the feeder or the table."""
    draw = random.Random(seed)
    parts = {}
    for number in range(3):
        start = {"feeder": "chute"} if draw.random() < 0.5 else {"start_m": [0.35, 0.1 * number]}
        parts[f"part_{number + 1}"] = {
            "mass_kg": round(draw.uniform(0.005, 0.2), 3),
            "size_m": [round(draw.uniform(0.01, 0.05), 4) for _ in "xy"]
            + [round(draw.uniform(0.003, 0.03), 4)],
            "goal_m": [0.55, round(-0.1 + 0.1 * number + draw.uniform(-0.01, 0.01), 4)],
            **start,
        }
    safe_height_m = round(draw.uniform(0.06, 0.15), 3)
    return content(parts, safe_height_m=safe_height_m)


def generated(seed):
    """Return the content that `skillplan generate assembly` writes for four parts."""
    text = BoardGenerator(parts=4, density=0.5, tools=1 + seed % 2, seed=seed).text()
    safe_load = yaml.safe_load(text)
    del safe_load["reward"]
    return safe_load


def planned(task, result):
    """Return the skills of a result, each by the way that it takes."""
    skills = [task.skill(step.skill) for step in result.steps]
    return choose_variants(task, skills, (), [step.way for step in result.steps])


def named(task, names):
    """Return the skills of some names."""
    return [task.skill(name) for name in names]


def performed(task, skills, pairs=None, engine=None):
    """Execute a plan in one world, under the limits of a detector beside the engine."""
    pybullet_engine = PybulletEngine(task, engine)
    introduce([pybullet_engine, ContactPairsDetector(task, pairs)])
    return pybullet_engine.perform(skills)


def first_fault(task, skills, pairs=None, engine=None):
    """Return the first skill of a plan that is infeasible by itself, and why; or None."""
    created = introduce([ContactPairsDetector(task, pairs), PybulletEngine(task, engine)])
    state = task.initial
    for skill in skills:
        for back_end in created:
            verdict = back_end.check(skill, state)
            if not verdict.is_feasible:
                return skill.name, verdict.reason
        state = skill.prediction_in(state).apply(state)
    return None


def assert_proved_is_performed(task, setup=PHYSICS):
    """Whatever plan a search by physics proves ends at the goal in one continuous world."""
    result = solve(task, setup=setup)
    assert result.status == "optimal"
    created = introduce(setup.back_ends(task))
    failed = created[0].perform(planned(task, result)).failed
    assert failed is None, f"{failed.skill}: {failed.verdict.reason}"


@pytest.mark.slow(reason="a whole plan by physics; skills of plans in every run")
def test_a_thin_part_from_a_feeder_on_the_table_is_picked_in_a_whole_plan():
    """It rubs on the table once the feeder lets go of it, in a plan as by itself."""
    limits = {"contact-pairs": {"threshold_n": 0.001}}
    assert_proved_is_performed(assembly(memory(collision=limits)), Setup(physics="pybullet"))


@pytest.mark.slow(reason="executes two plans; a plan with jaws in every run")
@pytest.mark.parametrize("first", ["narrow", "wide"])
def test_jaws_are_ready_before_the_hand_comes_down(first):
    """However wide the part before was, and however low the hand travels."""
    parts = {
        "narrow": {"size_m": [0.01, 0.03, 0.03], "start_m": [0.36, 0.1], "goal_m": [0.4, -0.1]},
        "wide": {"size_m": [0.07, 0.075, 0.03], "start_m": [0.5, 0.1], "goal_m": [0.55, -0.1]},
    }
    order = [first, "wide" if first == "narrow" else "narrow"]
    task = assembly(content({name: parts[name] for name in order}, safe_height_m=0.04))
    plan = named(task, [f"{verb}({name})" for name in order for verb in ("pick", "place")])
    assert first_fault(task, plan) is None
    failed = performed(task, plan).failed
    assert failed is None, f"{failed.skill}: {failed.verdict.reason}"


@pytest.mark.slow(reason="four executions; a whole plan and its skills agree in every run")
def test_both_have_the_limits_of_the_detector(call, tmp_path):
    """Those of the file, and -O before them: a module is set down on what may not move at all."""
    limits = {"displacement_m": 1e-10}
    base = {"tool": "gripper", "mass_kg": 0.1, "size_m": [0.05, 0.08, 0.01]}
    count = memory(collision={"contact-pairs": limits}, physics={"pybullet": {}})
    count["parts"] = {
        "base": {**base, "start_m": [0.4, 0.1], "goal_m": [0.5, 0.0]},
        "ram": {**count["parts"]["ram_1"], "goal_on": "base"},
    }
    count["step_limit"] = 6
    file = tmp_path / "memory.yaml"
    file.write_text(yaml.safe_dump(count), "utf-8")
    plan = ["pick(base)", "place(base)", "pick(ram)", "place(ram)"]
    task = assembly(count)
    result = first_fault(task, named(task, plan), ContactPairsDetector.Options(**limits))
    assert result is not None
    message = r"base was pushed 0.0 mm aside on the .* at \d+\.\d\d s; the limit is 1e-07 mm"
    assert re.fullmatch(message, result[1])
    words = ("simulate", str(file), "--sequence", ",".join(plan), "--format", "json")
    code, document = call(*words)
    last = document["skills"][-1]
    assert (code, last["status"]) == (1, "infeasible")
    assert re.fullmatch(message, last["reason"])
    assert last["begin_s"] < last["evidence"]["at_s"] < last["end_s"]
    code, document = call(*words, "-O", "contact-pairs.displacement_m=0.001")
    assert (code, document["complete"]) == (0, True)


@pytest.mark.slow(reason="a search by physics and two plans; limits of a file in every run")
def test_a_result_is_simulated_with_the_limits_it_was_found_with(call, tmp_path):
    """A limit below what resting bodies tremble by: no skill by itself has one in its world."""
    created = memory()
    created["parts"]["ram_1"]["goal_m"], created["parts"]["ram_2"]["goal_m"] = (
        [0.3, 0.3],
        [0.6, 0.1],
    )
    file, out = tmp_path / "memory.yaml", tmp_path / "out"
    file.write_text(yaml.safe_dump(created), "utf-8")
    chosen = ("--physics", "pybullet", "--collision", "contact-pairs", "--no-cache")
    limit = "contact-pairs.displacement_m"
    words = ("search-optimal", str(file), *chosen, "-O", f"{limit}=1e-10", "--out", str(out))
    code, document = call(*words, "--format", "json")
    assert (code, document["status"]) == (0, "optimal")
    code, document = call("simulate", str(out), "--format", "json")
    assert code == 1
    assert document["skills"][-1]["reason"].endswith("the limit is 1e-07 mm")
    code, _ = call("simulate", str(out), "-O", f"{limit}=0.001", "--format", "json")
    assert code == 0


@pytest.mark.slow(reason="executes until it collides; a whole plan in every run")
def test_a_collision_names_force_instant_and_limit(call, tmp_path):
    """In simulate and in explain: a finger comes down on the part beside."""
    file = tmp_path / "memory.yaml"
    created = memory()
    for name, goal_m in (("ram_1", [0.5, 0.0]), ("ram_2", [0.516, 0.0])):
        created["parts"][name] |= {"size_m": [0.012, 0.03, 0.02], "goal_m": goal_m}
    file.write_text(yaml.safe_dump(created), "utf-8")
    done = "pick(ram_1),place(ram_1),pick(ram_2)"
    physics = ("--physics", "pybullet", "--format", "json")
    code, document = call("simulate", str(file), "--sequence", f"{done},place(ram_2)", *physics)
    last = document["skills"][-1]
    assert (code, last["skill"]) == (1, "place(ram_2)")
    force_n, at_s = last["evidence"]["force_n"], last["evidence"]["at_s"]
    message = f" with {force_n:.3g} N on the approach to ram_2 at {at_s:.2f} s; the limit is 0.05 N"
    assert last["reason"].endswith(message)
    words = ("explain", str(file), "place(ram_2)", "--after", done, "--no-cache")
    code, document = call(*words, "--collision", "contact-pairs", *physics)
    assert code == 1
    assert re.search(
        r" N on the approach to ram_2 at \d\.\d\d s; the limit is 0.05 N", str(document)
    )


@pytest.mark.slow(reason="three skills of a larger board, twice")
def test_what_came_to_rest_within_tolerance_is_no_fault_of_a_later_skill():
    """A switch 6 mm below its goal is allowed here, and is not moved by what follows."""
    task = assembly(config_content("inverter_board"))
    lenient = PybulletEngine.Options(position_tolerance_m=0.01)
    plan = named(task, ["pick(switch_1)", "place(switch_1)", "pick(clock)"])
    assert first_fault(task, plan, engine=lenient) is None
    failed = performed(task, plan, engine=lenient).failed
    assert failed is None, f"{failed.skill}: {failed.verdict.reason}"


@pytest.mark.slow(reason="a search and a plan each; a board of two parts in every run")
@pytest.mark.parametrize("seed", [0])
@pytest.mark.parametrize("board", [small_board, generated])
def test_what_a_search_proves_is_performed(board, seed):
    """Parts by jaws from feeder and table; boards of `skillplan generate assembly`."""
    assert_proved_is_performed(assembly(board(seed)))


@pytest.mark.release(reason="50 searches by physics and their plans")
@pytest.mark.parametrize("seed", range(25))
@pytest.mark.parametrize("board", [small_board, generated])
def test_what_a_search_proves_is_performed_on_50_boards(board, seed):
    """As above, with other seeds."""
    assert_proved_is_performed(assembly(board(100 + seed)))


@pytest.mark.release(reason="the plan of every shipped board, skill by skill and at once")
@pytest.mark.parametrize("name", CONFIGS)
def test_the_plan_of_a_shipped_board_that_holds_singly_is_performed(name):
    """The chart's optimum, each skill of which physics finds feasible."""
    task = load_problem(FOLDER / f"{name}.yaml").task
    solver = ("value-iteration",) if name == "inverter_grasps" else ()
    plan = planned(task, solve(task, *solver))
    assert first_fault(task, plan) is None
    failed = performed(task, plan).failed
    assert failed is None, f"{failed.skill}: {failed.verdict.reason}"


@pytest.mark.release(reason="plans of layouts, skill by skill and at once")
@pytest.mark.parametrize("index", range(5))
@pytest.mark.parametrize("name", [name for name in CONFIGS if "\nfamily:" in TEXTS[name]])
def test_the_plan_of_a_layout_that_holds_singly_is_performed(name, index):
    """Of every family that the shipped boards describe."""
    config = AssemblyConfig.model_validate(config_content(name))
    task = ground(draw_layouts(config, 1, index + 1)[index], "")
    plan = planned(task, solve(task))
    failed = performed(task, plan).failed
    assert failed is None or first_fault(task, plan) is not None, failed


@pytest.fixture
def call(capfd, tmp_path, monkeypatch):
    """Return what runs a command and gives exit code and document."""
    monkeypatch.setenv("SKILLPLAN_CACHE_DIR", str(tmp_path / "cache"))

    def run(*words):
        capfd.readouterr()
        with pytest.raises(SystemExit) as ended:
            main(words)
        return ended.value.code, json.loads(capfd.readouterr().out)

    return run
