"""`skillplan benchmark`: its instances, its table, submissions, and what the referee refuses."""

import hashlib
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import jsonschema
import pytest
import yaml

from same_process import SameProcess
from skillplan.benchmark import (
    InstanceFile,
    Submission,
    format_instances,
    hash_instances,
    load_instances,
    parse_instances,
)
from skillplan.cli import main
from skillplan.errors import OptionError
from skillplan.views.tables import smallest_difference
from thinned import slow_case

ROOT = Path(__file__).parents[2]
DOCUMENTS = ROOT / "docs" / "reference" / "documents"
SMALL = "board-06-2"
# A learner as others write them: the cheapest action that the mask allows, after some steps.
LEARNER = '''
import numpy as np


class Agent:
    """Remember what each action costs, and take the cheapest one that is allowed."""

    def __init__(self, env, seed=0):
        self.env, self.steps = env, 0
        self.costs = np.zeros(env.action_space.n)
        env.action_space.seed(seed)

    def learn(self, total_timesteps):
        _, info = self.env.reset(seed=0)
        while self.steps < total_timesteps:
            action = self.env.action_space.sample(self.env.action_masks())
            _, _, ended, late, info = self.env.step(action)
            self.costs[action] = info["cost"]
            self.steps += 1
            if ended or late:
                self.env.reset()

    def predict(self, observation, action_masks):
        return int(np.argmin(np.where(action_masks == 1, self.costs, np.inf))), None


class Deaf:
    def __init__(self, env):
        pass


class Sleeper(Agent):
    def learn(self, total_timesteps):
        import time

        time.sleep(600)


class Endless(Agent):
    """A learner that ignores the limit."""

    def learn(self, total_timesteps):
        super().learn(3000)


class Unseeded(Agent):
    """The actions that the space draws, without a seed of the learner."""

    def __init__(self, env):
        self.env = env

    def learn(self, total_timesteps):
        _, info = self.env.reset()
        self.drawn = [int(self.env.action_space.sample()) for _ in range(20)]
        self.drawn.append(float(self.env.unwrapped.np_random.random()))

    def predict(self, observation):
        raise ValueError(f"drawn {self.drawn}")


def beyond(env):
    class Beyond(Agent):
        def predict(self, observation):
            return self.costs.size

    return Beyond(env)
'''


@pytest.fixture
def in_this_process(monkeypatch):
    """No processes for the runs."""
    monkeypatch.setattr("skillplan.benchmark.runs.LocalProcesses", SameProcess)


@pytest.fixture
def learner(tmp_path):
    """A file with learners."""
    path = tmp_path / "learner.py"
    path.write_text(LEARNER, "utf-8")
    return path


@pytest.fixture(scope="module")
def instances():
    """All instances by name."""
    return {each.name: each for each in load_instances()}


def schema_of(name):
    """Return the published schema of a document."""
    return yaml.safe_load((DOCUMENTS / f"{name}.yaml").read_text("utf-8"))


