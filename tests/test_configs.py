"""Every shipped task file has the figures that it declares, and the board is the paper's."""

from __future__ import annotations

import json
from collections import Counter
from copy import deepcopy
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import jsonschema
import pytest
import yaml

from skillplan import Result, Setup, SkillModel, Status, Task, load_problem, make_model, solve
from skillplan.chart import derive_chart
from skillplan.cli import main
from skillplan.model import Replay, replay
from skillplan.pipeline import make_feasibility, registry
from skillplan.robots import FINGER_PROFILE_M
from skillplan.task import Box, Cylinder, Literal, Mesh, Point
from skillplan.testing import reachable_states
from yaml_data import yaml_data

FOLDER = Path(__file__).parents[1] / "configs"
CONFIGS = sorted(FOLDER.glob("*.yaml"))
BOARD = FOLDER / "inverter_board.yaml"

# What an expect block must say, by kind, and all that it may say. The figures of assemblies are
# verified here, those of benches in swarmitfix/test_bench_configs.py.
NEEDED = {
    "assembly": [{"optimal_cost"}, {"optimal_expected_cost"}],
    "swarmitfix": [{"goals", "steps"}, {"swings"}],
}
VERIFIED = {
    "assembly": {
        "optimal_cost",
        "optimal_expected_cost",
        "optimal_actions",
        "states",
        "observations",
        "sequences",
        "costs",
        "tool_changes",
    },
    "swarmitfix": {
        "goals",
        "makespans",
        "supports",
        "steps",
        "relaxed",
        "split",
        "csp",
        "swings",
        "parallel_makespan",
    },
}


def content_of(path: Path) -> Any:
    return yaml_data(path)


def schema_of(kind: str) -> Any:
    return json.loads((FOLDER / f"{kind}.schema.json").read_text("utf-8"))


@cache
def validator_of(kind: str) -> Any:
    """Return what holds a file against the schema of a kind, which is checked itself, once."""
    schema = schema_of(kind)
    jsonschema.Draft202012Validator.check_schema(schema)
    return jsonschema.Draft202012Validator(schema)


ASSEMBLIES = [path for path in CONFIGS if content_of(path)["kind"] == "assembly"]
every_config = pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.stem)
every_kind = pytest.mark.parametrize("kind", sorted(VERIFIED))


def configs_expecting(key: str) -> pytest.MarkDecorator:
    """Return the parametrization over the assemblies whose expect block has `key`."""
    having = [path for path in ASSEMBLIES if key in (content_of(path).get("expect") or {})]
    params = [
        pytest.param(path, marks=[unless_installed(path), *large(path)], id=path.stem)
        for path in having
    ]
    return pytest.mark.parametrize("path", params)


def large(path: Path) -> list[pytest.MarkDecorator]:
    """Return the mark of what takes a second and more to plan."""
    if path.stem not in (
        "cell_arrivals",
        "cell_grips",
        "cell_screws",
        "cell_shaft",
        "cell_tray",
        "cell_turn",
        "drawer_module",
        "gear_unit",
        "gearbox",
        "mini_pc",
        "pcb",
        "pump",
    ):
        return []
    return [pytest.mark.slow(reason="a large product of space; boards in every run")]


def unless_installed(path: Path) -> pytest.MarkDecorator:
    """Return what skips a test where a detector that a file chooses is of a plugin not there."""
    absent = set(content_of(path).get("collision") or {}) - set(registry.names("collision"))
    return pytest.mark.skipif(bool(absent), reason=f"{', '.join(absent)} is not installed")


def walk(task: Task, actions: list[int]) -> Replay:
    return replay(make_model(task), [task.skills[action] for action in actions])


def half_a_unit(text: str) -> float:
    """Return half a unit of the last digit that a figure is printed with."""
    return 0.5 * 10.0 ** -len(text.partition(".")[2]) * (1 + 1e-6)


def printed_costs(path: Path) -> list[tuple[list[int], float, float]]:
    """Return actions, cost and the precision it is printed with, for each of ``expect.costs``."""
    entries = content_of(path)["expect"]["costs"]
    root = yaml.compose(path.read_text("utf-8"))
    nodes = {key.value: node for key, node in root.value}["expect"]
    texts = [
        {key.value: node.value for key, node in entry.value}["cost"]
        for entry in {key.value: node for key, node in nodes.value}["costs"].value
    ]
    return [
        (entry["actions"], entry["cost"], half_a_unit(text))
        for entry, text in zip(entries, texts, strict=True)
    ]


