"""Boards from the generator, ever larger: time to proof, or the gap at the time limit.

Brute force as in the paper (`exhaustive`), `exact`, `auto` (which takes the portfolio where a board
is large) and, if its plugin is installed, `cp-sat`. Every solver has a process of its own on one
core; imports and compiling are not counted.

Run from the repository: ``python benchmarks/scaling.py [--out FILE]``, and then
``python benchmarks/scaling.py --out FILE --plot benchmarks/scaling.png`` for the picture, which
measures nothing.
"""

from __future__ import annotations

import argparse
import itertools
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from fresh_process import Outcome, Trial, last_core
from record_file import RecordFile
from scaling_results import Showing, Size

from skillplan.pipeline import registry
from skillplan.views.text.table import Column, Table, render

PARTS = (6, 10, 15, 20, 30, 50, 100)
DENSITIES = (0.1, 0.3)
TOOLS = (1, 3)
SOLVERS = ("exhaustive", "exact", "auto", "cp-sat")


def contradictions(boards: Sequence[tuple[str, Outcome]]) -> Iterator[str]:
    """Yield which solver's bound is above which other's cost, on one board."""
    for (one, low), (other, high) in itertools.permutations(boards, 2):
        if low.bound is not None and high.cost is not None and low.bound > high.cost * (1 + 1e-9):
            yield f"{one}'s bound {low.bound:.9g} is above {other}'s cost {high.cost:.9g}"


def table(
    found: dict[Size, dict[str, Showing]], solvers: Sequence[str], title: str, seeds: int
) -> tuple[Table, bool]:
    """Return a row for every size, and whether nothing contradicts itself."""
    rows, notes = [], []
    for size, showings in found.items():
        cells = [showings[solver].cell() if solver in showings else "" for solver in solvers]
        rows.append([str(size.parts), f"{size.density:g}", str(size.tools), *cells])
        where = f"FAULT {size.parts} parts, density {size.density:g}, tools {size.tools}"
        for solver, showing in showings.items():
            notes += [f"{where}: {solver} {fault}" for fault in showing.faults()]
        for seed in range(seeds):
            board = [(name, showing.outcomes[seed]) for name, showing in showings.items()]
            notes += [f"{where}: {fault}" for fault in contradictions(board)]
    columns = [Column(name, right=True) for name in ("parts", "density", "tools", *solvers)]
    words = "seconds are to proof; a percentage is the gap at the limit; - means no plan"
    if seeds > 1:
        words += f"; medians over {seeds} boards, and how many were proved"
    return Table(title, columns, rows, [words, *notes]), not notes


def arguments() -> argparse.Namespace:
    """Return what the command line says."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add = parser.add_argument
    add("--parts", default=",".join(map(str, PARTS)), help="after commas")
    add("--densities", default=",".join(map(str, DENSITIES)), help="after commas")
    add("--tools", default=",".join(map(str, TOOLS)), help="after commas")
    add("--solvers", default=" ".join(SOLVERS), help="after blanks, each NAME[:KEY=VALUE,...]")
    add("--seeds", type=int, default=1, help="so many boards of each size")
    add("--seconds", type=float, default=10.0, help="time limit of each [s]")
    add("--by-cpu", action="store_true", help="count the seconds that a process computes")
    add("--core", type=int, default=last_core(), help="which all processes run on")
    add("--out", help="file of JSON lines; what it holds already is not measured again")
    add("--plot", help="draw what --out holds to this PNG or SVG, and measure nothing")
    add("--format", choices=("table", "md", "csv"), default="table")
    return parser.parse_args()


def main() -> int:
    """Print a row for every size of boards, and draw them with --plot."""
    args = arguments()
    if args.plot and not args.out:
        print("--plot draws what --out FILE holds: name it.", file=sys.stderr)
        return 2
    if args.plot and Path(args.plot).suffix not in (".png", ".svg"):
        print(f"--plot {args.plot}: a picture is a .png or a .svg.", file=sys.stderr)
        return 2
    wanted = args.solvers.split()
    solvers = [name for name in wanted if name.partition(":")[0] in registry.names("solver")]
    for name in sorted(set(wanted) - set(solvers)):
        print(f"{name} is left out: no such solver is installed.", file=sys.stderr)
    sizes = [
        Size(int(parts), float(density), int(tools))
        for density in args.densities.split(",")
        for tools in args.tools.split(",")
        for parts in args.parts.split(",")
    ]
    records = RecordFile(args.out)
    found: dict[Size, dict[str, Showing]] = {}
    with tempfile.TemporaryDirectory() as folder:
        for size in sizes:
            boards = [size.board(seed) for seed in range(1, args.seeds + 1)]
            for solver in solvers:
                outcomes = []
                for board in boards:
                    path = Path(folder) / f"{board.task_name}.yaml"
                    path.write_text(board.text(), "utf-8")
                    trial = Trial(str(path), solver, args.seconds, args.by_cpu, 0, args.core)
                    if args.plot:
                        outcome = records.known(board.task_name, trial)
                    else:
                        outcome = records.outcome(board.task_name, trial)
                    if outcome is not None:
                        outcomes.append(outcome)
                if len(outcomes) == len(boards):
                    found.setdefault(size, {})[solver] = showing = Showing(tuple(outcomes))
                    if not args.plot:
                        line = (size.parts, size.density, size.tools, solver, showing.cell())
                        print(*line, file=sys.stderr, flush=True)
    if not found:
        print(f"{args.out} holds nothing of this.", file=sys.stderr)
        return 2
    clock = "CPU seconds" if args.by_cpu else "seconds"
    title = f"boards from the generator, {args.seconds:g} {clock} on one core"
    shown, sound = table(found, solvers, title, args.seeds)
    print(render([shown], args.format, sys.stdout), end="")
    if args.plot:
        from scaling_figure import save

        save(found, solvers, args.seconds, args.seeds, args.by_cpu, Path(args.plot))
    return int(not sound)


if __name__ == "__main__":
    sys.exit(main())
