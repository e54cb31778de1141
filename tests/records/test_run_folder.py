"""Folders of runs as they are read: all of it, and one clear error for whatever is wrong."""

import json
import shutil
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from skillplan.errors import OptionError
from skillplan.pipeline import load_problem
from skillplan.records import (
    FiguresRecord,
    RunFolder,
    RunMetrics,
    format_metrics_line,
    get_copy_name,
    parse_metrics,
    read_metrics,
)
from skillplan.solvers import Episode
from sop_instances import FOLDER
from tabular_learner import learner_installed
from training_situations import BOARD, train


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    """The folder of a short training of seven runs, one of which has failed."""
    folder = tmp_path_factory.mktemp("kept")
    with pytest.MonkeyPatch.context() as patch, learner_installed(folder / "site", patch):
        train(folder / "run", {"fails": "3@150"}, steps=300, checkpoint_steps=100)
    return folder / "run"


@pytest.fixture
def run_dir(kept, tmp_path):
    """The same, to be changed freely."""
    return Path(shutil.copytree(kept, tmp_path / "run"))


def test_all_that_was_asked_is_there(kept):
    manifest = RunFolder(kept).manifest
    assert ("tabular", 300, tuple(range(7))) == (manifest.solver, manifest.steps, manifest.seeds)
    assert ("markov", "applicable", "reward") == (
        manifest.observation,
        manifest.mask,
        manifest.objective,
    )
    assert ("kinematic", ("precedence",)) == (manifest.physics, manifest.collision)
    assert {"python", "skillplan", "numpy", "tabular-learner"} == set(manifest.versions)
    assert "inverter-board" == manifest.task.name


def test_every_run_is_there_with_its_policies(kept):
    folder = RunFolder(kept)
    runs = folder.runs()
    assert list(range(7)) == [run.run for run in runs] == [item.seed for item in runs]
    assert [3] == [entry.run for entry in runs if entry.failure]
    assert all(element.policy is not None and element.last is not None for element in runs)
    assert all(
        (value.best is None) == (value.policy.kept == "last") for value in runs if value.policy
    )
    assert runs[2].episodes == folder.run(2).episodes
    with pytest.raises(OptionError, match="has no run 7, only 0 to 6"):
        folder.run(7)


def test_the_task_is_loaded_from_where_it_was_or_else_from_the_copy(run_dir):
    assert str(BOARD) == RunFolder(run_dir).source
    manifest = json.loads((run_dir / "manifest.json").read_text())
    manifest["task"]["path"] = str(run_dir / "gone.yaml")
    (run_dir / "manifest.json").write_text(json.dumps(manifest))
    assert str(run_dir / "task.yaml") == RunFolder(run_dir).source


def test_a_copy_keeps_the_suffix_by_which_it_is_read(tmp_path):
    source = Path(shutil.copy(FOLDER / "ESC07.sop", tmp_path / "learned.sop"))
    with pytest.MonkeyPatch.context() as patch, learner_installed(tmp_path / "site", patch):
        train(tmp_path / "run", steps=100, checkpoint_steps=100, source=source)
    source.unlink()
    folder = RunFolder(tmp_path / "run")
    assert str(tmp_path / "run" / "task.sop") == folder.source
    assert folder.manifest.task.sha256 == load_problem(folder.source).sha256


@pytest.mark.parametrize(
    ("source", "name"),
    [
        ("a.yaml", "task.yaml"),
        ("b/a.yml", "task.yaml"),
        ("a", "task.yaml"),
        ("a.json", "task.yaml"),
        ("A.SOP", "task.sop"),
    ],
)
def test_a_copy_takes_the_name_of_no_other_file(source, name):
    assert name == get_copy_name(source)


def test_a_run_that_is_damaged_says_so_and_the_others_are_read(run_dir):
    path = run_dir / "runs" / "02" / "policy.safetensors"
    path.write_bytes(b"")
    with pytest.raises(OptionError, match="is damaged"):
        RunFolder(run_dir).run(2)
    runs = RunFolder(run_dir).runs()
    assert runs[2].failure.startswith(f"{path}: is damaged")
    assert runs[3].policy is not None


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"schema": "skillplan.run/2"}, "another version, skillplan.run/2; this skillplan reads"),
        ({"schema": "skillplan.sweep/1"}, "is no document skillplan.run/1"),
        ({"steps": 0}, "steps"),
        ({"steps": 400}, "the option steps is not the number of steps"),
        ({"groups": [[0, 1]]}, "the groups do not hold every run once"),
        ({"seeds": []}, "seeds"),
        ({"options": {"steps": 300}}, "an option of observation, mask, objective is missing"),
        ({"task": {"name": "a"}}, "task.kind"),
        ({"surplus": 1}, "surplus"),
    ],
)
def test_a_manifest_that_makes_no_sense_is_named(run_dir, change, message):
    path = run_dir / "manifest.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), **change}))
    with pytest.raises(OptionError) as caught:
        RunFolder(run_dir)
    assert str(caught.value).startswith(f"{path}: is ")
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["manifest.json", "task.json", "result.json"])
@pytest.mark.parametrize("content", [b"", b"{", b"[]", b"\xff\xfe", b"[" * 100_000])
def test_a_document_that_is_no_json_is_named(run_dir, name, content):
    (run_dir / name).write_bytes(content)
    with pytest.raises(OptionError) as caught:
        RunFolder(run_dir).result()
    assert str(caught.value).startswith(f"{run_dir / name}: is ")
    assert "\n" not in str(caught.value)


