"""One solver on one task, in a process of its own on one core, imports and compiling not counted.

Before the clock starts, the process solves small tasks, so that libraries are imported and
compiled functions are loaded. The clock runs while the model is made and searched; reading the
file before and the referee after it are not counted, as in ``seconds`` of `compare`.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from types import SimpleNamespace

ROOT = Path(__file__).resolve().parents[1]
WARM_TASKS = ("configs/inverter_board.yaml", "configs/br17.10.sop")
# The portfolio's methods one by one: it would end with the first that has a proof.
METHODS = ("local-search", "subset-dp", "tree-search", "branch-and-cut")
WARM_S = 1.0
ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1"
)


@dataclass(frozen=True)
class Trial:
    """What a process has to do.

    Parameters
    ----------
    path
        The task file.
    solver
        Its name, and options after a colon: ``cp-sat:interleave=false,workers=1``.
    limit_s
        Time limit [s].
    by_cpu
        Whether the limit and the time taken are those that the process was computing, rather
        than those that passed: for a machine that others use, too.
    seed
        Governs all randomness.
    core
        The core it runs on.
    """

    path: str
    solver: str
    limit_s: float
    by_cpu: bool
    seed: int
    core: int

    @property
    def plugin(self) -> str:
        """The solver's name, without options."""
        return self.solver.partition(":")[0]

    @property
    def options(self) -> dict[str, object]:
        """The solver's options, of which a value that is not JSON is a text."""
        text = self.solver.partition(":")[2]
        pairs = (entry.partition("=") for entry in text.split(",") if entry)
        return {key: _value(value) for key, _, value in pairs}


def _value(text: str) -> object:
    try:
        return json.loads(text)
    except json.JSONDecodeError:
        return text


@dataclass(frozen=True)
class Outcome:
    """What became of it.

    Parameters
    ----------
    status
        What the referee grants; "failed" where the process did not come to an end of its own.
    cost, bound
        None where there is none.
    method
        What proved the bound.
    taken_s
        How long it took, in the time that the limit is in [s].
    nodes
        Looked at by the solver.
    peak_mib
        The most memory the process has held [MiB], the libraries included.
    reason
        Why it is no better than the status says.
    """

    status: str
    cost: float | None = None
    bound: float | None = None
    method: str = ""
    taken_s: float = 0.0
    nodes: int | None = None
    peak_mib: float = 0.0
    reason: str = ""


def last_core() -> int:
    """Return the last of the cores that this process may use: the first has other duties."""
    return max(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 0


def run_in_process(trial: Trial) -> Outcome:
    """Run a trial in a fresh process; what it says of its failure is the reason."""
    command = [sys.executable, str(Path(__file__).resolve()), json.dumps(asdict(trial))]
    most_s = 300 + 20 * trial.limit_s
    try:
        done = subprocess.run(
            command,
            cwd=ROOT,
            env={**os.environ, **ONE_THREAD},
            capture_output=True,
            text=True,
            timeout=most_s,
        )
    except subprocess.TimeoutExpired:
        return Outcome("failed", reason=f"killed after {most_s:.0f} s")
    if done.returncode != 0:
        said = done.stderr.strip().splitlines()
        return Outcome("failed", reason=said[-1] if said else f"exit code {done.returncode}")
    return Outcome(**json.loads(done.stdout.splitlines()[-1]))


def run_here(trial: Trial) -> Outcome:
    """Solve in this process, on its one core."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {trial.core})
    warm_up(trial.plugin)

    from skillplan import Setup, Stop, load_problem
    from skillplan.checks.verdict_cache import VerdictCache
    from skillplan.pipeline.solving import SearchRequest, grade, search
    from skillplan.solvers import stop as clocked

    task, cache = load_problem(trial.path).task, VerdictCache()
    setup = Setup(options={trial.plugin: trial.options})
    clock: Callable[[], float] = time.perf_counter
    if trial.by_cpu:
        clock = time.process_time
        # A stop reads the time of the module that it looks up here.
        vars(clocked)["time"] = SimpleNamespace(monotonic=clock)
    begin_s = clock()
    stop = Stop(time_limit_s=trial.limit_s)
    request = SearchRequest(task, trial.plugin, setup, trial.seed, stop, cache)
    made = search(request)
    taken_s = clock() - begin_s
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    result = grade(request, made)
    return Outcome(
        str(result.status),
        result.cost,
        result.document()["lower_bound"],
        result.bound_method,
        taken_s,
        result.expanded,
        peak / (1024 if sys.platform != "darwin" else 1024**2),
        result.reason,
    )


def warm_up(solver: str) -> None:
    """Solve small tasks, so that what is imported and compiled on demand is there."""
    from skillplan import Stop, load_problem, solve
    from skillplan.pipeline.solving import make_solver

    for path in WARM_TASKS:
        task = load_problem(path).task
        if solver in ("auto", "portfolio"):
            for method in METHODS:
                # However slow the compiler is, one round is brought to its end.
                solve(task, make_solver(method, {"rounds": 1}))
        if solver != "portfolio":
            solve(task, solver, stop=Stop(time_limit_s=WARM_S))


if __name__ == "__main__":
    print(json.dumps(asdict(run_here(Trial(**json.loads(sys.argv[1]))))))
