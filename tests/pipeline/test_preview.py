"""What is found out late is told early: cycles, what is never feasible, grasps, feeders."""

from pathlib import Path

import pytest

from skillplan.domains import Problem
from skillplan.errors import OptionError, PluginError
from skillplan.pipeline import load_problem, preview_problem, registry
from skillplan.pipeline import obstacles as stage
from skillplan.records import DerivedOrder
from thinned import slow_case

CONFIGS = Path(__file__).parents[2] / "configs"
BOARD = load_problem(CONFIGS / "inverter_board.yaml")

# What lies on the mainboard at the start belongs on it.
CIRCULAR = """kind: assembly
name: computer
robot: {home_m: [0.3, 0.0]}
tools: {gripper: {holder_m: [0.6, 0.3], opening_m: 0.08}}
initial_tool: gripper
parts:
  mainboard: {tool: gripper, size_m: [0.10, 0.06, 0.01], start_m: [0.4, 0.2], goal_m: [0.4, -0.2]}
  cpu:
    {tool: gripper, size_m: [0.02, 0.02, 0.01], start_on: mainboard, goal_m: [0.4, -0.2],
     goal_on: mainboard}
"""
WIDE = """kind: assembly
name: wide
robot: {home_m: [0.3, 0.0]}
tools: {gripper: {holder_m: [0.6, 0.3]}}
initial_tool: gripper
parts:
  tray:
    tool: gripper
    size_m: [0.12, 0.05, 0.02]
    grasp: {closing_axis: x}
    start_m: [0.4, 0.2]
    goal_m: [0.4, -0.2]
  plate:
    tool: gripper
    size_m: [0.12, 0.10, 0.02]
    start_m: [0.2, 0.2]
    goal_m: [0.2, -0.2]
"""
MESHES = CONFIGS.parent / "tests" / "bad_input" / "files"
HOLLOW = """kind: assembly
name: hollow
robot: {home_m: [0.3, 0.0], safe_height_m: 0.2}
tools: {gripper: {opening_m: 0.08, holder_m: [0.6, 0.3]}}
initial_tool: gripper
parts:
  channel:
    tool: gripper
    meshes: [{file: channel.obj}]
    start_m: [0.4, -0.2]
    goal_m: [0.5, 0.0]
"""


def loaded(folder: Path, text: str) -> Problem:
    path = folder / "task.yaml"
    path.write_text(text, "utf-8")
    return load_problem(path)


GEOMETRIC = "swept" if "swept" in registry.names("collision") else "aabb"


class TestTheDerivedOrder:
    def test_of_the_board_has_no_cycle(self):
        """By the default detector, although the file leaves geometry out, and without a warning."""
        result = preview_problem(BOARD)
        (order,) = result.orders
        assert ("inverter-board", ("kinematic", GEOMETRIC), ()) == (
            order.task,
            order.back_ends,
            order.cycle,
        )
        assert order.pairs > 0
        assert result.warnings == ()

    def test_names_a_cycle_with_the_file(self, tmp_path):
        """Nothing else in the file is wrong."""
        problem = loaded(tmp_path, CIRCULAR)
        result = preview_problem(problem, collision=("aabb",))
        assert set(result.orders[0].cycle) == {"mainboard", "cpu"}
        assert result.warnings == (
            f"{problem.source}: by kinematic, aabb no order exists: mainboard before cpu before "
            "mainboard: cpu lies on mainboard at the start and belongs on it.",
            f"{problem.source}: with another start for cpu, both components would have an order.",
        )
        assert result.document()["precedence"][0]["cycle"] == list(result.orders[0].cycle)

    def test_is_that_of_the_detectors_named(self):
        """Except the chart's own, of which an order says nothing."""
        (order,) = preview_problem(BOARD, collision=("aabb", "precedence")).orders
        assert order.back_ends == ("kinematic", "aabb")
        (order,) = preview_problem(BOARD, collision=("precedence",)).orders
        assert order.back_ends == ("kinematic", GEOMETRIC)

    def test_of_a_large_task_waits_to_be_asked_for(self, monkeypatch):
        """A preview is instant; with a detector named it takes its time."""
        monkeypatch.setattr(stage, "MOST_COMPONENTS", 3)
        large = DerivedOrder("inverter-board", (), not_derived="so many components")
        assert preview_problem(BOARD).orders == (large,)
        assert preview_problem(BOARD).document()["precedence"] == []
        assert preview_problem(BOARD, collision=("aabb",)).orders[0].pairs > 0

    def test_of_hollow_parts_waits_to_be_asked_for(self, tmp_path):
        """Boxes about them fill what others go into, and true meshes take minutes."""
        (tmp_path / "channel.obj").write_bytes((MESHES / "channel.obj").read_bytes())
        problem = loaded(tmp_path, HOLLOW)
        assert preview_problem(problem).orders == (
            DerivedOrder("hollow", (), not_derived="hollow parts"),
        )
        (order,) = preview_problem(problem, collision=("swept",)).orders
        assert order.back_ends == ("kinematic", "swept")

    @pytest.mark.parametrize("name", ["ESC12.sop", "swarmitfix_triangular.yaml"])
    def test_is_none_where_nothing_has_a_shape(self, name):
        """A matrix and a bench have no bodies to collide."""
        assert preview_problem(load_problem(CONFIGS / name)).orders == ()

    def test_of_an_unknown_detector_is_refused(self):
        """With its name, as everywhere."""
        with pytest.raises(PluginError, match="'aab'"):
            preview_problem(BOARD, collision=("aab",))

    def test_takes_the_options_of_back_ends(self):
        """And refuses those that they do not have."""
        with pytest.raises(OptionError, match="'aabb' has no option"):
            preview_problem(BOARD, collision=("aabb",), options={"aabb": {"colour": 1}})


class TestGrasps:
    def test_wider_than_a_real_hand_opens_are_told_of_at_the_key_to_change(self, tmp_path):
        """Along the chosen axis, with the axis that fits; or suction where none does."""
        problem = loaded(tmp_path, WIDE)
        assert problem.hints == (
            f"{problem.source}:10:12: parts.tray.grasp: 0.120 m wide along x, where jaws of "
            "'gripper' close; those that engines simulate open 0.080 m. Give grasp: "
            "{closing_axis: y} or {type: suction}.",
            f"{problem.source}:15:13: parts.plate.size_m: 0.100 m wide along y, where jaws of "
            "'gripper' close; those that engines simulate open 0.080 m. Give grasp: "
            "{type: suction}.",
        )
        assert preview_problem(problem).warnings == problem.hints
        assert problem.warnings == ()


# With ways, hollow parts or many skills.
LARGE = {
    "cell_screws",
    "cell_tray",
    "drawer_module",
    "gear_unit",
    "gearbox",
    "inverter_grasps",
    "inverter_time",
}
LARGE |= {"mini_pc", "motor_drive", "pcb", "pump"}


@pytest.mark.parametrize(
    "path",
    [
        slow_case(path, reason="a large one; others in every run") if path.stem in LARGE else path
        for path in sorted(CONFIGS.glob("*.yaml"))
    ],
    ids=lambda path: path.stem,
)
def test_the_shipped_files_have_nothing_to_warn_of(path):
    """Whatever geometry says of them, it says nothing against them."""
    assert preview_problem(load_problem(path)).warnings == ()
