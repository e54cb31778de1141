"""README, CONTRIBUTING and the pages: short where they must be, and no link leads nowhere."""

from __future__ import annotations

import re

import pytest

from skillplan.pipeline import load_problem, solve, solve_chain
from skillplan.records import Status
from transcripts import PAGES, ROOT, fences

DOCS = ROOT / "docs"
LINK = re.compile(r"\]\(([^)\s#]*)(?:#([^)\s]*))?\)")


def anchors(text):
    """Return the anchors of a page's headings, as Markdown renderers make them."""
    prose = re.sub(r"^```.*?^```", "", text, flags=re.M | re.S)
    headings = re.findall(r"^#+ (.*)$", prose, re.M)
    plain = [re.sub(r"[^\w\- ]", "", heading.lower()) for heading in headings]
    return {heading.strip().replace(" ", "-") for heading in plain}


def test_relative_links_and_their_anchors_lead_somewhere():
    """Every relative link of every page names a file, and a heading of it where it names one."""
    lost = []
    for page in PAGES:
        text = page.read_text("utf-8")
        prose = re.sub(r"^```.*?^```", "", text, flags=re.M | re.S)
        for target, anchor in LINK.findall(prose):
            if "://" in target:
                continue
            file = (page.parent / target) if target else page
            if not file.exists():
                lost.append(f"{page.relative_to(ROOT)}: {target}")
            elif anchor and anchor not in anchors(file.read_text("utf-8")):
                lost.append(f"{page.relative_to(ROOT)}: {target}#{anchor}")
    assert [] == lost


def test_readme_and_contributing_are_short():
    """What is longer belongs into the documentation."""
    for name in ("README.md", "CONTRIBUTING.md"):
        assert len((ROOT / name).read_text("utf-8").splitlines()) <= 150, name


def test_every_picture_is_in_the_gallery():
    """Each committed picture stands there, followed by the command that makes it."""
    gallery = (DOCS / "gallery.md").read_text("utf-8")
    pictures = [path.name for path in (DOCS / "_static").iterdir() if path.suffix != ".css"]
    for name in pictures:
        assert f"](_static/{name})" in gallery
        assert "```sh\n" in gallery.partition(name)[2]


def test_pictures_are_small():
    """All of them together are light enough for a clone."""
    sizes = [path.stat().st_size for path in (DOCS / "_static").iterdir()]
    assert max(sizes) < 1_500_000
    assert sum(sizes) < 4_000_000


def test_the_glossary_is_short():
    """Words that need explaining are to be avoided."""
    text = (DOCS / "reference/glossary.md").read_text("utf-8")
    (glossary,) = [fence for fence in fences(text) if fence.language == "{glossary}"]
    assert len(re.findall(r"^\w", glossary.body, re.M)) <= 25


def test_every_decision_has_its_four_parts():
    """Each has its file's number, which no other has, and says at least what was decided."""
    pages = sorted((DOCS / "explanation/decisions").glob("[0-9]*.md"))
    numbers = [page.name.partition("-")[0] for page in pages]
    assert len(set(numbers)) == len(numbers)
    for number, page in zip(numbers, pages, strict=True):
        text = page.read_text("utf-8")
        assert text.startswith(f"# {int(number)}. "), page.name
        assert "\n## Decision\n" in text, page.name


@pytest.mark.slow(reason="searches; what they say is valid in every run")
def test_the_examples_of_the_formats_are_solved(tmp_path):
    """The files that the reference explains have a proved optimum, or are a chain of such."""
    for kind in ("assembly", "sop", "swarmitfix"):
        text = (DOCS / f"reference/{kind}.md").read_text("utf-8")
        (example,) = [fence for fence in fences(text) if fence.file]
        file = tmp_path / example.file
        file.write_text(example.body, "utf-8")
        problem = load_problem(file)
        if len(problem.tasks) > 1:
            assert solve_chain(problem, "exact").proved_by_level
        else:
            assert Status.OPTIMAL is solve(problem.task).status


def test_the_template_is_short():
    """The plugin that the tutorial shows whole has 40 lines at most."""
    source = ROOT / "plugins/skillplan-template/src/skillplan_template/greedy.py"
    assert len(source.read_text("utf-8").splitlines()) <= 40
