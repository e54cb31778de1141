"""TSPLIB instances of sequential ordering: the portfolio against CP-SAT, at the same seconds.

Every solver has a process of its own on one core, in turns: A, B, A, B, so that a drifting machine
does not decide. Costs and bounds are compared with the best known costs: a bound above, or a cost
below, is an error of the solver, and the exit code is 1.

Run from the repository: ``python benchmarks/sequencing.py [--seconds 60] [--out FILE]``.
"""

from __future__ import annotations

import argparse
import csv
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from fresh_process import ROOT, Outcome, Trial, last_core
from record_file import RecordFile

from skillplan.pipeline import registry
from skillplan.solvers.solution import relative_gap
from skillplan.views.text.table import Column, Table, render

FOLDER = ROOT / "tests" / "instances" / "sop"
CLOSE = 0.005
NARROW = 0.10
# Costs are whole numbers.
ROUNDING = 1e-6
# What is later than this is said to be, as a fraction of the limit.
LATE = 0.05


@dataclass(frozen=True)
class Row:
    """One solver on one instance; `best` is the best known cost, or None."""

    name: str
    solver: str
    n: int | None
    best: float | None
    outcome: Outcome

    @property
    def proved(self) -> bool:
        """Whether the referee grants a proof."""
        return self.outcome.status == "optimal"

    @property
    def deviation(self) -> float | None:
        """How far the cost is above the best known, as a fraction of that."""
        if self.outcome.cost is None or self.best is None:
            return None
        return (self.outcome.cost - self.best) / max(1.0, self.best)

    @property
    def gap(self) -> float | None:
        """(cost - bound) / cost, or None."""
        return relative_gap(self.outcome.cost, self.outcome.bound)

    @property
    def fault(self) -> str:
        """What cannot be, in words; empty where all is well."""
        cost, bound, best = self.outcome.cost, self.outcome.bound, self.best
        if self.outcome.status in ("wrong", "failed", "refused", "infeasible"):
            return f"{self.outcome.status}: {self.outcome.reason}"
        if best is not None and bound is not None and bound > best + ROUNDING:
            return f"bound {bound:g} above the best known cost {best:g}"
        if best is not None and cost is not None and cost < best - ROUNDING:
            return f"cost {cost:g} below the best known cost {best:g}"
        return ""

    def cells(self) -> list[str]:
        """Return what the table shows."""
        outcome = self.outcome
        return [
            self.name,
            "-" if self.n is None else str(self.n),
            "-" if self.best is None else f"{self.best:g}",
            self.solver,
            "-" if outcome.cost is None else f"{outcome.cost:.0f}",
            "-" if self.deviation is None else f"{100 * self.deviation:.2f} %",
            "-" if outcome.bound is None else f"{outcome.bound:.0f}",
            "proved" if self.proved else "-" if self.gap is None else f"{100 * self.gap:.2f} %",
            f"{outcome.taken_s:.2f}",
            f"{outcome.peak_mib:.0f}",
            outcome.method,
        ]


def instance_table(rows: Sequence[Row]) -> Table:
    """Return a row for every instance and solver."""
    columns = [
        Column("instance"),
        Column("n", right=True),
        Column("best known", right=True),
        Column("solver"),
        Column("cost", right=True),
        Column("deviation", right=True),
        Column("bound", right=True),
        Column("gap", right=True),
        Column("seconds", right=True),
        Column("MiB", right=True),
        Column("bound by"),
    ]
    return Table("instance by instance", columns, [row.cells() for row in rows])


def totals_table(rows: Sequence[Row], solvers: Sequence[str], title: str, limit_s: float) -> Table:
    """Return a row for every solver, with what is to be said of it below."""
    columns = [
        Column("solver"),
        *(
            Column(heading, right=True)
            for heading in (
                "instances",
                "proved",
                f"within {100 * CLOSE:g} % of best known",
                f"gap below {100 * NARROW:g} %",
            )
        ),
    ]
    cells = []
    for solver in solvers:
        own = [row for row in rows if row.solver == solver]
        counts = (
            len(own),
            sum(row.proved for row in own),
            sum(row.deviation is not None and row.deviation <= CLOSE for row in own),
            sum(row.gap is not None and row.gap < NARROW for row in own),
        )
        cells.append([solver, *map(str, counts)])
    notes = [comparison(rows, solvers[0], other) for other in solvers[1:]]
    notes += [
        f"late: {row.name} {row.solver} took {row.outcome.taken_s:.2f} s"
        for row in rows
        if row.outcome.taken_s > (1 + LATE) * limit_s
    ]
    notes += [f"FAULT {row.name} {row.solver}: {row.fault}" for row in rows if row.fault]
    return Table(title, columns, cells, notes)


