"""compare --detectors: false alarms, misses and the figures that decide."""

from pathlib import Path

import pytest

# Flags every execution in which something stands that the file does not know.
WATCHMAN = '''
    from pydantic import Field

    from skillplan import Detector, Verdict
    from skillplan.task import back_end

    class Watchman(Detector):
        """See bodies that do not belong here."""

        name = "watchman"

        class Options(back_end.Options):
            """Options of the watchman."""

            limit_g: float = Field(default=0.1, description="mass that counts [g]")

        def check(self, skill, state):
            known = set(self.task.operations)
            extra = [one for one in self.task.scene.bodies if one.name not in known]
            mass_g = 1000 * sum(one.mass_kg for one in extra)
            figures = {"readings": {"mass_g": mass_g}, "limits": {"mass_g": self.options.limit_g}}
            none = state.facts.none
            if mass_g > self.options.limit_g:
                return Verdict.infeasible("what is this?", none, none, figures)
            return Verdict.feasible(none, none, figures)
'''


@pytest.fixture
def watchman(install):
    """A detector that reads masses."""
    install("collision", "watchman", "watchman_detector:Watchman", WATCHMAN)
    return "watchman"


def test_detectors_stand_side_by_side(cli, board, watchman):
    """A row each; below it what is right and how many trials there were."""
    words = ("compare", board, "--detectors", f"aabb,{watchman}", "--staged", "12")
    document = cli(*words, "--format", "json").document
    assert "skillplan.detectors/1" == document["schema"]
    assert ("kinematic", "the hand-made chart") == (document["physics"], document["reference"])
    aabb, seer = document["detectors"]
    assert ("aabb", "watchman") == (aabb["name"], seer["name"])
    assert 13 == document["trials"]["collision"]
    assert (0, 12) == (aabb["false_alarms"], seer["false_alarms"])
    assert {"mass_g": 2.0} == seer["largest_where_right"]["readings"]
    assert {"mass_g": 0.1} == seer["largest_where_right"]["limits"]
    assert aabb["misses"] == len(aabb["wrong_rulings"])
    out = cli(*words).out
    summary = out[out.index("detectors on trial") :]
    assert "right is      what the hand-made chart allows" in summary
    assert f"{aabb['misses']}/13" in summary
    assert "mass_g 2 (limit 0.1) at " in summary
    assert "+x of " in out[: out.index("detectors on trial")]


def test_options_reach_the_detectors(cli, board, watchman):
    """As everywhere, by the plugin's name."""
    words = ("compare", board, "--detectors", watchman, "--staged", "12", "--format", "json")
    (deaf,) = cli(*words, "-O", "watchman.limit_g=1000").document["detectors"]
    assert (0, 13) == (deaf["false_alarms"], deaf["misses"])


def test_the_same_trials_come_every_time(cli, board):
    """To the last figure, but for the time."""
    words = ("compare", board, "--detectors", "aabb", "--format", "json")
    first, second = cli(*words).document, cli(*words).document
    assert first.pop("wall_s") > 0
    assert second.pop("wall_s") > 0
    assert first == second


def test_csv_has_a_row_a_detector(cli, board):
    """What is ruled wrong is for the table and for JSON."""
    out = cli("compare", board, "--detectors", "aabb", "--staged", "0", "--format", "csv").out
    heading, row = out.splitlines()
    assert heading.startswith("detector,false alarms,misses,undecided,wrong outcomes seen,")
    assert row.startswith("aabb,0/")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ((), "Give one of --solvers, --detectors and --engines."),
        (
            ("--solvers", "exact", "--detectors", "aabb"),
            "Give one of --solvers, --detectors and --engines.",
        ),
        (("--detectors", ","), "--detectors names no detector."),
        (("--detectors", "aab"), "Unknown collision 'aab'. Did you mean 'aabb'?"),
        (
            ("--detectors", "aabb", "--collision", "precedence"),
            "--collision is for --solvers; name detectors in --detectors.",
        ),
        (("--detectors", "aabb", "--warm"), "--warm is for --solvers."),
        (("--detectors", "aabb", "-O", "swept.x=1"), "No plugin 'swept' takes part in this run."),
    ],
)
def test_what_does_not_go_together_is_refused(cli, board, words, message):
    """One message, exit code 2."""
    assert message in cli("compare", board, *words).refusal


def test_a_task_without_bodies_has_nothing_to_collide(cli):
    """Said at once."""
    bench = Path(__file__).parents[2] / "configs" / "swarmitfix_triangular.yaml"
    assert (
        "has no bodies: there is nothing to collide."
        in cli("compare", str(bench), "--detectors", "aabb").refusal
    )
