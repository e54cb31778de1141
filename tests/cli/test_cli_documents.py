"""The JSON documents: every key of the design, with the right type, and nothing beside."""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from thinned import thinned

NUMBER: dict[str, Any] = {"type": "number"}
MAYBE_NUMBER: dict[str, Any] = {"type": ["number", "null"]}
COUNT: dict[str, Any] = {"type": "integer", "minimum": 0}
MAYBE_COUNT: dict[str, Any] = {"type": ["integer", "null"], "minimum": 0}
TEXT: dict[str, Any] = {"type": "string"}
MAYBE_TEXT: dict[str, Any] = {"type": ["string", "null"]}
FLAG: dict[str, Any] = {"type": "boolean"}
SHA256: dict[str, Any] = {"type": "string", "pattern": "^[0-9a-f]{64}$"}


def many(items: dict[str, Any]) -> dict[str, Any]:
    return {"type": "array", "items": items}


def record(**properties: Any) -> dict[str, Any]:
    """Return the schema of an object with these keys; more may be added, never fewer."""
    return {"type": "object", "properties": properties, "required": list(properties)}


def one_of(*values: Any) -> dict[str, Any]:
    return {"enum": list(values)}


POINT = {
    "anyOf": [{"type": "null"}, {"type": "array", "items": NUMBER, "minItems": 3, "maxItems": 3}]
}
TASK = record(name=TEXT, kind=one_of("assembly"), sha256=SHA256)
STEP = record(
    index=COUNT,
    skill=TEXT,
    action=COUNT,
    start=POINT,
    goal=POINT,
    cost={"type": "number", "minimum": 0},
    duration_s={"type": "number", "minimum": 0},
)
ORIGIN = record(
    file=TEXT,
    part=MAYBE_TEXT,
    set={"type": "object", "additionalProperties": TEXT},
    physics=MAYBE_TEXT,
    collision=many(TEXT),
    options={"type": "object", "additionalProperties": {"type": "object"}},
)
RESULT = record(
    schema=one_of("skillplan.result/1"),
    task=TASK,
    origin=ORIGIN,
    solver=TEXT,
    seed=COUNT,
    physics=TEXT,
    collision=TEXT,
    status=one_of("optimal", "solved", "infeasible", "unsolved", "refused", "wrong"),
    reason=TEXT,
    proved_by=many(TEXT),
    simulation=one_of(None),
    not_checked=many(TEXT),
    cost=MAYBE_NUMBER,
    cost_unit=TEXT,
    lower_bound=MAYBE_NUMBER,
    bound_method=TEXT,
    gap=MAYBE_NUMBER,
    makespan=MAYBE_COUNT,
    makespan_s=MAYBE_NUMBER,
    timed_by=TEXT,
    skills=many(TEXT),
    actions=many(COUNT),
    steps=many(STEP),
    stats=record(
        states=COUNT,
        expanded=MAYBE_COUNT,
        checks=COUNT,
        cache_hits=COUNT,
        trajectories=COUNT,
        wall_s=NUMBER,
    ),
    trace={"type": "object"},
    policy=FLAG,
)
VERIFICATION = record(
    schema=one_of("skillplan.verification/1"),
    file=TEXT,
    task=TASK,
    claims=many(
        record(
            claim=TEXT, outcome=one_of("holds", "fails", "not checked"), detail=TEXT, method=TEXT
        )
    ),
    origin=ORIGIN,
    verdict=one_of("valid", "refuted", "not confirmed"),
    valid=FLAG,
)
EVALUATION = record(
    schema=one_of("skillplan.evaluation/1"),
    task=TASK,
    feasible=FLAG,
    complete=FLAG,
    cost=NUMBER,
    cost_unit=TEXT,
    optimum=MAYBE_NUMBER,
    deviation=MAYBE_NUMBER,
    lower_bound=MAYBE_NUMBER,
    bound_method=TEXT,
    gap=MAYBE_NUMBER,
    makespan=COUNT,
    makespan_s=NUMBER,
    reward=MAYBE_NUMBER,
    actions=many(COUNT),
    steps=many(STEP),
    violations=many(
        record(step=COUNT, skill=MAYBE_TEXT, stage=TEXT, reason=TEXT, facts=many(TEXT))
    ),
)
COMPARISON = record(schema=one_of("skillplan.comparison/1"), warm=FLAG, rows=many(RESULT))
PAIR = record(before=TEXT, after=TEXT)
CHART = record(
    schema=one_of("skillplan.chart/1"),
    task=TASK,
    back_ends=many(TEXT),
    relations=many(record(before=TEXT, after=TEXT, reason=TEXT, evidence={"type": "object"})),
    hand_made=many(PAIR),
    missing=many(PAIR),
    extra=many(record(before=TEXT, after=TEXT, reason=TEXT)),
    impossible={"type": "object", "additionalProperties": TEXT},
    undecided=many(TEXT),
    conditional={"type": "object", "additionalProperties": many(TEXT)},
)
EXPLANATION = record(
    schema=one_of("skillplan.explanation/1"),
    task=record(name=TEXT, sha256=SHA256),
    skill=TEXT,
    action=COUNT,
    state=many(TEXT),
    status=one_of("feasible", "infeasible", "unknown"),
    stage=MAYBE_TEXT,
    reason=MAYBE_TEXT,
    precondition=TEXT,
    prediction=record(add=many(TEXT), delete=many(TEXT)),
    otherwise=many(record(probability=NUMBER, add=many(TEXT), delete=many(TEXT))),
    stages=many(
        record(
            stage=TEXT,
            status=one_of("feasible", "infeasible", "unknown"),
            reason=MAYBE_TEXT,
            present=many(TEXT),
            absent=many(TEXT),
            evidence={"type": "object"},
        )
    ),
)
CHECK = record(
    schema=one_of("skillplan.check/1"),
    task=TASK,
    valid=one_of(True),
    tasks=many(
        record(
            name=TEXT,
            skills=COUNT,
            facts=COUNT,
            observation=COUNT,
            step_limit=COUNT,
            back_ends=many(TEXT),
        )
    ),
    precedence=many(
        record(
            task=TEXT,
            back_ends=many(TEXT),
            pairs=COUNT,
            cycle=many(TEXT),
            never_feasible={"type": "object"},
        )
    ),
    warnings=many(TEXT),
)
PLUGINS = record(
    schema=one_of("skillplan.plugins/1"),
    plugins=many(
        record(
            kind=one_of(
                "domain", "physics", "collision", "solver", "executor", "exporter", "sampler"
            ),
            name=TEXT,
            distribution=TEXT,
            version=TEXT,
            summary=TEXT,
            problem=MAYBE_TEXT,
        )
    ),
    options={"type": ["object", "null"]},
)
ERROR = record(
    schema=one_of("skillplan.error/1"),
    error=TEXT,
    message=TEXT,
    exit_code=COUNT,
    issues=many(
        record(
            file=TEXT,
            line=MAYBE_COUNT,
            column=MAYBE_COUNT,
            path=many({"type": ["string", "integer"]}),
            message=TEXT,
        )
    ),
)

