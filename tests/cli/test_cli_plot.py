"""``skillplan plot``: figures of real tasks, and what cannot be drawn."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest
from PIL import Image as PillowImage

from skillplan.views.figures import list_figure_names
from thinned import slow_case

CONFIGS = Path(__file__).parents[2] / "configs"
POLYGONAL = str(CONFIGS / "swarmitfix_polygonal.yaml")
WALK = """
kind: swarmitfix
name: walk
bench: {rows: 3, cols: 5}
base: {home: C1, goals: [C8, C8, C15]}
"""
MEET = """
kind: swarmitfix
name: meet
robots:
  left: {home: C1, goal: C13}
  right: {home: C66, goal: C78}
"""
QUICK = ("-O", "episodes=300")


@pytest.fixture
def walk(tmp_path, monkeypatch):
    """A base that walks on a small bench; the current folder is an empty one."""
    folder = tmp_path / "here"
    folder.mkdir()
    monkeypatch.chdir(folder)
    path = tmp_path / "walk.yaml"
    path.write_text(WALK)
    return str(path)


@pytest.fixture
def meet(tmp_path):
    """Two bases on one bench."""
    path = tmp_path / "meet.yaml"
    path.write_text(MEET)
    return str(path)


def texts(path: Path) -> set[str]:
    """Return the texts of an SVG file."""
    tags = ElementTree.parse(path).iter("{http://www.w3.org/2000/svg}text")
    return {(tag.text or "").strip() for tag in tags}


@pytest.mark.parametrize(
    ("figure", "words", "written"),
    [
        (
            "policy",
            ("--solver", "policy-iteration"),
            {"C1", "C15", "Policy of base-1: from C1 to C8"},
        ),
        slow_case(
            "policy", QUICK, {"P1", "goal"}, reason="a policy that is not learned in every run"
        ),
        ("rewards", (), {"reward [-]", "C15"}),
        ("gantt", (), {"head", "PKM", "base", "sequence 1"}),
        ("q-values", QUICK, {"Q(s, a) [-]", "episode [-]"}),
        slow_case(
            "q-values",
            (*QUICK, "--states", "C2,C3"),
            {"Q(s, a) [-]"},
            reason="all states in every run",
        ),
        slow_case(
            "learning",
            (*QUICK, "--seeds", "2"),
            {"base-1: C1 to C8", "base-3: C8 to C15"},
            reason="learns all ways; one of them in every run",
        ),
        slow_case(
            "learning",
            (*QUICK, "--seeds", "1", "--part", "base-1"),
            {"base-1: C1 to C8"},
            reason="learns a way; the same of a board in every run",
        ),
    ],
)
def test_a_figure_of_a_walk_is_drawn(cli, walk, figure, words, written):
    """Its path is printed, and nothing else is there."""
    outcome = cli("plot", walk, figure, *words, "--out", "f.svg")
    assert (0, "f.svg\n", "") == (outcome.code, outcome.out, outcome.err)
    assert [Path("f.svg")] == list(Path().iterdir())
    assert written <= texts(Path("f.svg"))


@pytest.mark.slow(reason="solves and draws a whole sheet; the other figures in every run")
def test_the_placement_of_a_trajectory_is_drawn(cli, walk):
    """With the goals of Table 3, and as many steps."""
    outcome = cli("plot", POLYGONAL, "placement", "--out", "f.svg")
    assert 0 == outcome.code
    title = "Placement of heads and bases of polygonal: 17 steps of the base for 16 goals"
    assert {title, "C42", "C29", "C54", "b7\N{EN DASH}9", "h16", "home"} <= texts(Path("f.svg"))


@pytest.mark.slow(reason="draws a fleet; its figure in test_figures.py of every run")
def test_the_ways_of_a_fleet_are_drawn(cli, walk, meet):
    """By the solver for fleets, or by any other that gives a plan."""
    assert 0 == cli("plot", meet, "fleet", "--out", "f.svg").code
    written = texts(Path("f.svg"))
    assert any(text.startswith("left: ") for text in written)
    assert any("parallel steps" in text for text in written)


@pytest.mark.parametrize(
    "figure", [slow_case("rewards", reason="another figure in every run"), "learning"]
)
def test_assemblies_are_drawn_too(cli, walk, board, figure):
    """Where nothing of a bench is shown."""
    words = ("--seeds", "1", *QUICK) if figure == "learning" else ()
    assert 0 == cli("plot", board, figure, *words, "--out", "f.svg").code
    assert any("inverter-board" in text for text in texts(Path("f.svg")))


def test_a_picture_is_named_after_task_and_figure(cli, walk):
    """In the current folder, as PNG, in the resolution asked for; a second call replaces it."""
    for dpi in ("60", "30"):
        assert "walk-gantt.png\n" == cli("plot", walk, "gantt", "--dpi", dpi).out
    content = Path("walk-gantt.png").read_bytes()
    assert content.startswith(b"\x89PNG")
    assert 11.55 * 30 == pytest.approx(int.from_bytes(content[16:20], "big"), abs=1)


@pytest.mark.slow(
    reason="draws three figures; equal figures are equal files in test_figures.py of every run"
)
def test_equal_calls_write_equal_files(cli, walk):
    """A seed says all; another one learns something else."""
    for out, seed in (("a.svg", "1"), ("b.svg", "1"), ("c.svg", "2")):
        cli("plot", walk, "q-values", *QUICK, "--seed", seed, "--out", out)
    assert Path("a.svg").read_bytes() == Path("b.svg").read_bytes()
    assert Path("a.svg").read_bytes() != Path("c.svg").read_bytes()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("polcy",), "Did you mean 'policy'?"),
        (("policy", "--out", "f.pdf"), "end it in .png or .svg"),
        (("policy", "--out", "no/f.png"), "there is no folder"),
        (("policy", "--solver", "exact"), "exact plans a sequence, not a policy"),
        (("policy", "--part", "base-9"), "No task 'base-9'"),
        (("policy", "--states", "C1"), "--states is for q-values"),
        (("policy", "-O", "gama=1"), "Did you mean 'gamma'?"),
        (("placement",), "no trajectory along which heads are placed"),
        (("gantt", "--part", "base-1"), "leave --part out"),
        (("fleet",), "no key robots"),
        (("q-values", "--states", "C99"), "there is no state 'C99'"),
        (("q-values", "--states", "C8", *QUICK), "nothing is to be decided in state C8"),
        (("q-values", "--solver", "exact"), "exact records no values of actions"),
        (("learning", "--solver", "exact"), "exact records no episodes"),
        (("learning", "-O", "gamma=0.9"), "leave -O gamma out"),
    ],
)
def test_what_cannot_be_drawn_is_told(cli, walk, words, message):
    """Exit code 2, and no file."""
    refusal = cli("plot", walk, *words).refusal
    assert message in " ".join(refusal.split())
    assert [] == list(Path().iterdir())


@pytest.mark.parametrize("figure", ["policy", "placement", "fleet"])
def test_a_bench_figure_of_an_assembly_is_refused(cli, walk, board, figure):
    """It says what can be drawn instead."""
    assert (
        "the file is of kind assembly. Figures of any kind are rewards"
        in cli("plot", board, figure).refusal
    )


@pytest.mark.parametrize(
    ("figure", "message"), [("gantt", "has several"), ("policy", "no task of the file leads")]
)
def test_a_figure_of_one_base_does_not_fit_a_fleet(cli, walk, meet, figure, message):
    """Nothing is solved in vain."""
    assert message in cli("plot", meet, figure).refusal


@pytest.mark.slow(reason="plans a sheet in vain; the comparison of such a chain in every run")
def test_a_chain_without_a_plan_is_not_drawn(cli, walk):
    """Exit code 1 and the reason: the planner of 2014 finds no shared pin."""
    outcome = cli("plot", POLYGONAL, "placement", "--solver", "csp")
    assert (1, "") == (outcome.code, outcome.out)
    assert "polygonal: unsolved: goals: nothing that" in outcome.err
    assert [] == list(Path().iterdir())


@pytest.mark.parametrize("figure", ["layout", "precedence", "exploded"])
def test_a_figure_of_an_arm_is_refused_of_a_bench(cli, walk, figure):
    """A bench has no parts and no arm."""
    refusal = cli("plot", walk, figure, "--part", "base-1").refusal
    assert "it shows parts and an arm" in refusal or "no parts that are put" in refusal


@pytest.mark.parametrize(
    ("figure", "written"),
    [
        ("layout", {"pcb", "8, 10", "50 mm"}),
        slow_case(
            "gantt",
            {"panda, gripper", "panda, tool change", "time [s]"},
            reason="draws; two others in every run",
        ),
        ("precedence", {"pcb", "brace", "screw_2"}),
        slow_case("exploded", {"transformer", "8"}, reason="draws; two others in every run"),
    ],
)
def test_a_board_is_drawn(cli, board, tmp_path, figure, written):
    """Text stays text, so that what a figure says can be read."""
    path = tmp_path / "f.svg"
    outcome = cli("plot", board, figure, "--out", str(path))
    assert (0, f"{path}\n") == (outcome.code, outcome.out)
    assert written <= texts(path)


@pytest.mark.slow(reason="draws 90 pictures; a part that comes along its way in every run")
def test_an_assembly_is_filmed_part_by_part(cli, board, tmp_path):
    """Its pictures are of one size, each part comes, and the film goes round."""
    path = tmp_path / "f.gif"
    outcome = cli("plot", board, "exploded", "--out", str(path))
    assert (0, f"{path}\n") == (outcome.code, outcome.out)
    content = path.read_bytes()
    assert content.startswith(b"GIF89a")
    assert b"NETSCAPE2.0" in content
    with PillowImage.open(path) as film:
        assert (720, True) == (film.width, film.n_frames > 20)


def test_only_a_figure_that_moves_is_filmed(cli, board, tmp_path):
    assert (
        "figures are not saved as .gif; end it in .png or .svg."
        in cli("plot", board, "layout", "--out", str(tmp_path / "f.gif")).refusal
    )


def test_a_precedence_relation_is_written_for_graphviz(cli, board, tmp_path):
    """Only of that figure: others are pictures."""
    path = tmp_path / "f.dot"
    assert 0 == cli("plot", board, "precedence", "--out", str(path)).code
    assert '"transformer" -> "brace"' in path.read_text()
    assert '"pcb" -> "screw_1"' not in path.read_text(), "it follows from other pairs"
    assert "end it in .png or .svg" in cli("plot", board, "layout", "--out", str(path)).err


def test_help_lists_all_figures_and_loads_none():
    """Matplotlib takes half a second."""
    code = (
        "import sys; from skillplan.cli import main\n"
        "try: main(['plot', '--help'])\n"
        "except SystemExit: print('matplotlib' in sys.modules, 'numpy' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.endswith("False False\n")
    assert all(f"│ {name} " in done.stdout for name in list_figure_names())


def test_a_missing_matplotlib_is_told(cli, walk, monkeypatch):
    """And what to do about it."""
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    assert "pip install matplotlib" in cli("plot", walk, "gantt").refusal


def test_rewards_of_a_task_without_rewards_are_minus_its_costs(cli, walk, tmp_path):
    """Any task has this picture; it says that the file has no rewards."""
    assert 0 == cli("init", "assembly", "--out", "mine.yaml").code
    assert 0 == cli("plot", "mine.yaml", "rewards", "--collision", "aabb", "--out", "r.svg").code
    drawn = Path("r.svg").read_text("utf-8")
    assert "reward = -cost, as the file has no rewards" in drawn
