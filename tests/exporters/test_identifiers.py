"""Names as identifiers: unique, reversible, the same every time."""

import json
import re

from hypothesis import given
from hypothesis import strategies as st

from skillplan.exporters import Identifiers, quote


@given(st.lists(st.text(max_size=80), unique=True, max_size=20))
def test_every_name_has_its_own_and_is_found_by_it(names):
    """Whatever the names are."""
    identifiers = Identifiers(names, {"end", "x"})
    assert [identifiers.name_of(identifiers[name].upper()) for name in names] == names
    for name in names:
        assert re.fullmatch(r"[a-z][a-z0-9]*(_[a-z0-9]+)*", identifiers[name])
        assert identifiers[name] not in {"end", "x"}


def test_names_that_become_the_same_are_numbered_in_order():
    """A name that looks like a number of another is no exception."""
    identifiers = Identifiers(["a-b", "A B", "a_b_2", "1"])
    assert ["a_b", "a_b_2", "a_b_2_2", "x_1"] == [identifiers[name] for name in identifiers]
    assert identifiers.name_of("c") is None


@given(st.text())
def test_a_quoted_name_stays_on_its_line_and_in_its_comment(name):
    """And is that name when it is read as JSON."""
    text = quote(name)
    assert text.isascii()
    assert text.isprintable()
    assert "*" not in text
    assert name == json.loads(text)
