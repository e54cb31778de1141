"""Which way a skill takes: in plans, in explanations, and in what is executed."""

import csv

import pytest
import yaml

from way_boards import drawer_content

JSON = ("--format", "json")
AABB = ("--collision", "aabb")
LEFT_FIRST = "0,1,4,5,2,3"

# Pretends to move bodies, and refuses one way of the drawer.
PUPPET = """
    from skillplan import Engine, Verdict
    from skillplan.physics.performance import PerformedSkill, Performance, Performer, Sample

    class Puppet(Engine, Performer):
        '''Move bodies by pretending.'''

        name = "puppet"

        def check(self, skill, state):
            none = state.facts.none
            if skill.name.endswith("+x"):
                return Verdict.infeasible("jams", none, none)
            return Verdict.feasible(none, none)

        def picture(self, skill, state):
            raise ValueError("there is nothing to be seen")

        def footage(self, skill, state, frames_per_s):
            return iter(())

        def perform(self, skills, *, note=None, **rest):
            done = []
            for index, skill in enumerate(skills):
                place = (0, 0, 0)
                sample = Sample(index, skill.name, "", place, place, (0.0,) * 7, 0.0, 0.0, {})
                if note is not None:
                    note(sample)
                verdict = Verdict.feasible(self.task.facts.none, self.task.facts.none)
                done.append(PerformedSkill(skill.name, verdict, index, index + 1))
            return Performance(tuple(done), (), len(done), len(done))
"""


@pytest.fixture
def drawer(tmp_path):
    """A board whose drawer goes in from two sides."""
    path = tmp_path / "drawer.yaml"
    path.write_text(yaml.safe_dump(drawer_content(), sort_keys=False), encoding="utf-8")
    return str(path)


@pytest.fixture
def puppet(install):
    """An engine that pretends to move bodies, and refuses one way of the drawer."""
    install("physics", "puppet", "puppet_engine:Puppet", PUPPET)
    return "puppet"


def test_a_plan_says_which_way_is_taken(cli, drawer):
    """Beside the skill, and only of skills that have several."""
    words = ("evaluate", drawer, "--sequence", LEFT_FIRST, *AABB)
    steps = cli(*words, *JSON).document["steps"]
    assert [step.get("way") for step in steps] == [None, None, None, "along +x", None, None]
    assert "way" not in steps[0]
    assert "along +x" in cli(*words).out


def test_explain_says_which_way_is_taken(cli, drawer):
    """As a stage of its own."""
    outcome = cli("explain", drawer, "place(drawer)", "--after", "4", *AABB, *JSON)
    stages = {stage["stage"]: stage for stage in outcome.document["stages"]}
    assert stages["ways"]["evidence"]["way"] == "along +x"
    assert outcome.document["status"] == "feasible"


def test_what_is_executed_is_the_way_that_is_granted(cli, drawer, puppet, tmp_path):
    """The engine refuses the preferred one; skills, trace and table name the other."""
    trace = tmp_path / "trace.csv"
    words = ("simulate", drawer, "--sequence", LEFT_FIRST, "--physics", puppet)
    outcome = cli(*words, "--trace", str(trace), *JSON)
    assert outcome.code == 0
    done = outcome.document["skills"]
    assert [item["skill"] for item in done][3] == "place(drawer)"
    assert [part.get("way") for part in done] == [None, None, None, "along -x", None, None]
    with trace.open(encoding="utf-8", newline="") as file:
        assert "place(drawer) along -x" in {row["skill"] for row in csv.DictReader(file)}
    assert "place(drawer) along -x" in cli(*words).out


def test_of_a_result_its_own_way_is_executed(cli, drawer, puppet, tmp_path):
    """As it was granted when it was searched for."""
    out = tmp_path / "out"
    cli("search-optimal", drawer, *AABB, "--out", str(out))
    document = cli("simulate", str(out), "--physics", puppet, *JSON).document
    assert {skill.get("way") for skill in document["skills"]} == {None, "along +x"}


def test_a_result_with_another_way_than_is_taken_is_not_valid(cli, drawer, tmp_path):
    """The way is checked like every figure."""
    out = tmp_path / "out"
    cli("search-optimal", drawer, *AABB, "--out", str(out))
    assert cli("verify", str(out)).code == 0
    path = out / "result.json"
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace("along +x", "along -x"), encoding="utf-8")
    outcome = cli("verify", str(out))
    assert outcome.code == 1
    assert "place(drawer) goes along +x, not along -x" in outcome.out


# Travels that are planned round something, by commands.


# What is tall stands between the start and the goal of what is flat.
TOWER = """
kind: assembly
name: tower
robot: {home_m: [0.35, 0.0], safe_height_m: 0.15}
tools: {gripper: {holder_m: [0.6, 0.3]}}
initial_tool: gripper
parts:
  base: {tool: gripper, size_m: [0.06, 0.1, 0.02], start_m: [0.4, -0.25], goal_m: [0.5, 0.0]}
  tower: {tool: gripper, size_m: [0.03, 0.03, 0.25], start_m: [0.45, -0.12], goal_m: [0.6, 0.3]}
step_limit: 20
"""


@pytest.mark.slow(reason="plans travels four times; paths to the bit by another process")
def test_two_jobs_find_what_one_does(cli, tmp_path):
    """At the cost of time; and the way round the tower is the same after either."""
    board = tmp_path / "tower.yaml"
    board.write_text(TOWER, encoding="utf-8")
    results = []
    for jobs in ("1", "2"):
        words = ["--set", "cost=time", "--collision", "swept", "--jobs", jobs]
        document = cli("search-optimal", str(board), *words, "--format", "json").document
        del document["stats"]["wall_s"]
        explained = cli(
            "explain", str(board), "place(base)", "--after", "0", "--collision", "swept"
        ).out
        assert "around tower" in explained
        results.append((document, explained))
    assert results[0] == results[1]
    assert results[0][0]["status"] == "optimal"
