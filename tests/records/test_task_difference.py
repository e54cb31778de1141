"""What differs between two task files is named key by key."""

from __future__ import annotations

import copy
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from situations import CONFIGS
from skillplan.pipeline import load_problem
from skillplan.records import MISSING, Difference, describe_changes, differences, resolve_config

JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.text(),
    lambda values: st.lists(values) | st.dictionaries(st.text(), values),
    max_leaves=12,
)


@given(JSON)
def test_nothing_differs_from_itself(value):
    assert [] == differences(value, copy.deepcopy(value))


@given(JSON, JSON)
def test_whatever_differs_is_found(one, other):
    def text(value: Any) -> str:
        return repr(value)

    if text(one) == text(other):
        return
    result = differences(one, other)
    if isinstance(one, dict) and isinstance(other, dict) and one == other:
        # Of mappings the order does not count.
        return
    assert result
    assert all(str(difference) for difference in result)


@pytest.mark.parametrize(
    ("was", "now", "text"),
    [
        ({"a": {"b": [1, 2]}}, {"a": {"b": [1, 3]}}, "a.b[1]: 2 there, 3 now"),
        ({"a": 1}, {}, "a: 1 there, nothing now"),
        ({}, {"a": None}, "a: nothing there, null now"),
        ({"a": [1]}, {"a": [1, 2]}, "a: [1] there, [1, 2] now"),
        ({"a": 1}, {"a": True}, "a: 1 there, true now"),
        ({"a": 1}, {"a": 1.0}, "a: 1 there, 1.0 now"),
        ({"a": "x" * 90}, {"a": ""}, f'a: "{"x" * 56}... there, "" now'),
    ],
)
def test_a_difference_is_told_with_its_key(was, now, text):
    assert [text] == [str(difference) for difference in differences(was, now)]


def test_a_key_that_is_missing_is_no_key_that_is_null():
    assert [Difference("a", MISSING, None)] == differences({}, {"a": None})


def test_of_a_file_what_was_set_is_what_changed():
    path = CONFIGS / "inverter_board.yaml"
    changes = {"parts.pcb.mass_kg": "0.5", "step_limit": "33"}
    was, now = (resolve_config(load_problem(path, None, some)) for some in ({}, changes))
    message = describe_changes(was, now)
    assert "parts.pcb.mass_kg: " in message
    assert "step_limit: 20 there, 33 now" in message
    assert 1 == message.count("; ")


def test_what_does_not_make_another_task_is_not_named():
    path = CONFIGS / "inverter_board.yaml"
    was, now = (
        resolve_config(load_problem(path, None, some)) for some in ({}, {"description": "other"})
    )
    assert "nothing that its file says" == describe_changes(was, now)


def test_many_differences_are_counted():
    message = describe_changes(
        {str(i): 0 for i in range(20)}, {str(i): 1 for i in range(20)}, most=3
    )
    assert message.endswith("; and 17 more")
    assert 3 == message.count(" there, ")
