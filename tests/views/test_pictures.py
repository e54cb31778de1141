"""Pictures of assemblies: what is where, and in which order."""

from __future__ import annotations

import math
import re
from itertools import combinations, islice, pairwise
from pathlib import Path
from xml.etree import ElementTree

import pytest

from skillplan import solve_problem
from skillplan.chart import Alternatives, DerivedChart, Relation
from skillplan.pipeline import Setup, load_problem
from skillplan.task import Body, Box, Pose
from skillplan.views import figures
from skillplan.views.report import embed_picture

PLAN = [0, 1, 2, 3, 4, 5, 8, 9, 10, 11, 6, 7, 13, 14, 15]


@pytest.fixture(scope="module")
def board():
    """The paper's inverter board."""
    return load_problem("configs/inverter_board.yaml").task


@pytest.fixture(scope="module")
def plan(board):
    """Its best plan."""
    return [board.skills[action].name for action in PLAN]


def labels(picture: figures.Picture) -> list[str]:
    """Return the texts of a picture."""
    return picture.texts


def paths(picture: figures.Picture, classes: str) -> list[ElementTree.Element]:
    """Return the shapes of a picture in a page that have some classes."""
    root = ElementTree.fromstring(embed_picture(picture, "p"))
    return [path for path in root.iter("path") if path.get("class") == classes]


def relation(before: str, after: str) -> Relation:
    """Return a pair with a reason."""
    return Relation(before, after, f"{before} is beneath {after}")


def chart(*relations: Relation, either: tuple[Alternatives, ...] = ()) -> DerivedChart:
    """Return a derived chart of some pairs."""
    return DerivedChart(relations, None, (), (), {}, {}, (), either)


def test_a_layout_numbers_every_step_that_moves_the_arm(board, plan):
    """Steps that end at one place share a label."""
    shown = ", ".join(labels(figures.draw_layout(board, plan)))
    assert set(range(1, 16)) <= {int(number) for number in re.findall(r"\b\d+\b", shown)}
    assert "8, 10" in shown


def test_a_layout_without_a_plan_shows_the_cell(board):
    assert {"pcb", "brace"} <= set(labels(figures.draw_layout(board, [])))


def test_a_layout_shows_zones_what_they_do_and_a_legend_within_its_width():
    """Notes name the effect; strokes of the hatch lie within the zone."""
    task = load_problem("configs/cell_zones.yaml").task
    picture = figures.draw_layout(task, [])
    shown = set(labels(picture))
    assert {"belt", "view", "curtain", "aisle", "keep-out zone", "slow, 0.25 m/s"} <= shown
    notes = {note.title for note in picture.notes.values()}
    assert "the zone view: keeps out load" in notes
    assert "the zone aisle: 0.25 m/s at most" in notes
    assert len(paths(picture, "no-fill s-red")) > 20
    plain = set(labels(figures.draw_layout(load_problem("configs/fixture_cell.yaml").task, [])))
    assert not plain & {"keep-out zone", "slow, 0.25 m/s"}


def test_a_product_that_was_turned_is_drawn_with_both_its_sides():
    """What was put in before the turn comes from below in the end."""
    task = load_problem("configs/cell_turn.yaml").task
    plan = [task.skills[i].name for i in (0, 1, 17, 3, 4, 10, 11, 9, 16, 6, 8, 10, 14)]
    picture = figures.draw_layout(task, plan)
    notes = {note.title for note in picture.notes.values()}
    assert {"pivot of flip", "vise holds chassis"} <= notes
    assert "part with a holder" in labels(picture)
    names = [text for text in labels(figures.draw_exploded_view(task, plan)) if not text.isdigit()]
    assert names == ["bottom", "foot", "chassis", "cover", "top"]


def test_sixteen_parts_have_sixteen_colours():
    assert len({figures.COLOURS[role] for role in figures.SERIES}) == 16


