"""What every detector owes the model, asked of those that read contacts; takes minutes."""

from __future__ import annotations

import pytest

from skillplan.testing import DetectorSuite


@pytest.mark.release(reason="the conformance suite of detectors on simulated executions")
class TestContactPairs(DetectorSuite):
    detector = "contact-pairs"


@pytest.mark.release(reason="a minute of simulated executions")
class TestContactForce(DetectorSuite):
    detector = "contact-force"
