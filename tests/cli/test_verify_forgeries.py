"""verify against a forger: no result is valid if an essential claim was not checked."""

from __future__ import annotations

import contextlib
import copy
import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from skillplan.errors import SkillplanError
from skillplan.judge import LeastCost
from skillplan.pipeline import certify
from skillplan.records import Verdict
from skillplan.views.tables import render_csv_files

ROOT = Path(__file__).parents[2]
BOARD = str(ROOT / "configs/inverter_board.yaml")
SLIPPERY = """\
kind: assembly
name: slippery
robot: {home_m: [0.3, 0]}
tools: {t: {holder_m: [0.6, 0.2]}}
initial_tool: t
parts:
  a: {tool: t, size_m: [0.01, 0.01, 0.01], start_m: [0.4, -0.1], goal_m: [0.4, 0.1],
      grasp_failure: 0.3}
  b: {tool: t, size_m: [0.01, 0.01, 0.01], start_m: [0.5, -0.1], goal_m: [0.5, 0.1]}
"""
NO_PLAN: dict[str, Any] = {
    "cost": None,
    "lower_bound": None,
    "gap": None,
    "makespan": None,
    "makespan_s": None,
    "skills": [],
    "actions": [],
    "steps": [],
}
FREE = {**NO_PLAN, "cost": 0.0, "lower_bound": 0.0, "gap": 0.0, "makespan": 0, "makespan_s": 0.0}
Document = dict[str, Any]
Forge = Callable[[Document], None]


@pytest.fixture(scope="module")
def slippery(solved, tmp_path_factory):
    """A board with chance, its optimum and its policy."""
    folder = tmp_path_factory.mktemp("slippery")
    (folder / "slippery.yaml").write_text(SLIPPERY, "utf-8")
    return Path(solved(folder / "run", str(folder / "slippery.yaml")))


@pytest.fixture(scope="module")
def sop(solved, tmp_path_factory):
    """An instance of the sequential ordering problem."""
    folder = tmp_path_factory.mktemp("sop") / "run"
    return Path(solved(folder, str(ROOT / "configs/ESC12.sop"), "--solver", "exact"))


@pytest.fixture
def genuine(request, tmp_path):
    """A copy of the result of a fixture."""
    return Path(shutil.copytree(request.getfixturevalue(request.param), tmp_path / "forged"))


def forge(folder: Path, change: Forge) -> None:
    """Change the document of a result in place."""
    path = folder / "result.json"
    document = json.loads(path.read_text("utf-8"))
    change(document)
    path.write_text(json.dumps(document), "utf-8")


def verify(cli: Any, folder: Path, *words: str) -> tuple[int, str, dict[str, str]]:
    """Return the exit code, the verdict and the outcome of each claim."""
    outcome = cli("verify", str(folder), *words, "--format", "json")
    claims = {claim["claim"]: claim["outcome"] for claim in outcome.document["claims"]}
    return outcome.code, outcome.document["verdict"], claims


every_kind = pytest.mark.parametrize(
    "genuine", ["solved_board", "slippery", "sop", "solved_corner"], indirect=True
)
a_chain = pytest.mark.parametrize("genuine", ["solved_corner"], indirect=True)


class TestAChainOfNoParts:
    @every_kind
    @pytest.mark.parametrize("status", ["optimal", "infeasible", "unsolved"])
    def test_it_is_refuted_for_every_kind_of_task(self, cli, genuine, status):
        claims = FREE if status == "optimal" else NO_PLAN
        forge(genuine, lambda d: d.update(claims, status=status, sequences=[], stages=[]))
        code, verdict, outcomes = verify(cli, genuine)
        assert (1, "refuted", "fails") == (code, verdict, outcomes["parts"])

    @pytest.mark.parametrize("genuine", ["solved_board"], indirect=True)
    def test_a_single_task_has_no_parts_at_all(self, cli, genuine, solved_corner):
        """Parts of a valid chain make no valid result of another task."""
        chain = json.loads((solved_corner / "result.json").read_text("utf-8"))
        parts = {key: chain[key] for key in ("sequences", "stages", "replans")}
        forge(genuine, lambda d: d.update(parts))
        assert (1, "refuted") == verify(cli, genuine)[:2]

    @a_chain
    def test_a_chain_without_its_parts_is_no_single_task(self, cli, genuine):
        forge(genuine, lambda d: [d.pop(key) for key in ("sequences", "stages", "replans")])
        assert (1, "refuted") == verify(cli, genuine)[:2]


