"""Write the STEP files of ``tests/fixtures``, beside each what is true of it, and an example.

Run it in an environment of its own, as what it needs is no dependency of the project:

    python -m venv ocp && ocp/bin/pip install "cadquery-ocp-novtk<8"
    ocp/bin/python plugins/skillplan-cad/tests/step_writer/write_fixtures.py [--check]

``--check`` also moves the exact solids against each other in steps, and tells where a truth that
was written down by hand differs from what they overlap.
"""

from __future__ import annotations

import gzip
import json
import sys
from pathlib import Path

from check_truth import differences
from clamp import clamp
from fastened import fastened
from OCP.BRep import BRep_Builder
from OCP.TopAbs import TopAbs_FACE
from OCP.TopExp import TopExp_Explorer
from OCP.TopoDS import TopoDS_Shell
from products import PRODUCTS
from solids import Product, box, write_step

FIXTURES = Path(__file__).parents[1] / "fixtures"
EXAMPLES = Path(__file__).parents[4] / "examples"
ZIPPED_FROM_BYTES = 60_000


def open_shell():
    """Return a box without its lid, as a shell: no solid."""
    builder, shell = BRep_Builder(), TopoDS_Shell()
    builder.MakeShell(shell)
    faces = TopExp_Explorer(box(5, 5, 5, 15, 15, 15), TopAbs_FACE)
    for _ in range(5):
        builder.Add(shell, faces.Current())
        faces.Next()
    return Product("open_mesh").add("plate", box(0, 0, 0, 20, 20, 5)).add("tray", shell)


def write(product, name, unit="MM", folder=FIXTURES):
    """Write one file, zipped where it is large."""
    path = folder / f"{name}.step"
    write_step(product, path, unit)
    if path.stat().st_size > ZIPPED_FROM_BYTES:
        zipped = path.with_suffix(".step.gz")
        zipped.write_bytes(gzip.compress(path.read_bytes(), mtime=0))
        path.unlink()


def write_with_truth(name, product, truth):
    """Write a file and what is true of it; with ``--check`` say where its solids differ."""
    if "--check" in sys.argv:
        for line in differences(product, truth):
            sys.stdout.write(f"{name}: {line}\n")
    write(product, name)
    (FIXTURES / f"{name}.json").write_text(json.dumps(truth, indent=1) + "\n", "utf-8")


def main():
    """Write all, and say what differs."""
    FIXTURES.mkdir(exist_ok=True)
    # All of them: a file's numbers depend on those written before it.
    for name in PRODUCTS:
        write_with_truth(name, *PRODUCTS[name]())
    write(PRODUCTS["bracket"]()[0], "inch", "INCH")
    write(open_shell(), "open_mesh")
    write_with_truth("fastened", *fastened())
    write(clamp(), "clamp", folder=EXAMPLES)


if __name__ == "__main__":
    main()
