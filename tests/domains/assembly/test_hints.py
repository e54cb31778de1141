"""A part that lies where a feeder hands out is told of before anything is planned."""

from typing import Any

import pytest

from skillplan.domains.assembly import AssemblyConfig, AssemblyDomain


def hints(lying: dict[str, Any], handed_out: dict[str, Any] | None = None) -> list[str]:
    """Return what is said of a box that lies near a feeder at [0.4, 0.2]."""
    box = {"tool": "gripper", "size_m": [0.04, 0.04, 0.02], "goal_m": [0.5, -0.2]}
    chip = {"tool": "gripper", "size_m": [0.01, 0.01, 0.01], "goal_m": [0.4, -0.2]}
    content: dict[str, Any] = {
        "kind": "assembly",
        "name": "feeder",
        "robot": {"home_m": [0.3, 0.0]},
        "tools": {"gripper": {"holder_m": [0.6, 0.3]}},
        "initial_tool": "gripper",
        "feeders": {"tray": {"position_m": [0.4, 0.2]}},
        "parts": {"box": {**box, **lying}},
    }
    content["parts"] |= {"chip": {**chip, "feeder": "tray"}} if handed_out is None else {}
    config = AssemblyConfig.model_validate({**content, **(handed_out or {})})
    return [str(hint) for hint in AssemblyDomain().hints(config)]


@pytest.mark.parametrize("start_m", [[0.4, 0.2], [0.42, 0.2], [0.4, 0.224]])
def test_a_part_upon_a_feeder_is_told_of_with_what_waits(start_m):
    """Whatever of the two boxes meets."""
    assert hints({"start_m": start_m}) == [
        "parts.box.start_m: 'box' lies where 'tray' hands out 'chip', which cannot be taken before "
        "it is gone. Move one of them."
    ]


@pytest.mark.parametrize("start_m", [[0.43, 0.2], [0.4, 0.23], [0.3, 0.0]])
def test_a_part_beside_a_feeder_is_not(start_m):
    """Nothing of it is over what is handed out."""
    assert hints({"start_m": start_m}) == []


def test_a_screw_s_feeder_is_blocked_as_well():
    """Screws wait like parts."""
    screw = {"tool": "driver", "hole_m": [0.5, -0.2], "through": "box", "feeder": "tray"}
    tools = {"gripper": {"holder_m": [0.6, 0.3]}, "driver": {"holder_m": [0.6, -0.3]}}
    (hint,) = hints({"start_m": [0.41, 0.2]}, {"screws": {"bolt": screw}, "tools": tools})
    assert "where 'tray' hands out 'bolt'" in hint


def test_a_part_over_a_low_feeder_is_told_of_by_the_way_up():
    """What is handed out at the table's height is lifted through a bridge."""
    bridge = {
        "size_m": None,
        "boxes": [
            {"size_m": [0.01, 0.06, 0.04], "centre_m": [-0.05, 0, 0.02]},
            {"size_m": [0.01, 0.06, 0.04], "centre_m": [0.05, 0, 0.02]},
            {"size_m": [0.11, 0.06, 0.01], "centre_m": [0, 0, 0.045]},
        ],
    }
    assert len(hints({"start_m": [0.4, 0.2], **bridge})) == 1


def test_what_nobody_takes_is_not_blocked():
    """A feeder that hands out nothing has nothing to wait for."""
    assert hints({"start_m": [0.4, 0.2]}, {"screws": {}}) == []
