"""What JSON is accepted."""

import json
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from skillplan.files import MAX_DEPTH, parse_json

VALUES = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=4),
    max_leaves=30,
)


@given(VALUES)
def test_what_is_written_is_read(value):
    """As text and as bytes."""
    text = json.dumps(value)
    assert value == parse_json(text)
    assert value == parse_json(text.encode())


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('{"a": 1, "b": 2, "a": 3}', "the key 'a' stands twice"),
        ("[NaN]", "a number must be finite, not NaN"),
        ("[-Infinity]", "a number must be finite, not -Infinity"),
        ("[1e999]", "the number 1e999 is too large"),
        ("[1, 2", "Expecting"),
        ("", "Expecting value"),
        (b"\xff", "decode"),
        ("9" * 301, "is too large"),
        ("9" * 5000, "is too large"),
    ],
)
def test_what_the_standard_library_lets_pass_is_refused(text, words):
    """As is what is no JSON at all."""
    with pytest.raises(ValueError, match=words):
        parse_json(text)


@pytest.mark.parametrize("pair", ["[]", '{"a":}'], ids=["lists", "objects"])
def test_the_depth_is_limited(pair):
    """The deepest that is allowed is read, one level more is not."""
    opening, closing = pair[:-1], pair[-1]
    inside = "[]" if pair == "[]" else "{}"
    for depth in (MAX_DEPTH, MAX_DEPTH + 1):
        text = opening * (depth - 1) + inside + closing * (depth - 1)
        if depth > MAX_DEPTH:
            with pytest.raises(ValueError, match="nested deeper than 64 levels"):
                parse_json(text)
        else:
            parse_json(text)


def test_brackets_within_strings_do_not_count():
    """Nor do quotes that are escaped."""
    value = ["[" * 500, '"[' * 500, "\\", "{" * 500]
    assert value == parse_json(json.dumps(value))


@pytest.mark.parametrize(
    "text",
    ["[" * 2_000_000, '{"a":' * 400_000, '"' + '\\"' * 1_000_000, "][" * 1_000_000],
    ids=["open lists", "open objects", "an open string", "brackets that do not pair"],
)
def test_hostile_texts_are_refused_soon(text):
    """However they are made, in the time that their size takes."""
    begin_s = time.perf_counter()
    with pytest.raises(ValueError):  # noqa: PT011
        parse_json(text)
    assert time.perf_counter() - begin_s < 5


def test_a_mark_of_the_byte_order_is_passed_over():
    """Editors put it there."""
    assert {"a": 1} == parse_json(b'\xef\xbb\xbf{"a": 1}')