def _without_last(document: Document) -> None:
    document["sequences"].pop()


def _first_part_twice(document: Document) -> None:
    document["sequences"].insert(0, copy.deepcopy(document["sequences"][0]))


def _extra_part(document: Document) -> None:
    document["sequences"].append({**copy.deepcopy(document["sequences"][-1]), "name": "base-9"})


def _other_order(document: Document) -> None:
    document["sequences"].reverse()


def _stages_only(document: Document) -> None:
    document.update(sequences=[], cost=0.0, lower_bound=0.0, gap=0.0)


def _stages_as_sequences(document: Document) -> None:
    document["sequences"], document["stages"] = document["stages"], []


def _part_after_a_failed_one(document: Document) -> None:
    document["sequences"][0].update(NO_PLAN, status="unsolved")


def _reused_without_an_earlier_one(document: Document) -> None:
    document["sequences"][0]["reused_policy"] = True


@a_chain
@pytest.mark.parametrize(
    "change",
    [
        _without_last,
        _first_part_twice,
        _extra_part,
        _other_order,
        _stages_only,
        _stages_as_sequences,
        _part_after_a_failed_one,
        _reused_without_an_earlier_one,
    ],
)
def test_parts_of_a_chain_that_are_missing_extra_or_moved_are_refuted(cli, genuine, change):
    forge(genuine, change)
    assert (1, "refuted") == verify(cli, genuine)[:2]


@pytest.mark.parametrize("genuine", ["slippery"], indirect=True)
class TestChanceWithoutItsPolicy:
    @pytest.mark.parametrize("cost", [0.0, 0.5, 99.0])
    def test_an_optimal_cost_is_compared_with_the_value_of_all_states(self, cli, genuine, cost):
        (genuine / "policies.json").unlink()
        forge(genuine, lambda d: d.update(cost=cost, lower_bound=min(cost, d["lower_bound"])))
        code, verdict, outcomes = verify(cli, genuine)
        assert (1, "refuted", "fails") == (code, verdict, outcomes["cost"])

    def test_a_cost_below_the_least_is_refuted_without_a_claim_of_optimality(self, cli, genuine):
        (genuine / "policies.json").unlink()
        change = {"status": "solved", "cost": 0.5, "lower_bound": None, "gap": None}
        forge(genuine, lambda d: d.update(change))
        assert (1, "refuted") == verify(cli, genuine)[:2]

    def test_a_higher_cost_is_not_confirmed(self, cli, genuine):
        """Some policy may cost that much; which one was followed is unknown."""
        (genuine / "policies.json").unlink()
        change = {"status": "solved", "cost": 99.0, "lower_bound": None, "gap": None}
        change["bound_method"] = ""
        forge(genuine, lambda d: d.update(change))
        code, verdict, outcomes = verify(cli, genuine)
        assert (1, "not confirmed") == (code, verdict)
        assert "not checked" == outcomes["cost"] == outcomes["policies.json"]

    def test_even_the_right_cost_is_not_confirmed(self, cli, genuine):
        """The plan shows nominal outcomes only; off them there is nothing to execute."""
        (genuine / "policies.json").unlink()
        code, verdict, outcomes = verify(cli, genuine)
        assert (1, "not confirmed", "holds") == (code, verdict, outcomes["cost"])
        assert "not checked" == outcomes["policies.json"]

    def test_a_file_without_policies_or_with_two_of_a_task_is_refuted(self, cli, genuine):
        path = genuine / "policies.json"
        document = json.loads(path.read_text("utf-8"))
        for policies in ([], document["policies"] * 2):
            path.write_text(json.dumps({**document, "policies": policies}), "utf-8")
            code, verdict, outcomes = verify(cli, genuine)
            assert (1, "refuted", "fails") == (code, verdict, outcomes["policies.json"])


