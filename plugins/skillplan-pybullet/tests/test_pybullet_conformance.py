"""What every engine with a simulated arm owes, asked of pybullet."""

from __future__ import annotations

import random
from collections.abc import Iterator

import pytest

from example_count import examples
from simulated import SLOW, mark_slow
from skillplan.task import Skill, State, Task
from skillplan.testing import DetectorSuite, SimulationSuite


@mark_slow(
    SLOW
    | {
        "test_a_part_comes_to_rest_where_it_belongs": "an execution; parts of the paper's board in "
        "every run",
        "test_what_has_nothing_beneath_it_does_not_come_to_rest": "an execution; a switch without "
        "its board in every run",
    }
)
class TestConformance(SimulationSuite):
    engine = "pybullet"

    def queries(self, task: Task) -> Iterator[tuple[Skill, State]]:
        """A sample, as every question is a simulation: in every run, of one skill only."""
        every, few = list(super().queries(task)), 2
        count = examples(12, fewest=few)
        if count == few:
            every = [query for query in every if query[0].name == "pick(lid)"]
        yield from random.Random(4).sample(every, count)


# What every detector owes the model, asked of those that read contacts; takes minutes.


@pytest.mark.release(reason="the conformance suite of detectors on simulated executions")
class TestContactPairs(DetectorSuite):
    detector = "contact-pairs"


@pytest.mark.release(reason="a minute of simulated executions")
class TestContactForce(DetectorSuite):
    detector = "contact-force"
