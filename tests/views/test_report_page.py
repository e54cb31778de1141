"""The page of a report: one file that allows what is in it, and takes nobody's names for markup."""

from __future__ import annotations

import base64
import hashlib
import json
import re
from html.parser import HTMLParser

import pytest

from skillplan.views.report import (
    Chapter,
    Markup,
    Player,
    Section,
    build_comparison_chapter,
    build_lead,
    embed_json,
    number,
    numbers,
    read_page_style,
    render_page,
    seconds,
    share,
    table,
    tag,
    text,
)

HOSTILE = "<script>alert(1)</script> \"quoted\" 'x' </title></style> \x1b[31m \u202e &amp;"
PLAYER = Player("const a = '</script><!--';", ".player{color:red}", "MIT")


class Elements(HTMLParser):
    """All elements of a page with their attributes."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.content: dict[str, list[str]] = {}
        self._within: list[str] = []
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, dict(attrs)))
        self._within.append(tag)

    def handle_endtag(self, tag: str) -> None:
        while self._within and self._within.pop() != tag:
            pass

    def handle_data(self, data: str) -> None:
        if self._within:
            self.content.setdefault(self._within[-1], []).append(data)


def chapter(words: str = "calm") -> Chapter:
    """Return a chapter that says something."""
    created = table(words, [words, "n"], [[words, words]], " n")
    return Chapter("c1", words, tag("p", {"title": words}, words), [Section("s", words, created)])


def a_page(words: str = "calm", playing: bool = True) -> str:
    """Return a page with a player."""
    playback = {"title": words, "duration_s": 1.0} if playing else None
    return render_page(words, [chapter(words)], playback, PLAYER)


def test_names_of_others_are_text_and_no_markup():
    """Neither in headings, tables and attributes nor in the data of the player."""
    plain, hostile = Elements(a_page()), Elements(a_page(HOSTILE))
    assert [name for name, _ in plain.found] == [name for name, _ in hostile.found]
    assert not [key for _, given in hostile.found for key in given if key.startswith("on")]
    assert "\x1b" not in a_page(HOSTILE)
    assert "\u202e" not in a_page(HOSTILE)
    (data,) = (item for item in hostile.content["script"] if item.startswith("{"))
    assert HOSTILE == json.loads(data)["title"]


def test_the_policy_allows_what_the_page_holds_and_nothing_else():
    """By its hashes; there is no style attribute, and nothing is loaded."""
    page = a_page()
    elements = Elements(page)
    (policy,) = (a["content"] or "" for _, a in elements.found if "http-equiv" in a)
    assert policy.startswith("default-src 'none'; script-src 'sha256-")
    assert "unsafe" not in policy
    for name in ("style", "script"):
        for _, content in re.findall(rf"<({name})>(.*?)</{name}>", page, re.DOTALL):
            digest = base64.b64encode(hashlib.sha256(content.encode()).digest()).decode()
            assert f"'sha256-{digest}'" in policy
    assert not [a for _, a in elements.found if {"style", "onclick", "srcset"} & a.keys()]
    links = [a.get("src") or a.get("href") or "" for _, a in elements.found]
    assert not [link for link in links if link and not link.startswith(("#", "data:"))]


def test_a_script_ends_where_it_ends():
    """Whatever its strings hold."""
    page = a_page()
    assert 2 == page.count("</script>")
    assert r"'<\/script><\!--'" in page


def test_without_a_playback_there_is_no_script():
    page = a_page(playing=False)
    assert "<script" not in page
    (policy,) = (a["content"] or "" for _, a in Elements(page).found if "http-equiv" in a)
    assert "script-src 'none'" in policy


def test_numbers_that_are_none_are_no_json():
    with pytest.raises(ValueError, match="JSON"):
        embed_json({"x": float("nan")})


def test_a_page_has_landmarks_and_says_what_tables_show():
    """For who does not see it."""
    names = [name for name, _ in Elements(a_page()).found]
    assert {"header", "nav", "main", "footer", "caption", "h1", "h2"} <= set(names)
    result = Elements(a_page()).found
    assert [("col", "row")] == [
        (
            next(a["scope"] for name, a in result if name == "th"),
            [a["scope"] for name, a in result if name == "th"][-1],
        )
    ]


def test_the_page_serves_dark_rooms_narrow_screens_and_paper():
    style = read_page_style()
    assert {"prefers-color-scheme:dark", "max-width:560px", "@media print"} <= {
        item
        for item in ("prefers-color-scheme:dark", "max-width:560px", "@media print")
        if item in style
    }
    assert "url(" not in style


def test_a_comparison_from_elsewhere_is_data():
    """Whatever stands in it: words for numbers, rows that are none, names that are markup."""
    rows = [
        {"solver": HOSTILE, "status": HOSTILE, "cost": "1", "stats": {"wall_s": -1}},
        {"solver": "exact", "status": "optimal", "cost": 1.5, "stats": {"wall_s": 0.2}},
        "no row",
    ]
    comparison_chapter = build_comparison_chapter({"rows": rows, "warm": False}, "c1")
    page = render_page("t", [comparison_chapter])
    assert "<script" not in page
    assert "&lt;script&gt;alert(1)" in page
    assert "1.5" in page
    assert "No" not in build_comparison_chapter({"rows": 7}, "c1").heading


def test_texts_are_escaped_once():
    assert "&lt;" == text("<")
    assert "<b>" == text(Markup("<b>"))
    assert '<i a="&quot;&gt;">&amp;</i>' == tag("i", {"a": '">', "b": None, "c": False}, "&")
    assert "<i hidden></i>" == tag("i", {"hidden": True})


@pytest.mark.parametrize(
    ("shown", "expected"),
    [
        (number(None), "-"),
        (number(float("inf")), "-"),
        (number(True), "-"),
        (number(12345), "12,345"),
        (number(1.8670861), "1.86709"),
        (seconds("3"), "-"),
        (seconds(1.005), "1.00"),
        (share(0.007), "0.7 %"),
        (share(float("nan")), "-"),
    ],
)
def test_numbers_are_shown_as_such_and_nothing_else_is(shown, expected):
    assert expected == shown


def test_numbers_of_a_column_have_the_same_decimals():
    """As many as the longest needs, five at most; counts stay whole, and what is none a dash."""
    assert numbers([0.038, 0.0816088, 1.5]) == ["0.03800", "0.08161", "1.50000"]
    assert numbers([0.25, 2.0, None, 3]) == ["0.25", "2.00", "-", "3"]


def test_of_what_has_no_plan_the_page_says_why_and_shows_no_empty_figures():
    """Each reason is a sentence of its own."""
    why = "pcb before clock before pcb: clock belongs on pcb\nwith another start it has an order"
    message = str(
        build_lead({"status": "infeasible", "reason": why, "cost": None, "cost_unit": "m"})
    )
    assert [
        "Proved: there is no plan.",
        "pcb before clock before pcb: clock belongs on pcb.",
        "with another start it has an order.",
    ] == re.findall(r'<p class="lead">(.*?)</p>', message)
    assert ["Status"] == re.findall("<dt>(.*?)</dt>", message)


OPTIMAL = {
    "status": "optimal",
    "physics": "kinematic",
    "collision": "swept,precedence",
    "cost": 1.0,
    "steps": [{}] * 30,
}
FAILURE = {
    "engine": "mujoco",
    "complete": False,
    "failed_step": 9,
    "skill": "place(gear)",
    "reason": "it rests 6 mm off",
}


def leads(document: dict[str, object]) -> list[str]:
    return re.findall(r'<p class="lead">(.*?)</p>', str(build_lead(document)))


class TestTheHeadline:
    def test_names_the_back_ends_of_the_proof(self):
        (words,) = leads(OPTIMAL)
        assert words == (
            "A valid plan, proved to be the best by geometry (kinematic, swept, precedence)."
        )

    def test_says_how_many_parts_of_the_product_it_is_about(self):
        lead = str(build_lead(OPTIMAL, covered=(4, 26)))
        assert "It is about 4 of 26 parts of the product; 22 left out." in lead
        assert "It is about all 8 parts of the product." in str(build_lead(OPTIMAL, covered=(8, 8)))

    def test_of_a_failed_simulation_says_so_in_the_first_sentence(self):
        shown = leads({**OPTIMAL, "simulation": FAILURE})
        assert shown == [
            "Proved by geometry (kinematic, swept, precedence); the simulation by mujoco fails at "
            "step 9 of 30, place(gear): it rests 6 mm off."
        ]
        figures = str(build_lead({**OPTIMAL, "simulation": FAILURE}))
        assert '<span class="chip bad">fails</span><small>at step 9 of 30</small>' in figures
        assert '<span class="chip good">optimal</span>' in figures, "the status stays"

    def test_of_a_plan_not_proved_to_be_the_best_claims_no_proof(self):
        (words,) = leads({**OPTIMAL, "status": "solved", "simulation": FAILURE})
        assert words.startswith("Checked by geometry (kinematic, swept, precedence), not proved")

    def test_of_a_complete_simulation_says_by_which_engine(self):
        done = {**FAILURE, "complete": True, "failed_step": None, "skill": None, "reason": ""}
        (words,) = leads({**OPTIMAL, "simulation": done})
        assert words.endswith("The simulation by mujoco completes the plan.")

    def test_of_the_chart_alone_mentions_no_geometry_and_lists_it_as_not_checked(self):
        sentence = "geometry (collisions): only the chart is checked"
        by_chart = {**OPTIMAL, "collision": "precedence", "not_checked": [sentence]}
        assert leads(by_chart) == [
            "A valid plan, proved to be the best by kinematic, precedence.",
            f"Not checked: {sentence}.",
        ]


@pytest.mark.parametrize(
    ("measured_s", "played_s", "expected"),
    [
        (50.0, None, "50.00 s<small>simulated; 69.47 s by the task&#x27;s own figures</small>"),
        (
            None,
            68.1,
            "69.47 s<small>planned, by the task&#x27;s own figures; "
            "68.10 s along the paths that are played</small>",
        ),
        (None, None, "69.47 s<small>planned</small>"),
    ],
)
def test_the_time_of_a_plan_says_whose_it_is(measured_s, played_s, expected):
    """A task's figures, paths and simulation differ, and a reader sees which is which."""
    lead = build_lead({"status": "optimal", "cost": 1.0, "makespan_s": 69.47}, measured_s, played_s)
    assert expected in str(lead)
