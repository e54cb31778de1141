"""What every detector owes the model, asked of those that read contacts; takes minutes."""

from __future__ import annotations

import pytest

from skillplan.testing import DetectorSuite

pytestmark = pytest.mark.slow(reason="the conformance suite of detectors on simulated executions")


class TestContactPairs(DetectorSuite):
    detector = "contact-pairs"


class TestContactForce(DetectorSuite):
    detector = "contact-force"
