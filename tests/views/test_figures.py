"""Figures: what is drawn, what is written, and what equal figures are as files."""

from __future__ import annotations

import io
import math
import re
from collections.abc import Callable
from functools import cache
from itertools import pairwise
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib import rc_context
from matplotlib.collections import Collection
from matplotlib.figure import Figure
from matplotlib.image import imread

import skillplan_swarmitfix as swarm
from skillplan.errors import OptionError
from skillplan.views import figures
from thinned import slow_case

pytestmark = pytest.mark.slow(reason="draws; commands draw some in every run")

BENCH = swarm.Bench(6, 13, 0.34)
HEADING = figures.Heading("A title", "task t,  solver s,  seed 0")
GOAL, START = BENCH.position("C42"), BENCH.position("C66")


def greedy(bench: swarm.Bench, goal: int) -> dict[int, int]:
    """Return the first action of a shortest way to the goal, for all other positions."""
    left = bench.distances(goal)
    chosen = {}
    for here, ends in enumerate(bench.successors.tolist()):
        ways = [(int(left[end]), action) for action, end in enumerate(ends) if end >= 0]
        chosen[here] = min(ways)[1]
    del chosen[goal]
    return chosen


def a_policy(bench: swarm.Bench = BENCH, goal: int = GOAL, start: int | None = START) -> Figure:
    return swarm.draw_policy(bench, greedy(bench, goal), goal, HEADING, start=start)


def a_placement(*, closed: bool = True) -> Figure:
    corners = [(0.6, 0.5), (1.9, 0.5), (1.2, 1.4)]
    heads = [swarm.HeadMark(corner, 0.3, 0.1, True) for corner in corners]
    goals = [
        swarm.BaseGoal(BENCH.position("C44"), (corners[0], corners[1])),
        swarm.BaseGoal(BENCH.position("C44"), (corners[1], corners[2])),
        swarm.BaseGoal(BENCH.position("C33"), (corners[2], corners[0])),
    ]
    ways = [["C66", "C54", "C42", "C44"], ["C44"], ["C44", "C33"]]
    named = [[BENCH.position(name) for name in way] for way in ways]
    return swarm.draw_placement(BENCH, corners, heads, goals, named, HEADING, closed=closed)


def a_gantt(sequences: int = 3) -> Figure:
    bars, now_s = [], 0.0
    for number in range(1, sequences + 1):
        for step, takes_s in (("retract", 0.3), ("park", 0.45), ("swing", 11.6), ("support", 0.3)):
            agents = ("base", "pkm") if step == "swing" else ("head", "pkm")
            labels = {"base": f"B2: C66 to C{number}"} if step == "swing" else {}
            bars.append(swarm.Bar(number, step, agents, now_s, now_s + takes_s, labels))
            now_s += takes_s
    return swarm.draw_gantt(bars, HEADING)


def some_rewards(count: int = 4) -> Figure:
    steps = [
        figures.RewardStep(f"base-{i // 2 + 1}", f"B{i % 3}", f"C{i + 1}", i - 1.5)
        for i in range(count)
    ]
    return figures.draw_rewards(steps, ["B0", "B1", "B2"], HEADING)


def some_learning() -> Figure:
    episodes = np.arange(10.0, 1001.0, 10.0)
    steps = np.stack([400 / np.sqrt(episodes), 500 / np.sqrt(episodes)])
    curves = (
        figures.LearningCurve("set 1", episodes, steps),
        figures.LearningCurve("set 2", episodes, steps * 2),
    )
    return figures.draw_learning([figures.LearningPanel("base-1", curves, 3.4)], HEADING)


def some_values() -> Figure:
    values = {f"B{i}": np.linspace(0.0, -i, 50).tolist() for i in range(11)}
    return figures.draw_q_values(
        list(range(1, 51)),
        [figures.StateValues("C66", values), figures.StateValues("C13", {"B5": [0.5] * 50})],
        HEADING,
        order=[f"B{i}" for i in range(11)],
    )


