"""Sequential ordering as a task: the published instances, the order, and what is not allowed."""

from __future__ import annotations

import json
import subprocess
import sys
from itertools import pairwise, permutations
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skillplan.chart import derive_chart
from skillplan.domains.sop import NodeOrder, SopConfig, SopDomain, list_nodes
from skillplan.errors import TaskError
from skillplan.model import replay
from skillplan.pipeline import Setup, load_problem, make_feasibility, make_model, solve
from skillplan.records import Status
from skillplan.task import Task
from skillplan.testing import DomainSuite, reachable_states
from sop_instances import BEST_KNOWN, FOLDER, instance
from thinned import slow_case

CONFIGS = Path(__file__).parents[3] / "configs"

# Pairs of which one comes before the other, node 0 before all included.
PAIRS = {
    "br17.10": 48,
    "ESC07": 22,
    "ESC12": 36,
    "ESC25": 62,
    "ESC47": 127,
    "ft53.1": 117,
    "ft53.4": 864,
    "ft70.1": 156,
    "ft70.4": 1464,
    "kro124p.1": 232,
    "kro124p.4": 2504,
    "p43.1": 96,
    "p43.4": 581,
    "prob.42": 100,
    "rbg048a": 544,
    "rbg109a": 5548,
    "rbg150a": 10635,
    "rbg253a": 30688,
    "ry48p.1": 107,
    "ry48p.4": 691,
}


def content_of(costs: list[list[int]]) -> dict[str, Any]:
    return {"kind": "sop", "name": "small", "costs": costs}


def task_of(costs: list[list[int]]) -> Task:
    domain = SopDomain()
    config = SopConfig.model_validate(content_of(costs))
    assert [] == list(domain.issues(config))
    (task,) = domain.ground(config, "")
    return task


def open_costs(n: int) -> list[list[int]]:
    """Return costs between n nodes of which only the first and the last are bound."""
    costs = [[(7 * i + 3 * j) % 11 for j in range(n)] for i in range(n)]
    for i in range(1, n):
        costs[i][0] = costs[n - 1][i - 1] = -1
    return costs


class TestSopDomain(DomainSuite):
    domain = "sop"
    content = content_of(open_costs(5))


class TestInstances:
    def test_all_given_are_there(self):
        """A file for each line of the table, and an order for each file."""
        names = {path.name.removesuffix(".sop") for path in FOLDER.glob("*.sop")}
        assert names == set(BEST_KNOWN) == set(PAIRS)
        assert 20 == len(names)

    @pytest.mark.parametrize("name", BEST_KNOWN)
    def test_it_has_the_published_size_and_order(self, name):
        """As many nodes as the table says, a skill for each but the first."""
        problem = instance(name)
        n = int(BEST_KNOWN[name]["n"])
        order = NodeOrder(problem.config.costs)  # type: ignore[attr-defined]
        assert n == len(order.direct)
        assert PAIRS[name] == sum(members.bit_count() for members in order.before)
        assert [f"visit({node})" for node in range(1, n)] == [s.name for s in problem.task.skills]
        assert n - 1 == problem.task.step_limit == len(problem.task.operations)

    @pytest.mark.parametrize("name", BEST_KNOWN)
    def test_an_order_that_respects_it_is_a_plan_of_no_less_than_the_best_known(self, name):
        """Its cost is the sum of the matrix along the way."""
        problem = instance(name)
        costs = problem.config.costs  # type: ignore[attr-defined]
        way = NodeOrder(costs).sequence
        done = replay(make_model(problem.task), [problem.task.skill(node - 1) for node in way[1:]])
        assert done.complete
        assert sum(costs[i][j] for i, j in pairwise(way)) == done.cost
        assert float(BEST_KNOWN[name]["lower_bound"]) <= done.cost

    @pytest.mark.parametrize(
        ("name", "cost"),
        [("ESC07", 2125), slow_case("ESC12", 1675, reason="a smaller one in every run")],
    )
    def test_exact_search_proves_the_optimum_of_small_ones(self, name, cost):
        """The published one."""
        result = solve(instance(name).task, "exact")
        assert (Status.OPTIMAL, cost) == (result.status, result.cost)
        assert str(cost) == BEST_KNOWN[name]["best_known"]

    def test_the_shipped_ones_are_published_ones(self):
        """To the letter."""
        shipped = sorted(CONFIGS.glob("*.sop"))
        assert ["ESC12.sop", "br17.10.sop"] == [path.name for path in shipped]
        for path in shipped:
            assert (FOLDER / path.name).read_bytes() == path.read_bytes()


