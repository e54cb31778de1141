"""The bench owes the rest what every kind of task does."""

from pathlib import Path
from typing import Any, ClassVar

import pytest

from skillplan.testing import DomainSuite
from yaml_data import yaml_data

CONFIGS = Path(__file__).parents[3] / "configs"


def content_of(name: str) -> dict[str, Any]:
    content: dict[str, Any] = yaml_data(CONFIGS / f"swarmitfix_{name}.yaml")
    return content


class TestATrajectory(DomainSuite):
    domain = "swarmitfix"
    content: ClassVar[dict[str, Any]] = content_of("triangular")


@pytest.mark.slow(reason="a bench more; a trajectory in every run")
class TestACurve(DomainSuite):
    domain = "swarmitfix"
    content: ClassVar[dict[str, Any]] = content_of("open_curve")


@pytest.mark.slow(reason="a bench more; a trajectory in every run")
class TestAFleet(DomainSuite):
    domain = "swarmitfix"
    content: ClassVar[dict[str, Any]] = content_of("fleet")


class TestGivenGoals(DomainSuite):
    domain = "swarmitfix"
    content: ClassVar[dict[str, Any]] = {
        "kind": "swarmitfix",
        "name": "walk",
        "base": {"home": "C66", "goals": ["C42", "C29"]},
    }