def complete_sequences(model: SkillModel) -> dict[int, list[tuple[float, tuple[int, ...]]]]:
    """Return cost and actions of every complete sequence, by length; a walk of its own."""
    results: dict[int, list[tuple[float, tuple[int, ...]]]] = {}
    stack: list[tuple[Any, float, tuple[int, ...]]] = [(model.initial, 0.0, ())]
    while stack:
        state, cost, actions = stack.pop()
        for step in model.transitions(state):
            total, longer = cost + step.cost, (*actions, model.task.action(step.skill))
            if model.is_goal(step.next_state):
                results.setdefault(len(longer), []).append((total, longer))
            elif len(longer) < model.step_limit:
                stack.append((step.next_state, total, longer))
    return results


def count_sequences(model: SkillModel) -> dict[int, int]:
    """Return the number of complete sequences by length, counted layer by layer."""
    layer, counts = Counter({model.initial: 1}), Counter[int]()
    for length in range(1, model.step_limit + 1):
        following = Counter[Any]()
        for state, ways in layer.items():
            for step in model.transitions(state):
                if model.is_goal(step.next_state):
                    counts[length] += ways
                else:
                    following[step.next_state] += ways
        layer = following
    return dict(counts)


@cache
def optimum(path: Path) -> Result:
    """Return what exact search proves of a task; solved once for all that is held against it."""
    return solve(load_problem(path).task)


@pytest.fixture(scope="module")
def board():
    return load_problem(BOARD).task


@pytest.fixture(scope="module")
def brute_force(board):
    """All sequences of the board, counted."""
    return solve(board, "exhaustive")


@pytest.fixture(scope="module")
def stack():
    return load_problem(FOLDER / "sensor_stack.yaml").task


@pytest.fixture(scope="module")
def board_sequences(board):
    return complete_sequences(make_model(board))


def add(first: Point, other: Point) -> Point:
    """Return the sum of two vectors."""
    return (first[0] + other[0], first[1] + other[1], first[2] + other[2])


def overlaps(first: Box, other: Box) -> list[float]:
    """Return by how much two boxes overlap along each axis; negative where they are apart."""
    return [
        (a + b) / 2 - abs(p - q)
        for a, b, p, q in zip(first.size, other.size, first.centre, other.centre, strict=True)
    ]


class TestEveryConfig:
    def test_there_are_the_board_larger_ones_and_those_of_another_kind(self):
        """Of another order, many tools, many parts, of chance, in space, and of time as cost."""
        expected = {"inverter_board", "motor_drive", "sensor_stack"}
        expected |= {"battery_module", "relay_rail", "inverter_grasps", "inverter_time"}
        expected |= {"mini_pc", "gear_unit", "drawer_module"}
        assert expected <= {path.stem for path in ASSEMBLIES}

    def test_every_kind_has_a_file(self):
        """None of another kind, either."""
        assert set(VERIFIED) == {content_of(path)["kind"] for path in CONFIGS}

    @every_config
    def test_it_names_its_schema_in_the_first_line(self, path):
        """Editors complete and explain its keys."""
        first = path.read_text("utf-8").partition("\n")[0]
        schema = f"{content_of(path)['kind']}.schema.json"
        assert first == f"# yaml-language-server: $schema={schema}"
        assert (FOLDER / schema).is_file()

    @every_config
    def test_it_declares_the_figures_that_are_held_against_it(self, path):
        """A task file without an expect block, or without an optimum in it, is not shipped."""
        expect = content_of(path).get("expect")
        assert expect, f"{path.name} has no expect block"
        assert any(needed <= set(expect) for needed in NEEDED[content_of(path)["kind"]])

    @every_config
    def test_its_figures_are_all_verified(self, path):
        """No key of an expect block goes unread."""
        content = content_of(path)
        assert set(content["expect"]) <= VERIFIED[content["kind"]]

    @every_kind
    def test_an_expect_block_may_say_nothing_else(self, kind):
        """The schema allows no key that is not verified."""
        (block,) = (
            definition
            for name, definition in schema_of(kind)["$defs"].items()
            if name in ("ExpectConfig", "BenchExpectConfig")
        )
        assert set(block["properties"]) == VERIFIED[kind]

    @every_config
    def test_it_validates_against_the_shipped_schema(self, path):
        """What an editor says of it agrees with what loading says."""
        validator_of(content_of(path)["kind"]).validate(content_of(path))

    @every_kind
    def test_the_shipped_schema_is_the_printed_one(self, kind, capsys):
        """`skillplan schema KIND` gives the very file."""
        with pytest.raises(SystemExit) as ended:
            main(["schema", kind])
        assert 0 == ended.value.code
        assert (FOLDER / f"{kind}.schema.json").read_text("utf-8") == capsys.readouterr().out

    @pytest.mark.parametrize(
        ("stem", "section", "key", "slip"),
        [
            ("inverter_board", "robot", "home_m", "hoem_m"),
            ("swarmitfix_triangular", "heads", "max_gap_m", "max_gap"),
        ],
    )
    def test_the_schema_catches_what_loading_catches(self, stem, section, key, slip):
        """A misspelt key is a fault for editors, too."""
        content = deepcopy(content_of(FOLDER / f"{stem}.yaml"))
        content[section][slip] = content[section].pop(key)
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.Draft202012Validator(schema_of(content["kind"])).validate(content)


