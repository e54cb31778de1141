"""plugins and schema: what is installed, what is broken and why, and which options there are."""

import json

import pytest

from skillplan import __version__
from skillplan.pipeline import registry

BUILT_IN = {
    ("domain", "assembly"),
    ("physics", "kinematic"),
    ("collision", "aabb"),
    ("collision", "precedence"),
    ("solver", "exact"),
    ("solver", "exhaustive"),
}


def test_built_ins_are_listed_with_version_and_summary(cli):
    """They register like anybody's plugins."""
    plugins = cli("plugins", "--format", "json").document["plugins"]
    ours = {(p["kind"], p["name"]): p for p in plugins if p["distribution"] == "skillplan"}
    assert BUILT_IN <= set(ours)
    for plugin in ours.values():
        assert plugin["version"] == __version__
        assert plugin["summary"].endswith(".")
        assert plugin["problem"] is None


@pytest.mark.parametrize("kind", registry.KINDS)
def test_a_kind_lists_its_own_only(cli, kind):
    """`skillplan plugins KIND`."""
    plugins = cli("plugins", kind, "--format", "json").document["plugins"]
    assert {kind} == {plugin["kind"] for plugin in plugins}


def test_options_are_listed_with_range_default_and_unit(cli):
    """From the pydantic model alone."""
    out = cli("plugins", "collision", "aabb").out
    (row,) = [line for line in out.splitlines() if line.startswith("tolerance_m")]
    assert "number" in row
    assert "0.0002" in row
    assert ">= 0, <= 0.01" in row
    assert row.endswith("[m]")
    document = cli("plugins", "collision", "aabb", "--format", "json").document
    assert 0.01 == document["options"]["properties"]["tolerance_m"]["maximum"]


def test_an_option_that_may_be_null_says_so_as_a_file_does(cli):
    """Not as Python writes it; and with the bounds of its values."""
    rows = cli("plugins", "solver", "sarsa").out.splitlines()
    (row,) = [line for line in rows if line.startswith("epsilon_end ")]
    assert ["number", "null", ">="] == row.split()[1:4]


def test_a_plugin_without_options_says_so(cli):
    """Not an empty table without a word."""
    assert "exhaustive has no options\n" in cli("plugins", "solver", "exhaustive").out


def test_a_plugin_just_installed_is_listed_and_run(cli, board, choosy_solver):
    """With its distribution and version; no list of names is kept anywhere."""
    plugins = cli("plugins", "solver", "--format", "json").document["plugins"]
    (results,) = [plugin for plugin in plugins if plugin["name"] == choosy_solver]
    assert ("choosy-solver", "1.5", "Refuse everything.", None) == (
        results["distribution"],
        results["version"],
        results["summary"],
        results["problem"],
    )


@pytest.mark.parametrize(
    ("value", "source", "reason"),
    [
        ("sick_one:Sick", "import no_such_module\n", "ModuleNotFoundError: No module named"),
        ("sick_two:Sick", "class Other: pass\n", "AttributeError: module 'sick_two' has no"),
        ("sick_three:Sick", "class Sick: pass\n", "is not a subclass of skillplan.solvers."),
        (
            "sick_four:Sick",
            "from skillplan import Solver\n\nclass Sick(Solver):\n    name = 'sick'\n",
            "does not implement solve.",
        ),
    ],
)
def test_a_broken_plugin_is_shown_with_the_reason(cli, board, install, value, source, reason):
    """In the list it takes nothing else down; asked for, it is an error in the same words."""
    install("solver", "sick", value, source)
    outcome = cli("plugins", "--format", "md")
    assert 0 == outcome.code
    (row,) = [line for line in outcome.out.splitlines() if "BROKEN" in line]
    assert reason in row
    assert "exact" in outcome.out
    assert 0 == cli("search-optimal", board).code
    refusal = cli("search-optimal", board, "--solver", "sick").refusal
    assert reason in refusal
    assert "sick-" in refusal


def test_a_name_with_two_providers_is_an_error_that_names_both(cli, board, install):
    """Neither silently wins."""
    source = "from skillplan.solvers import ExactSolver as Exact\n"
    install("solver", "exact", "second_exact:Exact", source)
    refusal = cli("search-optimal", board, "--solver", "exact").refusal
    assert f"skillplan {__version__}" in refusal
    assert "second-exact 1.5" in refusal


def test_what_looks_like_markup_is_not_swallowed(cli, install):
    """Brackets in a summary stand in every format as they were written."""
    source = '''
        from skillplan import Solution, Solver

        class Loud(Solver):
            """Be [bold]loud[/bold], [/] and :smile:."""

            name = "loud"

            def solve(self, model, *, seed=0):
                return Solution(None)
    '''
    install("solver", "loud", "loud_solver:Loud", source)
    for style in ("table", "json", "csv", "md"):
        out = cli("plugins", "solver", "--format", style).out
        assert "Be [bold]loud[/bold], [/] and :smile:." in out


def test_the_schema_is_a_json_document(cli):
    """Of the default kind, which is the named one."""
    outcome = cli("schema")
    assert (0, "") == (outcome.code, outcome.err)
    assert outcome.out == cli("schema", "assembly").out
    schema = outcome.document
    assert "https://json-schema.org/draft/2020-12/schema" == schema["$schema"]
    assert "skillplan.task.assembly/1" == schema["$id"]
    assert not schema["additionalProperties"]
    undescribed = [k for k, v in schema["properties"].items() if "description" not in v]
    assert set(undescribed) <= {"kind", "robot", "durations_s", "tools", "tool_change", "parts"}
    assert json.loads(outcome.out) == schema


def test_the_version_is_the_package_s(cli):
    """On one line."""
    assert f"skillplan, version {__version__}\n" == cli("--version").out