class TestAProofThatCannotBeRepeated:
    @pytest.fixture
    def large(self, cli, tmp_path):
        """A board of which no method takes all states."""
        path = tmp_path / "large.yaml"
        words = ("--parts", "40", "--density", "0.1", "--tools", "1", "--seed", "1")
        cli("generate", "assembly", *words, "--out", str(path))
        return path

    def claim(self, task: Path, folder: Path, **claims: Any) -> None:
        """Write a result that only claims."""
        from skillplan import load_problem

        problem = load_problem(str(task))
        (folder / "forged").mkdir()
        document = {
            "schema": "skillplan.result/1",
            "task": {"name": problem.name, "kind": problem.kind, "sha256": problem.sha256},
            "solver": "exact",
            "seed": 0,
            "physics": "kinematic",
            "collision": "aabb",
            "reason": "",
            "cost_unit": "m",
            "bound_method": "A*",
            "timed_by": "",
            "stats": {},
            "trace": {},
            **NO_PLAN,
            **claims,
        }
        (folder / "forged" / "result.json").write_text(json.dumps(document), "utf-8")

    def test_that_there_is_no_plan_is_not_confirmed(self, cli, large, tmp_path):
        """Nothing else is claimed, so that nothing was checked."""
        self.claim(large, tmp_path, status="infeasible")
        words = ("--task", str(large), "--time-limit", "0.2")
        code, verdict, outcomes = verify(cli, tmp_path / "forged", *words)
        assert (1, "not checked") == (code, outcomes["infeasible"])
        assert "valid" != verdict

    def test_the_optimum_of_a_plan_that_holds_is_not_confirmed(self, cli, large, tmp_path):
        """The plan and its cost hold, and the summary names what was not checked."""
        folder = tmp_path / "run"
        words = ("--solver", "exact", "--time-limit", "1", "--out", str(folder))
        cli("search-optimal", str(large), *words)
        forge(folder, lambda d: d.update(status="optimal", lower_bound=d["cost"], gap=0.0))
        forge(folder, lambda d: d.update(bound_method="audited", reason=""))
        code, verdict, outcomes = verify(cli, folder, "--time-limit", "0.2")
        assert (1, "not confirmed") == (code, verdict)
        assert ("holds", "not checked") == (outcomes["plan"], outcomes["optimal"])
        text = cli("verify", str(folder), "--time-limit", "0.2").out
        assert "verdict    NOT CONFIRMED: not checked: optimal" in text


class TestFilesBeside:
    @pytest.mark.parametrize(
        ("genuine", "name"),
        [("solved_board", "plan.csv"), ("solved_corner", "timeline.csv")],
        indirect=["genuine"],
    )
    def test_a_missing_table_is_named(self, cli, genuine, name):
        (genuine / name).unlink()
        code, verdict, outcomes = verify(cli, genuine)
        assert (0, "valid", "not checked") == (code, verdict, outcomes[name])
        assert f"valid, but for what was not checked: {name}" in cli("verify", str(genuine)).out

    def test_missing_policies_are_named_though_the_plan_needs_none(self, cli, tmp_path):
        """The result says that its solver gave a policy."""
        folder = tmp_path / "run"
        cli("search-optimal", BOARD, "--solver", "value-iteration", "--out", str(folder))
        assert "holds" == verify(cli, folder)[2]["policies.json"]
        (folder / "policies.json").unlink()
        code, _, outcomes = verify(cli, folder)
        assert (0, "not checked") == (code, outcomes["policies.json"])

    @pytest.mark.parametrize("genuine", ["solved_board"], indirect=True)
    def test_a_result_that_is_no_folder_of_its_own_needs_no_files(self, cli, genuine, tmp_path):
        """What --format json printed, redirected."""
        alone = shutil.copy(genuine / "result.json", tmp_path / "printed.json")
        assert {"holds"} == set(verify(cli, Path(alone))[2].values())


def test_options_that_made_another_task_of_the_file_are_shown(cli, tmp_path):
    folder = tmp_path / "run"
    words = ("--set", "goal=[placed(pcb)]", "--collision", "aabb", "-O", "aabb.tolerance_m=0.001")
    assert 0 == cli("search-optimal", BOARD, *words, "--out", str(folder)).code
    text = re.sub(r"\s+", " ", cli("verify", str(folder)).out)
    shown = "--set goal=[placed(pcb)] --collision aabb -O aabb.tolerance_m=0.001"
    assert f"task {BOARD} with {shown}" in text