class TestExpectedFigures:
    @configs_expecting("optimal_cost")
    def test_the_optimum_is_proved_at_the_expected_cost_by_the_expected_actions(self, path):
        """`exact` proves it, to half a unit of the fifth decimal, by that very sequence if any."""
        result = optimum(path)
        assert result.status is Status.OPTIMAL
        expected = content_of(path)["expect"]
        assert expected["optimal_cost"] == pytest.approx(result.cost, abs=5e-6)
        actions = [step.action for step in result.steps]
        assert expected.get("optimal_actions", actions) == actions

    @configs_expecting("optimal_expected_cost")
    def test_the_expected_optimum_is_proved_at_the_expected_cost(self, path):
        """By both dynamic programs and the referee, to half a unit of the fifth decimal."""
        problem = load_problem(path)
        assert problem.domain.default_solver(problem.config) == "auto"
        for solver in ("value-iteration", "policy-iteration"):
            result = solve(problem.task, solver)
            assert result.status is Status.OPTIMAL
            expected = content_of(path)["expect"]["optimal_expected_cost"]
            assert expected == pytest.approx(result.cost, abs=5e-6)

    @configs_expecting("states")
    def test_the_model_has_the_expected_states(self, path):
        """As many states can be reached."""
        states = reachable_states(make_model(load_problem(path).task), 100_000)
        assert content_of(path)["expect"]["states"] == len(states)

    @configs_expecting("observations")
    def test_the_model_has_the_expected_observations(self, path):
        """So many different ones are seen in the states that can be reached."""
        task = load_problem(path).task
        states = reachable_states(make_model(task), 100_000)
        seen = {task.observe(state) for state in states}
        assert content_of(path)["expect"]["observations"] == len(seen)

    @pytest.mark.slow(reason="walks the board twice; its counts in a comparison of every run")
    @configs_expecting("sequences")
    def test_brute_force_counts_the_expected_sequences(self, path):
        """As many of each length, and a count of another kind agrees."""
        task = load_problem(path).task
        expected = {int(k): n for k, n in content_of(path)["expect"]["sequences"].items()}
        result = solve(task, "exhaustive")
        assert result.status is Status.OPTIMAL
        assert expected == result.trace["sequences_by_length"]
        assert expected == count_sequences(make_model(task))

    @configs_expecting("costs")
    def test_given_sequences_cost_what_is_expected(self, path):
        """Each is complete, and its cost rounds to the figure as it is printed."""
        task = load_problem(path).task
        for actions, cost, precision in printed_costs(path):
            walked = walk(task, actions)
            assert walked.complete, actions
            assert precision <= 5e-4 * (1 + 1e-6)
            assert cost == pytest.approx(walked.cost, abs=precision)

    @configs_expecting("tool_changes")
    def test_the_optimum_has_the_expected_tool_changes(self, path):
        """So many skills of the plan load a tool."""
        task = load_problem(path).task
        kinds = [task.skill(step.skill).kind for step in optimum(path).steps]
        assert content_of(path)["expect"]["tool_changes"] == kinds.count("load")


