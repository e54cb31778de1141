"""Lines end between words, else in lists, else in names, else anywhere."""

import pytest

from skillplan.views import make_printable, wrap, wrap_note


@pytest.mark.parametrize(
    ("text", "width", "lines"),
    [
        ("all fits", 8, ["all fits"]),
        ("words go over", 9, ["words go", "over"]),
        ("0,1,2,3,4,5", 6, ["0,1,2,", "3,4,5"]),
        ("at(home)+hand_free", 10, ["at(home)+", "hand_free"]),
        ("policy-iteration", 10, ["policy-", "iteration"]),
        ("see /a/folder/somewhere", 12, ["see /a/", "folder/", "somewhere"]),
        ("abcdefghij", 4, ["abcd", "efgh", "ij"]),
        ("two\nlines", 20, ["two", "lines"]),
    ],
)
def test_a_text_is_broken_where_it_reads_best(text, width, lines):
    """Words whole as long as they fit a line."""
    assert lines == wrap(text, width)


def test_further_lines_hang():
    assert ["one two", "  three", "  four"] == wrap("one two three four", 7, 2)


def test_a_note_hangs_under_its_text():
    """Behind the label and the blanks that follow it."""
    assert ["cost   one two", "       three"] == wrap_note("cost   one two three", 15)


def test_wide_characters_take_two_columns():
    assert ["\N{CJK UNIFIED IDEOGRAPH-4E00}" * 2] * 2 == wrap(
        "\N{CJK UNIFIED IDEOGRAPH-4E00}" * 4, 4
    )


def test_nothing_moves_the_cursor():
    """A name in a task file cannot colour or overwrite what is printed."""
    assert r"\x1b[31mred bell\x07\x0d" == make_printable("\x1b[31mred\tbell\x07\r")