OPTIMUM = "0,1,2,3,4,5,8,9,10,11,6,7,13,14,15"
CALLS: dict[str, tuple[int, dict[str, Any], tuple[str, ...]]] = {
    "search-optimal": (0, RESULT, ("search-optimal", "BOARD")),
    "search without a plan": (
        1,
        RESULT,
        ("search-optimal", "MOTOR", "--solver", "exhaustive", "--time-limit", "0.05"),
    ),
    "search with proof that there is none": (1, RESULT, ("search-optimal", "NO_WAY")),
    "evaluate": (0, EVALUATION, ("evaluate", "BOARD", "--sequence", OPTIMUM)),
    "evaluate infeasible": (1, EVALUATION, ("evaluate", "BOARD", "--sequence", "0,3")),
    "evaluate incomplete": (1, EVALUATION, ("evaluate", "BOARD", "--sequence", "0,1")),
    "compare": (0, COMPARISON, ("compare", "BOARD", "--solvers", "exhaustive,exact")),
    "check": (0, CHECK, ("check", "MOTOR")),
    "explain": (0, EXPLANATION, ("explain", "BOARD", "pick(pcb)")),
    "explain infeasible": (1, EXPLANATION, ("explain", "BOARD", "place(pcb)")),
    "chart": (0, CHART, ("chart", "BOARD")),
    "plugins": (0, PLUGINS, ("plugins",)),
    "plugin options": (0, PLUGINS, ("plugins", "solver", "exact")),
    "unknown skill": (2, ERROR, ("explain", "BOARD", "pick(pbc)")),
    "no such file": (2, ERROR, ("check", "nowhere.yaml")),
    "wrong option": (2, ERROR, ("search-optimal", "BOARD", "--gap", "7")),
    "unknown command": (2, ERROR, ("serch", "BOARD")),
}


