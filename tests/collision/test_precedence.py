"""The hand-made chart as a detector."""

import pytest

from skillplan.collision import PrecedenceDetector
from skillplan.errors import OptionError
from skillplan.pipeline import Setup, make_model
from skillplan.testing import DetectorSuite, lid_task, reachable_states


class TestPrecedenceDetector(DetectorSuite):
    detector = "precedence"


class TestPrecedenceDetectorThatHoldsBackPicks(DetectorSuite):
    detector = "precedence"

    def make(self, task):
        return PrecedenceDetector(task, PrecedenceDetector.Options(hold_back_picks=True))


def test_what_comes_later_waits():
    """The brace may not be placed before the transformer; the message says so."""
    task = lid_task()
    facts = task.facts
    verdict = PrecedenceDetector(task).check(
        task.skill("place(lid)"), facts.of("placed(box)", "held(lid)", "tool(gripper)")
    )
    assert verdict.is_infeasible
    assert verdict.reason == "the chart puts fuse before lid, and placed(fuse) does not hold"
    assert verdict.facts == ["placed(box)", "not placed(fuse)"]
    assert verdict.evidence == {"before": "fuse", "after": "lid"}


def test_what_should_have_come_earlier_comes_no_more():
    """Once a later one is done."""
    task = lid_task()
    verdict = PrecedenceDetector(task).check(
        task.skill("place(fuse)"), task.facts.of("placed(box)", "placed(lid)", "held(fuse)")
    )
    assert verdict.is_infeasible
    assert verdict.reason == "the chart puts fuse before lid, and placed(lid) holds already"


def test_picks_and_tool_changes_are_free_unless_held_back():
    """The chart is about operations; picking is held back on demand."""
    task = lid_task()
    pick, state = task.skill("pick(lid)"), task.initial
    assert PrecedenceDetector(task).check(pick, state).facts == []
    options = PrecedenceDetector.Options(hold_back_picks=True)
    assert PrecedenceDetector(task, options).check(pick, state).is_infeasible
    assert (
        PrecedenceDetector(task, options).check(task.skill("load(screwdriver)"), state).facts == []
    )


def test_a_task_without_a_chart_is_refused_in_words():
    """With what to do instead."""
    task = lid_task().replace(chart=())
    with pytest.raises(OptionError, match=r"no 'chart:'\. Add one, or use --collision aabb"):
        make_model(task, Setup(collision=("precedence",)))


@pytest.mark.parametrize(("hold_back", "states", "observations"), [(0, 320, 268), (1, 307, 255)])
def test_the_board_has_the_states_that_were_computed_independently(
    board_task, hold_back, states, observations
):
    """320 of them, 307 if picks are held back; 268 and 255 distinct observations."""
    setup = Setup(
        collision=("precedence",), options={"precedence": {"hold_back_picks": bool(hold_back)}}
    )
    result = reachable_states(make_model(board_task, setup))
    assert states == len(result)
    assert observations == len({board_task.observe(state) for state in result})
