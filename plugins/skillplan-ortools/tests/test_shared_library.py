"""OR-Tools and highspy both bring HiGHS, and are to live in one process."""

import subprocess
import sys
from pathlib import Path

import pytest

from thinned import slow_case

INSTANCE = Path(__file__).parents[3] / "tests" / "instances" / "sop" / "ESC07.sop"


@pytest.mark.slow(reason="a process for each order; one comparison is a command of every CI run")
@pytest.mark.parametrize(
    "solvers",
    [
        "cp-sat,branch-and-cut",
        slow_case("branch-and-cut,cp-sat", reason="the other order in every run"),
    ],
)
def test_a_comparison_may_hold_both_in_any_order(solvers):
    """In a process of its own, as what is loaded first stays."""
    words = ["compare", str(INSTANCE), "--solvers", solvers, "--format", "csv"]
    done = subprocess.run(
        [sys.executable, "-m", "skillplan", *words], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.count(",optimal,2125,") == 2