class TestInstances:
    def test_a_hundred_boards_of_6_to_60_parts_are_proved_by_two_codes(self, instances):
        """The second code is no solver of the first one's kind."""
        boards = [each for each in instances.values() if each.suite == "boards"]
        assert 100 == len(boards)
        assert {6, 60} <= {each.generate["parts"] for each in boards}
        provers = {proof.by for each in boards for proof in each.proofs[1:]}
        assert provers <= {"fast-downward", "cp-sat", "value-iteration"}
        assert all(len(each.proofs) == 2 for each in boards)

    def test_proofs_of_an_instance_agree_and_state_versions(self, instances):
        """A single proof is named as such."""
        for each in instances.values():
            assert "optimal" == each.status
            assert all(abs(p.cost - each.optimum) <= 1e-5 * each.optimum for p in each.proofs)
            assert all(any(c.isdigit() for c in proof.version) for proof in each.proofs)
            assert each.proof_text.startswith("one proof: ") == (len(each.proofs) == 1)

    @pytest.mark.parametrize("name", [SMALL, "board-24-5", "chance-08-6", "ESC07", "gear_unit"])
    def test_a_task_has_the_hash_of_the_data(self, instances, name):
        """Generated, or from a file."""
        task = instances[name].load()
        assert instances[name].sha256 == task.sha256

    @pytest.mark.slow(reason="all instances; one of each suite in every run")
    def test_all_tasks_have_the_hashes_of_the_data(self, instances):
        """No change of a generator or a file goes unnoticed."""
        for each in instances.values():
            task = each.load()
            assert each.sha256 == task.sha256

    def test_a_changed_task_is_refused(self, instances):
        """Its optimum would be that of another task."""
        changed = instances[SMALL].model_copy(update={"sha256": "0" * 64})
        with pytest.raises(OptionError, match="its task has changed"):
            changed.load()

    def test_data_are_read_as_they_are_written(self, instances):
        """One instance a line, without defaults."""
        some = [each for each in instances.values() if each.suite == "chance"]
        text = format_instances(some)
        assert some == parse_instances(text, "assembly")
        assert len(some) + 2 == len(text.splitlines())
        jsonschema.validate(json.loads(text), schema_of("benchmark-instances"))

    def test_the_list_shows_optimum_and_provers(self, cli):
        """And how many are proved twice."""
        done = cli("benchmark", "--list", "--only", f"{SMALL},ESC07")
        assert 0 == done.code
        assert "auto and fast-downward" in done.out
        assert "2 instances: 2 proved by two codes, 0 by one" in done.out

    def test_learning_tasks_have_a_noise_floor(self, cli, instances):
        """The spread over ten seeds of a learner, and of random episodes."""
        learning = [each for each in instances.values() if each.learning]
        assert len(learning) > 20
        for each in learning:
            assert "q-learning" == each.noise[-1].agent
            assert all(10 == spread.runs for spread in each.noise)
        assert "noise floor of learning tasks" in cli("benchmark", "--list", "--only", SMALL).out

    @pytest.mark.parametrize(
        ("words", "message"),
        [
            (("--suite", "bords"), "No suite 'bords'. Did you mean 'boards'?"),
            (("--only", "bord-06-2"), "--only bord-06-2: no instance matches."),
            (("--list", "--prove"), "Give one of --list, --check and --prove."),
            (("auto", "--list"), "--list, --check and --prove run no agents."),
            (("exakt",), "exakt"),
            (("no_such_module:Agent",), "Agent no_such_module:Agent: cannot be imported"),
            (("--out", "rows.txt"), "submissions are not saved as .txt"),
            (("--prove",), "--prove prints the data of one kind of task"),
            (("--check", "missing.json"), "missing.json"),
            (("--check", "rows.json", "--out", "x.json"), "write no file. Leave out --out."),
        ],
    )
    def test_wrong_words_are_refused(self, cli, words, message):
        """With a correction."""
        assert message in " ".join(cli("benchmark", *words).refusal.split())


class TestProofs:
    @pytest.mark.parametrize(
        "name",
        [
            "chance-04-1",
            slow_case("board-06-1", reason="a planner; dynamic programming in every run"),
            slow_case("board-28-5", reason="CP-SAT; dynamic programming in every run"),
        ],
    )
    def test_one_command_repeats_the_data(self, cli, instances, name):
        """Optimum, hash and provers are those of the package."""
        done = cli("benchmark", "--prove", "--only", name)
        assert 0 == done.code
        (each,) = parse_instances(done.out, "assembly")
        known = instances[name]
        assert (known.sha256, known.status) == (each.sha256, each.status)
        assert known.optimum == pytest.approx(each.optimum, rel=1e-9)
        assert [p.by for p in known.proofs] == [p.by for p in each.proofs]

    def test_difference_that_means_something_shrinks_with_runs(self):
        """Three runs a side find less than ten; the power is that of the noncentral t."""
        from scipy.special import nctdtr, stdtrit

        for runs, deviations in ((3, 3.07), (5, 2.02)):
            difference, freedom = smallest_difference(0.1, runs), 2 * runs - 2
            assert deviations * 0.1 == pytest.approx(difference, rel=3e-3)
            critical, shift = stdtrit(freedom, 0.975), difference / 0.1 * (runs / 2) ** 0.5
            within = nctdtr(freedom, shift, critical) - nctdtr(freedom, shift, -critical)
            assert 0.8 == pytest.approx(1 - within, abs=1e-4)
        assert smallest_difference(0.1, 10) < smallest_difference(0.1, 5)


