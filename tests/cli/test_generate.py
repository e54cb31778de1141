"""``skillplan generate``: task files at random, to stdout or to a new file."""

from __future__ import annotations

import os

import pytest

FIVE = ("generate", "assembly", "--parts", "5", "--density", "0.3", "--tools", "2")


def test_stdout_and_file_hold_the_same(cli, tmp_path):
    """And the file is what check takes and search-optimal proves the optimum of."""
    shown = cli(*FIVE, "--seed", "4")
    path = tmp_path / "five.yaml"
    written = cli(*FIVE, "--seed", "4", "--out", str(path))
    assert (0, "", 0, "") == (shown.code, shown.err, written.code, written.err)
    assert shown.out == path.read_text("utf-8")
    assert f"{path}: 5 parts and 2 tools; 3 of 10 pairs of parts ordered\n" == written.out
    first, second = shown.out.splitlines()[:2]
    assert "# yaml-language-server: $schema=assembly.schema.json" == first
    assert second.endswith(
        ": skillplan generate assembly --parts 5 --density 0.3 --tools 2 --seed 4"
    )
    assert 0 == cli("check", str(path)).code
    solved = cli("search-optimal", str(path), "--solver", "exact", "--format", "json")
    assert (0, "optimal") == (solved.code, solved.document["status"])


def test_its_chart_is_derived_again_from_itself(cli, tmp_path):
    """By the boxes of the parts there is none."""
    path = tmp_path / "five.yaml"
    cli(*FIVE, "--out", str(path))
    assert "equals the hand-made" in cli("chart", str(path), "--collision", "precedence").out
    assert "missing 3, extra 0" in cli("chart", str(path)).out


def test_a_name_is_the_tasks(cli):
    """And part of the command line that the file names."""
    out = cli(*FIVE, "--name", "my-board").out
    assert "\nname: my-board\n" in out
    assert "--seed 0 --name my-board\n" in out


def test_grasps_may_fail(cli, tmp_path):
    """And replan takes the board; a wrong range is told so."""
    path = tmp_path / "missed.yaml"
    words = (*FIVE, "--failures", "0.1:0.4", "--failing-share", "0.4")
    written = cli(*words, "--out", str(path))
    assert written.out.endswith("; 2 grasps may fail\n")
    assert "--failures 0.1:0.4 --failing-share 0.4\n" in path.read_text("utf-8")
    solved = cli("search-optimal", str(path), "--solver", "replan", "--format", "json")
    assert (0, "solved") == (solved.code, solved.document["status"])
    assert solved.document["lower_bound"] <= solved.document["cost"]
    assert 2_000 == solved.document["trace"]["expected_cost"]["roll_outs"]
    assert (
        "must be LEAST:GREATEST below 1, such as 0.1:0.4, not 0.4:0.1"
        in cli(*FIVE, "--failures", "0.4:0.1").refusal
    )


def test_no_file_is_overwritten(cli, tmp_path):
    """Not even one that leads nowhere."""
    there, link = tmp_path / "there.yaml", tmp_path / "link.yaml"
    there.write_text("mine")
    link.symlink_to(tmp_path / "nowhere.yaml")
    for path in (there, link):
        assert (
            f"error: --out {path}: is there already. Name a new file.\n"
            in cli(*FIVE, "--out", str(path)).refusal
        )
    assert "mine" == there.read_text()
    assert not (tmp_path / "nowhere.yaml").exists()


@pytest.mark.parametrize("words", [FIVE, ("init", "assembly")])
def test_nor_is_one_that_another_program_writes_meanwhile(cli, tmp_path, monkeypatch, words):
    """The other was there first, when all but the name was ready."""
    path, sync = tmp_path / "board.yaml", os.fsync

    def meanwhile(descriptor: int) -> None:
        if not path.exists():
            path.write_text("theirs")
        sync(descriptor)

    monkeypatch.setattr(os, "fsync", meanwhile)
    assert (
        f"error: --out {path}: is there already. Name a new file.\n"
        in cli(*words, "--out", str(path)).refusal
    )
    assert "theirs" == path.read_text()
    assert [path] == list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("out", "message"),
    [
        ("a.txt", "task files are not saved as .txt; end it in .yaml or .yml."),
        ("", "does not say which format"),
        ("nowhere/a.yaml", "there is no folder nowhere. Make it first."),
        ("a\0b.yaml", "cannot be used: embedded null byte."),
        ("\ud800.yaml", "cannot be used: 'utf-8' codec can't encode"),
        ("a" * 5000 + ".yaml", "cannot be used: File name too long."),
    ],
)
def test_a_file_that_cannot_be_is_refused(cli, tmp_path, monkeypatch, out, message):
    """Before anything is made."""
    monkeypatch.chdir(tmp_path)
    assert message in cli(*FIVE, "--out", out).refusal
    assert [] == list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ((), "Missing option '--parts'"),
        (("--parts", "3"), "Missing option '--density'"),
        (("--parts", "0", "--density", "0"), "'--parts': 0 is not in the range 1<=x<=256."),
        (("--parts", "257", "--density", "0"), "'--parts': 257 is not in the range 1<=x<=256."),
        (("--parts", "x", "--density", "0"), "'--parts': 'x' is not a whole number"),
        (("--parts", "3", "--density", "nan"), "'--density': must be from 0 to 1, not nan."),
        (("--parts", "3", "--density", "1.1"), "'--density': must be from 0 to 1, not 1.1."),
        (("--parts", "3", "--density", "half"), "'--density': 'half' is not a number."),
        (("--parts", "3", "--density", "0", "--tools", "9"), "'--tools': 9 is not in the range"),
        (("--parts", "3", "--density", "0", "--seed", "-1"), "'--seed': -1 is not in the range"),
        (("--parts", "3", "--density", "0", "--name", "3x"), "'3x' cannot be the name of a task"),
    ],
)
def test_a_wrong_value_is_one_clear_message(cli, words, message):
    """With the range, and nothing on stdout."""
    assert message in cli("generate", "assembly", *words).refusal


def test_the_kinds_are_listed_and_the_nearest_is_named(cli):
    """Without one, and where there is no such one."""
    listed = cli("generate")
    assert 2 == listed.code
    assert "│ assembly  Write an assembly task with N parts to be picked and placed" in listed.out
    assert (
        "No such command 'asembly'. Did you mean 'assembly'?" in cli("generate", "asembly").refusal
    )