@pytest.mark.parametrize(
    "call",
    thinned(
        CALLS,
        *(item for item in CALLS if item not in ("compare", "check", "evaluate incomplete")),
        why="searches again; others in every run",
    ),
)
def test_stdout_is_one_document_of_the_schema(cli, board, motor, no_way, call):
    """Every key is there with its type, and stdout holds nothing else."""
    code, schema, words = CALLS[call]
    places = {"BOARD": board, "MOTOR": motor, "NO_WAY": no_way}
    outcome = cli(*(places.get(word, word) for word in words), "--format", "json")
    assert code == outcome.code
    jsonschema.Draft202012Validator(schema).validate(outcome.document)
    assert (code == 2) == bool(outcome.err)


@pytest.mark.parametrize(("shift", "code"), [(0.0, 0), (1.0, 1)])
def test_a_verification_is_one_document_of_the_schema(cli, board, tmp_path, shift, code):
    """Whether the claims hold or not."""
    folder = tmp_path / "run"
    document = cli("search-optimal", board, "--out", str(folder), "--format", "json").document
    document["cost"] += shift
    (folder / "result.json").write_text(json.dumps(document), "utf-8")
    outcome = cli("verify", str(folder), "--format", "json")
    assert code == outcome.code
    jsonschema.Draft202012Validator(VERIFICATION).validate(outcome.document)


@pytest.mark.parametrize("spelling", [("--format", "json"), ("--format=json",)])
def test_a_wrong_file_gives_a_document_with_positions(cli, tmp_path, board, spelling):
    """The faults on stderr stand in the document, too, each with line and column."""
    text = Path(board).read_text("utf-8").replace("reach_m: 0.855", "reach_m: -1")
    path = tmp_path / "short_arm.yaml"
    path.write_text(text, encoding="utf-8")
    outcome = cli("check", str(path), *spelling)
    assert 2 == outcome.code
    jsonschema.Draft202012Validator(ERROR).validate(outcome.document)
    (issue,) = outcome.document["issues"]
    assert (13, ["robot", "reach_m"]) == (issue["line"], issue["path"])
    assert f"{path}:13:{issue['column']}: robot.reach_m" in outcome.err


def test_a_result_is_consistent_in_itself(cli, board):
    """Steps, skills and actions agree, and their costs and durations add up."""
    document = cli("search-optimal", board, "--format", "json").document
    steps = document["steps"]
    assert document["skills"] == [step["skill"] for step in steps]
    assert document["actions"] == [step["action"] for step in steps]
    assert list(range(15)) == [step["index"] for step in steps]
    assert 15 == document["makespan"]
    assert sum(s["cost"] for s in steps) == pytest.approx(document["cost"])
    assert sum(s["duration_s"] for s in steps) == pytest.approx(document["makespan_s"])
    assert all(a["goal"][:2] == b["start"][:2] for a, b in pairwise(steps))
    assert document["lower_bound"] == pytest.approx(document["cost"])
    assert 0 == document["gap"]
    assert ("m", "kinematic", "precedence", "auto") == (
        document["cost_unit"],
        document["physics"],
        document["collision"],
        document["solver"],
    )


def test_a_document_names_the_task_by_its_content(cli, board):
    """All commands give the same hash of the same file."""
    hashes = {
        cli(*words, "--format", "json").document["task"]["sha256"]
        for words in (
            ("search-optimal", board),
            ("check", board),
            ("chart", board),
            ("explain", board, "0"),
            ("evaluate", board, "--sequence", "0"),
        )
    }
    assert 1 == len(hashes)


def test_the_deviation_is_a_fraction_of_the_optimum(cli, board):
    """0.0070 is 0.70 %."""
    sequence = "0,1,4,5,2,3,8,9,10,11,6,7,13,14,15"
    document = cli("evaluate", board, "--sequence", sequence, "--format", "json").document
    assert "0.0070" == f"{document['deviation']:.4f}"
    assert document["cost"] / document["optimum"] - 1 == pytest.approx(document["deviation"])


def test_seed_and_options_show_in_the_document(cli, board):
    """What was asked for can be read off the result."""
    words = ("--seed", "7", "--collision", "aabb,precedence", "-O", "aabb.tolerance_m=0.0001")
    document = cli("search-optimal", board, *words, "--format", "json").document
    assert 7 == document["seed"]
    assert "aabb,precedence" == document["collision"]