@pytest.fixture(scope="module")
def rows(tmp_path_factory):
    """Results of `exact` on a board, and of a policy under chance, made once."""
    path = tmp_path_factory.mktemp("benchmark") / "rows.json"
    words = ("exact", "job-values", "--only", f"{SMALL},chance-04-1", "--out", str(path))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("skillplan.benchmark.runs.LocalProcesses", SameProcess)
        with pytest.raises(SystemExit) as ended:
            main(("benchmark", *words))
    assert 0 == ended.value.code
    return path.read_text("utf-8")


@pytest.fixture
def submission(rows, tmp_path):
    """A file of results of a plan and a policy."""
    path = tmp_path / "rows.json"
    path.write_text(rows, "utf-8")
    return path


class TestRuns:
    def test_agents_are_compared_with_intervals_over_instances(self, cli, in_this_process):
        """Shares after Wilson, no interval over seeds; a solver that refuses is named."""
        done = cli("benchmark", "exact", "random", "--only", "board-06-[12]", "--steps", "300")
        assert 0 == done.code
        exact = next(line for line in done.out.splitlines() if line.startswith("exact"))
        assert ["2", "100", "(34-100)", "100", "(34-100)", "100", "(34-100)"] == exact.split()[1:8]
        assert "95 % intervals over instances" in done.out
        assert "4 runs of 4 to do, 1.4 min at most on 1 process" in done.err

    def test_a_submission_is_continued(self, cli, submission, in_this_process):
        """Runs in the file are not repeated; one begun with another limit is refused."""
        words = ("--only", f"{SMALL},chance-04-1", "--out", str(submission))
        before = json.loads(submission.read_text("utf-8"))
        done = cli("benchmark", "exact", "job-values", *words)
        assert "0 runs of 4 to do" in done.err
        assert before == json.loads(submission.read_text("utf-8"))
        refusal = cli("benchmark", "auto", *words, "--time-limit", "1").refusal
        assert "was begun with another search_limit_s: 10.0 there, 1.0 now" in refusal

    def test_a_file_with_rows_of_another_benchmark_is_not_continued(self, cli, submission):
        """Its tasks differ, so its rows compare with nothing."""
        document = json.loads(submission.read_text("utf-8"))
        document["rows"][0]["sha256"] = "0" * 64
        submission.write_text(json.dumps(document), "utf-8")
        refusal = cli("benchmark", "exact", "--only", SMALL, "--out", str(submission)).refusal
        assert "that is not of this benchmark" in " ".join(refusal.split())

    def test_a_submission_has_the_keys_of_its_schema(self, submission):
        """The published schema has those of the model that reads it."""
        document = json.loads(submission.read_text("utf-8"))
        published = schema_of("benchmark")
        jsonschema.validate(document, published)
        jsonschema.Draft202012Validator.check_schema(published)
        assert {*Submission.model_json_schema()["properties"], "refused"} == set(
            published["properties"]
        )
        keys = InstanceFile.model_json_schema()["$defs"]["Instance"]["properties"]
        listed = schema_of("benchmark-instances")["properties"]["instances"]["items"]
        assert set(keys) == set(listed["properties"])

    def test_a_learner_from_a_file_is_trained_and_followed(self, cli, learner, in_this_process):
        """Masks reach it, and its steps are counted."""
        name = f"{learner}:Agent"
        words = ("--only", "walk-*,board-06-5", "--steps", "200", "--format", "json")
        rows = cli("benchmark", name, *words).document["rows"]
        assert {name} == {row["agent"] for row in rows}
        row = next(row for row in rows if row["instance"] == "board-06-5")
        assert 200 == row["steps"]
        assert row["status"] in ("solved", "unsolved")

    def test_steps_end_the_training_of_any_learner(self, cli, learner, in_this_process):
        """Also of one that ignores `total_timesteps`."""
        words = ("--only", SMALL, "--steps", "100", "--format", "json")
        (row,) = cli("benchmark", f"{learner}:Endless", *words).document["rows"]
        assert 100 == row["steps"]

    def test_the_environment_has_the_seed_of_the_run(self, cli, learner, in_this_process):
        """Actions and outcomes repeat by it, and differ between seeds."""
        words = ("--only", SMALL, "--steps", "10", "--runs", "2", "--format", "json")

        def draw():
            rows = cli("benchmark", f"{learner}:Unseeded", *words).document["rows"]
            return [row["reason"] for row in rows]

        first, second = draw()
        assert "drawn [" in first
        assert first != second
        assert [first, second] == draw()

    def test_a_file_begun_with_another_agent_is_not_continued(self, cli, learner, in_this_process):
        """Its rows are results of the code before the edit."""
        out = learner.with_name("rows.json")
        words = ("benchmark", f"{learner}:Agent", "--only", SMALL, "--steps", "50", "--out", out)
        assert 0 == cli(*map(str, words)).code
        (version,) = json.loads(out.read_text("utf-8"))["agents"].values()
        assert f"sha256 {hashlib.sha256(LEARNER.encode()).hexdigest()}" == version
        assert "0 runs of 1 to do" in cli(*map(str, words)).err
        learner.write_text(LEARNER + "# edited", "utf-8")
        done = cli(*map(str, words))
        assert 2 == done.code
        assert f"was begun with another {learner}; name a new file" in "".join(
            done.refusal.replace("\n", " ").split("  ")
        )

    def test_a_file_begun_with_another_version_is_not_continued(self, cli, submission):
        """Of a package."""
        document = json.loads(submission.read_text("utf-8"))
        document["agents"]["exact"] = "skillplan 0.0.1"
        submission.write_text(json.dumps(document), "utf-8")
        refusal = cli("benchmark", "exact", "--only", SMALL, "--out", str(submission)).refusal
        assert "begun with another exact: skillplan 0.0.1 there" in " ".join(refusal.split())

    def test_a_file_has_dataclasses_and_imports_modules_beside_it(
        self, cli, learner, in_this_process
    ):
        """Each from its own folder; an import within the training, too."""
        names = []
        for steps in (20, 30):
            folder = learner.with_name(f"folder{steps}")
            folder.mkdir()
            (folder / "beside.py").write_text(LEARNER + f"\nSTEPS = {steps}\n", "utf-8")
            (folder / "late.py").write_text("from beside import STEPS\n", "utf-8")
            (folder / "mine.py").write_text(
                "from __future__ import annotations\n"
                "from dataclasses import dataclass, field\n"
                "from beside import Agent\n\n"
                "@dataclass\nclass Mine(Agent):\n    env: object\n\n"
                "    def __post_init__(self):\n        super().__init__(self.env)\n\n"
                "    def learn(self, total_timesteps):\n        from late import STEPS\n\n"
                "        super().learn(STEPS)\n",
                "utf-8",
            )
            names.append(f"{folder / 'mine.py'}:Mine")
        path = list(sys.path)
        rows = cli("benchmark", *names, "--only", SMALL, "--format", "json").document["rows"]
        assert [20, 30] == [row["steps"] for row in rows]
        assert path == sys.path
        assert not {"mine", "beside", "late"} & set(sys.modules)

    def test_a_file_without_a_name_gets_the_form(self, cli, learner):
        """It is no solver."""
        refusal = " ".join(cli("benchmark", str(learner), "--only", SMALL).refusal.split())
        assert "write " in refusal
        assert ".py:NAME" in refusal

    @pytest.mark.parametrize(
        ("name", "reason"), [("Deaf", "made a Deaf without learn()"), ("beyond", "does not exist")]
    )
    def test_a_learner_that_is_none_fails(self, cli, learner, in_this_process, name, reason):
        """The row states the reason."""
        words = ("--only", SMALL, "--steps", "10", "--format", "json")
        done = cli("benchmark", f"{learner}:{name}", *words)
        assert 2 == done.code
        (row,) = done.document["rows"]
        assert "failed" == row["status"]
        assert reason in row["reason"]

    def test_a_file_with_a_fault_is_refused(self, cli, tmp_path):
        """Before anything runs."""
        path = tmp_path / "broken.py"
        path.write_text("import (", "utf-8")
        refusal = cli("benchmark", f"{path}:Agent", "--only", SMALL).refusal
        assert "cannot be imported: SyntaxError" in " ".join(refusal.split())

    @pytest.mark.slow(reason="a process that hangs; failures of learners in every run")
    def test_an_agent_that_hangs_is_ended(self, cli, learner, monkeypatch):
        """The others go on."""
        monkeypatch.setattr("skillplan.benchmark.runs._GRACE_S", 4.0)
        words = ("--only", SMALL, "--time-limit", "1", "--format", "json")
        done = cli("benchmark", "exact", f"{learner}:Sleeper", *words)
        by_agent = {row["agent"].rpartition(":")[2]: row["status"] for row in done.document["rows"]}
        assert {"Sleeper": "failed", "exact": "optimal"} == by_agent

    @pytest.mark.slow(reason="a signal to a process; continued runs in every run")
    def test_ctrl_c_keeps_the_runs_that_are_done(self, tmp_path):
        """The same command continues."""
        path = tmp_path / "rows.json"
        words = [sys.executable, "-m", "skillplan", "benchmark", "exact", "random"]
        words += ["--only", "board-[12]*", "--time-limit", "1", "--out", str(path)]
        process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        until = time.monotonic() + 60
        while time.monotonic() < until:
            if path.exists() and json.loads(path.read_text("utf-8"))["rows"]:
                break
            time.sleep(0.2)
        os.kill(process.pid, signal.SIGINT)
        out, _ = process.communicate(timeout=60)
        assert 130 == process.returncode
        assert "exact" in out
        assert json.loads(path.read_text("utf-8"))["rows"]

    @pytest.mark.slow(reason="a training with torch; a learner of a few lines in every run")
    def test_stable_baselines_takes_part(self, cli):
        """DQN and MaskablePPO, each by its name alone."""
        pytest.importorskip("stable_baselines3")
        agents = ["stable_baselines3:DQN"]
        try:
            import sb3_contrib  # noqa: F401

            agents.append("sb3_contrib:MaskablePPO")
        except ImportError:
            pass
        words = ("--only", SMALL, "--steps", "600", "--time-limit", "20", "--format", "json")
        document = cli("benchmark", *agents, *words).document
        assert agents == list(document["agents"])
        assert {"solved", "unsolved"} >= {row["status"] for row in document["rows"]}
        assert all(600 == row["steps"] for row in document["rows"])