class TestTask:
    def test_weights_have_no_unit_and_no_decimals(self):
        """They are whole numbers of nobody knows what."""
        task = task_of(open_costs(4))
        assert ("12", "weight") == (task.cost_text(12.0), task.metric.heading)

    def test_facts_say_what_is_visited_and_where_one_stands(self):
        """One stands at one node; at the start at node 0."""
        task = task_of(open_costs(3))
        names = ("at(0)", "at(1)", "at(2)", "visited(1)", "visited(2)")
        assert names == task.facts.names
        assert ["at(0)"] == list(task.initial)
        assert ["at(1)", "visited(1)"] == list(task.skills[0].prediction.apply(task.initial))

    def test_a_skill_needs_only_what_comes_right_before(self):
        """The rest follows; what the rows leave out as implied is implied."""
        costs = open_costs(5)
        costs[2][1] = costs[3][2] = -1
        closed = [list(row) for row in costs]
        closed[3][1] = -1
        for given_costs in (costs, closed):
            needed = [list(s.precondition.requires) for s in task_of(given_costs).skills]
            assert [[], ["visited(1)"], ["visited(2)"], ["visited(3)"]] == needed

    def test_a_cost_is_looked_up_in_the_row_of_where_one_stands(self):
        """And there is none from where one cannot come."""
        costs = open_costs(5)
        costs[2][1] = costs[3][2] = -1
        task = task_of(costs)
        to_3 = task.skills[2].cost
        assert costs[2][3] == to_3.at(task.facts.of("at(2)"))
        assert costs[2][3] == to_3.least(0, 0)
        for node in (0, 1, 3, 4):
            assert float("inf") == to_3.at(task.facts.of(f"at({node})"))

    def test_the_chart_derived_is_the_order(self):
        """By asking what each skill needs."""
        problem = instance("ESC07")
        order = NodeOrder(problem.config.costs)  # type: ignore[attr-defined]
        chart = derive_chart(make_feasibility(problem.task, Setup()))
        results = {(int(r.before), int(r.after)) for r in chart.relations}
        expected = {
            (before, node)
            for node, members in enumerate(order.immediate)
            for before in list_nodes(members)
            if before
        }
        assert expected == results
        assert [] == [*chart.conditional, *chart.undecided, *chart.impossible]

    @given(st.integers(3, 6), st.data())
    def test_plans_are_the_paths_that_keep_the_order(self, n, data):
        """Enumerated from the matrix itself; the cheapest is what exact search proves."""
        costs = open_costs(n)
        for i in range(2, n - 1):
            for j in range(1, i):
                if data.draw(st.booleans()):
                    costs[i][j] = -1
        task = task_of(costs)
        model = make_model(task)
        best = float("inf")
        for middle in permutations(range(1, n - 1)):
            way = (0, *middle, n - 1)
            keeps = all(costs[a][b] != -1 for k, a in enumerate(way) for b in way[k + 1 :])
            done = replay(model, [task.skill(node - 1) for node in way[1:]])
            assert keeps == done.complete
            if keeps:
                assert sum(costs[a][b] for a, b in pairwise(way)) == done.cost
                best = min(best, done.cost)
        assert best == solve(task, "exact").cost

    def test_the_last_node_is_reached_last(self):
        """Wherever it can be visited, all others have been."""
        task = task_of(open_costs(5))
        model = make_model(task)
        for state in reachable_states(model, 100):
            if task.skills[-1] in model.applicable(state):
                assert 3 == sum(fact.startswith("visited") for fact in state)