def a_fleet() -> Figure:
    starts = {"r1": BENCH.position("C1"), "r2": BENCH.position("C78")}
    schedule = [
        [("r1", BENCH.position("C15")), ("r2", BENCH.position("C76"))],
        [("r1", BENCH.position("C28"))],
    ]
    return swarm.draw_fleet(BENCH, starts, schedule, HEADING)


FIGURES: dict[str, Callable[[], Figure]] = {
    "policy": a_policy,
    "placement": a_placement,
    "gantt": a_gantt,
    "rewards": some_rewards,
    "learning": some_learning,
    "q-values": some_values,
    "fleet": a_fleet,
}


@cache
def svg(name: str) -> bytes:
    """Return a figure as SVG; drawn once."""
    return figures.render_figure(FIGURES[name](), ".svg")


def texts(figure: Figure | bytes) -> list[str]:
    """Return the texts of a figure's SVG."""
    content = figure if isinstance(figure, bytes) else figures.render_figure(figure, ".svg")
    root = ElementTree.fromstring(content)
    results = [element.text or "" for element in root.iter("{http://www.w3.org/2000/svg}text")]
    return [text.strip() for text in results]


def collection(figure: Figure, gid: str) -> Collection:
    (results,) = [c for axes in figure.axes for c in axes.collections if c.get_gid() == gid]
    return results


class TestFiles:
    @pytest.mark.parametrize(
        "name",
        [
            name
            if name in ("gantt", "placement", "rewards")
            else slow_case(name, reason="other figures in every run")
            for name in FIGURES
        ],
    )
    def test_equal_figures_are_equal_files(self, name):
        """Neither the time nor anything random is in them."""
        assert svg(name) == figures.render_figure(FIGURES[name](), ".svg")

    def test_equal_figures_are_equal_pictures(self):
        """In dots, too; and the file does not name the program that wrote it."""
        content = figures.render_figure(some_rewards(), ".png", 40)
        assert content == figures.render_figure(some_rewards(), ".png", 40)
        assert b"tEXt" not in content

    @pytest.mark.parametrize(
        "name",
        [
            name
            if name in ("gantt", "rewards")
            else slow_case(name, reason="other figures in every run")
            for name in FIGURES
        ],
    )
    def test_a_png_has_the_size_of_its_figure(self, name):
        """In dots: inches times dots per inch."""
        figure = FIGURES[name]()
        content = figures.render_figure(figure, ".png", 50)
        assert content.startswith(b"\x89PNG")
        height, width = imread(io.BytesIO(content)).shape[:2]
        assert figure.get_size_inches() * 50 == pytest.approx([width, height], abs=1.0)

    @pytest.mark.parametrize("name", FIGURES)
    def test_text_of_an_svg_is_text(self, name):
        """Title, details and axis labels can be searched and read aloud."""
        written = texts(svg(name))
        assert {"A title", "task t,  solver s,  seed 0"} <= {
            text.replace("task t, solver", "task t,  solver") for text in written
        }
        assert any(re.fullmatch(r".+ \[.+\]", text) for text in written)

    def test_the_users_own_style_changes_nothing(self):
        """A matplotlibrc is for the user's own figures."""
        with rc_context({"font.size": 30, "svg.fonttype": "path", "axes.grid": True}):
            assert svg("rewards") == figures.render_figure(some_rewards(), ".svg")

    def test_what_was_there_is_replaced_whole(self, tmp_path):
        """And nothing is left beside it."""
        path = tmp_path / "f.svg"
        path.write_text("before")
        figures.save_figure(some_rewards(), path)
        assert path.read_bytes() == svg("rewards")
        assert [path] == list(tmp_path.iterdir())

    def test_a_figure_that_cannot_be_written_leaves_what_was_there(self, tmp_path):
        """A folder in the place of the file cannot be replaced."""
        path = tmp_path / "f.svg"
        path.mkdir()
        with pytest.raises(OptionError, match="cannot be written"):
            figures.save_figure(some_rewards(), path)
        assert [path] == list(tmp_path.iterdir())

    @pytest.mark.parametrize(
        ("name", "message"),
        [
            ("f.pdf", r"not saved as \.pdf; end it in \.png or \.svg"),
            ("f", "does not say which format"),
            ("no/f.png", "there is no folder"),
            ("d.png", "is a folder"),
            ("f" * 300 + ".png", "cannot be used: File name too long"),
        ],
    )
    def test_a_path_that_will_not_do_is_told_at_once(self, tmp_path, name, message):
        """Before anything is solved."""
        (tmp_path / "d.png").mkdir()
        with pytest.raises(OptionError, match=message):
            figures.check_path(str(tmp_path / name))

    def test_other_formats_are_refused(self):
        """By the writer, too."""
        with pytest.raises(ValueError, match=r"not '\.pdf'"):
            figures.render_figure(some_rewards(), ".pdf")


