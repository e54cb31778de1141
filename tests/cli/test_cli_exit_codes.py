"""Exit codes, each provoked by a real situation; 130 by signals in test_cli_process.py."""

from __future__ import annotations

from pathlib import Path

import pytest
import typer
from rich.text import Text

from skillplan.cli import COMMANDS, EPILOG, app
from skillplan.views.figures import RUN_FIGURES, describe_figures

OPTIMUM = "0,1,2,3,4,5,8,9,10,11,6,7,13,14,15"
EXACT = ("--solver", "exact")


class TestZero:
    def test_a_proved_plan(self, cli, board):
        """Optimal is solved."""
        assert 0 == cli("search-optimal", board).code

    def test_an_unproved_plan(self, cli, board):
        """Solved with a gap is solved, too."""
        outcome = cli("search-optimal", board, *EXACT, "-O", "max_labels=1", "--format", "json")
        assert 0 == outcome.code
        assert "solved" == outcome.document["status"]

    def test_a_complete_sequence(self, cli, board):
        """Whatever it costs."""
        assert 0 == cli("evaluate", board, "--sequence", OPTIMUM).code

    @pytest.mark.parametrize("words", [("--help",), ("-h",), ("--version",), ("evaluate", "-h")])
    def test_asking_for_help(self, cli, words):
        """Help and version go to stdout."""
        outcome = cli(*words)
        assert (0, "") == (outcome.code, outcome.err)
        assert outcome.out


class TestOne:
    def test_a_task_without_a_plan(self, cli, no_way):
        """Proved infeasible."""
        outcome = cli("search-optimal", no_way, "--format", "json")
        assert (1, "infeasible") == (outcome.code, outcome.document["status"])

    def test_no_plan_in_time(self, cli, motor):
        """Unsolved."""
        words = ("--solver", "exhaustive", "--time-limit", "0.05", "--format", "json")
        outcome = cli("search-optimal", motor, *words)
        assert (1, "unsolved") == (outcome.code, outcome.document["status"])
        assert "time limit: no plan was found" == outcome.document["reason"]

    @pytest.mark.parametrize("sequence", ["0,3", "0,1", "13,12," * 10 + "13"])
    def test_a_sequence_that_does_not_do(self, cli, board, sequence):
        """Infeasible, incomplete or too long."""
        assert 1 == cli("evaluate", board, "--sequence", sequence).code

    def test_a_skill_that_is_not_feasible(self, cli, board):
        """Explained, and the code says so."""
        assert 1 == cli("explain", board, "place(pcb)").code