FORGERIES = {
    "a lower cost": (0, lambda row: {"cost": row["cost"] * 0.9}, "it claims the cost"),
    "a bound above the optimum": (0, lambda row: {"lower_bound": row["cost"] * 1.1}, "above the"),
    "a proof with a gap": (0, lambda row: {"lower_bound": 0.0}, "its bound leaves a gap"),
    "a skill less": (0, lambda row: {"skills": row["skills"][1:]}, "the plan fails at step 1"),
    "no plan": (0, lambda row: {"skills": None}, "the plan fails at the end"),
    "a skill of another task": (0, lambda row: {"skills": ["fly(home)"]}, "not one of this task"),
    "another task": (0, lambda row: {"sha256": "0" * 64}, "it is for another task"),
    "a time above the limit": (0, lambda row: {"wall_s": 100.0}, "more than the limit of 10 s"),
    "an agent that is not listed": (0, lambda row: {"agent": "x:Y"}, "does not list its agent"),
    "an unknown instance": (0, lambda row: {"instance": "board-99-9"}, "no such instance"),
    "no plan exists": (
        0,
        lambda row: {"status": "infeasible", "cost": None, "lower_bound": None},
        "it claims that no plan exists",
    ),
    "a lower expectation": (-1, lambda row: {"cost": row["cost"] * 0.99}, "it claims the cost"),
    "no policy": (-1, lambda row: {"policy": None}, "the policy says nothing in"),
    "facts that there are not": (-1, lambda row: {"policy": {"sunny": "x"}}, "not for this task"),
}


