"""What is said of a task that cannot be done."""

from __future__ import annotations

from typing import Any

from skillplan.domains.assembly import AssemblyConfig, ground
from skillplan.model import explain_obstruction
from skillplan.pipeline import Setup, make_model
from skillplan.task import Task
from skillplan.testing import lid_content, lid_task, shut_box_task


def lid_with(**changes: Any) -> Task:
    content = lid_content()
    content["parts"] = {**content["parts"], **changes}
    return ground(AssemblyConfig.model_validate(content), "")


def test_the_skill_that_fails_everywhere_is_named_with_its_reason():
    fuse = {**lid_content()["parts"]["fuse"], "goal_m": [0.57, 0.0]}
    model = make_model(lid_with(fuse=fuse), Setup(collision=("aabb",), with_chart=False))
    message = explain_obstruction(model)
    assert message == (
        "place(fuse) fails in all 4 states in which it can be tried: "
        "aabb: fuse has nothing beneath it"
    )


def test_only_what_the_goal_lacks_is_named():
    message = explain_obstruction(make_model(shut_box_task()))
    assert message is not None
    assert message.startswith("place(fuse)")
    assert "load(" not in message


def test_where_every_skill_succeeds_somewhere_none_is_blamed():
    assert explain_obstruction(make_model(lid_task(), Setup(collision=("aabb",)))) is None


def test_a_task_with_too_many_states_is_not_gone_through():
    model = make_model(shut_box_task(), Setup(collision=("precedence",)))
    assert explain_obstruction(model, most_states=2) is None