class TestTwo:
    @pytest.mark.parametrize(
        ("words", "message"),
        [
            (("serch-optimal", "BOARD"), "No such command 'serch-optimal'. Did you mean"),
            (("search", "BOARD"), "Did you mean 'search-optimal'?"),
            (("xyzzy",), "No such command 'xyzzy'. Known: search-optimal, evaluate"),
            (("search-optimal",), "Missing argument 'TASK'"),
            (
                ("search-optimal", "BOARD", "--slover", "exact"),
                "No such option '--slover'. Did you mean '--solver'",
            ),
            (("search-optimal", "BOARD", "--solver", "exat"), "Did you mean 'exact'?"),
            (("search-optimal", "BOARD", "--solver", "optimal"), "Did you mean 'exact'?"),
            (("search-optimal", "BOARD", "--solver", "Best"), "Did you mean 'auto'?"),
            (("search-optimal", "BOARD", "--physics", "kinematik"), "Did you mean 'kinematic'?"),
            (("search-optimal", "BOARD", "--collision", "aab,precedence"), "Did you mean 'aabb'?"),
            (("search-optimal", "BOARD", "--collision", ","), "--collision names no detector."),
            (("search-optimal", "BOARD", "--gap", "1.5"), "must be from 0 to 1, not 1.5."),
            (("search-optimal", "BOARD", "--gap", "nan"), "must be from 0 to 1, not nan."),
            (("search-optimal", "BOARD", "--seed", "-1"), "-1 is not in the range"),
            (("search-optimal", "BOARD", "--time-limit", "0"), "must be a finite number > 0"),
            (("search-optimal", "BOARD", "--time-limit", "inf"), "must be a finite number > 0"),
            (("search-optimal", "BOARD", "--time-limit", "soon"), "'soon' is not a number"),
            (("search-optimal", "BOARD", "--format", "xml"), "'table', 'json', 'csv', 'md'"),
            (("evaluate", "BOARD"), "Give either --sequence or --policy."),
            (("evaluate", "BOARD", "--sequence", ""), "The sequence is empty."),
            (("evaluate", "BOARD", "--sequence", "0,,1"), "Entry 2 of the sequence is empty."),
            (("evaluate", "BOARD", "--sequence", "0,16"), "No action 16; the task has actions 0"),
            (("evaluate", "BOARD", "--sequence", "0,-1"), "Unknown skill '-1'"),
            (("evaluate", "BOARD", "--sequence", "plce(pcb)"), "Did you mean 'place(pcb)'?"),
            (("compare", "BOARD", "--solvers", ","), "--solvers names no solver."),
            (("compare", "BOARD", "--solvers", "exact,exat"), "Did you mean 'exact'?"),
            (("explain", "BOARD", "pik(pcb)"), "Did you mean 'pick(pcb)'?"),
            (("explain", "BOARD", "0", "--after", "0,3"), "--after fails at step 2 (place(swit"),
            (("chart", "BOARD", "--collision", "abab"), "Did you mean 'aabb'?"),
            (("plugins", "solvr"), "Did you mean 'solver'?"),
            (("plugins", "solver", "exat"), "Did you mean 'exact'?"),
            (("schema", "asembly"), "Did you mean 'assembly'?"),
            (("check", "no_such.yaml"), "no_such.yaml: "),
        ],
    )
    def test_a_wrong_word(self, cli, board, words, message):
        """The message names the fault and, where one is near, the right word; stdout is empty."""
        refusal = cli(*(board if word == "BOARD" else word for word in words)).refusal
        assert message in " ".join(refusal.split())
        assert "Traceback" not in refusal

    def test_an_option_of_a_solver_that_is_not_named(self, cli, board):
        """The one that chooses has no options."""
        assert (
            "'auto' has no option 'max_labels'. It has none at all; name the"
            in cli("search-optimal", board, "-O", "max_labels=3").refusal
        )

    @pytest.mark.parametrize(
        ("option", "message"),
        [
            ("max_label=3", "The solver 'exact' has no option 'max_label'. Did you mean"),
            ("max_labels=0", "Options of the solver 'exact': max_labels: must be >= 1, not '0'"),
            ("max_labels=many", "Options of the solver 'exact': max_labels: "),
            ("dives=7", "Options of the solver 'exact': dives: "),
            ("max_labels", "must have the form [PLUGIN.]KEY=VALUE."),
            ("=3", "must have the form [PLUGIN.]KEY=VALUE."),
            ("exact.=3", "must have the form [PLUGIN.]KEY=VALUE."),
            ("exat.max_labels=3", "No plugin 'exat' takes part in this run. Did you mean 'exact'?"),
            ("aabb.tolerance_m=0.001", "No plugin 'aabb' takes part in this run."),
            ("precedence.hold_back=true", "has no option 'hold_back'. Did you mean 'hold_back_p"),
        ],
    )
    def test_a_wrong_plugin_option(self, cli, board, option, message):
        """Explained with the nearest name, the range or the form."""
        assert message in cli("search-optimal", board, *EXACT, "-O", option).refusal

    def test_an_option_that_could_be_of_either_solver(self, cli, board):
        """Where two solvers run, an option must name its plugin."""
        words = ("--solvers", "exact,exhaustive", "-O", "max_labels=5")
        assert "must name its plugin: PLUGIN.max_labels=5." in cli("compare", board, *words).refusal

    def test_a_solver_that_refuses(self, cli, board, choosy_solver):
        """Its words are printed, as a result."""
        outcome = cli("search-optimal", board, "--solver", choosy_solver)
        assert 2 == outcome.code
        assert "status     refused (it is Monday)\n" in outcome.out

    def test_a_solver_that_lies(self, cli, board, lying_solver):
        """Caught by the referee, in a comparison even beside one that solves."""
        outcome = cli("compare", board, "--solvers", f"exact,{lying_solver}", "--format", "json")
        assert 2 == outcome.code
        assert ["optimal", "wrong"] == [row["status"] for row in outcome.document["rows"]]
        out = cli("search-optimal", board, "--solver", lying_solver).out
        assert "WRONG: the solver's claim does not hold (the plan fails at the end: " in out

    def test_a_detector_that_cannot_serve(self, cli, tmp_path, board):
        """The chart detector needs a chart, and says so."""
        text = Path(board).read_text("utf-8")
        head, _, rest = text.partition("chart:\n")
        bare = head + rest.partition("collision: {precedence: {}}\n")[2]
        path = tmp_path / "bare.yaml"
        path.write_text(bare, "utf-8")
        assert (
            "the task file has no 'chart:'"
            in cli("search-optimal", str(path), "--collision", "precedence").refusal
        )


