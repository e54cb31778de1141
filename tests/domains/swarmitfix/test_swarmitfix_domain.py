"""The bench owes the rest what every kind of task does."""

from pathlib import Path
from typing import Any, ClassVar

import yaml

from skillplan.testing import DomainSuite

CONFIGS = Path(__file__).parents[3] / "configs"


def content_of(name: str) -> dict[str, Any]:
    content: dict[str, Any] = yaml.safe_load((CONFIGS / f"swarmitfix_{name}.yaml").read_text())
    return content


class TestATrajectory(DomainSuite):
    domain = "swarmitfix"
    content: ClassVar[dict[str, Any]] = content_of("triangular")


class TestACurve(DomainSuite):
    domain = "swarmitfix"
    content: ClassVar[dict[str, Any]] = content_of("open_curve")


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