class TestReferee:
    def test_a_true_submission_holds(self, cli, submission):
        """All plans and policies were executed again."""
        done = cli("benchmark", "--check", str(submission))
        assert 0 == done.code
        assert "4 of 4 rows hold. Plans and policies executed again: 3; rows without: 1" in done.out
        assert "refused rows" not in done.out
        assert "benchmark  " not in done.out

    def test_a_minimal_submission_holds(self, cli, submission):
        """Agents elsewhere need not state seeds, steps or bounds."""
        document = json.loads(submission.read_text("utf-8"))
        keys = ("agent", "instance", "sha256", "cost", "wall_s", "skills")
        row = {key: document["rows"][0][key] for key in keys}
        document["rows"] = [{**row, "status": "solved"}]
        submission.write_text(json.dumps(document), "utf-8")
        assert 0 == cli("benchmark", "--check", str(submission)).code

    @pytest.mark.parametrize("forgery", FORGERIES)
    def test_a_forged_row_is_refused(self, cli, submission, forgery):
        """The other rows stay."""
        index, change, reason = FORGERIES[forgery]
        document = json.loads(submission.read_text("utf-8"))
        document["rows"][index] |= change(document["rows"][index])
        submission.write_text(json.dumps(document), "utf-8")
        done = cli("benchmark", "--check", str(submission), "--format", "json")
        assert 1 == done.code
        (refused,) = done.document["refused"]
        assert reason in refused["reason"]
        assert len(document["rows"]) - 1 == len(done.document["rows"])

    def test_a_row_beyond_the_steps_of_the_header_is_refused(self, cli, submission):
        """A learner elsewhere had more steps than the others."""
        document = json.loads(submission.read_text("utf-8"))
        document["agents"]["mine"] = "1.0"
        document["rows"][0] |= {"agent": "mine", "steps": 10_001}
        submission.write_text(json.dumps(document), "utf-8")
        done = cli("benchmark", "--check", str(submission))
        assert 1 == done.code
        assert "it took 10001 environment steps, more than 10000" in " ".join(done.out.split())

    def test_a_refused_row_counts_as_a_failure(self, cli, submission):
        """A forged row does not leave the table."""
        document = json.loads(submission.read_text("utf-8"))
        for row in document["rows"]:
            row["cost"] = None if row["cost"] is None else row["cost"] * 0.9
        submission.write_text(json.dumps(document), "utf-8")
        out = cli("benchmark", "--check", str(submission)).out
        exact = next(line.split() for line in out.splitlines() if line.startswith("exact  "))
        assert ["2", "0"] == exact[1:3]

    @pytest.mark.parametrize(
        ("change", "note"),
        [
            ({"skillplan": "0.0.1"}, "written by skillplan 0.0.1, checked by "),
            ({"benchmark": "0" * 64}, "000000000000 is not the hash of the 2 instances"),
            ({"benchmark": "chance"}, "instances of its rows, but of the suite chance"),
        ],
    )
    def test_differences_of_the_header_are_noted(self, cli, submission, instances, change, note):
        """The rows hold."""
        if change.get("benchmark") == "chance":
            suite = [each for each in instances.values() if each.suite == "chance"]
            change = {"benchmark": hash_instances(suite)}
        document = json.loads(submission.read_text("utf-8"))
        submission.write_text(json.dumps({**document, **change}), "utf-8")
        done = cli("benchmark", "--check", str(submission))
        assert 0 == done.code
        assert note in " ".join(done.out.split())

    def test_a_submission_without_rows_is_no_success(self, cli, submission):
        """Nothing was checked."""
        document = json.loads(submission.read_text("utf-8"))
        submission.write_text(json.dumps({**document, "rows": []}), "utf-8")
        done = cli("benchmark", "--check", str(submission))
        assert 1 == done.code
        assert "no rows: nothing to check" in done.out

    @pytest.mark.parametrize(
        ("change", "message"),
        [
            (lambda d: {**d, "rows": [*d["rows"], d["rows"][0]]}, "stands twice"),
            (lambda d: {**d, "rows": [{**d["rows"][0], "cost": -1.0}]}, "is damaged: "),
            (lambda d: {**d, "schema": "skillplan.result/1"}, "skillplan.benchmark/1"),
        ],
    )
    def test_a_file_that_is_no_submission_is_refused(self, cli, submission, change, message):
        """With the first fault."""
        document = json.loads(submission.read_text("utf-8"))
        submission.write_text(json.dumps(change(document)), "utf-8")
        assert message in " ".join(cli("benchmark", "--check", str(submission)).refusal.split())
