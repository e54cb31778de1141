"""What a terminal would obey, or nobody sees, is written out."""

from __future__ import annotations

import io
import re
import sys
import unicodedata

import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.figure import Figure

from skillplan.views import Column, Table, escape, render
from skillplan.views.figures import render_figure

HOSTILE = "\x1b[2J\x9b31m\x7f\r\N{RIGHT-TO-LEFT OVERRIDE}\N{ZERO WIDTH SPACE}\N{LINE SEPARATOR}"
WRITTEN_OUT = r"\x1b[2J\x9b31m\x7f\x0d\u202e\u200b\u2028"


def test_every_control_and_format_character_is_written_out():
    """All that Unicode has of them, but for line breaks and tabs."""
    hidden = [
        chr(code)
        for code in range(sys.maxunicode + 1)
        if unicodedata.category(chr(code)) in ("Cc", "Cf", "Cs", "Zl", "Zp")
    ]
    raw = [char for char in hidden if escape(char) == char]
    assert ["\t", "\n"] == raw
    assert "".join(map(escape, hidden)).isascii()


def test_what_is_read_stays():
    """Letters of all scripts, wide characters, accents, and a symbol with its selector."""
    text = "p\u00f6\u4e00 e\u0301 \u05e9\u05dc\u05d5\u05dd \N{PILE OF POO} \u2764\ufe0f \u2500"
    assert text == escape(text)


@given(st.text())
def test_a_text_that_was_escaped_stays(text):
    """Nothing is written out twice."""
    assert escape(text) == escape(escape(text))


class Screen(io.StringIO):
    """A terminal."""

    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize("where", ["title", "cell", "note"])
def test_a_terminal_gets_our_marks_and_nobody_elses(where, monkeypatch):
    """A heading is bold; what a document holds neither colours nor moves nor is markup."""
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.setenv("TERM", "xterm")
    texts = {"title": "t", "cell": "c", "note": "n", where: f"[red]{HOSTILE}[/]"}
    table = Table(texts["title"], [Column("a")], [(texts["cell"],)], [texts["note"]])
    text = render([table], "table", Screen())
    assert f"[red]{WRITTEN_OUT}[/]" in text
    assert {"\x1b[1m", "\x1b[0m"} == set(re.findall(r"\x1b[^a-z]*.", text))
    assert r"[2J" not in re.sub(r"\\x1b\[2J", "", text)


def test_a_figure_names_them():
    """In an SVG as text, where it would be taken up by whoever copies it."""
    figure = Figure()
    figure.suptitle("a\N{RIGHT-TO-LEFT OVERRIDE}b\x1b")
    render_figure(figure, ".svg")
    assert [r"a\u202eb\x1b"] == [text.get_text() for text in figure.texts]
