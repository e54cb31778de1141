"""The executor `ray`, on clusters of this machine."""

from __future__ import annotations

from typing import Any, ClassVar

import pytest

from skillplan.testing import ExecutorSuite


@pytest.mark.slow(reason="starts a Ray cluster and an actor a test; local ones in every run")
class TestRayExecutor(ExecutorSuite):
    executor = "ray"
    options: ClassVar[dict[str, Any]] = {"cpus": 0}
