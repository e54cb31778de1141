"""What is compiled at installation is what searches call."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from skillplan.domains.assembly import BoardGenerator

INSTANCES = Path(__file__).parents[2] / "instances" / "sop"

# In a process of its own: other tests compile kernels for types of their own.
SCRIPT = """
import json, sys
from numba.core.dispatcher import Dispatcher
from skillplan import Setup, load_problem, solve
from skillplan.solvers.ordering import portfolio

def compiled():
    return {
        f"{kernel.py_func.__module__}.{kernel.py_func.__name__}": len(kernel.signatures)
        for name, module in list(sys.modules.items())
        if name.startswith("skillplan.solvers.ordering.")
        for kernel in vars(module).values()
        if isinstance(kernel, Dispatcher)
    }

portfolio.warm_up()
before = compiled()
# Every method still runs, each for a fraction of its turn.
portfolio._MOVES, portfolio._WORK, portfolio._FIRST_WORK = 20_000, 500_000, 500_000
portfolio._PAIRS_WORK = 1_000_000
for path in sys.argv[1:]:
    solve(load_problem(path).task, "portfolio", Setup(options={"portfolio": {"rounds": 1}}))
print(json.dumps([before, compiled()]))
"""

PARTS_OF_MOVES = {"cost_of", "draw", "insert", "may_pass", "note_reversals", "write_string"}

pytestmark = pytest.mark.slow(reason="warms up, and searches three tasks, in a process of its own")


@pytest.fixture(scope="module")
def counts(tmp_path_factory):
    """How many types every kernel is compiled for, after warming up and after real searches."""
    board = tmp_path_factory.mktemp("boards") / "board.yaml"
    board.write_text(BoardGenerator(14, 0.2, 2).text("test"), "utf-8")
    paths = [board, INSTANCES / "ry48p.1.sop", INSTANCES / "rbg109a.sop"]
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT, *map(str, paths)], capture_output=True, text=True, check=True
    )
    loads: list[dict[str, int]] = json.loads(done.stdout)
    return loads


def test_every_kernel_that_python_calls_is_compiled(counts):
    """Kernels that only other kernels call are compiled into their callers."""
    called = {
        name: n
        for name, n in counts[0].items()
        if not name.split(".")[-1].startswith("_") and name.split(".")[-1] not in PARTS_OF_MOVES
    }
    assert len(called) >= 8
    assert set(called.values()) == {1}


def test_real_searches_compile_nothing_more(counts):
    """Costs of metres or whole numbers, sets of one word or two, start or none."""
    assert counts[0] == counts[1]
