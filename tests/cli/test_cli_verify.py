"""verify: what holds, what fails, what could not be checked, and what is no result at all."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from thinned import slow_case

EXACT = ("--solver", "exact", "--format", "json")
Tamper = Callable[[dict[str, Any]], None]


@pytest.fixture
def result(solved_board, tmp_path):
    """The proved optimum of the inverter board, in a folder."""
    return Path(shutil.copytree(solved_board, tmp_path / "run")) / "result.json"


@pytest.fixture
def tampered(result):
    """The same result after somebody has changed it."""

    def change(how: Tamper) -> str:
        document = json.loads(result.read_text("utf-8"))
        how(document)
        result.write_text(json.dumps(document), "utf-8")
        return str(result)

    return change


def outcomes(document: dict[str, Any]) -> dict[str, str]:
    return {claim["claim"]: claim["outcome"] for claim in document["claims"]}


def verified(cli: Any, *words: str) -> dict[str, str]:
    """Return what a verification that finds nothing wrong says of every claim."""
    outcome = cli("verify", *words, "--format", "json")
    assert (0, True) == (outcome.code, outcome.document["valid"])
    return outcomes(outcome.document)


def details(document: dict[str, Any]) -> str:
    failing = [claim for claim in document["claims"] if claim["outcome"] == "fails"]
    return "; ".join(f"{claim['claim']}: {claim['detail']}" for claim in failing)


class TestAnHonestResult:
    def test_every_claim_holds(self, cli, result):
        """Replayed, calculated, and proved by another method than A*."""
        outcome = cli("verify", str(result), "--format", "json")
        assert (0, True) == (outcome.code, outcome.document["valid"])
        named = {"plan", "steps", "cost", "bound", "gap", "status", "optimal"}
        assert named | {"record", "plan.csv"} == set(outcomes(outcome.document))
        assert {"holds"} == set(outcomes(outcome.document).values())
        methods = {c["claim"]: c["method"] for c in outcome.document["claims"]}
        assert "dynamic program over orders of jobs" == methods["optimal"]

    def test_the_folder_is_as_good_as_the_file(self, cli, result):
        """As --out was given it."""
        outcome = cli("verify", str(result.parent))
        assert 0 == outcome.code
        assert "\nverdict    valid\n" in outcome.out

    def test_what_was_proved_over_orders_is_proved_over_states(self, cli, tampered):
        """Never by the method that was claimed, where another is fit."""

        def by_orders(document: dict[str, Any]) -> None:
            document["bound_method"] = "dynamic programming over feasible subsets"

        outcome = cli("verify", tampered(by_orders), "--format", "json")
        methods = {c["claim"]: c["method"] for c in outcome.document["claims"]}
        assert "uniform-cost search over all states" == methods["optimal"]

    def test_a_bound_without_a_proof_is_checked_too(self, cli, solved_within_a_gap):
        """Against the least cost, where that can be worked out."""
        document = cli("verify", str(solved_within_a_gap), "--format", "json").document
        assert "holds" == outcomes(document)["lower bound"]

    def test_that_there_is_no_plan_is_checked_too(self, cli, no_way, tmp_path):
        """By looking at every state."""
        folder = str(tmp_path / "none")
        assert 1 == cli("search-optimal", no_way, *EXACT, "--out", folder).code
        outcome = cli("verify", folder, "--format", "json")
        assert 0 == outcome.code
        assert "holds" == outcomes(outcome.document)["infeasible"]

    def test_changes_and_back_ends_of_the_search_are_used_again(self, cli, board, tmp_path):
        """As the result remembers them."""
        folder = tmp_path / "changed"
        words = ("--set", "parts.clock.start_m=[0.60, -0.134]", "--collision", "aabb")
        words += ("-O", "aabb.tolerance_m=0.0001")
        assert 0 == cli("search-optimal", board, *EXACT, *words, "--out", str(folder)).code
        origin = json.loads((folder / "result.json").read_text("utf-8"))["origin"]
        assert {
            "file": board,
            "part": None,
            "set": {"parts.clock.start_m": "[0.60, -0.134]"},
            "physics": None,
            "collision": ["aabb"],
            "options": {"aabb": {"tolerance_m": "0.0001"}},
            "screening": True,
        } == origin
        assert 0 == cli("verify", str(folder)).code

    @pytest.mark.slow(reason="searches a board of 40 parts; small ones in every run")
    def test_a_bound_of_a_case_too_large_is_not_confirmed(self, cli, motor, tmp_path):
        """Both methods say why; the replay counts all the same."""
        path = tmp_path / "large.yaml"
        words = ("--parts", "40", "--density", "0.1", "--tools", "1", "--seed", "1")
        cli("generate", "assembly", *words, "--out", str(path))
        folder = str(tmp_path / "large")
        cli("search-optimal", str(path), *EXACT, "--time-limit", "0.3", "--out", folder)
        outcome = cli("verify", folder, "--time-limit", "0.5")
        assert 1 == outcome.code
        assert "verdict    NOT CONFIRMED: not checked: lower bound" in outcome.out
        assert "replay     plan, steps, cost hold" in outcome.out

    def test_a_chain_is_verified_part_by_part(self, cli, solved_corner):
        """And then its sum."""
        outcome = cli("verify", str(solved_corner), "--format", "json")
        claims = outcomes(outcome.document)
        assert (0, True) == (outcome.code, outcome.document["valid"])
        for claim in ("heads-1: optimal", "goals: plan", "base-1: optimal", "cost"):
            assert "holds" == claims[claim]

    def test_a_part_of_a_chain_is_verified_alone(self, cli, corner, tmp_path):
        """The result remembers which."""
        folder = str(tmp_path / "part")
        cli("search-optimal", corner, *EXACT, "--part", "base-1", "--out", folder)
        claims = verified(cli, folder)
        assert {"holds"} == set(claims.values())

    @pytest.mark.slow(reason="iterates values; an honest result in every run")
    def test_under_chance_the_least_expected_cost_is_worked_out(self, cli, tmp_path, board):
        """Without the policy, too; then the cost is compared with it."""
        path = tmp_path / "slippery.yaml"
        text = Path(board).read_text("utf-8")
        slippery = text.replace("  clock:\n", "  clock:\n    grasp_failure: 0.1\n")
        path.write_text(slippery, "utf-8")
        folder = tmp_path / "run"
        words = ("--solver", "value-iteration", "--format", "json", "--out", str(folder))
        assert 0 == cli("search-optimal", str(path), *words).code
        claims = outcomes(cli("verify", str(folder), "--format", "json").document)
        assert ("holds", "holds") == (claims["cost"], claims["optimal"])
        (folder / "policies.json").unlink()
        alone = outcomes(cli("verify", str(folder), "--format", "json").document)
        assert ("holds", "not checked") == (alone["cost"], alone["policies.json"])
        document = json.loads((folder / "result.json").read_text("utf-8"))
        document["cost"] = document["lower_bound"] = document["cost"] + 0.01
        (folder / "result.json").write_text(json.dumps(document), "utf-8")
        failed = cli("verify", str(folder), "--format", "json")
        assert (1, "fails") == (failed.code, outcomes(failed.document)["optimal"])


def _raise_cost(document: dict[str, Any]) -> None:
    document["cost"] -= 0.1


def _swap_steps(document: dict[str, Any]) -> None:
    for key in ("skills", "actions", "steps"):
        document[key][0], document[key][1] = document[key][1], document[key][0]


def _swap_in_steps_only(document: dict[str, Any]) -> None:
    document["steps"][0]["skill"] = document["steps"][1]["skill"]


def _drop_the_end(document: dict[str, Any]) -> None:
    for key in ("skills", "actions", "steps"):
        document[key].pop()
    document["makespan"] -= 1


def _other_actions(document: dict[str, Any]) -> None:
    document["actions"][3] += 1


def _cheaper_step(document: dict[str, Any]) -> None:
    document["steps"][3]["cost"] /= 2


def _unknown_skill(document: dict[str, Any]) -> None:
    document["skills"][2] = "fly(pcb)"


def _wrong_gap(document: dict[str, Any]) -> None:
    document["gap"] = 0.25


def _bound_above_cost(document: dict[str, Any]) -> None:
    document["lower_bound"] = document["cost"] + 1


def _optimal_without_bound(document: dict[str, Any]) -> None:
    document["lower_bound"] = document["gap"] = None


def _infeasible_with_a_plan(document: dict[str, Any]) -> None:
    document["status"] = "infeasible"


@pytest.mark.parametrize(
    ("how", "claim", "message"),
    [
        (_raise_cost, "cost", "the plan costs 1.867086014, claimed 1.767086014"),
        (_swap_steps, "plan", "fails at step 1 (place(pcb)): precondition"),
        (_swap_in_steps_only, "steps", "step 1: is pick(pcb) among skills, place(pcb) among steps"),
        (_drop_the_end, "plan", "fails at the end: goal: the goal is not reached"),
        (_other_actions, "steps", "step 4: place(switch_1) is action 3"),
        (_cheaper_step, "steps", "step 4: place(switch_1) costs"),
        (_unknown_skill, "plan", "is not one of this task: "),
        (_wrong_gap, "gap", "is 0, claimed 0.25"),
        (_bound_above_cost, "bound", "2.867086014 is above the cost 1.867086014"),
        (_optimal_without_bound, "status", "optimal, and the bound does not meet the cost"),
        (_infeasible_with_a_plan, "status", "infeasible does not go with a plan"),
    ],
)
def test_a_tampered_result_fails_where_it_was_tampered_with(cli, tampered, how, claim, message):
    """Exit code 1, the claim and the figures."""
    outcome = cli("verify", tampered(how), "--format", "json")
    assert (1, False) == (outcome.code, outcome.document["valid"])
    assert "fails" == outcomes(outcome.document)[claim]
    assert message in details(outcome.document)


class TestAClaimThatIsNotTrue:
    @pytest.fixture
    def expensive(self, solved_within_a_gap, tmp_path):
        """A plan that is not the best."""
        path = shutil.copytree(solved_within_a_gap, tmp_path / "expensive") / "result.json"
        assert "solved" == json.loads(path.read_text("utf-8"))["status"]
        return path

    def test_a_status_raised_to_optimal_fails(self, cli, expensive):
        """The bound does not meet the cost."""
        document = json.loads(expensive.read_text("utf-8"))
        expensive.write_text(json.dumps({**document, "status": "optimal"}), "utf-8")
        outcome = cli("verify", str(expensive), "--format", "json")
        assert (1, "fails") == (outcome.code, outcomes(outcome.document)["status"])

    def test_a_proof_made_up_throughout_fails_by_a_cheaper_plan(self, cli, expensive):
        """Bound, gap and status agree with each other; the second proof finds the better plan."""
        document = json.loads(expensive.read_text("utf-8"))
        document |= {"status": "optimal", "lower_bound": document["cost"], "gap": 0.0}
        expensive.write_text(json.dumps(document), "utf-8")
        outcome = cli("verify", str(expensive), "--format", "json")
        failing = {c for c, how in outcomes(outcome.document).items() if how == "fails"}
        assert (1, {"optimal"}) == (outcome.code, failing - {"record", "plan.csv"})
        assert "the least cost is 5.198898903: " in details(outcome.document)

    def test_a_bound_above_the_optimum_fails(self, cli, expensive):
        """Though it is below the cost."""
        document = json.loads(expensive.read_text("utf-8"))
        bound = (document["cost"] + 5.198898903) / 2
        gap = (document["cost"] - bound) / document["cost"]
        expensive.write_text(json.dumps({**document, "lower_bound": bound, "gap": gap}), "utf-8")
        outcome = cli("verify", str(expensive))
        assert 1 == outcome.code
        assert "verdict    NOT VALID: lower bound" in outcome.out

    def test_a_plan_denied_is_found(self, cli, tampered):
        """What is said to be infeasible is not."""

        def deny(document: dict[str, Any]) -> None:
            nothing: dict[str, Any] = {"skills": [], "actions": [], "steps": []}
            document |= {"status": "infeasible", "cost": None, "gap": None, "makespan": None}
            document |= {"lower_bound": None, "makespan_s": None, **nothing}

        outcome = cli("verify", tampered(deny), "--format", "json")
        assert 1 == outcome.code
        assert "claimed is that there is no plan; the least cost is" in details(outcome.document)

    def test_a_part_of_a_chain_made_worse_fails_by_its_name(self, cli, solved_corner, tmp_path):
        """And so does the sum."""
        folder = Path(shutil.copytree(solved_corner, tmp_path / "chain"))
        path = folder / "result.json"
        document = json.loads(path.read_text("utf-8"))
        document["sequences"][0]["cost"] += 1
        path.write_text(json.dumps(document), "utf-8")
        outcome = cli("verify", str(folder), "--format", "json")
        claims = outcomes(outcome.document)
        assert (1, "fails", "fails") == (outcome.code, claims["base-1: cost"], claims["cost"])

    def test_parts_of_a_chain_in_another_order_fail(self, cli, solved_corner, tmp_path):
        """The name says which stands where another should."""
        folder = Path(shutil.copytree(solved_corner, tmp_path / "chain"))
        path = folder / "result.json"
        document = json.loads(path.read_text("utf-8"))
        document["stages"].reverse()
        path.write_text(json.dumps(document), "utf-8")
        outcome = cli("verify", str(folder), "--format", "json")
        assert 1 == outcome.code
        assert "goals stands where the chain has heads-1" in details(outcome.document)


class TestWrongInput:
    def test_a_result_that_was_cut_off(self, cli, result):
        """It is no JSON any more."""
        result.write_text(result.read_text("utf-8")[:500], "utf-8")
        outcome = cli("verify", str(result))
        assert (2, True) == (outcome.code, f"{result}: is damaged" in outcome.err)

    @pytest.mark.parametrize(
        ("changes", "message"),
        [
            ({"schema": "skillplan.chart/1"}, "is no document skillplan.result/1"),
            ({"schema": "skillplan.result/2"}, "is of another version, skillplan.result/2"),
            ({"cost": "cheap"}, "is damaged: cost: "),
            ({"status": "splendid"}, "is damaged: status: "),
            ({"steps": [{}]}, "is damaged: steps[0].index: "),
            ({"cost": float("nan")}, "is damaged: a number must be finite, not NaN"),
            ({"status": "wrong"}, "claims nothing, its status is wrong"),
            (
                {"origin": None},
                "does not say which file its task is from. Solve the task again, or",
            ),
        ],
    )
    def test_what_is_no_sound_result_is_refused(self, cli, tampered, changes, message):
        """One message with the key, exit code 2, nothing on stdout."""
        assert message in cli("verify", tampered(lambda document: document.update(changes))).refusal

    def test_no_such_file(self, cli):
        """In words."""
        outcome = cli("verify", "nowhere.json")
        assert (2, True) == (outcome.code, "nowhere.json: cannot be read" in outcome.err)

    def test_another_task_is_refused(self, cli, result, motor):
        """Both are named."""
        refusal = cli("verify", str(result), "--task", motor).refusal
        assert "the result is of 'inverter-board'" in refusal
        assert "'motor-drive'" in refusal

    def test_a_task_that_has_changed_since_is_refused(self, cli, result, board, tmp_path):
        """The plan was made for what it was."""
        changed = tmp_path / "changed.yaml"
        text = Path(board).read_text("utf-8").replace("step_limit: 20", "step_limit: 21")
        changed.write_text(text, "utf-8")
        outcome = cli("verify", str(result), "--task", str(changed))
        assert (2, True) == (outcome.code, "has changed since" in outcome.err)

    @pytest.mark.parametrize(
        "words",
        [
            ("verify",),
            slow_case(("simulate", "--physics", "mujoco"), reason="executes a plan"),
            ("export", "--to", "pddl", "--out", "OUT"),
            slow_case(("advise", "--tries", "1"), reason="solves changed tasks"),
            slow_case(("plot", "gantt", "--out", "OUT.png"), reason="draws"),
            slow_case(("report", "--no-simulation", "--out", "OUT.html"), reason="draws a page"),
        ],
        ids=lambda words: words[0],
    )
    def test_a_task_that_is_gone_is_named_by_an_option(self, cli, tampered, board, tmp_path, words):
        """Each command that reads results has it, and says so."""
        path = tampered(lambda document: document["origin"].update(file="gone/board.yaml"))
        command, *more = (word.replace("OUT", str(tmp_path / "out")) for word in words)
        hint = "its task gone/board.yaml is neither here nor beside it. Copy it there, or name it"
        assert hint in cli(command, path, *more).refusal
        assert 0 == cli(command, path, *more, "--task", board).code

    @pytest.mark.parametrize("command", ["simulate", "advise", "export"])
    def test_a_task_file_is_its_own(self, cli, board, command):
        more = ("--to", "pddl", "--out", "x") if command == "export" else ("--sequence", "0")
        more = () if command == "advise" else more
        refusal = cli(command, board, *more, "--task", board).refusal
        assert f"--task names the task file of a result, but {board} is a task file." in refusal

    def test_a_task_beside_the_result_is_found(self, cli, tampered, board, result):
        """Where the path from here leads nowhere."""
        path = tampered(lambda document: document["origin"].update(file="gone/board.yaml"))
        (result.parent / "board.yaml").write_text(Path(board).read_text("utf-8"), "utf-8")
        assert {"holds"} == set(verified(cli, path).values())

    def test_a_result_of_no_file_is_verified_with_a_task_named(self, cli, tampered, board):
        """With the back ends that it says were asked."""
        path = tampered(lambda document: document.update(origin=None))
        assert {"holds"} == set(verified(cli, path, "--task", board).values())
