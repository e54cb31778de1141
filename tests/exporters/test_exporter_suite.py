"""Built-in exporters, held to what every exporter owes its users."""

from __future__ import annotations

from skillplan.testing import ExporterSuite


class TestCsv(ExporterSuite):
    exporter = "csv"


class TestStructuredText(ExporterSuite):
    exporter = "st"


class TestPddl(ExporterSuite):
    exporter = "pddl"


class TestBehaviourTree(ExporterSuite):
    exporter = "btcpp"
