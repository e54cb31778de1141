"""Every command on a TSPLIB file: what it prints has no units, no places and no times."""

import pytest

from sop_instances import FOLDER, instance_text

ESC07 = str(FOLDER / "ESC07.sop")
OPTIMUM = "0,3,1,6,5,4,2,7"


def test_a_plan_is_shown_in_plain_numbers(cli):
    """Without columns that no step has anything in."""
    done = cli("search-optimal", ESC07, "--solver", "exact")
    lines = [line.rstrip() for line in done.out.splitlines()]
    assert 0 == done.code
    assert "step   action   skill      weight" == lines[1]
    assert "   2        3   visit(4)       75" == lines[4]
    assert "cost       2125  (lower bound 2125, gap 0.00 %)" in lines
    assert f"sequence   {OPTIMUM}" in lines
    assert "plan       8 skills" in lines


def test_the_document_has_the_same_keys_as_ever(cli):
    """Its unit is an empty text."""
    document = cli("search-optimal", ESC07, "--solver", "exact", "--format", "json").document
    assert (2125.0, 2125.0, "") == tuple(
        document[key] for key in ("cost", "lower_bound", "cost_unit")
    )
    assert {"name": "ESC07", "kind": "sop"} == {
        key: document["task"][key] for key in ("name", "kind")
    }
    assert ["visit(1)", "visit(4)"] == document["skills"][:2]


def test_solvers_are_compared_in_plain_numbers(cli):
    """Brute force counts the orders, and q-learning finds one."""
    done = cli("compare", ESC07, "--solvers", "exact,exhaustive,q-learning")
    assert 0 == done.code
    assert ["solver", "status", "cost", "gap"] == done.out.splitlines()[1].split()[:4]
    assert "exhaustive: sequences  252 complete ones: 252 of 8 skills" in done.out
    assert "exhaustive: worst      3400 among those of 8 skills" in done.out


def test_a_sequence_is_replayed(cli):
    """Against the proved optimum; one that breaks the order is told what comes before."""
    done = cli("evaluate", ESC07, "--sequence", OPTIMUM)
    assert 0 == done.code
    assert "cost       2125\n" in done.out
    assert "0.00 % of the proved optimum 2125\n" in done.out
    wrong = cli("evaluate", ESC07, "--sequence", "0,4")
    assert 1 == wrong.code
    assert "at step 2 (visit(5)): precondition: needs visited(4), visited(6), " in wrong.out


def test_the_chart_is_the_order_of_the_file(cli):
    """Reduced in the table."""
    rows = cli("chart", ESC07, "--format", "csv").out.splitlines()
    assert "4,5,-,visit(5),visit(5) needs visited(4)" in rows
    assert 1 + 9 == len(rows)


def test_a_skill_is_explained_by_what_it_needs(cli):
    """Nothing but its precondition stands against it."""
    done = cli("explain", ESC07, "visit(5)")
    assert 1 == done.code
    assert "needs visited(4), visited(6), visited(7)" in done.out


@pytest.mark.parametrize("name", ["ESC07", "rbg253a"])
def test_a_file_is_checked(cli, name):
    """Small or large."""
    done = cli("check", str(FOLDER / f"{name}.sop"))
    assert (0, f"{name}: valid") == (done.code, done.out.splitlines()[0])


def test_a_malformed_file_is_one_line_and_code_2(cli, tmp_path):
    """With file, line and column."""
    path = tmp_path / "bad.sop"
    path.write_text(instance_text("ESC07").replace("TYPE: SOP", "TYPE: TSP", 1))
    refusal = cli("check", str(path)).refusal
    assert refusal.startswith(f"skillplan: error: {path}:2:1: TYPE must be SOP, not 'TSP'.")
    assert 1 == len(refusal.splitlines())


def test_what_simulates_arms_refuses_it_in_one_line(cli):
    """There is no arm."""
    refusal = cli("simulate", ESC07, "--sequence", OPTIMUM).refusal
    assert 1 == len(refusal.splitlines())


def test_a_misspelt_file_is_answered_with_the_nearest(cli):
    """Files of costs are among those that are named."""
    assert "Did you mean 'ESC07.sop'?" in cli("check", str(FOLDER / "ESC0.sop")).refusal
