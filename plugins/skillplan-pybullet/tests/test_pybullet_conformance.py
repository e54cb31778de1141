"""What every engine with a simulated arm owes, asked of pybullet."""

from __future__ import annotations

import random
from collections.abc import Iterator

import pytest

from example_count import examples
from skillplan.task import Skill, State, Task
from skillplan.testing import SimulationSuite


class TestConformance(SimulationSuite):
    engine = "pybullet"

    def queries(self, task: Task) -> Iterator[tuple[Skill, State]]:
        """A sample, as every question is a simulation: in every run, of one skill only."""
        every, few = list(super().queries(task)), 2
        count = examples(12, fewest=few)
        if count == few:
            every = [query for query in every if query[0].name == "pick(lid)"]
        yield from random.Random(4).sample(every, count)

    @pytest.mark.slow(reason="executions again; a reused verdict equals a fresh one in every run")
    def test_it_answers_the_same_whatever_was_checked_before(self):
        super().test_it_answers_the_same_whatever_was_checked_before()

    @pytest.mark.slow(reason="executions again; the facts of verdicts on the board in every run")
    def test_a_verdict_rests_on_facts_that_hold(self):
        super().test_a_verdict_rests_on_facts_that_hold()

    @pytest.mark.slow(reason="an execution; a part on the paper's board in every run")
    def test_a_part_is_felt_between_the_jaws(self):
        super().test_a_part_is_felt_between_the_jaws()

    @pytest.mark.slow(reason="an execution; on the paper's board in every run")
    def test_a_screw_is_pressed_as_hard_as_it_has_to_be(self):
        super().test_a_screw_is_pressed_as_hard_as_it_has_to_be()

    @pytest.mark.slow(reason="an execution; other skills in every run")
    def test_a_tool_is_sensed_to_be_attached(self):
        super().test_a_tool_is_sensed_to_be_attached()

    @pytest.mark.slow(reason="executions; on the paper's board in every run")
    def test_what_is_in_the_way_is_named(self):
        super().test_what_is_in_the_way_is_named()

    @pytest.mark.slow(reason="eight executions; single ones in every run")
    def test_a_right_order_is_granted_from_the_first_skill_to_the_last(self):
        super().test_a_right_order_is_granted_from_the_first_skill_to_the_last()

    @pytest.mark.slow(reason="six executions; the paper's board in every run")
    def test_answers_are_equal_to_the_bit_in_any_order(self):
        super().test_answers_are_equal_to_the_bit_in_any_order()

    @pytest.mark.slow(reason="processes; the paper's board in every run")
    def test_answers_are_equal_to_the_bit_in_other_processes(self):
        super().test_answers_are_equal_to_the_bit_in_other_processes()

    @pytest.mark.slow(reason="an execution; parts of the paper's board in every run")
    def test_a_part_comes_to_rest_where_it_belongs(self):
        super().test_a_part_comes_to_rest_where_it_belongs()

    @pytest.mark.slow(reason="an execution; a switch without its board in every run")
    def test_what_has_nothing_beneath_it_does_not_come_to_rest(self):
        super().test_what_has_nothing_beneath_it_does_not_come_to_rest()