class TestStyle:
    @pytest.mark.parametrize("colour", figures.PALETTE)
    def test_text_in_a_colour_can_be_read_on_white(self, colour):
        """A contrast of at least 3 to 1 (WCAG, large or bold text)."""
        channels = [int(figures.darken_colour(colour)[i : i + 2], 16) / 255 for i in (1, 3, 5)]
        linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
        light = float(np.dot(linear, [0.2126, 0.7152, 0.0722]))
        assert 3.0 <= 1.05 / (light + 0.05)

    @given(st.text(alphabet="abc WM", max_size=200), st.floats(1.0, 8.0))
    def test_lines_of_a_heading_fit(self, details, width_in):
        """Or are single words, and no word is lost."""
        lines = figures.Heading("t", details).lines(width_in)
        assert details.split() == [word for line in lines for word in line.split()]
        for line in lines:
            assert figures.measure_text_in(line, 8.0) <= width_in + 1e-6 or len(line.split()) == 1

    @pytest.mark.parametrize("size_in", [(0.0, 1.0), (1.0, math.nan)])
    def test_a_sheet_has_a_size(self, size_in):
        """Nothing can be drawn on nothing."""
        with pytest.raises(ValueError, match="cannot be"):
            figures.create_sheet(*size_in, HEADING)


class TestBenchCanvas:
    @pytest.mark.parametrize("shape", [(1, 1), (2, 13), (6, 13), (12, 25), (40, 3), (3, 101)])
    def test_a_bench_of_any_shape_is_to_scale(self, shape):
        """A metre is as long up as along, and the sheet stays of a size for a screen."""
        canvas = swarm.open_bench_canvas(swarm.Bench(*shape, 0.34), HEADING)
        place = canvas.axes.get_window_extent()
        (x0, x1), (y0, y1) = canvas.axes.get_xlim(), canvas.axes.get_ylim()
        assert place.width / (x1 - x0) == pytest.approx(place.height / (y1 - y0))
        assert all(2.0 < side < 18.0 for side in canvas.figure.get_size_inches())

    @given(st.floats(-1, 3), st.floats(-1, 3))
    def test_inches_and_metres_are_inverse(self, x_m, y_m):
        """There and back."""
        canvas = _CANVAS
        assert canvas.to_metres(canvas.to_inches((x_m, y_m))) == pytest.approx((x_m, y_m))

    def test_points_beside_the_bench_are_on_paper(self):
        """A trajectory may leave the bench."""
        canvas = swarm.open_bench_canvas(BENCH, HEADING, around_m=np.array([[-1.0, 4.0]]))
        assert canvas.axes.get_xlim()[0] < -1.0
        assert canvas.axes.get_ylim()[1] > 4.0


_CANVAS = swarm.open_bench_canvas(BENCH, HEADING)