def test_an_exploded_view_of_many_parts_has_numbers_that_cover_no_other_and_a_legend():
    """The legend leaves out words that all names begin with, and then as many as do not fit."""
    long, block = "a very long name " * 4, (Box((0.002, 0.002, 0.004), (0.0, 0.0, 0.002)),)
    names = {n: f"cell-1 - frame/{long * (n > 38)}bolt-{n}" for n in range(1, 41)}
    added = [
        (
            Body(name, block, (), 0.1),
            Pose((0.003 * (n % 8), 0.003 * (n // 8), 0.0)),
            (0.0, 0.0, -1.0),
        )
        for n, name in names.items()
    ]
    picture = figures.draw_product("cell", added)
    numbers = [str(n) for n in range(1, 41)]
    assert sorted(labels(picture)[:40], key=int) == numbers
    assert labels(picture)[40:44] == ["1", "bolt-1", "2", "bolt-2"]
    assert labels(picture)[-1].endswith("a very long name bolt-40")
    boxes = [
        [float(value) for value in re.findall(r"[-\d.]+", path.get("d"))]
        for path in paths(picture, "f-paper s-ink")
    ]
    assert len(boxes) == 40
    for first, second in combinations(boxes, 2):
        apart = [
            max(first[axis::2]) <= min(second[axis::2])
            or max(second[axis::2]) <= min(first[axis::2])
            for axis in (0, 1)
        ]
        assert any(apart)


def test_an_exploded_view_numbers_parts_in_the_order_of_the_plan(board, plan):
    """The board first, the screws last; each has a number and a name."""
    texts = labels(figures.draw_exploded_view(board, plan))
    named = dict(zip(texts[1::2], map(int, texts[::2]), strict=True))
    assert {"pcb": 1, "switch_1": 2, "brace": 5, "screw_2": 8}.items() <= named.items()


def test_a_film_brings_part_after_part_along_its_way(board, plan):
    """The first comes from above, gently, and then rests."""
    first = [image.rgb for image in islice(figures.film_assembly(board, plan, width_px=300.0), 14)]
    assert len(set(first[:10])) == 10
    assert len(set(first[10:])) == 1
    wide, blue = 3 * 300, bytes.fromhex(figures.COLOURS["blue"].removeprefix("#"))[2]
    heights = []
    for rgb in first[:11]:
        rows = [rgb[at : at + wide] for at in range(0, len(rgb), wide)]
        bluish = [
            number
            for number, row in enumerate(rows)
            if any(row[at] < 40 and row[at + 2] > blue // 3 for at in range(0, 3 * 90, 3))
        ]
        heights.append(min(bluish))
    assert heights == sorted(heights)
    assert heights[0] < heights[-1]


def test_a_time_line_has_a_row_for_each_tool(board, plan):
    """A change of tools has its own."""
    bars = figures.list_plan_bars(board, plan, [1.0] * len(plan))
    assert ["panda, gripper", "panda, tool change", "panda, screwdriver"] == list(
        dict.fromkeys(bar.row for bar in bars)
    )
    assert [float(k) for k in range(15)] == [bar.start_s for bar in bars]


def test_measured_times_go_before_planned_ones(board, plan):
    times = {k: (2.0 * k, 2.0 * k + 1.5) for k in range(len(plan))}
    bars = figures.list_plan_bars(board, plan, [1.0] * len(plan), times)
    assert [(28.0, 29.5)] == [(bar.start_s, bar.end_s) for bar in bars[-1:]]


def test_after_a_failed_step_bars_follow_as_planned_and_are_marked(board, plan):
    times = {0: (0.5, 2.0), 1: (2.0, 5.0)}
    bars = figures.list_plan_bars(board, plan, [1.0] * len(plan), times, failed=1)
    assert ["", figures.FAILED] + [figures.NOT_SIMULATED] * (len(plan) - 2) == [
        bar.mark for bar in bars
    ]
    assert [(0.5, 2.0), (2.0, 5.0), (5.0, 6.0), (6.0, 7.0)] == [
        (bar.start_s, bar.end_s) for bar in bars[:4]
    ]
    assert bars[1].title.endswith(", fails in simulation")


def test_a_time_line_marks_the_failure_across_all_rows_and_explains_its_marks(board, plan):
    bars = figures.list_plan_bars(board, plan, [1.0] * len(plan), {0: (0.0, 2.0)}, failed=0)
    whole = figures.draw_gantt_picture(
        figures.list_plan_bars(board, plan, [1.0] * len(plan)), "Times"
    )
    marked = figures.draw_gantt_picture(bars, "Times")
    added = {*labels(marked)} - {*labels(whole)}
    assert {figures.FAILED, figures.NOT_SIMULATED} <= added
    (line,) = paths(marked, "no-fill s-red")
    left, right = re.findall(r"[ML] (\S+)", line.get("d", ""))
    assert left == right


def test_a_time_line_needs_a_bar():
    with pytest.raises(ValueError, match="at least one bar"):
        figures.draw_gantt_picture([], "nothing")


def test_a_bar_does_not_end_before_it_begins():
    with pytest.raises(ValueError, match="cannot run"):
        figures.PlanBar("arm", "part", "pick", 2.0, 1.0, "")


def test_pairs_that_follow_from_others_are_not_drawn(board):
    """The hand-made chart and the derived one are laid over each other."""
    graph = figures.build_precedence_graph(
        board, chart(relation("pcb", "clock"), relation("clock", "brace"))
    )
    pairs = {(edge.before, edge.after): edge for edge in graph.edges}
    assert ("pcb", "brace") not in pairs
    assert (True, True) == (pairs["pcb", "clock"].derived, pairs["pcb", "clock"].drawn)
    assert (True, False) == (pairs["clock", "brace"].derived, pairs["clock", "brace"].drawn)
    assert (False, True) == (pairs["brace", "screw_1"].derived, pairs["brace", "screw_1"].drawn)
    assert "pcb is beneath clock" in pairs["pcb", "clock"].why


def test_layers_follow_the_longest_chain(board):
    graph = figures.build_precedence_graph(board, None)
    depth = {node: k for k, layer in enumerate(graph.layers) for node in layer}
    assert (0, 1, 2, 3) == tuple(depth[item] for item in ("pcb", "clock", "brace", "screw_1"))


def test_an_edge_that_passes_a_layer_has_a_place_of_its_own_there():
    """So that it runs through no node of that layer."""
    edges = [("a", "b"), ("b", "c"), ("a", "d"), ("d", "c"), ("e", "c"), ("c", "f"), ("a", "f")]
    placed = figures.arrange_layers("abcdef", edges)
    assert [figures.Bend(("e", "c"), 1)] == list(placed.bends["e", "c"])
    assert [figures.Bend(("a", "f"), 1), figures.Bend(("a", "f"), 2)] == list(
        placed.bends["a", "f"]
    )
    assert ("a", "b") not in placed.bends
    assert {"b", "d", figures.Bend(("e", "c"), 1), figures.Bend(("a", "f"), 1)} == set(
        placed.layers[1]
    )


def test_numbers_of_steps_cover_no_others():
    """Where places are near each other the longer row goes aside, with a line to its place."""
    ends = {(100.0, 50.0): [1], (112.0, 50.0): [2, 4, 6, 8, 10], (118.0, 52.0): [3, 5, 7]}
    rows = figures.place_number_rows(ends, (300.0, 300.0))
    assert [(1,), (3, 5, 7), (2, 4, 6, 8, 10)] == [row.numbers for row in rows]
    assert rows[0].at == rows[0].centre
    for first, other in combinations(rows, 2):
        across = abs(first.centre[0] - other.centre[0])
        down = abs(first.centre[1] - other.centre[1])
        assert across >= first.half_px + other.half_px or down >= 2 * figures.NUMBER_PX


def test_names_stand_where_they_do_in_every_process(board, plan):
    """They are placed in the order of the bodies, the same whatever the seed of hashes is."""
    names = [body.name for body in board.scene.bodies]
    starts = board.scene.at(board.initial)
    placed = [text for text in labels(figures.draw_layout(board, plan)) if text in names]
    assert placed == sorted(placed, key=lambda name: (name not in starts, names.index(name)))


def test_a_circle_is_drawn_all_the_same(board):
    """No order exists, and the picture says so; the other pairs are in layers as ever."""
    graph = figures.build_precedence_graph(
        board, chart(relation("clock", "pcb"), relation("clock", "brace"))
    )
    assert [("clock", "pcb")] == [(e.before, e.after) for e in graph.edges if e.closing]
    depth = {node: k for k, layer in enumerate(graph.layers) for node in layer}
    assert (0, 1, 2, 3) == tuple(depth[item] for item in ("pcb", "clock", "brace", "screw_1"))
    assert any(
        "closes a cycle" in text for text in labels(figures.draw_precedence(graph, "circle"))
    )


def test_alternatives_stand_below_the_graph(board):
    groups = ((("clock", "brace"),), (("clock", "switch_1"),))
    either = tuple(
        Alternatives("clock", skill, groups) for skill in ("pick(clock)", "place(clock)")
    )
    picture = figures.draw_precedence(
        figures.build_precedence_graph(board, chart(either=either)), "or"
    )
    words = [text for text in labels(picture) if "before" in text]
    assert ["pick(clock), place(clock): clock before brace or clock before switch_1"] == words
    assert 1 == labels(picture).count("or")


def test_a_picture_of_a_page_has_no_style_attribute(board, plan):
    """The policy of the page forbids them; a title says what an arrow means."""
    graph = figures.build_precedence_graph(board, None)
    text = embed_picture(figures.draw_precedence(graph, "Precedence"), "p")
    root = ElementTree.fromstring(text)
    assert not [element for element in root.iter() if "style" in element.attrib]
    assert any("pcb before" in (item.text or "") for item in root.iter("title"))


def test_a_bar_of_a_page_says_where_it_leads(board, plan):
    bars = figures.list_plan_bars(board, plan, [1.0] * 15)
    text = embed_picture(figures.draw_gantt_picture(bars, "Times", seeks=True), "g")
    assert 'id="gantt-cursor"' in text
    assert 'data-seek-s="3.000" tabindex="0" role="button"' in text
    assert "data-seek-s" not in embed_picture(figures.draw_gantt_picture(bars, "Times"), "g")


def test_a_bar_too_narrow_for_its_name_has_the_number_of_its_step(board, plan):
    """And the picture says so; no name is cut to a few letters."""
    names = {"pcb", "switch_1", "switch_2", "transformer", "brace", "clock"}
    wide = labels(
        figures.draw_gantt_picture(figures.list_plan_bars(board, plan, [1.0] * 15), "Times")
    )
    assert names <= set(wide)
    assert not any("a number: the step" in text for text in wide)
    narrow = labels(
        figures.draw_gantt_picture(
            figures.list_plan_bars(board, plan, [1.0] * 14 + [20.0]), "Times"
        )
    )
    assert {"4", "7", "11", "14"} <= set(narrow)
    assert any("a number: the step" in text for text in narrow)
    assert not any("\N{HORIZONTAL ELLIPSIS}" in text for text in narrow)


def test_names_of_others_are_no_markup():
    picture = figures.Picture(10, 10, "<b>")
    picture.line(((0, 0), (1, 1)), "ink", note=figures.Note("</title><script>"))
    picture.label((1, 1), '"><img src=x>\x1b[31m')
    text = embed_picture(picture, "x")
    assert not {"<script", "<img", "<b>", "\x1b"} & set(re.findall(r"<\w+>?|\x1b", text))
    assert "\\x1b[31m" in text


def test_a_page_colours_a_picture_by_roles():
    """Numbers of the drawing are attributes."""
    picture = figures.Picture(96, 48, "colours")
    square = [(0.0, 0.0), (48.0, 0.0), (48.0, 48.0)]
    picture.polygon(square, "blue", "red", 2.0, dashed=True, opacity=0.5)
    picture.label((8.0, 8.0), "name", "muted", bold=True)
    root = ElementTree.fromstring(embed_picture(picture, "p"))
    (shape,), (text,) = root.iter("path"), root.iter("text")
    assert {"f-blue", "s-red"} == set(shape.get("class", "").split())
    assert ("0.5", "1.5") == (shape.get("fill-opacity"), shape.get("stroke-width"))
    assert "M 0 0 L 36 0 L 36 36 z" == shape.get("d")
    assert ({"f-muted", "bold"}, "name") == (set(text.get("class", "").split()), text.text)
    assert ("0 0 72 36", "96") == (root.get("viewBox"), root.get("width"))


@pytest.mark.parametrize("change", [{"fill": "pink"}, {"stroke": "#fff"}])
def test_a_colour_is_a_role(change):
    with pytest.raises(KeyError):
        figures.Picture(5, 5, "colours").polygon([(0.0, 0.0), (1.0, 1.0)], **change)


def test_a_picture_has_an_extent():
    with pytest.raises(ValueError, match="cannot be"):
        figures.Picture(0, 5, "nothing")


def test_equal_pictures_are_equal_markup(board, plan):
    """Also of solids."""
    first, second = (embed_picture(figures.draw_exploded_view(board, plan), "e") for _ in range(2))
    assert first == second


def test_the_nearer_of_two_solids_is_seen(board):
    """Whichever is drawn first."""
    body, pose = board.scene.bodies[0], Pose((0.0, 0.0, 0.0))
    above = pose.moved((0.0, 0.0, 0.05))
    camera = figures.Camera(0.0, scale=200.0, left=80.0, top=80.0)
    counts = []
    for order in ((0, 1), (1, 0)):
        painter = figures.SolidPainter(camera, 160, 160)
        for number in order:
            painter.add(body, (pose, above)[number], figures.COLOURS["blue"], number)
        counts.append([int((painter.bodies == number).sum()) for number in (0, 1)])
    assert counts[0] == counts[1]
    assert 0 < counts[0][0] < counts[0][1]
    assert (painter.image()[..., 3] > 0).sum() == sum(counts[0])


def test_a_hull_leaves_out_what_is_inside():
    square = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]
    assert set(square) == set(figures.find_hull([*square, (0.5, 0.5), (0.5, 0.0)]))


def test_long_names_are_shortened_to_their_room():
    assert "ab" == figures.shorten("ab", 100)
    assert figures.shorten("a very long name of a part", 60).endswith("\N{HORIZONTAL ELLIPSIS}")
    assert "" == figures.shorten("abc", 1)


# The path of a plan over the table.


CONFIGS = Path(__file__).parents[2] / "configs"


@pytest.mark.parametrize("config", ["inverter_board", "battery_module"])
def test_arrows_are_as_long_as_the_plan_costs(config):
    """They call at every feeder and holder that the cost counts."""
    problem = load_problem(CONFIGS / f"{config}.yaml")
    result = solve_problem(problem, setup=Setup(collision=("precedence",)))
    steps = figures.list_path_steps(problem.task, [step.skill for step in result.steps])
    length_m = sum(math.dist(*leg) for step in steps for leg in pairwise(step.stops))
    assert length_m == pytest.approx(result.cost, rel=1e-9)
