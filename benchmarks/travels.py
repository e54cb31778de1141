"""Travels among pillars and the bodies of the boards: milliseconds, planned against straight.

Each question is put to a planner that was asked nothing before; the hulls of what stands are known.
Run from the repository: ``python benchmarks/travels.py 100``. With ``--check`` every path is
checked by code of its own, at places of which anything is within half a millimetre: seconds a path.
"""

from __future__ import annotations

import statistics
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "support"))

from cluttered_travels import cramped_travels, deepest_m
from skillplan_pinocchio.planning.travel import Travel, Unfound

COUNT = 100


def main() -> None:
    """Print how many are straight, planned or not found, and how long they take."""
    numbers = [int(word) for word in sys.argv[1:] if word.isdigit()]
    checks = "--check" in sys.argv
    spent_ms: dict[str, list[float]] = {"straight": [], "planned": [], "not found": []}
    nearest_m = []
    for travel in cramped_travels(numbers[0] if numbers else COUNT):
        planner = travel.fresh_planner()
        begin_s = time.process_time()
        found = travel.answer(planner)
        taken_ms = 1e3 * (time.process_time() - begin_s)
        if isinstance(found, Unfound):
            spent_ms["not found"].append(taken_ms)
            continue
        assert isinstance(found, Travel)
        spent_ms["straight" if found.is_straight else "planned"].append(taken_ms)
        if checks:
            nearest_m.append(deepest_m(travel, found.path))
    print(f"{'travel':12}{'count':>8}{'median [ms CPU]':>18}{'longest':>10}")
    for kind, all_ms in spent_ms.items():
        if all_ms:
            median_ms, most_ms = statistics.median(all_ms), max(all_ms)
            print(f"{kind:12}{len(all_ms):8}{median_ms:18.1f}{most_ms:10.1f}")
    if spent_ms["straight"] and spent_ms["planned"]:
        ratio = statistics.median(spent_ms["planned"]) / statistics.median(spent_ms["straight"])
        print(f"planned takes {ratio:.1f} times as long as straight")
    if nearest_m:
        print(f"nearest to anything on {len(nearest_m)} paths: {1e3 * min(nearest_m):.2f} mm")


if __name__ == "__main__":
    main()
