"""evaluate, explain, chart, check: what is asked about a task, and what is answered."""

from pathlib import Path

import pytest

from skillplan.pipeline import registry

OPTIMUM = "0,1,2,3,4,5,8,9,10,11,6,7,13,14,15"


class TestEvaluate:
    @pytest.mark.parametrize(
        ("sequence", "cost", "deviation"),
        [
            (OPTIMUM, "1.86709", "0.00 %"),
            ("0,1,2,3,4,5,8,9,6,7,10,11,13,14,15", "1.86711", "0.00 %"),
            ("0,1,4,5,2,3,8,9,10,11,6,7,13,14,15", "1.88012", "0.70 %"),
            ("0,1,2,3,4,5,6,7,8,9,10,11,13,14,15", "1.88498", "0.96 %"),
            ("0,1,6,7,2,3,8,9,4,5,10,11,13,14,15", "1.93911", "3.86 %"),
        ],
    )
    def test_the_sequences_of_table_3(self, cli, board, sequence, cost, deviation):
        """Feasible, complete, at this cost and this far from the proved optimum."""
        outcome = cli("evaluate", board, "--sequence", sequence)
        assert 0 == outcome.code
        assert "feasible   yes\ncomplete   yes\n" in outcome.out
        assert f"cost       {cost} m, " in outcome.out
        assert f"deviation  {deviation} of the proved optimum 1.86709 m\n" in outcome.out

    def test_names_do_as_well_as_numbers(self, cli, board):
        """Mixed, with blanks: the same evaluation."""
        named = cli(
            "evaluate", board, "--sequence", "pick(pcb), 1 ,pick(switch_1)", "--format=json"
        )
        numbered = cli("evaluate", board, "--sequence", "0,1,2", "--format", "json")
        assert numbered.document == named.document
        assert [0, 1, 2] == named.document["actions"]

    def test_an_infeasible_step_is_named_with_its_facts(self, cli, board):
        """Which condition fails where; the steps before it stand in the document."""
        outcome = cli("evaluate", board, "--sequence", "0,1,10,11", "--format", "json")
        document = outcome.document
        assert (False, False) == (document["feasible"], document["complete"])
        assert (None, None) == (document["optimum"], document["deviation"])
        assert 3 == len(document["steps"])
        (violation,) = document["violations"]
        assert (3, "place(brace)", "precedence") == (
            violation["step"],
            violation["skill"],
            violation["stage"],
        )
        assert "not placed(transformer)" in violation["facts"]
        assert "the chart puts transformer before brace" in violation["reason"]
        out = cli("evaluate", board, "--sequence", "0,1,10,11").out
        assert "violation  at step 4 (place(brace)): precedence: " in out
        assert "           rests on placed(pcb), not placed(transformer)\n" in out

    def test_an_incomplete_sequence_names_what_is_missing(self, cli, board):
        """Feasible so far, and these facts of the goal do not hold."""
        outcome = cli("evaluate", board, "--sequence", OPTIMUM[:-3], "--format", "json")
        document = outcome.document
        assert (True, False) == (document["feasible"], document["complete"])
        (violation,) = document["violations"]
        assert (14, None, "goal") == (violation["step"], violation["skill"], violation["stage"])
        assert ["fastened(screw_2)"] == violation["facts"]
        out = cli("evaluate", board, "--sequence", OPTIMUM[:-3]).out
        assert "so far     1.78709 m" in out
        assert "at the end: goal: the goal is not reached: fastened(screw_2)\n" in out
        assert 1 == out.count("fastened(screw_2)")

    def test_a_sequence_beyond_the_limit_is_not_feasible(self, cli, board):
        """The step that the limit forbids is the violation, however it would have gone."""
        sequence = ",".join(["13,12"] * 10 + ["13"])
        document = cli("evaluate", board, "--sequence", sequence, "--format", "json").document
        assert (False, 20) == (document["feasible"], document["makespan"])
        (violation,) = document["violations"]
        assert (20, "step-limit") == (violation["step"], violation["stage"])
        assert "the sequence has 21 skills, the limit is 20" == violation["reason"]

    def test_a_goal_reached_early_may_be_left_again(self, cli, board):
        """What follows is executed like any other; the cost counts it."""
        longer = cli("evaluate", board, "--sequence", f"{OPTIMUM},12", "--format", "json")
        assert 0 == longer.code
        assert longer.document["deviation"] > 0

    def test_the_reward_is_the_sum_of_table_2(self, cli, board):
        """Complete: +10 and -0.1 per metre of all steps but the last."""
        document = cli("evaluate", board, "--sequence", OPTIMUM, "--format", "json").document
        last = document["steps"][-1]["cost"]
        assert 10 - 0.1 * (document["cost"] - last) == pytest.approx(document["reward"])

    @pytest.mark.slow(reason="solves twelve parts; every run has an optimum that is not proved")
    def test_an_optimum_not_proved_in_time_is_unknown(self, cli, motor):
        """The evaluation stands; only the deviation is left out."""
        best = cli("search-optimal", motor, "--format", "json").document["actions"]
        sequence = ",".join(str(action) for action in best)
        words = ("--sequence", sequence, "--time-limit", "0.001")
        outcome = cli("evaluate", motor, *words)
        assert 0 == outcome.code
        assert "deviation  unknown: the optimum was not proved in time\n" in outcome.out
        assert cli("evaluate", motor, *words, "--format", "json").document["deviation"] is None

    def test_under_chance_a_sequence_has_no_deviation(self, cli, board):
        """An optimum is of policies there, and no time would change that."""
        grasps = str(Path(board).with_name("inverter_grasps.yaml"))
        outcome = cli("evaluate", grasps, "--sequence", OPTIMUM)
        assert 0 == outcome.code
        assert "deviation  none: under chance" in outcome.out