class TestPolicy:
    @pytest.mark.parametrize("shape", [(2, 13), (6, 13), (12, 25)])
    def test_there_is_an_arrow_for_every_position_but_the_goal(self, shape):
        """As many arrows as the policy recommends swings."""
        bench = swarm.Bench(*shape, 0.34)
        figure = a_policy(bench, 3, bench.n_positions - 1)
        arrows = collection(figure, "policy-arrows")
        assert bench.n_positions - 1 == len(arrows.get_offsets())

    def test_an_arrow_points_to_where_the_action_leads(self):
        """Of C66, B2 leads to C54."""
        figure = swarm.draw_policy(BENCH, {START: 2}, GOAL, HEADING)
        arrows = collection(figure, "policy-arrows")
        along = BENCH.centroids_m[BENCH.position("C54")] - BENCH.centroids_m[START]
        drawn = np.array([arrows.U[0], arrows.V[0]])  # type: ignore[attr-defined]
        assert drawn / np.linalg.norm(drawn) == pytest.approx(along / np.linalg.norm(along))

    @pytest.mark.slow(reason="draws 78 positions; other figures in every run")
    def test_every_position_and_pin_is_named(self):
        """With the action beside the position."""
        written = texts(a_policy())
        assert {BENCH.name(i) for i in range(78)} | {f"P{i}" for i in range(1, 53)} <= set(written)
        assert {"x [m]", "y [m]", "steps to the goal", "goal", "path from the start"} <= set(
            written
        )

    @pytest.mark.slow(reason="draws a bench of 30 by 61; smaller benches in every run")
    def test_names_too_small_to_read_are_left_out(self):
        """On a large bench there are arrows only."""
        assert "C7" not in texts(a_policy(swarm.Bench(30, 61, 0.34), 0, None))

    @pytest.mark.slow(reason="draws a policy; another one in every run")
    def test_staying_where_the_goal_is_not_is_shown(self):
        """As a ring, and as never getting to the goal."""
        recommended = greedy(BENCH, GOAL) | {0: 0}
        figure = swarm.draw_policy(BENCH, recommended, GOAL, HEADING, start=0)
        assert 1 == len(collection(figure, "policy-stays").get_offsets())
        assert {"B0: stay", "never gets to the goal"} <= set(texts(figure))
        assert "path from the start" not in texts(figure)

    @pytest.mark.parametrize(
        ("recommended", "message"),
        [
            ({0: 11}, "Action 11 does not exist"),
            ({0: 1}, "leaves the bench in C1"),
            ({99: 1}, "not on the bench"),
        ],
    )
    def test_a_policy_must_be_one_of_the_bench(self, recommended, message):
        """What does not exist is not drawn."""
        with pytest.raises(ValueError, match=message):
            swarm.draw_policy(BENCH, recommended, GOAL, HEADING)

    def test_a_shortest_policy_takes_the_fewest_swings(self):
        """What the shades show is what the bench counts."""
        ends = {here: int(BENCH.successors[here, a]) for here, a in greedy(BENCH, GOAL).items()}
        assert BENCH.distances(GOAL).tolist() == swarm.count_steps_to(GOAL, ends, 78).tolist()