class TestTheBoard:
    def test_it_has_the_action_space_of_figure_6(self, board):
        """Sixteen actions, in order."""
        assert [
            "pick(pcb)",
            "place(pcb)",
            "pick(switch_1)",
            "place(switch_1)",
            "pick(switch_2)",
            "place(switch_2)",
            "pick(clock)",
            "place(clock)",
            "pick(transformer)",
            "place(transformer)",
            "pick(brace)",
            "place(brace)",
            "load(gripper)",
            "load(screwdriver)",
            "fasten(screw_1)",
            "fasten(screw_2)",
        ] == [skill.name for skill in board.skills]

    def test_it_has_the_observation_of_figure_5(self, board):
        """Seventeen bits, in order."""
        parts = ("pcb", "switch_1", "switch_2", "clock", "transformer", "brace")
        expected = [f"{what}({part})" for part in parts for what in ("at_start", "placed")]
        expected += ["fastened(screw_1)", "fastened(screw_2)", "tool(screwdriver)"]
        expected += ["not hand_free", "changed_tool"]
        assert expected == [str(literal) for literal in board.observation]

    def test_its_first_observation_is_that_of_figure_5(self, board):
        """All parts at their starts, nothing placed, gripper attached and ready."""
        expected = (1, 0, 1, 0, 1, 0, 1, 0, 1, 0, 1, 0, 0, 0, 0, 0, 0)
        assert expected == board.observe(board.initial)

    def test_its_reward_is_that_of_table_2(self, board):
        """-10 collision, +10 complete, -0.1 d, -10 out of time, -2.5 repeated tool change."""
        reward = board.reward
        assert reward is not None
        assert -10.0 == reward.infeasible
        assert 10.0 == reward.complete
        assert -0.1 == reward.per_cost
        assert -10.0 == reward.out_of_time
        assert [("repeated_tool_change", -2.5)] == [(p.name, p.reward) for p in reward.penalties]
        assert 20 == board.step_limit

    def test_every_term_of_table_2_is_paid(self, board):
        """A replay pays each exactly where the table says."""
        walked = walk(board, content_of(BOARD)["expect"]["optimal_actions"])
        assert [-0.1 * s.cost for s in walked.steps[:-1]] == [s.reward for s in walked.steps[:-1]]
        assert 10.0 == walked.steps[-1].reward
        assert -10.0 == walk(board, [0, 0]).penalty
        back_and_forth = walk(board, [13, 12, 13])
        assert [False, True, True] == [step.reward == -2.5 for step in back_and_forth.steps]
        assert -10.0 == walk(board, [13, 12] * 10).steps[-1].reward

    @pytest.mark.parametrize(
        ("actions", "cost", "deviation"),
        [
            ([0, 1, 2, 3, 4, 5, 8, 9, 10, 11, 6, 7, 13, 14, 15], "1.867", "0.00 %"),
            ([0, 1, 4, 5, 2, 3, 8, 9, 10, 11, 6, 7, 13, 14, 15], "1.880", "0.70 %"),
            ([0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 13, 14, 15], "1.885", "0.96 %"),
            ([0, 1, 6, 7, 2, 3, 8, 9, 4, 5, 10, 11, 13, 14, 15], "1.939", "3.86 %"),
        ],
    )
    def test_it_reproduces_table_3(self, board, actions, cost, deviation):
        """Costs and deviations from the optimum, in the digits that the paper prints."""
        minimum = optimum(BOARD).cost
        assert minimum is not None
        walked = walk(board, actions)
        assert cost == f"{walked.cost:.3f}"
        assert deviation == f"{100 * (walked.cost / minimum - 1):.2f} %"

    def test_the_order_of_the_paper_s_prose_is_hardly_worse(self, board):
        """Two hundredths of a millimetre: both print 1.867."""
        walked = walk(board, [0, 1, 2, 3, 4, 5, 8, 9, 6, 7, 10, 11, 13, 14, 15])
        assert walked.complete
        assert "1.86711" == f"{walked.cost:.5f}"
        assert "1.867" == f"{walked.cost:.3f}"

    @pytest.mark.slow(reason="walks all sequences; brute force in every run")
    def test_the_worst_shortest_sequence_is_known(self, brute_force):
        """Brute force reports the worst of the 15-skill sequences."""
        worst = brute_force.trace["worst_cost_by_length"]
        assert "2.0586" == f"{worst[15]:.4f}"

    @pytest.mark.slow(reason="by brute force; the same figures in test_exhaustive.py")
    def test_screws_early_need_a_sixteenth_skill(self, brute_force, board_sequences):
        """All 16-skill sequences screw before the last part is placed and change tools twice."""
        assert 120 == len(board_sequences[16])
        for _, actions in board_sequences[16]:
            assert (13, 12) == tuple(action for action in actions if action in (12, 13))
            assert max(actions.index(14), actions.index(15)) < actions.index(12)
        cost, actions = min(board_sequences[16])
        assert "1.94921" == f"{cost:.5f}"
        best = brute_force.trace["best_cost_by_length"]
        assert "1.94921" == f"{best[16]:.5f}"
        assert cost > min(board_sequences[15])[0]

    @pytest.mark.slow(reason="walks all sequences; brute force in every run")
    def test_an_independent_walk_agrees_with_brute_force(self, brute_force, board_sequences):
        """The same number, the same best and the same worst of each length."""
        result = brute_force
        assert 12_420 == sum(len(results) for results in board_sequences.values())
        assert 12_420 == result.trace["sequences"]
        best = min(min(outcome)[0] for outcome in board_sequences.values())
        assert best == pytest.approx(result.cost, abs=1e-12)
        for length, board_sequence in board_sequences.items():
            assert max(board_sequence)[0] == pytest.approx(
                result.trace["worst_cost_by_length"][length], abs=1e-12
            )

    def test_holding_back_picks_leaves_307_states(self, board):
        """Without picks before their support is there: 307 states, 255 observations."""
        setup = Setup(options={"precedence": {"hold_back_picks": True}})
        states = reachable_states(make_model(board, setup), 100_000)
        assert 307 == len(states)
        assert 255 == len({board.observe(state) for state in states})


