"""What tests of both engines share: the suite with its slow tests marked, and a swinging arm."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

# How a part is turned in the hand: its x is along the closing axis.
ACROSS = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])

SLOW = {
    "test_a_verdict_rests_on_facts_that_hold": "executions; the facts of single ones in every run",
    "test_it_answers_the_same_whatever_was_checked_before": "executions again; one after another, "
    "or a reused verdict, in every run",
    "test_a_part_is_felt_between_the_jaws": "an execution; on the paper's board in every run",
    "test_a_screw_is_pressed_as_hard_as_it_has_to_be": "an execution; on the paper's board in "
    "every run",
    "test_a_tool_is_sensed_to_be_attached": "an execution; other skills in every run",
    "test_what_is_in_the_way_is_named": "executions; on the paper's board in every run",
    "test_a_right_order_is_granted_from_the_first_skill_to_the_last": "eight executions; single "
    "ones in every run",
    "test_answers_are_equal_to_the_bit_in_any_order": "six executions; single ones in every run",
    "test_answers_are_equal_to_the_bit_in_other_processes": "processes; one in every run",
}


def mark_slow(names):
    """Return a decorator that leaves inherited tests of a suite to `make test-all`.

    Parameters
    ----------
    names
        Names of the tests, each with the reason.
    """

    def mark(suite):
        for name, reason in names.items():

            def run(self, name=name):
                getattr(super(suite, self), name)()

            setattr(suite, name, pytest.mark.slow(reason=reason)(run))
        return suite

    return mark


@dataclass(frozen=True)
class Swing:
    """A run of an arm's last three joints to and fro, of which nothing is left."""

    begin_rad: np.ndarray
    amplitude_rad: float
    duration_s: float

    def at(self, time_s: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return angles, speeds and accelerations."""
        rate = 2 * np.pi / self.duration_s
        wrist = np.zeros(len(self.begin_rad))
        wrist[-3:] = self.amplitude_rad / 2
        cosine, sine = np.cos(rate * time_s), np.sin(rate * time_s)
        return (
            self.begin_rad + wrist * (1 - cosine),
            wrist * rate * sine,
            wrist * rate**2 * cosine,
        )