def test_what_is_no_folder_of_runs_is_named(tmp_path):
    with pytest.raises(OptionError, match="there is no such folder"):
        RunFolder(tmp_path / "nowhere")
    with pytest.raises(OptionError, match=r"holds no manifest.json"):
        RunFolder(tmp_path)
    with pytest.raises(OptionError, match="there is no such folder"):
        RunFolder(tmp_path / "\0")


@pytest.mark.parametrize(
    "name", ["runs/02/metrics.jsonl", "runs/02/policy.json", "runs/02/policy.safetensors"]
)
def test_a_link_that_leads_out_of_the_folder_is_not_followed(run_dir, name):
    """The run is told as failed, in words that name the file; the others are read."""
    outside = run_dir.parent / "outside"
    (run_dir / name).rename(outside)
    (run_dir / name).symlink_to(outside)
    run = RunFolder(run_dir).runs()[2]
    assert f"{run_dir / name}: cannot be read: a link leads out of the folder" in run.failure


def test_nor_is_that_of_the_manifest(run_dir):
    """Though it is what makes the folder one of runs."""
    outside = run_dir.parent / "outside"
    (run_dir / "manifest.json").rename(outside)
    (run_dir / "manifest.json").symlink_to(outside)
    with pytest.raises(OptionError, match="cannot be read: a link leads out of the folder"):
        RunFolder(run_dir)


# What runs note: lines that come back as they were, and damage that is named.


FINITE = st.floats(allow_nan=False, allow_infinity=False)
EPISODES = st.builds(
    Episode,
    run=st.just(3),
    step=st.integers(1, 10**9),
    end=st.sampled_from(["complete", "infeasible", "out-of-time"]),
    actions=st.lists(st.integers(0, 500), max_size=30).map(tuple),
    cost=FINITE,
    reward=FINITE,
    greedy=st.booleans(),
)
GOOD = format_metrics_line(Episode(0, 7, "complete", (0, 1), 1.5, 10.0, True))


@given(st.lists(EPISODES, max_size=8), st.dictionaries(st.text(min_size=1), FINITE, max_size=4))
def test_every_line_comes_back_as_it_was(episodes, figures):
    episodes.sort(key=lambda first: first.step)
    figures = {name: value for name, value in figures.items() if name not in ("kind", "step")}
    record = FiguresRecord(10**9, figures)
    lines = [format_metrics_line(episode) for episode in (*episodes, record)]
    assert all("\n" not in line for line in lines)
    assert RunMetrics(tuple(episodes), (record,)) == parse_metrics(lines, Path("a"), 3)


def test_figures_that_are_not_finite_are_left_out():
    line = format_metrics_line(
        FiguresRecord(5, {"loss": float("nan"), "q": 1.0, "far": float("inf")})
    )
    (result,) = parse_metrics([line], Path("a"), 0).figures
    assert FiguresRecord(5, {"q": 1.0}) == result


def test_an_episode_whose_cost_is_not_finite_is_refused():
    with pytest.raises(ValueError, match="JSON"):
        format_metrics_line(Episode(0, 7, "complete", (0, 1), float("nan"), 10.0, True))


def test_a_run_that_has_noted_nothing_has_no_metrics(tmp_path):
    assert RunMetrics() == read_metrics(tmp_path / "metrics.jsonl", 0)


def test_a_piece_of_a_line_at_the_end_is_left_out(tmp_path):
    """Wherever the line is cut, and where only its end is missing."""
    for length in range(1, len(GOOD) + 1):
        path = tmp_path / f"{length}.jsonl"
        path.write_text(f"{GOOD}\n{GOOD[:length]}")
        assert parse_metrics([GOOD], path, 0) == read_metrics(path, 0), length


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("{", "["),
        ('"episode"', '"epsiode"'),
        ('"complete"', '"lost"'),
        ('"step":7', '"step":0'),
        ('"step":7', '"step":3'),
        ('"step":7', '"step":"7"'),
        ('"length":2', '"length":3'),
        ('"actions":[0,1]', '"actions":[0,-1]'),
        ('"actions":[0,1]', '"actions":[0,1.5]'),
        ('"actions":[0,1]', '"actions":null'),
        ('"cost":1.5', '"cost":NaN'),
        ('"cost":1.5', '"cost":true'),
        ('"reward":10.0', '"reword":10.0'),
        ('"greedy":true', '"greedy":1'),
        (GOOD, "7"),
        (GOOD, "[" * 5_000),
    ],
)
def test_another_damaged_line_is_named(tmp_path, old, new):
    path = tmp_path / "metrics.jsonl"
    bad = GOOD.replace(old, new)
    assert bad != GOOD
    before = GOOD.replace('"step":7', '"step":5')
    path.write_text(f"{before}\n{bad}\n{GOOD}\n")
    with pytest.raises(OptionError) as caught:
        read_metrics(path, 0)
    assert str(caught.value).startswith(f"{path}:2: is damaged: ")
    assert "\n" not in str(caught.value)