class TestExplain:
    def test_a_failing_precondition(self, cli, board):
        """The first stage: what it needs does not hold."""
        outcome = cli("explain", board, "place(pcb)", "--format", "json")
        document = outcome.document
        assert 1 == outcome.code
        assert ("precondition", "needs held(pcb)") == (document["stage"], document["reason"])
        (stage,) = document["stages"]
        assert ["held(pcb)"] == stage["absent"]
        assert [] == stage["present"]

    def test_an_engine_that_says_no(self, cli, board, install):
        """The second stage: the reason, the facts and the figures of the engine asked for."""
        source = '''
            from skillplan import Engine, Verdict

            class Lame(Engine):
                """Lift nothing that is heavy."""

                name = "lame"

                def check(self, skill, state):
                    reason = "the wrist gives way"
                    return Verdict.infeasible(reason, state, state.facts.none, {"force_n": 12.345})
        '''
        install("physics", "lame", "lame_engine:Lame", source)
        words = ("explain", board, "pick(pcb)", "--physics", "lame")
        document = cli(*words, "--format", "json").document
        assert ("lame", "the wrist gives way") == (document["stage"], document["reason"])
        (stage,) = [stage for stage in document["stages"] if stage["stage"] == "lame"]
        assert {"force_n": 12.345} == stage["evidence"]
        assert document["state"] == stage["present"]
        lines = cli(*words).out.splitlines()
        (row,) = [line for line in lines if line.startswith("lame ")]
        assert row.endswith("the wrist gives way")
        measured = [line.split() for line in lines[lines.index("lame: infeasible") + 1 :]]
        assert ["force_n", "12.35"] in measured[:3]

    def test_the_chart(self, cli, board):
        """A collision stage: the chart and its line."""
        words = ("explain", board, "place(brace)", "--after", "0,1,10", "--format", "json")
        document = cli(*words).document
        assert "precedence" == document["stage"]
        stage = document["stages"][-1]
        assert {"before": "transformer", "after": "brace"} == stage["evidence"]
        assert ["placed(transformer)"] == stage["absent"]

    def test_geometry(self, cli, board):
        """A collision stage: the bodies that meet, and when."""
        words = ("--after", "0,1,10,11,8", "--collision", "aabb", "--set", "chart=[]")
        document = cli("explain", board, "place(transformer)", *words, "--format", "json").document
        assert "aabb" == document["stage"]
        evidence = document["stages"][-1]["evidence"]
        assert ("transformer", ["brace"]) == (evidence["moving"], evidence["bodies"])
        assert ["placed(brace)"] == document["stages"][-1]["present"]

    def test_a_feasible_skill(self, cli, board):
        """Every stage passed, each with the facts it rests on."""
        outcome = cli("explain", board, "place(pcb)", "--after", "0")
        assert 0 == outcome.code
        assert outcome.out.startswith("inverter-board: place(pcb) is feasible\n")
        assert "precondition  held(pcb) and tool(gripper)\n" in outcome.out
        assert "state         held(pcb), at_start(switch_1), " in outcome.out

    def test_a_number_does_as_well_as_a_name(self, cli, board):
        """Action 0 is pick(pcb)."""
        assert cli("explain", board, "0").out == cli("explain", board, "pick(pcb)").out

    def test_a_state_that_cannot_be_reached_is_a_wrong_question(self, cli, board):
        """`--after` that fails: where, at which stage, and why."""
        assert (
            "--after fails at step 4 (place(brace)): precedence: the chart"
            in cli("explain", board, "0", "--after", "0,1,10,11,6").refusal
        )


