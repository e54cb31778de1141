"""``explain TASK 'free(PART)'``: what is in the way of a part, from the relation beside a task."""

import json

import pytest

from skillplan.cli import run

TASK = """\
kind: assembly
name: tower
robot: {home_m: [0.3, 0.0], safe_height_m: 0.2}
tools:
  gripper: {opening_m: 0.080, holder_m: [0.5, 0.3]}
  cup: {type: suction, holder_m: [0.6, 0.3]}
initial_tool: gripper
parts:
  plate: {tool: cup, size_m: [0.10, 0.16, 0.02], start_m: [0.3, 0.2], goal_m: [0.5, 0.0]}
  post:
    {tool: gripper, size_m: [0.02, 0.02, 0.04], start_m: [0.4, -0.2], goal_m: [0.5, 0.0],
     goal_on: plate}
  cap:
    {tool: gripper, size_m: [0.03, 0.03, 0.01], start_m: [0.3, -0.2], goal_m: [0.5, 0.0],
     goal_on: post}
"""
AFTER_PLATE = "load(cup),pick(plate),place(plate)"
AXES = [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]]
# The file has the tower lying: its x points up in the task.
TURN = [[0, 0, -1], [0, 1, 0], [1, 0, 0]]


def blocked(part, by, direction, distance_mm, *, sensitive=False):
    """Return an entry of the relation, in the file's frame."""
    return {
        "part": part,
        "by": by,
        "direction": direction,
        "distance_mm": distance_mm,
        "width_mm": 8.0,
        "point_mm": [10.0, 0.0, 2.0],
        "sensitive": sensitive,
    }


@pytest.fixture
def tower(tmp_path):
    """A task with its relation: the post stands between plate and cap; screws hold nothing."""
    (tmp_path / "product.yaml").write_text(TASK)
    relation = {
        "schema": "skillplan.relation/1",
        "tolerance_mm": 0.1,
        "parts": [{"name": name} for name in ("PLATE 1", "POST", "CAP")],
        "directions": AXES,
        "blocked": [
            blocked("POST", "CAP", [1, 0, 0], 3.0),
            blocked("POST", "PLATE 1", [-1, 0, 0], 0.0),
            blocked("POST", "PLATE 1", [0, 1, 0], 5.0, sensitive=True),
            blocked("POST", "CAP", [0, 1, 0], 1.0),
            blocked("CAP", "POST", [-1, 0, 0], 0.0),
        ],
    }
    report = {
        "schema": "skillplan.import/1",
        "task_names": {"PLATE 1": "plate", "POST": "post", "CAP": "cap"},
        "placement": {"turn": TURN, "offset_mm": [500.0, 0.0, 20.0]},
    }
    (tmp_path / "relation.json").write_text(json.dumps(relation))
    (tmp_path / "report.json").write_text(json.dumps(report))
    return tmp_path / "product.yaml"


def told(capsys, *words):
    """Return the document and the exit code of a command."""
    code = run(["explain", *map(str, words), "--format", "json"])
    return json.loads(capsys.readouterr().out), code


def test_in_the_whole_product_each_direction_names_what_blocks_it_the_nearest_first(tower, capsys):
    """Directions and points are those of the task, in which the product stands."""
    messages, code = told(capsys, tower, "free(post)")
    assert code == 0
    assert messages["present"] == ["plate", "cap"]
    by = {tuple(direction["direction"]): direction for direction in messages["directions"]}
    up, side = by[0, 0, 1], by[0, 1, 0]
    assert [item["part"] for item in up["blocked_by"]] == ["cap"]
    assert up["in_file"] == [1, 0, 0]
    assert up["blocked_by"][0]["distance_mm"] == 3
    assert up["blocked_by"][0]["point_mm"] == [498, 0, 30]
    assert [entry["part"] for entry in side["blocked_by"]] == ["cap", "plate"]
    assert [element["sensitive"] for element in side["blocked_by"]] == [False, True]
    assert by[1, 0, 0]["free"]


def test_after_a_sequence_only_what_it_has_put_there_is_in_the_way(tower, capsys):
    """Up is free while the cap is not there; the sequence leads to the state as predicted."""
    messages, _ = told(capsys, tower, "free(post)", "--after", AFTER_PLATE)
    assert messages["present"] == ["plate"]
    free = [
        tuple(direction["direction"]) for direction in messages["directions"] if direction["free"]
    ]
    assert (0, 0, 1) in free
    assert (0, 0, -1) not in free


def test_what_is_blocked_in_all_directions_ends_with_code_1(tower, capsys):
    relation = json.loads((tower.parent / "relation.json").read_text())
    relation["blocked"] += [blocked("CAP", "POST", axis, 1.0) for axis in AXES]
    (tower.parent / "relation.json").write_text(json.dumps(relation))
    messages, code = told(capsys, tower, "free(cap)")
    assert code == 1
    assert not messages["free"]


