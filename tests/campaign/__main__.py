"""``python tests/campaign --seed N --scale X``: kills, failing writes, mutated inputs and liars.

It prints counts by kind and every failure with its seed, and exits with 1 if anything failed.
``--only SEED`` does one case again. Scale 1 takes at most 30 minutes on two cores (``--jobs 2``);
all counts go with it. ``tests/campaign/mutants.py`` shows what the campaign notices.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parent / "support")]

from failing_writers import fail_every_call_of_writers  # noqa: E402
from forgeries import forge_results  # noqa: E402
from interrupted_writes import (  # noqa: E402
    fail_calls_of_a_training,
    fail_every_call_of_a_search,
    kill_at_random,
    prepare_inputs,
)
from liars import lie  # noqa: E402
from mutated_inputs import mutate  # noqa: E402
from tally import Tally, call, progress  # noqa: E402

# At scale 1, by what takes how long.
KILLS = {
    "search": 40,
    "report": 20,
    "export": 20,
    "import-cad": 15,
    "train": 25,
    "sweep": 25,
    "cache-fill": 10,
}
FORGED_LEAVES, CALLS_OF_A_TRAINING = 800, 80
# Two halves that take about as long.
HALVES = (("lies", "forgeries", "inputs"), ("writes", "kills"))
PARTS = (*HALVES[0], *HALVES[1])


def main() -> int:
    """Run the campaign; return 1 if anything failed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=1, help="of all chances")
    parser.add_argument("--scale", type=float, default=1.0, help="of all counts; 0.01 for a look")
    parser.add_argument("--only", help="the seed of one case, as a failure names it")
    parser.add_argument("--parts", default=",".join(PARTS), help=f"of {', '.join(PARTS)}")
    parser.add_argument("--kinds", default="", help="of inputs and kills, as sop; default: all")
    parser.add_argument("--jobs", type=int, choices=(1, 2), default=1, help="processes")
    chosen = parser.parse_args()
    parts = set(chosen.parts.split(","))
    kinds = {kind for kind in chosen.kinds.split(",") if kind}
    if chosen.jobs == 2:
        return in_two_processes(chosen, parts)
    tally = Tally(chosen.seed, chosen.only)

    def scaled(count: int) -> int:
        return max(1, round(count * chosen.scale))

    with tempfile.TemporaryDirectory(prefix="campaign-cache-") as cache:
        os.environ["SKILLPLAN_CACHE_DIR"] = cache
        task = Path(cache) / "task.yaml"
        code, message = call("init", "assembly", "--out", str(task))
        assert code == 0, message
        try:
            if "lies" in parts:
                progress("liars")
                lie(tally)
            if "forgeries" in parts:
                forge_results(tally, scaled(FORGED_LEAVES))
            if "inputs" in parts:
                mutate(tally, chosen.scale, kinds)
            if "writes" in parts:
                fail_every_call_of_writers(tally)
                modes = ("ENOSPC", "EIO", "short")
                fail_every_call_of_a_search(tally, task, modes, step=1)
                fail_calls_of_a_training(tally, task, scaled(CALLS_OF_A_TRAINING))
            if "kills" in parts:
                prepare_inputs(task)
                chosen_kills = {name: count for name, count in KILLS.items() if name in kinds}
                counts = {name: scaled(count) for name, count in (chosen_kills or KILLS).items()}
                kill_at_random(tally, task, counts)
        finally:
            # Also of what was done before Ctrl-C.
            sys.stdout.write(tally.text())
    return 1 if tally.failures else 0


def in_two_processes(chosen: argparse.Namespace, parts: set[str]) -> int:
    """Run both halves of the campaign at once; return 1 if anything failed."""
    words = ["--seed", str(chosen.seed), "--scale", str(chosen.scale)]
    words += ["--kinds", chosen.kinds]
    words += [] if chosen.only is None else ["--only", chosen.only]
    halves = [",".join(part for part in half if part in parts) for half in HALVES]
    processes = [
        subprocess.Popen([sys.executable, str(HERE), *words, "--parts", half])
        for half in halves
        if half
    ]
    return max(process.wait() for process in processes)


if __name__ == "__main__":
    sys.exit(main())
