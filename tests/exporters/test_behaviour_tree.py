"""Behaviour trees, run in the library that they are written for."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pytest

from skillplan.exporters import PORTS, BehaviourTreeExporter, Handover, escape_text, unescape_text
from skillplan.testing import chance_task, hostile_task, solved_lid
from skillplan.xml_tree import parse_xml

bt: Any = pytest.importorskip("behaviortreepy", reason="needs behaviortreepy: skillplan[test]")


def tree_of(handover: Handover, attempts: int = 2) -> str:
    options = BehaviourTreeExporter.Options(attempts=attempts)
    (text,) = BehaviourTreeExporter(options).files(handover).values()
    assert isinstance(text, str)
    return text


class Cell:
    """Does skills on the facts alone; some fail as often as is staged."""

    def __init__(self, handover: Handover, failures: Mapping[str, int] = {}) -> None:
        self.facts = set(handover.model.initial)
        self.failures = dict(failures)
        self.done: list[str] = []
        self.recovered: list[str] = []
        self.cost = 0.0

    def run(self, text: str) -> str:
        """Return what the tree comes to."""
        factory = bt.BehaviorTreeFactory()
        for element in parse_xml(text.encode()).all("TreeNodesModel"):
            for node in element.all("Action"):
                name = node.attributes["ID"]
                job = self._execute if name.startswith("Execute") else self._recover
                factory.register_simple_action(name, job)
        factory.register_simple_condition("SkillApplicable", self._applicable)
        factory.register_simple_condition("SkillDone", self._is_done)
        return str(factory.create_tree_from_text(text).tick_while_running().name)

    def _port(self, node: Any, name: str) -> str:
        return unescape_text(node.config().blackboard.get_string(name))

    def _facts(self, node: Any, name: str) -> set[str]:
        return set(self._port(node, name).split(";")) - {""}

    def _status(self, good: bool) -> Any:
        return bt.NodeStatus.SUCCESS if good else bt.NodeStatus.FAILURE

    def _applicable(self, node: Any) -> Any:
        forbidden = self._facts(node, "forbids") & self.facts
        return self._status(self._facts(node, "requires") <= self.facts and not forbidden)

    def _is_done(self, node: Any) -> Any:
        left = self._facts(node, "ends") & self.facts
        return self._status(self._facts(node, "achieves") <= self.facts and not left)

    def _execute(self, node: Any) -> Any:
        skill = self._port(node, "skill")
        if self.failures.get(skill):
            self.failures[skill] -= 1
            return bt.NodeStatus.FAILURE
        self.facts = self.facts - self._facts(node, "ends") | self._facts(node, "achieves")
        self.done.append(skill)
        self.cost += float(self._port(node, "cost"))
        return bt.NodeStatus.SUCCESS

    def _recover(self, node: Any) -> Any:
        self.recovered.append(self._port(node, "skill"))
        return bt.NodeStatus.SUCCESS


def plan_of(handover: Handover) -> list[str]:
    return [skill.skill.name for skill in handover.skills]


class TestInBehaviorTreeCpp:
    def test_the_plan_is_done_at_its_cost(self, board):
        """Every skill once, in order, and the goal holds."""
        cell = Cell(board)
        assert "SUCCESS" == cell.run(tree_of(board))
        assert board.plan is not None
        assert (plan_of(board), board.plan.cost) == (cell.done, pytest.approx(cell.cost))
        assert set(board.task.goal.requires) <= cell.facts
        assert [] == cell.recovered

    def test_a_failure_is_recovered_from_and_the_skill_tried_again(self, board):
        """The plan comes to its end all the same."""
        cell = Cell(board, {"pick(clock)": 1})
        assert "SUCCESS" == cell.run(tree_of(board))
        assert (plan_of(board), ["pick(clock)"]) == (cell.done, cell.recovered)

    def test_two_failures_of_a_skill_end_the_plan(self, board):
        """Unless more attempts are asked for; what is behind it is not done."""
        cell = Cell(board, {"pick(clock)": 2})
        assert "FAILURE" == cell.run(tree_of(board))
        assert plan_of(board)[:10] == cell.done
        assert "SUCCESS" == Cell(board, {"pick(clock)": 2}).run(tree_of(board, attempts=3))

    def test_a_skill_that_is_done_already_is_passed_over(self, board):
        """Where somebody stopped behind the first one, the tree goes on with the second."""
        cell = Cell(board)
        cell.facts = set(board.skills[0].after)
        assert "SUCCESS" == cell.run(tree_of(board))
        assert plan_of(board)[1:] == cell.done

    def test_hostile_names_arrive_as_they_are(self):
        """Quotes, brackets, line breaks and control characters."""
        handover = solved_lid(hostile_task())
        cell = Cell(handover)
        assert "SUCCESS" == cell.run(tree_of(handover))
        assert plan_of(handover) == cell.done

    def test_a_grasp_that_may_fail_is_tried_again(self):
        """That is what a tree can say of chance."""
        handover = solved_lid(chance_task())
        assert "SUCCESS" == Cell(handover, {"pick(fuse)": 1}).run(tree_of(handover))
        assert BehaviourTreeExporter().notes(handover)


def test_every_node_has_a_model_with_its_ports(board):
    """So that Groot shows what each takes."""
    root = parse_xml(tree_of(board).encode())
    (models,) = root.all("TreeNodesModel")
    ids = {model.attributes["ID"] for model in models.children}
    assert {"pick", "place", "load", "fasten"} <= ids
    assert {"Execute_pick", "Recover_pick", "SkillApplicable", "SkillDone"} <= ids
    for model in models.children:
        assert list(PORTS) == [port.attributes["name"] for port in model.children]


@pytest.mark.parametrize("text", ["a\\u0041", "{x}", "\x00\n\t", "\ud800", "plain é 漢", "\\"])
def test_what_xml_cannot_hold_is_written_by_number_and_read_back(text):
    """And what would name an entry of the blackboard."""
    assert text == unescape_text(escape_text(text))
    assert not escape_text(text).startswith("{")