class TestChart:
    def test_geometry_finds_the_hand_made_chart_of_the_board(self, cli, board):
        """Nothing missing, nothing extra; each relation with reason and evidence."""
        document = cli("chart", board, "--format", "json").document
        assert ([], []) == (document["missing"], document["extra"])
        derived = {(r["before"], r["after"]) for r in document["relations"]}
        assert {(r["before"], r["after"]) for r in document["hand_made"]} <= derived
        assert all(r["reason"] and r["evidence"] for r in document["relations"])
        geometric = "swept" if "swept" in registry.names("collision") else "aabb"
        assert ["kinematic", geometric] == document["back_ends"]
        assert "The derived relation equals the hand-made chart.\n" in cli("chart", board).out

    def test_what_the_chart_lacks_is_extra(self, cli, board, tmp_path):
        """Geometry knows more than this chart."""
        text = Path(board).read_text("utf-8")
        line = "  - {before: transformer, after: [brace]}\n"
        assert line in text
        path = tmp_path / "careless.yaml"
        path.write_text(text.replace(line, ""), "utf-8")
        outcome = cli("chart", str(path), "--format", "json")
        assert 0 == outcome.code
        assert [] == outcome.document["missing"]
        extra = [(r["before"], r["after"]) for r in outcome.document["extra"]]
        assert ("transformer", "brace") in extra

    def test_what_geometry_does_not_ask_for_is_missing(self, cli, board, tmp_path):
        """The chart demands more than collisions do."""
        text = Path(board).read_text("utf-8")
        line = "  - {before: transformer, after: [brace]}\n"
        more = "  - {before: switch_1, after: [clock]}\n"
        path = tmp_path / "strict.yaml"
        path.write_text(text.replace(line, line + more), "utf-8")
        document = cli("chart", str(path), "--format", "json").document
        assert [{"before": "switch_1", "after": "clock"}] == document["missing"]
        assert [] == document["extra"]
        out = cli("chart", str(path)).out
        assert "missing 1, extra 0\n" in out
        (row,) = [line for line in out.splitlines() if "MISSING" in line]
        assert ["switch_1", "clock", "MISSING"] == row.split()[:3]

    def test_a_task_without_a_chart_has_one_derived(self, cli, board, tmp_path):
        """There is nothing to compare with, and the table says so."""
        text = Path(board).read_text("utf-8")
        head, _, rest = text.partition("chart:\n")
        path = tmp_path / "bare.yaml"
        path.write_text(head + rest.partition("collision: {precedence: {}}\n")[2], "utf-8")
        out = cli("chart", str(path)).out
        assert "has no hand-made chart to compare with." in out
        assert "MISSING" not in out

    def test_the_larger_board_is_charted_too(self, cli, motor):
        """Twelve parts and a stack: the bridge goes before the heat sink beneath it."""
        document = cli("chart", motor, "--format", "json").document
        derived = {(r["before"], r["after"]) for r in document["relations"]}
        assert ("bridge", "heat_sink") in derived
        assert ("power_board", "shield") in derived


class TestCheck:
    def test_a_valid_file_is_summed_up(self, cli, board):
        """Actions, facts, observed bits, limit and the back ends that will be asked."""
        outcome = cli("check", board)
        assert 0 == outcome.code
        lines = outcome.out.splitlines()
        assert "inverter-board: valid" == lines[0]
        assert ["inverter-board", "16", "41", "17", "20", "kinematic,", "precedence"] == lines[
            3
        ].split()

    def test_all_faults_are_told_at_once(self, cli, board, tmp_path):
        """Each on its line with its position, none on stdout."""
        text = Path(board).read_text("utf-8")
        text = text.replace("reach_m: 0.855", "reach_m: far").replace("kg: 0.250", "kg: -1")
        path = tmp_path / "faulty.yaml"
        path.write_text(text, "utf-8")
        refusal = cli("check", str(path)).refusal
        first, second = refusal.splitlines()
        assert first.startswith(f"skillplan: error: {path}:13:12: robot.reach_m: ")
        assert second.startswith(f"skillplan: error: {path}:60:14: parts.transformer.mass_kg: ")