def comparison(rows: Sequence[Row], one: str, other: str) -> str:
    """Return on how many instances the other solver is better, in one line."""
    ours = {row.name: row for row in rows if row.solver == one}
    theirs = [row for row in rows if row.solver == other]
    cheaper = [row.name for row in theirs if _cost(row) < _cost(ours[row.name]) - ROUNDING]
    proofs = [row.name for row in theirs if row.proved and not ours[row.name].proved]
    words = [
        f"{what} on {len(names)}" + (f" ({', '.join(names)})" if names else "")
        for what, names in (("a lower cost", cheaper), ("a proof that is missing there", proofs))
    ]
    return f"{other} against {one}: {' and '.join(words)}"


def _cost(row: Row) -> float:
    return float("inf") if row.outcome.cost is None else row.outcome.cost


def best_known(path: Path) -> dict[str, dict[str, str]]:
    """Return the lines of a CSV file with the columns name, n and best_known, by name."""
    if not path.exists():
        return {}
    with path.open(encoding="utf-8", newline="") as file:
        return {line["name"]: line for line in csv.DictReader(file)}


def arguments() -> argparse.Namespace:
    """Return what the command line says."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add = parser.add_argument
    add("--folder", type=Path, default=FOLDER, help="of *.sop files")
    add("--best-known", type=Path, help="CSV file; default: best_known.csv of the folder")
    add("--names", help="instances, after commas; default: all")
    add(
        "--solvers",
        default="portfolio cp-sat",
        help="after blanks, each NAME[:KEY=VALUE,...]; the first is held up",
    )
    add("--seconds", type=float, default=10.0, help="time limit of each [s]")
    add("--by-cpu", action="store_true", help="count the seconds that a process computes")
    add("--seed", type=int, default=0)
    add("--core", type=int, default=last_core(), help="which all processes run on")
    add("--out", help="file of JSON lines; what it holds already is not measured again")
    add("--format", choices=("table", "md", "csv"), default="table")
    return parser.parse_args()


def main() -> int:
    """Print a row for every instance and solver, and the totals."""
    args = arguments()
    records = RecordFile(args.out)
    best = best_known(args.best_known or args.folder / "best_known.csv")
    paths = sorted(args.folder.glob("*.sop"), key=lambda path: path.name.lower())
    if args.names:
        wanted = args.names.split(",")
        paths = [path for path in paths if path.stem in wanted]
        missing = sorted(set(wanted) - {path.stem for path in paths})
        if missing:
            print(f"{args.folder} has no {', '.join(missing)}.", file=sys.stderr)
            return 2
    wanted = args.solvers.split()
    solvers = [name for name in wanted if name.partition(":")[0] in registry.names("solver")]
    for name in sorted(set(wanted) - set(solvers)):
        print(f"{name} is left out: no such solver is installed.", file=sys.stderr)
    if not solvers or not paths:
        print("There is nothing to measure.", file=sys.stderr)
        return 2
    rows = []
    for path in paths:
        for solver in solvers:
            trial = Trial(
                str(path.resolve()), solver, args.seconds, args.by_cpu, args.seed, args.core
            )
            line = best.get(path.stem, {})
            known = line.get("best_known")
            row = Row(
                path.stem,
                solver,
                int(line["n"]) if line.get("n") else None,
                float(known) if known else None,
                records.outcome(path.stem, trial),
            )
            rows.append(row)
            print(" ".join(row.cells()), row.fault, file=sys.stderr, flush=True)
    clock = "CPU seconds" if args.by_cpu else "seconds"
    title = f"sequential ordering, {args.seconds:g} {clock} on one core, seed {args.seed}"
    tables = [totals_table(rows, solvers, title, args.seconds), instance_table(rows)]
    print(render(tables, args.format, sys.stdout), end="")
    return int(any(row.fault for row in rows))


if __name__ == "__main__":
    sys.exit(main())
