"""Detectors on trial: which executions they are shown, and how their verdicts are counted."""

from collections import Counter

import pytest

from situations import assembly, config_content, fake_back_end
from skillplan.collision import AabbDetector
from skillplan.physics import Engine, KinematicEngine
from skillplan.records import find_decisive, list_wrong, make_detectors_document
from skillplan.task import Verdict, VerdictStatus
from skillplan.trials import CHART, OBSTACLE, Truth, try_detectors


@pytest.fixture(scope="module")
def board():
    """The paper's board."""
    return assembly(config_content("inverter_board"))


def sees_blocks(task, *, limit_mm=1.0, slow=False):
    """Return a detector that sees every block and reads its mass, and rests on all facts."""

    def rule(skill, state):
        blocks = [body for body in task.scene.bodies if body.name == OBSTACLE]
        reading = 1000 * sum(body.mass_kg for body in blocks)
        evidence = {"readings": {"mass_g": reading}, "limits": {"mass_g": limit_mm}}
        facts = state.facts
        if reading > limit_mm:
            return Verdict.infeasible("there is a block", facts.none, facts.none, evidence)
        return Verdict.feasible(facts.none, facts.none, evidence)

    return fake_back_end(task, rule, name="seer")


def back_ends(task):
    """Return an engine and three detectors."""
    return [
        KinematicEngine(task),
        AabbDetector(task),
        fake_back_end(task, name="blind"),
        sees_blocks(task),
    ]


@pytest.fixture(scope="module")
def trials(board):
    """Everything, once."""
    return try_detectors(board, back_ends, 40)


class TestTrials:
    def test_every_class_of_right_executions_is_tried_once(self, board, trials):
        """Whatever the chart allows; of those that agree on all that matters, one."""
        shown = [checked.trial for checked in trials.of(Truth.LEGITIMATE) if not checked.trial.kind]
        assert CHART == trials.reference
        assert {skill.name for skill in board.skills} == {trial.skill.name for trial in shown}
        again = AabbDetector(board)
        seen = set()
        for trial in shown:
            verdict = again.check(trial.skill, trial.state)
            key = (trial.skill.name, verdict.present, verdict.absent)
            assert key not in seen
            seen.add(key)

    def test_collisions_of_all_kinds_and_skills_are_tried_in_turn(self, trials):
        """As many as requested, and as many near misses; no two are alike."""
        collisions = [
            checked.trial
            for checked in trials.of(Truth.COLLISION)
            if checked.trial.kind != "wrong order"
        ]
        assert 40 == len(collisions)
        assert 40 == len({(trial.skill.name, trial.fault) for trial in collisions})
        kinds = Counter(trial.kind for trial in collisions)
        assert {"beside", "tall", "too deep", "in the holder", "under the screw"} <= set(kinds)
        near = [item for item in trials.of(Truth.LEGITIMATE) if item.trial.kind == "near miss"]
        assert 40 == len(near)

    def test_orders_that_the_geometry_forbids_are_tried(self, trials):
        """A part put through another, and parts put down on nothing."""
        orders = [check.trial for check in trials.checked if check.trial.kind == "wrong order"]
        assert ["brace stands in the way of transformer"] == [order.fault for order in orders]
        falling = [checked.trial for checked in trials.of(Truth.OUTCOME)]
        assert {"place(switch_1)", "place(brace)", "fasten(screw_1)"} <= {
            trial.skill.name for trial in falling
        }
        assert "place(pcb)" not in {trial.skill.name for trial in falling}

    def test_without_a_chart_what_most_back_ends_grant_is_right(self, board):
        """And that is said."""
        drawn = board.replace(chart=())
        trials = try_detectors(drawn, lambda task: [KinematicEngine(task), AabbDetector(task)], 0)
        assert "more than half of the back ends grant" == trials.reference
        assert trials.of(Truth.LEGITIMATE)
        assert not [
            trial for trial in trials.of(Truth.COLLISION) if trial.trial.kind != "wrong order"
        ]

    def test_being_stopped_keeps_what_is_known(self, board):
        """After three trials."""
        created = []
        trials = try_detectors(
            board, back_ends, note=lambda: created.append(1), stopped=lambda: len(created) == 3
        )
        assert trials.stopped
        assert 3 == len(trials.checked)


class TestCounting:
    def test_false_alarms_and_misses_are_counted(self, trials):
        """The blind one misses all, the one that sees blocks also those that are clear."""
        document = make_detectors_document(trials, 1.0)
        by_name = {detector["name"]: detector for detector in document["detectors"]}
        assert ["aabb", "blind", "seer"] == list(by_name)
        assert (0, 41) == (by_name["blind"]["false_alarms"], by_name["blind"]["misses"])
        assert 40 == by_name["seer"]["false_alarms"]
        assert 0 == by_name["aabb"]["false_alarms"]
        assert len(trials.of(Truth.OUTCOME)) == by_name["aabb"]["outcomes_seen"]
        assert 41 == document["trials"]["collision"]

    def test_every_wrong_verdict_is_listed_with_its_evidence(self, trials):
        """As many as are counted; with the state and the injected fault."""
        for detector in make_detectors_document(trials, 1.0)["detectors"]:
            wrong = detector["wrong_rulings"]
            assert detector["false_alarms"] + detector["misses"] + detector["undecided"] == len(
                wrong
            )
            assert all(checked["state"] for checked in wrong)
        assert 40 <= len(list_wrong(trials, "seer"))

    def test_the_figures_that_decide_are_the_nearest_to_a_wrong_verdict(self, trials):
        """The largest on right executions, the smallest on collisions."""
        right = find_decisive(trials, "seer", Truth.LEGITIMATE)
        wrong = find_decisive(trials, "seer", Truth.COLLISION)
        assert right is not None
        assert wrong is not None
        assert {"mass_g": 2.0} == right["readings"]
        assert {"mass_g": 0.0} == wrong["readings"]
        assert find_decisive(trials, "blind", Truth.COLLISION) is None

    @pytest.mark.slow(reason="tries two back ends on the board; the other counts in every run")
    def test_what_is_unknown_is_neither_a_miss_nor_an_alarm(self, board):
        """It is counted apart."""

        def make(task):
            unsure = fake_back_end(task, Verdict.unknown("too dark"), name="unsure")
            return [fake_back_end(task, name="still", base=Engine), unsure]

        trials = try_detectors(board.replace(chart=board.chart), make, 3)
        (only,) = make_detectors_document(trials, 1.0)["detectors"]
        assert (0, 0, len(trials.checked)) == (
            only["false_alarms"],
            only["misses"],
            only["undecided"],
        )
        assert trials.count(Truth.COLLISION, "unsure", VerdictStatus.UNKNOWN)
