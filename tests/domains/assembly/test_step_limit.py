"""The step limit of a file that gives none is enough for every order of its skills."""

from typing import Any

import pytest

from situations import assembly, config_content
from skillplan.domains.assembly import MOST_STEPS

BOARD = "inverter_board"


def limit_of(name: str = BOARD, **changes: Any) -> int:
    """Return the step limit of a shipped file that says none."""
    content = config_content(name)
    content.pop("step_limit")
    return assembly({**content, **changes}).step_limit


def failing(probability: float) -> dict[str, Any]:
    parts = config_content(BOARD)["parts"]
    parts["pcb"]["grasp_failure"] = probability
    return parts


class TestTheDefault:
    def test_is_every_skill_once_and_a_change_before_each(self):
        """Six picks, six places, two screws; a swap before each of these eight, and a last one."""
        assert limit_of() == 6 + 6 + 2 + (8 + 1)

    def test_counts_two_skills_a_change_where_tools_are_returned_first(self):
        """Offload and load."""
        assert limit_of(tool_change={"style": "separate"}) == 6 + 6 + 2 + 2 * (8 + 1)

    def test_has_one_change_where_there_is_one_tool(self):
        """Which may have to be attached first."""
        content = config_content(BOARD)
        content = {k: v for k, v in content.items() if k not in ("chart", "actions", "observation")}
        content["tools"].pop("screwdriver")
        content |= {"screws": {}, "step_limit": None, "collision": {}, "reward": None}
        assert assembly(content).step_limit == 6 + 6 + 1

    @pytest.mark.parametrize(("probability", "tries"), [(0.05, 3), (0.1, 3), (0.5, 10)])
    def test_has_room_for_grasps_that_fail(self, probability, tries):
        """So many tries that the part is left lying once in 1,000 times at most."""
        assert limit_of(parts=failing(probability)) == limit_of() + tries - 1
        assert probability**tries <= 1e-3 * (1 + 1e-9) < probability ** (tries - 1)

    def test_is_never_more_than_a_file_may_give(self):
        """However hopeless a grasp is."""
        assert limit_of(parts=failing(1 - 1e-9)) == MOST_STEPS


def test_a_given_limit_holds(board_task):
    """The default is for files that say none."""
    assert board_task.step_limit == 20