@pytest.mark.parametrize("genuine", ["solved_board"], indirect=True)
class TestViewsOfAForgedResult:
    @pytest.fixture
    def forged(self, genuine):
        """A plan said to cost less than it does, with an auditor."""
        claims = {"cost": 0.1, "lower_bound": 0.1, "bound_method": "audited by TUEV"}
        forge(genuine, lambda d: d.update(claims))
        return genuine

    @pytest.mark.parametrize(
        "words",
        [("report", "{}", "--no-simulation", "--out", "page.html"), ("plot", "{}", "layout")],
        ids=["report", "plot"],
    )
    def test_what_is_refuted_is_not_shown(self, cli, forged, tmp_path, words):
        with contextlib.chdir(tmp_path):
            outcome = cli(*(word.format(forged) for word in words))
        assert (2, "") == (outcome.code, outcome.out)
        assert "is refuted: cost: the plan costs 1.867086014, claimed 0.1" in outcome.err
        assert {"forged"} == {path.name for path in tmp_path.iterdir()}

    def test_a_proof_that_was_not_repeated_is_a_claim_of_the_result(
        self, cli, genuine, tmp_path, monkeypatch
    ):
        """As for a board that is too large for the time limit."""
        given_up = LeastCost("a method", why_not="too large")
        monkeypatch.setattr("skillplan.judge.claim_check._find_least_cost", lambda *_: given_up)
        page = tmp_path / "page.html"
        assert 0 == cli("report", str(genuine), "--no-simulation", "--out", str(page)).code
        text = page.read_text("utf-8")
        assert "The result claims: A valid plan, proved to be the best." in text
        assert "Not verified: optimal (too large)." in text
        drawn = cli("plot", str(genuine), "layout", "--out", str(tmp_path / "layout.png"))
        assert (0, True) == (drawn.code, "not verified: optimal (too large)" in drawn.err)


@pytest.mark.parametrize("genuine", ["sop"], indirect=True)
def test_what_cannot_be_verified_is_marked_on_the_page(cli, genuine, tmp_path):
    forge(genuine, lambda d: d.update(bound_method="audited by TUEV"))
    page = tmp_path / "page.html"
    assert 0 == cli("report", str(genuine), "--no-simulation", "--out", str(page)).code
    text = page.read_text("utf-8")
    assert "Verified for this page." in text
    assert "audited by TUEV, says the result" in text


HOSTILE: list[Any] = [
    *(None, True, False, 0, 1, -1, 0.5, 1e308, -1e308, 10**280, -(10**280), 2**63),
    *("", "x", "optimal", "1", "\x1b[31m", [], {}, [[]], [None], {"a": 1}),
]
# verify lists these as unchecked, or ignores them in results of older versions.
UNCHECKED = re.compile(
    r"(solver|seed|bound_method|stats|trace|policy|proved_by|simulation|not_checked"
    r"|origin\.(file|set|options|screening))\b.*"
)


def nodes(value: Any, path: tuple[str | int, ...] = ()) -> list[tuple[str | int, ...]]:
    """Return the paths of all values in a document."""
    keys: Any = (
        value if isinstance(value, dict) else range(len(value)) if isinstance(value, list) else ()
    )
    paths = [path] if path else []
    return paths + [node for key in keys for node in nodes(value[key], (*path, key))]


@pytest.mark.parametrize("genuine", ["solved_board"], indirect=True)
@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.data())
def test_no_value_in_any_place_ends_in_an_error_or_is_believed(genuine, data):
    """Replaced, removed, doubled or moved; unless it is listed as unchecked."""
    path = genuine / "result.json"
    original = json.loads(path.read_text("utf-8"))
    forged = copy.deepcopy(original)
    place = data.draw(st.sampled_from(nodes(original)))
    holder: Any = forged
    for key in place[:-1]:
        holder = holder[key]
    value = data.draw(st.sampled_from(HOSTILE))
    change = data.draw(st.sampled_from(["replace", "remove", "double"]))
    if change == "replace":
        holder[place[-1]] = value
    elif change == "remove":
        del holder[place[-1]]
    elif isinstance(holder, list):
        holder.insert(int(place[-1]), holder[int(place[-1])])
    else:
        holder["extra"] = value
    try:
        path.write_text(json.dumps(forged), "utf-8")
        verdict = certify(str(genuine), saved_tables=render_csv_files).verdict
    except SkillplanError:
        return
    finally:
        path.write_text(json.dumps(original), "utf-8")
    unchecked = UNCHECKED.fullmatch(".".join(map(str, place))) is not None
    assert forged == original or verdict is not Verdict.VALID or unchecked