class TestYaml:
    def test_the_same_matrix_in_yaml_is_the_same_task(self, tmp_path):
        """To the hash, as comments do not count."""
        there = instance("ESC07")
        rows = "".join(f"- {row}\n" for row in there.config.costs)  # type: ignore[attr-defined]
        path = tmp_path / "esc07.yaml"
        path.write_text(f"kind: sop\nname: ESC07\ncosts:\n{rows}")
        assert there.sha256 == load_problem(path).sha256

    @pytest.mark.slow(
        reason="a process; the shipped schemas of every run are those of the reference"
    )
    def test_the_shipped_schema_is_the_printed_one(self):
        """Editors know what a file may hold, and how large its numbers may be."""
        command = [sys.executable, "-m", "skillplan", "schema", "sop"]
        printed = subprocess.run(command, capture_output=True, text=True, check=True).stdout
        assert printed == (CONFIGS / "sop.schema.json").read_text("utf-8")
        validator = jsonschema.Draft202012Validator(json.loads(printed))
        validator.validate(content_of(open_costs(4)))
        with pytest.raises(jsonschema.ValidationError):
            validator.validate(content_of([[0, -2], [-1, 0]]))

    @pytest.mark.parametrize(
        ("costs", "message"),
        [
            (
                "[[0, 1, 2], [-1, 0], [-1, -1, 0]]",
                "3:20: costs[1]: row 1 has 2 entries; in a matrix of 3 rows it has 3.",
            ),
            ("[[0, 1.5], [-1, 0]]", "3:13: costs[0][1]: must be a whole number, not 1.5."),
            (
                "[[0, 1, 2, 3], [-1, 0, -1, 3], [-1, -1, 0, 3], [-1, -1, -1, 0]]",
                "3:44: costs[2][1]: the order has a cycle: node 1 before 2 before 1. "
                "Write a cost for one of these -1.",
            ),
        ],
    )
    def test_a_faulty_matrix_is_told_by_its_entry(self, tmp_path, costs, message):
        """Where it stands in the YAML."""
        path = tmp_path / "small.yaml"
        path.write_text(f"kind: sop\nname: small\ncosts: {costs}\n")
        with pytest.raises(TaskError) as caught:
            load_problem(path)
        assert [f"{path}:{message}"] == caught.value.lines()

    def test_a_name_of_other_characters_is_refused(self, tmp_path):
        """With what a name may have."""
        path = tmp_path / "small.yaml"
        path.write_text("kind: sop\nname: a b\ncosts: [[0, 1], [-1, 0]]\n")
        with pytest.raises(TaskError, match=r":2:7: name: 'a b' is not a name\. Use letters"):
            load_problem(path)


class TestNodeOrder:
    def test_a_circle_is_named_from_its_lowest_node(self):
        """Each before the next; what only follows it is left out."""
        costs = open_costs(7)
        costs[2][4] = costs[4][3] = costs[3][2] = costs[5][2] = -1
        assert (2, 3, 4) == NodeOrder(costs).cycle

    @given(st.permutations(range(1, 9)), st.sets(st.tuples(st.integers(0, 7), st.integers(0, 7))))
    def test_closing_and_reducing_undo_each_other(self, labels, pairs):
        """The reduction of an order has the same closure, and the closure the same reduction."""
        costs = open_costs(10)
        for a, b in pairs:
            if a < b:
                costs[labels[b]][labels[a]] = -1
        order = NodeOrder(costs)
        assert () == order.cycle
        for sets in (order.before, order.immediate):
            again = [[-1 if members >> j & 1 else 1 for j in range(10)] for members in sets]
            assert order.before == NodeOrder(again).before
            assert order.immediate == NodeOrder(again).immediate
        place = {node: i for i, node in enumerate(order.sequence)}
        assert all(
            place[other] < place[node]
            for node, members in enumerate(order.direct)
            for other in list_nodes(members)
        )


@pytest.mark.slow(reason="a process; the board needs none in every run")
def test_a_sop_file_needs_no_arrays():
    """Reading, grounding and searching a small one import no numerics."""
    path = FOLDER / "ESC07.sop"
    code = (
        "import sys\nfrom skillplan.pipeline import load_problem, solve\n"
        f"assert solve(load_problem({str(path)!r}).task, 'exact').cost == 2125\n"
        "assert 'numpy' not in sys.modules and 'skillplan.domains.assembly' not in sys.modules"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert "" == done.stderr
