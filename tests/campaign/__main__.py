"""``python tests/campaign --seed N --scale X``: kills, failing writes, mutated inputs and liars.

It prints counts by kind and every failure with its seed, and exits with 1 if anything failed.
``--only SEED`` does one case again. ``--scale 1`` takes minutes; all counts go with it.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parent / "support")]

from interrupted_writes import (  # noqa: E402
    fail_calls_of_a_training,
    fail_every_call_of_a_search,
    kill_at_random,
)
from liars import lie  # noqa: E402
from mutated_inputs import mutate  # noqa: E402
from tally import Tally, call, progress  # noqa: E402

# At scale 1, by what takes how long.
KILLS = {"search": 40, "train": 25, "sweep": 25, "cache-fill": 10}
INPUTS, CALLS_OF_A_TRAINING = 10_000, 80
PARTS = ("lies", "inputs", "writes", "kills")


def main() -> int:
    """Run the campaign; return 1 if anything failed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=1, help="of all chances")
    parser.add_argument("--scale", type=float, default=1.0, help="of all counts; 0.01 for a look")
    parser.add_argument("--only", help="the seed of one case, as a failure names it")
    parser.add_argument("--parts", default=",".join(PARTS), help=f"of {', '.join(PARTS)}")
    chosen = parser.parse_args()
    parts = set(chosen.parts.split(","))
    tally = Tally(chosen.seed, chosen.only)

    def scaled(count: int) -> int:
        return max(1, round(count * chosen.scale))

    with tempfile.TemporaryDirectory(prefix="campaign-cache-") as cache:
        os.environ["SKILLPLAN_CACHE_DIR"] = cache
        task = Path(cache) / "task.yaml"
        code, said = call("init", "assembly", "--out", str(task))
        assert code == 0, said
        try:
            if "lies" in parts:
                progress("liars")
                lie(tally)
            if "inputs" in parts:
                mutate(tally, scaled(INPUTS))
            if "writes" in parts:
                modes = ("ENOSPC", "EIO", "short")
                fail_every_call_of_a_search(tally, task, modes, step=1)
                fail_calls_of_a_training(tally, task, scaled(CALLS_OF_A_TRAINING))
            if "kills" in parts:
                kill_at_random(tally, task, {name: scaled(count) for name, count in KILLS.items()})
        finally:
            # Also of what was done before Ctrl-C.
            sys.stdout.write(tally.text())
    return 1 if tally.failures else 0


if __name__ == "__main__":
    sys.exit(main())