class TestPlacement:
    def test_goals_and_intermediate_positions_are_told_apart(self):
        """Continuous circles and dashed ones, and home dotted."""
        (axes,) = a_placement().axes
        styles = {patch.get_gid(): patch.get_linestyle() for patch in axes.patches}
        assert {"goal-C44": "-", "goal-C33": "-", "between-C54": "--"}.items() <= styles.items()
        assert ":" == styles["home-C66"]
        assert "--" == styles["between-C42"]

    def test_names_numbers_and_kinds_are_written(self):
        """Goals by the numbers of their sequences, heads in the order of travel."""
        written = set(texts(a_placement()))
        assert {"C44", "C33", "C54", "C66", "b1\N{EN DASH}2", "b3", "h1", "h3", "home"} <= written
        assert {"trajectory (closed)", "goal position of the base (b)", "x [m]"} <= written

    def test_an_open_trajectory_is_not_closed(self):
        """It says so, and its last point is not its first."""
        figure = a_placement(closed=False)
        (line,) = [line for line in figure.axes[0].lines if line.get_gid() == "trajectory"]
        assert 3 == len(line.get_xdata())  # type: ignore[arg-type]
        assert "trajectory (open)" in texts(figure)

    def test_lines_join_the_circles_and_their_supports(self):
        """One for each base and support, from the edge of the circle."""
        goals = [
            swarm.BaseGoal(GOAL, ((1.0, 1.0), (0.2, 0.2))),
            swarm.BaseGoal(GOAL, ((1.0, 1.0),)),
        ]
        lines = swarm.find_links_m(BENCH, goals)
        assert [(1.0, 1.0), (0.2, 0.2)] == [end for _, end in lines]
        for edge, _ in lines:
            assert math.dist(edge, BENCH.centroids_m[GOAL]) == pytest.approx(0.2 * 0.34)

    def test_bases_beside_each_other_differ_in_colour(self):
        """Where there are more of them than colours, two of one are far from each other."""
        row = [BENCH.position(f"C{number}") for number in range(1, 13)]
        colours = swarm.assign_colours(BENCH, [swarm.BaseGoal(position, ()) for position in row])
        assert 6 == len(set(colours.values()))
        assert all(colours[a] != colours[b] for a, b in pairwise(row))

    def test_heads_are_equilateral_and_point_their_yaw(self):
        """About their centroid."""
        corners = swarm.HeadMark((1.0, 2.0), 0.4, 0.1, False).corners_m()
        sides = [math.dist(corners[i], corners[i - 1]) for i in range(3)]
        assert [0.1] * 3 == pytest.approx(sides)
        assert (1.0, 2.0) == pytest.approx(tuple(corners.mean(axis=0)))
        along = corners[0] - (1.0, 2.0)
        assert 0.4 == pytest.approx(math.atan2(along[1], along[0]))

    def test_names_of_positions_do_not_overlap(self):
        """Nor do those of heads and goals."""
        figure = a_placement()
        figures.render_figure(figure, ".png", 100)
        boxes = [text.get_window_extent() for text in figure.axes[0].texts if text.get_text()]
        pairs = [(a, b) for i, a in enumerate(boxes) for b in boxes[:i]]
        assert not any(a.overlaps(b) for a, b in pairs)

    @pytest.mark.parametrize(
        ("numbers", "text"),
        [([1], "1"), ([1, 2, 5], "1\N{EN DASH}2, 5"), ([3, 5], "3, 5"), ([], "")],
    )
    def test_numbers_in_a_row_are_a_range(self, numbers, text):
        """As people write them."""
        assert text == swarm.format_ranges(numbers)

    def test_what_cannot_be_placed_is_refused(self):
        """A trajectory of one point, ways without goals, a head without a size."""
        with pytest.raises(ValueError, match="at least two points"):
            swarm.draw_placement(BENCH, [(0, 0)], [], [], [], HEADING, closed=False)
        with pytest.raises(ValueError, match="0 goals need as many paths"):
            swarm.draw_placement(BENCH, [(0, 0), (1, 1)], [], [], [[1]], HEADING, closed=False)
        with pytest.raises(ValueError, match="side must be > 0"):
            swarm.HeadMark((0.0, 0.0), 0.0, 0.0, True)


class TestLabelPlacer:
    def test_a_label_goes_where_it_is_wanted_if_nothing_is_there(self):
        """Above, by default."""
        x, y = figures.LabelPlacer(5, 5).place((2, 2), "name", 8, (0.1,))
        assert 2 == pytest.approx(x)
        assert y > 2.1

    def test_a_label_evades_lines_discs_texts_and_the_edge(self):
        """To the only side that is left."""
        placer = figures.LabelPlacer(5, 2.3)
        placer.avoid_line([(1.9, 1.5), (1.5, 2.2)])
        placer.avoid_disc((2.5, 2.0), 0.4)
        placer.avoid_box((1.7, 2.0), 0.5, 0.3)
        place = placer.place((2, 2), "name", 8, (0.1, 0.2))
        assert place[1] < 1.9

    @given(st.lists(st.tuples(st.floats(1, 4), st.floats(1, 4)), min_size=2, max_size=6))
    def test_a_place_that_is_taken_is_not_free(self, anchors):
        """Every label takes its place."""
        placer = figures.LabelPlacer(5, 5)
        for anchor in anchors:
            assert not placer.is_free(placer.place(anchor, "C1", 8, (0.1, 0.3)), "C1", 8)