def test_the_table_says_where_it_is_free_and_how_far_it_goes_elsewhere(tower, capsys):
    assert run(["explain", str(tower), "free(post)"]) == 0
    table = capsys.readouterr().out
    assert "tower: post is free along" in table
    assert "plate*" in table
    assert "* half or double the tolerance of 0.1 mm says otherwise" in table


@pytest.mark.parametrize("suffix", [".png", ".svg"])
def test_a_picture_shows_the_part_and_what_is_in_its_way(tower, tmp_path, capsys, suffix):
    path = tmp_path / f"post{suffix}"
    messages, _ = told(capsys, tower, "free(post)", "--picture", path)
    assert messages["files"] == {"picture": str(path)}
    if suffix == ".svg":
        assert "in its way" in path.read_text()
    else:
        assert path.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("part", "words"),
    [("pots", "there is no part 'pots'. Did you mean 'post'?"), ("", "there is no part ''")],
)
def test_an_unknown_part_is_refused_with_the_nearest(tower, capsys, part, words):
    assert run(["explain", str(tower), f"free({part})"]) == 2
    assert words in capsys.readouterr().err


def test_a_task_without_a_relation_is_told_what_to_ask_instead(tower, capsys):
    (tower.parent / "relation.json").unlink()
    assert run(["explain", str(tower), "free(post)"]) == 2
    error = capsys.readouterr().err
    assert "there is no relation.json beside it" in error
    assert "place(PART)" in error


@pytest.mark.parametrize("name", ["relation.json", "report.json"])
def test_a_damaged_file_is_named_with_the_remedy(tower, capsys, name):
    path = tower.parent / name
    document = json.loads(path.read_text())
    del document["blocked" if name == "relation.json" else "placement"]
    path.write_text(json.dumps(document))
    assert run(["explain", str(tower), "free(post)"]) == 2
    error = capsys.readouterr().err
    assert "Write it anew with `skillplan import-cad`" in error
    assert str(tower.parent / "relation.json") in error


def test_a_step_that_cannot_be_executed_is_named(tower, capsys):
    assert run(["explain", str(tower), "free(post)", "--after", "place(plate)"]) == 2
    assert "Step 1 of the sequence, place(plate), fails" in capsys.readouterr().err


def test_a_part_that_the_task_leaves_out_is_explained_by_its_name_in_the_file(tower, capsys):
    """It is in the way in the whole product, and never in place after a sequence."""
    report = json.loads((tower.parent / "report.json").read_text("utf-8"))
    del report["task_names"]["CAP"]
    report["left_out"] = {"CAP": "has no level face beneath it"}
    (tower.parent / "report.json").write_text(json.dumps(report))
    own, _ = told(capsys, tower, "free(CAP)")
    assert [way["blocked_by"][0]["part"] for way in own["directions"] if way["blocked_by"]] == [
        "post"
    ]
    whole, _ = told(capsys, tower, "free(post)")
    assert "CAP" in whole["present"]
    after, _ = told(capsys, tower, "free(post)", "--after", AFTER_PLATE)
    assert after["present"] == ["plate"]


def test_a_relation_without_a_task_answers_in_the_names_and_the_frame_of_the_file(tower, capsys):
    relation = tower.parent / "relation.json"
    document = json.loads(relation.read_text()) | {"stuck": ["CAP", "PLATE 1"]}
    relation.write_text(json.dumps(document))
    tower.unlink()
    (tower.parent / "report.json").unlink()
    answer, code = told(capsys, relation, "free(POST)")
    assert (code, answer["task"], answer["stuck"]) == (0, None, False)
    assert answer["present"] == ["PLATE 1", "CAP"]
    by = {tuple(direction["direction"]): direction for direction in answer["directions"]}
    assert by[1, 0, 0]["blocked_by"][0]["part"] == "CAP"
    assert by[1, 0, 0]["blocked_by"][0]["point_mm"] == [10, 0, 2]
    assert run(["explain", str(relation), "free(CAP)"]) == 0
    assert "no motion that import-cad searched frees it, nor PLATE 1" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["free(POS)"], "there is no part 'POS'. Did you mean 'POST'?"),
        (["place(POST)"], "is a relation, which has no skills: ask 'free(PART)'"),
        (["free(POST)", "--after", "0"], "--after needs a task"),
        (["free(POST)", "--picture", "a.png"], "Name its product.yaml instead"),
    ],
)
def test_a_relation_without_a_task_refuses_what_needs_one(tower, capsys, words, message):
    assert run(["explain", str(tower.parent / "relation.json"), *words]) == 2
    assert message in capsys.readouterr().err


def test_a_damaged_relation_is_named_with_the_remedy(tower, capsys):
    path = tower.parent / "relation.json"
    path.write_text(path.read_text().replace('"blocked"', '"blocks"'))
    assert run(["explain", str(path), "free(POST)"]) == 2
    assert "is damaged: KeyError('blocked'). Write it anew with" in capsys.readouterr().err
