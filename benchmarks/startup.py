"""How long the command line takes, as whole processes and as ratios to ``python -c pass``.

Budgets of the project: ``--help`` at most 0.25 s, ``search-optimal`` and ``check`` on the board at
most 0.5 s, all with a warm file cache.
"""

from __future__ import annotations

import sys

from timing import BASELINE, against_baseline

BOARD = "configs/inverter_board.yaml"
COMMANDS = {
    "python -c pass": (BASELINE[1:], None),
    "skillplan --help": (("-m", "skillplan", "--help"), 0.25),
    "skillplan check": (("-m", "skillplan", "check", BOARD), 0.5),
    "skillplan search-optimal": (("-m", "skillplan", "search-optimal", BOARD), 0.5),
    "skillplan compare": (
        ("-m", "skillplan", "compare", BOARD, "--solvers", "exhaustive,exact"),
        None,
    ),
}


def main() -> None:
    """Print a row for every command."""
    print(f"{'command':28} {'median [s]':>11} {'ratio':>7} {'budget [s]':>11}")
    for name, (arguments, budget_s) in COMMANDS.items():
        timing = against_baseline((sys.executable, *arguments))
        budget = "-" if budget_s is None else f"{budget_s:.2f}"
        print(f"{name:28} {timing.wall_s:11.3f} {timing.ratio:7.1f} {budget:>11}")


if __name__ == "__main__":
    main()