class TestGantt:
    @pytest.mark.slow(reason="draws 40 sequences; a short chart in every run")
    def test_a_long_chart_goes_on_in_further_lines(self):
        """Broken between sequences only, to the same scale, and never more than eight."""
        figure = a_gantt(40)
        assert 2 <= len(figure.axes) <= 8
        scales = [axes.get_window_extent().width / np.ptp(axes.get_xlim()) for axes in figure.axes]
        assert [scales[0]] * len(scales) == pytest.approx(scales)
        ends = [axes.get_xlim() for axes in figure.axes]
        assert [end for _, end in ends[:-1]] == pytest.approx([begin for begin, _ in ends[1:]])

    def test_swings_steps_and_sequences_are_named(self):
        """And the axis has its unit."""
        written = set(texts(a_gantt()))
        assert {"B2: C66 to C1", "sequence 2", "head", "PKM", "base", "time [s]"} <= written
        assert {"retract", "park", "swing", "support"} <= written
        assert "approach" not in written

    @pytest.mark.parametrize(
        ("values", "message"),
        [
            ((1, "jump", ("base",), 0.0, 1.0), "'jump' is none of the steps"),
            ((1, "park", ("arm",), 0.0, 1.0), "'arm' is none of the agents"),
            ((1, "park", ("pkm",), 0.0, 1.0, {"arm": "x"}), "'arm' is none of the agents"),
            ((1, "park", ("pkm",), 2.0, 1.0), "cannot run from 2.0 s to 1.0 s"),
        ],
    )
    def test_a_bar_is_one_of_the_five_steps(self, values, message):
        """Of agents that there are, forward in time."""
        with pytest.raises(ValueError, match=message):
            swarm.Bar(*values)  # type: ignore[arg-type]

    def test_nothing_is_no_chart(self):
        """There is no time to draw."""
        with pytest.raises(ValueError, match="at least one step"):
            swarm.draw_gantt([], HEADING)


class TestRewards:
    def test_steps_actions_and_positions_are_written(self):
        """The minus sign is one."""
        written = set(texts(some_rewards()))
        assert {"B0", "B2", "C1", "C4", "\N{MINUS SIGN}1.50", "1.50"} <= written
        assert {"base-1", "base-2", "action", "reward [-]"} <= written

    @pytest.mark.slow(reason="draws 120 steps; fewer in every run")
    def test_many_steps_are_numbered_sparsely(self):
        """Labels keep apart."""
        figure = some_rewards(120)
        assert figure.get_size_inches()[0] < 16
        assert len(figure.axes[0].get_xticks()) < 50

    def test_what_cannot_be_drawn_is_refused(self):
        """No step, or an action that nobody knows."""
        with pytest.raises(ValueError, match="No step"):
            figures.draw_rewards([], ["B0"], HEADING)
        with pytest.raises(ValueError, match="'B9' is none"):
            figures.draw_rewards([figures.RewardStep("t", "B9", "", 0.0)], ["B0"], HEADING)

    def test_small_rewards_are_seen_beside_a_large_one(self):
        """On a logarithmic axis each bar is as high as a twentieth of it at least."""
        rewards = [-0.0038, -0.014, -0.021, 10.0]
        steps = [figures.RewardStep("t", "B0", "", reward) for reward in rewards]
        axes = figures.draw_rewards(steps, ["B0"], HEADING).axes[0]
        assert "reward [-], log scale" == axes.get_ylabel()
        heights = [bar.get_window_extent().height for bar in axes.patches]
        assert min(heights) > axes.get_window_extent().height / 20

    def test_rewards_of_like_size_keep_a_linear_axis(self):
        assert "linear" == some_rewards().axes[0].get_yscale()