class TestTheSensorStack:
    """The order is another one than the board's, and a hand with fingers decides a part of it."""

    def finger(self, stack: Task) -> tuple[Box, list[Box]]:
        """Return boxes about the coil and about a finger beside the connector, in the world."""
        scene = stack.scene
        coil, connector = scene.body("coil"), scene.body("connector")
        grasp = connector.grasp
        assert grasp is not None
        assert "x" == grasp.closing_axis
        poses = {
            body.name: placement.pose.position
            for body in scene.bodies
            for placement in body.placements
            if placement.fact == f"placed({body.name})"
        }
        (around,) = coil.boxes
        tall = Box(around.size, add(around.centre, poses["coil"]))
        tip = add(grasp.tip, poses["connector"])
        pieces = []
        for low, high in pairwise(FINGER_PROFILE_M):
            face_m = tip[0] + grasp.width_m / 2 + low[2]
            centre = (face_m + low[3] / 2, tip[1], tip[2] + (low[0] + high[0]) / 2)
            pieces.append(Box((low[3], 2 * low[1], high[0] - low[0]), centre))
        return tall, pieces

    def test_a_finger_at_the_connector_reaches_into_the_coil(self, stack):
        """Even one that touches the connector, so that no way of opening helps."""
        tall, pieces = self.finger(stack)
        deepest = max(min(overlaps(tall, piece)) for piece in pieces)
        assert 0.004 < deepest

    def test_the_chart_but_for_the_finger_follows_from_boxes(self, stack):
        """Derived by `aabb`, which knows no fingers; it finds nothing beyond the chart."""
        boxes = Setup(collision=("aabb",), with_chart=False)
        derived = derive_chart(make_feasibility(stack, boxes))
        assert ((("connector", "coil"),), ()) == (derived.missing, derived.extra)

    def test_the_finger_costs_four_centimetres(self, stack):
        """By boxes alone, the coil would come first; with the chart as well, it may not."""
        by_boxes = solve(stack, setup=Setup(collision=("aabb",), with_chart=False))
        by_both = solve(stack, setup=Setup(collision=("aabb", "precedence")))
        by_chart = solve(stack)
        assert "2.78515" == f"{by_boxes.cost:.5f}"
        assert "2.82515" == f"{by_chart.cost:.5f}" == f"{by_both.cost:.5f}"
        order = [step.skill for step in by_boxes.steps]
        assert order.index("place(coil)") < order.index("place(connector)")

    def test_its_coil_is_a_mesh_and_its_spacer_a_cylinder(self, stack):
        """A hexagonal prism, held across its flats."""
        coil = stack.scene.body("coil")
        (prism,) = coil.shapes
        assert isinstance(prism, Mesh)
        assert 12 == len(prism.corners)
        assert coil.boxes[0].size == pytest.approx((0.024, 0.0207846, 0.036), abs=1e-7)
        assert coil.grasp is not None
        assert 0.0207846 == pytest.approx(coil.grasp.width_m, abs=1e-7)
        assert isinstance(stack.scene.body("spacer").shapes[0], Cylinder)

    def test_a_task_is_another_one_with_another_mesh(self, tmp_path):
        """Its hash follows the mesh's file, not only its name."""
        (tmp_path / "meshes").mkdir()
        mesh = tmp_path / "meshes" / "hexagonal_coil.obj"
        task = tmp_path / "sensor_stack.yaml"
        task.write_bytes((FOLDER / "sensor_stack.yaml").read_bytes())
        mesh.write_bytes((FOLDER / "meshes" / mesh.name).read_bytes())
        assert load_problem(FOLDER / "sensor_stack.yaml").sha256 == load_problem(task).sha256
        mesh.write_text(mesh.read_text("utf-8").replace("36.0", "30.0"), "utf-8")
        shorter = load_problem(task)
        assert load_problem(FOLDER / "sensor_stack.yaml").sha256 != shorter.sha256
        assert 0.03 == pytest.approx(shorter.task.scene.body("coil").height_m)


