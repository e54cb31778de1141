"""What the messages on places out of reach name: the safe height, or the place."""

from pathlib import Path

import pytest

from skillplan import load_problem
from skillplan.errors import TaskError

CONFIG = Path(__file__).parents[2] / "configs" / "inverter_board.yaml"


def faults(changes: dict[str, str]) -> list[str]:
    with pytest.raises(TaskError) as caught:
        load_problem(CONFIG, changes=changes)
    return str(caught.value).splitlines()


def test_a_safe_height_out_of_reach_over_most_places_is_one_message_with_the_limit():
    (message,) = faults({"robot.safe_height_m": "0.9"})
    assert "robot.safe_height_m: 0.9 m is too high" in message
    limit_m = float(message.split("At ")[1].split(" m or less")[0])
    load_problem(CONFIG, changes={"robot.safe_height_m": str(limit_m)})
    assert faults({"robot.safe_height_m": str(limit_m + 0.002)})


def test_a_place_out_of_reach_at_the_safe_height_alone_names_both():
    (message,) = faults({"tools.screwdriver.holder_m": "[0.85, 0.0]"})
    assert "tools.screwdriver.holder_m: out of reach at robot.safe_height_m" in message


def test_a_place_out_of_reach_at_any_height_does_not_blame_the_safe_height():
    (message,) = faults({"tools.screwdriver.holder_m": "[0.9, 0.0]"})
    assert "safe_height_m" not in message
