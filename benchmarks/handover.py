"""What handing a plan over takes: the page beyond its simulation, its first frame, every export.

Budgets of the project: a page at most 3 s beyond `simulate` of the same plan, at most 1.5 MB for
the board, its first frame within 1.5 s of opening it without a graphics card, an export within 1 s.

Run from the repository: ``python benchmarks/handover.py [TASK]``, by default the inverter board.
Needs the player (`make web`) and, for the first frame, Chromium.
"""

from __future__ import annotations

import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "support"))

from browser import Page, executable

BOARD = "configs/inverter_board.yaml"
EXPORTERS = {"csv": ".csv", "pddl": "", "btcpp": ".xml", "st": ".st", "ros2": ".mcap"}
RUNS = 3
# The browser's own start is not the page's.
BROWSER_STARTS_S = 2.5
# When the player was ready, and its first picture done: reading a pixel waits for that.
FIRST_FRAME = """
new MutationObserver((changes, observer) => {
  if (!document.documentElement?.dataset.playerReady) return;
  observer.disconnect();
  const gl = document.querySelector("canvas").getContext("webgl2");
  gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
  window.firstFrame_ms = performance.now();
}).observe(document, {attributes: true, subtree: true, attributeFilter: ["data-player-ready"]});
"""


def wall_s(*words: str) -> float:
    """Run a command of the tool and return its seconds.

    Raises
    ------
    subprocess.CalledProcessError
        If it fails.
    """
    begin_s = time.perf_counter()
    command = (sys.executable, "-m", "skillplan", *words)
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    return time.perf_counter() - begin_s


def first_frame_s(page: Path) -> float:
    """Return the seconds from opening a page until its first picture is drawn, in software."""
    with tempfile.TemporaryDirectory() as scratch:
        browser = Page(Path(scratch))
        try:
            time.sleep(BROWSER_STARTS_S)
            browser.open(page, FIRST_FRAME, size=(1280, 900))
            return float(browser.evaluate("window.firstFrame_ms")) / 1000
        finally:
            browser.close()


def show(name: str, seconds: Sequence[float], budget_s: float | None) -> None:
    """Print a row: median and largest of some runs, beside what is allowed."""
    budget = "-" if budget_s is None else f"{budget_s:.1f}"
    print(f"{name:28} {statistics.median(seconds):10.2f} {max(seconds):10.2f} {budget:>10}")


def main() -> None:
    """Print a row for each, and the size of the page."""
    task = sys.argv[1] if len(sys.argv) > 1 else BOARD
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        result = str(folder / "result")
        wall_s("search-optimal", task, "--out", result)
        print(f"{'':28} {'median [s]':>10} {'most [s]':>10} {'budget':>10}")
        simulated, reported = [], []
        for run in range(RUNS):
            simulated.append(wall_s("simulate", result))
            reported.append(wall_s("report", result, "--out", str(folder / f"{run}.html")))
        beyond = [page - alone for page, alone in zip(reported, simulated, strict=True)]
        show("simulate", simulated, None)
        show("report", reported, None)
        show("report beyond simulate", beyond, 3.0)
        for name, ending in EXPORTERS.items():
            outs = [str(folder / f"{name}_{run}{ending}") for run in range(RUNS)]
            show(
                f"export {name}",
                [wall_s("export", result, "--to", name, "--out", out) for out in outs],
                1.0,
            )
        page = folder / "0.html"
        if executable() is None:
            print("first frame: not measured, as there is no Chromium on PATH")
        else:
            show("first frame", [first_frame_s(page) for _ in range(RUNS)], 1.5)
        print(f"page: {page.stat().st_size / 1e6:.2f} MB (budget 1.5 for the board)")


if __name__ == "__main__":
    main()