class TestNothingOfTheBoardIsInPython:
    """A change of the YAML text changes the task."""

    def variant(self, tmp_path: Path, old: str, new: str) -> Task:
        text = BOARD.read_text("utf-8")
        assert text.count(old) == 1, old
        path = tmp_path / "variant.yaml"
        path.write_text(text.replace(old, new), "utf-8")
        return load_problem(path).task

    def test_the_order_of_actions_is_the_file_s(self, tmp_path, board):
        """Two lines of the action list exchanged are two actions exchanged."""
        old, new = "- pick(pcb)\n  - place(pcb)\n", "- place(pcb)\n  - pick(pcb)\n"
        task = self.variant(tmp_path, old, new)
        names = [skill.name for skill in board.skills]
        assert [names[1], names[0], *names[2:]] == [skill.name for skill in task.skills]

    def test_the_observation_is_the_file_s(self, tmp_path, board):
        """A line less is a bit less."""
        task = self.variant(tmp_path, "  - fastened(screw_2)\n  - tool", "  - tool")
        assert board.observation[:13] + board.observation[14:] == task.observation
        assert Literal("fastened(screw_2)") not in task.observation

    @pytest.mark.parametrize(
        ("line", "new", "attribute"),
        [
            ("infeasible: -10.0", -7.0, "infeasible"),
            ("complete: 10.0", 3.0, "complete"),
            ("per_cost: -0.1", -0.4, "per_cost"),
            ("out_of_time: -10.0", -6.0, "out_of_time"),
        ],
    )
    def test_the_reward_is_the_file_s(self, tmp_path, line, new, attribute):
        """Each figure of Table II is read, not known."""
        task = self.variant(tmp_path, f"  {line}\n", f"  {line.split(':')[0]}: {new}\n")
        assert new == getattr(task.reward, attribute)

    def test_the_penalty_for_tool_changes_is_the_file_s(self, tmp_path):
        """Another figure is another penalty; none is none."""
        other = self.variant(tmp_path, "tool_change: -2.5", "tool_change: -1.25")
        assert other.reward is not None
        assert [-1.25] == [penalty.reward for penalty in other.reward.penalties]
        without = self.variant(tmp_path, "  repeated_tool_change: -2.5\n", "")
        assert without.reward is not None
        assert () == without.reward.penalties

    def test_the_layout_is_the_file_s(self, tmp_path):
        """A part laid elsewhere costs another way."""
        task = self.variant(tmp_path, "start_m: [0.556, -0.134]", "start_m: [0.556, -0.334]")
        result = solve(task)
        assert result.cost is not None
        assert 2.0 < result.cost

    def test_the_chart_is_the_file_s(self, tmp_path):
        """A line less leaves more orders."""
        old = "  - {before: transformer, after: [brace]}\n"
        counts = count_sequences(make_model(self.variant(tmp_path, old, "")))
        assert counts[15] > 120

    def test_the_step_limit_is_the_file_s(self, tmp_path):
        """With 15 skills at most there are the 120 shortest sequences only."""
        task = self.variant(tmp_path, "step_limit: 20", "step_limit: 15")
        assert {15: 120} == count_sequences(make_model(task))

    def test_reloading_is_the_file_s(self, tmp_path):
        """Where an attached tool may be loaded again, there are 925,020 sequences."""
        task = self.variant(tmp_path, "reload: false", "reload: true ")
        assert 925_020 == sum(count_sequences(make_model(task)).values())
