"""What README and documentation show is what the program prints.

``pytest tests/docs --update-transcripts`` writes what it prints into the pages instead.
"""

import difflib

import pytest

from thinned import slow_case
from transcripts import PAGES, ROOT, Session, agree, fences, untimed


def takes_part(page, *, slow):
    """Whether a page shows anything, or anything slow, that can be done."""
    result = fences(page.read_text("utf-8"))
    return any(
        fence.slow if slow else fence.language == "console" or "run" in fence.words
        for fence in result
    )


LONG_PAGES = {
    "docs/howto/boards.md",
    "docs/howto/export.md",
    "docs/explanation/solvers.md",
    "docs/howto/compare.md",
    "docs/howto/output.md",
    "docs/howto/python.md",
    "docs/howto/sop.md",
    "docs/howto/verify.md",
    "docs/tutorials/first_board.md",
    "docs/tutorials/swarmitfix.md",
}
# Of those with fences that take long, half a minute each.
LONGEST_PAGES = {
    "docs/howto/cache.md",
    "docs/howto/compare.md",
    "docs/tutorials/cad.md",
    "docs/tutorials/physics.md",
    "docs/tutorials/training.md",
}


def named(page):
    return str(page.relative_to(ROOT))


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with configs, examples and a cold cache, on something of no width in particular."""
    for shown in ("configs", "examples"):
        (tmp_path / shown).symlink_to(ROOT / shown)
    monkeypatch.setenv("SKILLPLAN_CACHE_DIR", str(tmp_path / ".cache"))
    monkeypatch.delenv("COLUMNS", raising=False)
    monkeypatch.chdir(tmp_path)


def follow(page, request, *, with_slow):
    session = Session(page, with_slow)
    text = session.follow()
    if request.config.getoption("--update-transcripts"):
        page.write_text(text, "utf-8")
        return
    different = [
        "\n".join(
            [
                difference.command,
                *difflib.unified_diff(difference.shown, difference.printed, lineterm=""),
            ]
        )
        for difference in session.differences
    ]
    assert [] == different, "\n".join(different)


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    "page",
    [
        slow_case(p, reason="a second of commands; others in every run")
        if named(p) in LONG_PAGES
        else p
        for p in PAGES
        if takes_part(p, slow=False)
    ],
    ids=named,
)
def test_a_page_shows_what_is_printed(page, request):
    """Each quick command and script of a page prints what the page shows, times aside."""
    follow(page, request, with_slow=False)


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    "page",
    [
        pytest.param(
            p,
            marks=pytest.mark.release(reason="half a minute; other pages in the whole suite")
            if named(p) in LONGEST_PAGES
            else pytest.mark.slow(reason="physics, training and studies of the pages"),
        )
        for p in PAGES
        if takes_part(p, slow=True)
    ],
    ids=named,
)
def test_a_page_shows_what_is_printed_where_that_takes_long(page, request):
    """The same with physics, training and studies."""
    follow(page, request, with_slow=True)


def test_three_dots_stand_for_any_lines():
    """A transcript may leave lines out, but not others than at the dots."""
    assert agree(["a", "...", "d"], ["a", "b", "c", "d"])
    assert agree(["a", "..."], ["a"])
    assert not agree(["a", "...", "d"], ["a", "b", "c"])
    assert not agree(["b", "...", "d"], ["a", "b", "d"])


def test_only_figures_of_the_machine_are_masked():
    """Costs count to the last digit; seconds do not."""
    shown = untimed("cost 1.86709 m\neffort 23 checks, 0.01 s", "skillplan search-optimal a.yaml")
    assert ["cost 1.86709 m", "effort 23 checks, # s"] == shown