class TestLearning:
    @pytest.mark.parametrize(("most", "shown"), [(7.0, {"6", "7"}), (40.0, {"10", "20"})])
    def test_a_short_axis_is_labelled_with_plain_numbers(self, most, shown):
        """Between powers of ten too, and never by a formula."""
        episodes = np.arange(1.0, 50.0)
        curve = figures.LearningCurve("set 1", episodes, np.linspace(most, 5.5, 98).reshape(2, 49))
        written = set(
            texts(figures.draw_learning([figures.LearningPanel("board", (curve,))], HEADING))
        )
        assert shown <= written
        assert not any("mathdefault" in text or "$" in text for text in written)

    def test_both_sets_and_the_fewest_steps_are_named(self):
        """On axes with units."""
        written = set(texts(some_learning()))
        assert {"set 1", "set 2", "fewest, mean over all starts", "base-1"} <= written
        assert {"episode [-]", "steps of an episode [-]"} <= written

    @given(st.integers(1, 400), st.integers(1, 90))
    def test_binning_keeps_the_sum_of_steps(self, points, every):
        """A constant stays what it is, and no stretch is lost."""
        episodes = np.arange(1.0, points + 1) * every
        middles, steps = figures.LearningCurve("c", episodes, np.full((2, points), 7.0)).binned()
        assert len(middles) == steps.shape[1] <= 48
        assert np.allclose(7.0, steps)
        assert (np.diff(middles) > 0).all()
        assert 1 <= middles[0] <= middles[-1] <= episodes[-1]

    @pytest.mark.parametrize(
        ("episodes", "steps", "message"),
        [
            ([1.0], np.zeros((0, 1)), "has no run"),
            ([1.0, 2.0], np.zeros((1, 1)), "has 2 stretches, but steps of 1"),
            ([2.0, 2.0], np.zeros((1, 2)), "must ascend from 1"),
            ([0.0, 2.0], np.zeros((1, 2)), "must ascend from 1"),
        ],
    )
    def test_a_curve_is_of_ascending_episodes(self, episodes, steps, message):
        """With steps for each of them."""
        with pytest.raises(ValueError, match=message):
            figures.LearningCurve("c", np.array(episodes), steps)

    def test_a_panel_has_one_or_two_curves(self):
        """And a figure at least one panel."""
        with pytest.raises(ValueError, match="1 to 2 curves, not 0"):
            figures.LearningPanel("p", ())
        with pytest.raises(ValueError, match="No learning curve"):
            figures.draw_learning([], HEADING)


class TestQValues:
    def test_every_state_names_its_best_action(self):
        """And the legend all actions, in their order."""
        written = texts(some_values())
        assert {"state C66, best action B0", "state C13, best action B5"} <= set(written)
        assert [f"B{i}" for i in range(11)] == [text for text in written if text[0] == "B"]

    def test_no_two_actions_look_alike(self):
        """Told apart by colour and marker together, up to 24 of them."""
        assert 24 == len({figures.choose_look(number) for number in range(24)})

    def test_values_must_be_there_for_every_episode(self):
        """Of every action."""
        with pytest.raises(ValueError, match="all of them as many"):
            figures.StateValues("C1", {"B0": [0.0], "B1": []})
        with pytest.raises(ValueError, match="all of them as many"):
            figures.StateValues("C1", {})
        with pytest.raises(ValueError, match="not a value for each"):
            figures.draw_q_values([1, 2], [figures.StateValues("C1", {"B0": [0.0]})], HEADING)
        with pytest.raises(ValueError, match="No state"):
            figures.draw_q_values([1], [], HEADING)


class TestFleet:
    def test_robots_and_steps_are_named(self):
        """With the number of swings of each."""
        written = texts(a_fleet())
        assert {"r1: 2 swings", "r2: 1 swing", "start", "goal", "C40"} <= set(written)
        assert 2 == written.count("1")
        assert 1 == written.count("2")

    def test_a_path_says_when_a_robot_is_where(self):
        """A robot that waits has no entry for that step."""
        paths = swarm.find_paths({"a": 1, "b": 5}, [[("a", 2)], [("b", 6), ("a", 3)]])
        assert {"a": [(0, 1), (1, 2), (2, 3)], "b": [(0, 5), (2, 6)]} == paths

    def test_robots_must_be_known(self):
        """By where they start."""
        with pytest.raises(ValueError, match="at least one robot"):
            swarm.find_paths({}, [])
        with pytest.raises(ValueError, match="'b' moves"):
            swarm.find_paths({"a": 1}, [[("b", 2)]])


def test_a_run_has_a_seed():
    """That is not negative."""
    with pytest.raises(ValueError, match="seed must be >= 0"):
        figures.Run(seed=-1)