class TestThree:
    @pytest.mark.parametrize(
        "words",
        [
            ("search-optimal", "BOARD"),
            ("evaluate", "BOARD", "--sequence", "0"),
            ("explain", "BOARD", "0"),
            ("chart", "BOARD"),
        ],
        ids=lambda words: words[0],
    )
    def test_a_back_end_that_raises(self, cli, board, bursting_detector, words):
        """Named, with the skill and its own words, in every command that asks it."""
        called = [board if word == "BOARD" else word for word in words]
        outcome = cli(*called, "--collision", bursting_detector, "--format", "json")
        assert 3 == outcome.code
        assert "Back end 'bursting' failed on pick(" in outcome.err
        assert "RuntimeError: the simulator has gone away" in outcome.err
        assert (3, "BackEndError") == (outcome.document["exit_code"], outcome.document["error"])

    def test_a_bug_of_our_own_is_no_traceback(self, cli, board, monkeypatch):
        """It is owned up to, and the way to more is named; JSON stays one document."""
        monkeypatch.setattr("skillplan.pipeline.setup.load_problem", lambda *_: 1 / 0)
        monkeypatch.delenv("SKILLPLAN_DEBUG", raising=False)
        outcome = cli("check", board, "--format", "json")
        assert 3 == outcome.code
        assert "internal error: ZeroDivisionError" in outcome.err
        assert "SKILLPLAN_DEBUG=1" in outcome.err
        assert "ZeroDivisionError" == outcome.document["error"]

    def test_debugging_shows_where(self, board, monkeypatch):
        """With SKILLPLAN_DEBUG the exception comes through."""
        from skillplan.cli import main

        monkeypatch.setattr("skillplan.pipeline.setup.load_problem", lambda *_: 1 / 0)
        monkeypatch.setenv("SKILLPLAN_DEBUG", "1")
        with pytest.raises(ZeroDivisionError):
            main(["check", board])


def words_of(help_text: str) -> str:
    """Return a help text without its frames, on one line."""
    return " ".join(help_text.translate(dict.fromkeys(map(ord, "│╭╮╰╯─"), " ")).split())


class TestHelp:
    def test_it_lists_every_command_and_exit_code(self, cli):
        """Nobody has to look elsewhere."""
        words = words_of(cli("--help").out)
        assert all(f" {name} {line}" in words for name, line in COMMANDS.items())
        assert EPILOG in words
        assert all(f"{code} " in EPILOG for code in (0, 1, 2, 3, 130))

    @pytest.mark.parametrize("words", [(), ("cache",), ("generate",)])
    def test_a_line_that_names_no_command_is_answered_by_help(self, cli, words):
        """It is wrong input all the same."""
        outcome = cli(*words)
        assert (2, "") == (outcome.code, outcome.err)
        assert "COMMAND [ARGS]..." in outcome.out

    @pytest.mark.parametrize("columns", ["60", "80"])
    @pytest.mark.parametrize("name", COMMANDS)
    def test_every_command_explains_itself_and_each_of_its_options(
        self, cli, name, columns, monkeypatch
    ):
        """Within the width, every option by its whole name and help."""
        monkeypatch.setenv("COLUMNS", columns)
        command = app.get_command(typer.Context(app), name)
        assert name == command.name
        out = cli(name, "--help").out
        assert out.lstrip().startswith(f"Usage: skillplan {name} ")
        assert int(columns) >= max(map(len, out.splitlines()))
        for parameter in command.params:
            assert parameter.help, parameter.name
            argument = parameter.param_type_name == "argument"
            shown = parameter.metavar.split("|")[0] if argument else max(parameter.opts, key=len)
            assert (shown in out) != getattr(parameter, "hidden", False)

    @pytest.mark.parametrize("name", COMMANDS)
    def test_nothing_that_is_said_is_taken_for_markup(self, name):
        """Brackets, as of an interval, stay."""
        command = app.get_command(typer.Context(app), name)
        inner = [command, *getattr(command, "commands", {}).values()]
        texts = [text for node in inner for text in (node.help, node.epilog) if text]
        texts += [parameter.help for item in inner for parameter in item.params]
        assert texts == [Text.from_markup(text).plain for text in texts]

    def test_the_figures_of_plot_stand_in_a_list(self, cli):
        """Each with its line."""
        words = words_of(cli("plot", "--help").out)
        lines = describe_figures() | {name: figure.line for name, figure in RUN_FIGURES.items()}
        assert {"gantt", "placement", "success"} <= set(lines)
        for name, line in lines.items():
            assert f"{name} {line}" in words
