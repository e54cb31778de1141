"""Exact search against brute force, and checked orders against exact search, in the same run."""

from __future__ import annotations

import random
from pathlib import Path
from tempfile import TemporaryDirectory

from skillplan import (
    Detector,
    Setup,
    Skill,
    SkillModel,
    State,
    Stop,
    Task,
    Verdict,
    load_problem,
    solve,
)
from skillplan.checks import Feasibility
from skillplan.domains.assembly import AssemblyDomain
from skillplan.pipeline import make_solver

_LIMIT_S = 30.0


class Obstacles(Detector):
    """Refuses one pick in eight from where another part was put, unless a third is in place."""

    name = "obstacles"

    def __init__(self, task: Task) -> None:
        super().__init__(task)
        rng = random.Random(0)
        places = [fact for fact in task.facts.names if fact.startswith("at(")]
        parts = [fact for fact in task.facts.names if fact.startswith("placed(")]
        self.refused = {
            skill.name: (rng.sample(places, len(places) // 8), rng.choice(parts))
            for skill in task.skills
            if skill.kind == "pick"
        }

    def check(self, skill: Skill, state: State) -> Verdict:
        """Return the verdict, with the facts it rests on."""
        facts = self.task.facts
        places, part = self.refused.get(skill.name, ((), ""))
        place = next((fact for fact in places if fact in state), None)
        if place is None:
            return Verdict.feasible(facts.none, facts.of(*places))
        if part in state:
            return Verdict.feasible(facts.of(part), facts.none)
        return Verdict.infeasible("the arm meets a part", facts.of(place), facts.of(part))


def compare_checked_orders() -> None:
    """Print cost, bound and time of exact search and of checked orders on boards at random."""
    print(f"{'paths that are refused':24} {'solver':10} {'cost':>9} {'gap':>7} {'s':>7}")
    with TemporaryDirectory() as folder:
        for parts in (10, 20, 40):
            path = Path(folder, f"{parts}.yaml")
            path.write_text(
                AssemblyDomain().generate({"parts": parts, "density": 0.3, "tools": 2, "seed": 1})
            )
            task = load_problem(path).task
            for name in ("exact", "portfolio"):
                stop = Stop(time_limit_s=_LIMIT_S)
                before_s = stop.left_s or 0.0
                back_ends = (*Setup(collision=("precedence",)).back_ends(task), Obstacles(task))
                model = SkillModel(Feasibility(task, back_ends))
                solution = make_solver(name, {}, stop).solve(model)
                cost = None if solution.plan is None else solution.plan.cost
                gap = None if cost is None else 1 - (solution.lower_bound or 0.0) / cost
                seconds = before_s - (stop.left_s or 0.0)
                shown = "-" if cost is None else f"{cost:.5f}"
                share = "-" if gap is None else f"{gap:.2%}"
                label = f"{parts} parts"
                print(f"{label:24} {name:10} {shown:>9} {share:>7} {seconds:7.2f}")


def main() -> None:
    """Print the board's ratios, exact search on every board and detector, and checked orders."""
    compare_checked_orders()
    print()
    task = load_problem("configs/inverter_board.yaml").task
    brute, exact = solve(task, "exhaustive"), solve(task, "exact")
    assert brute.expanded is not None
    assert exact.expanded is not None
    print("inverter board                 exhaustive      exact    ratio")
    for name, one, other in (
        ("nodes", brute.expanded, exact.expanded),
        ("checks", brute.checks, exact.checks),
        ("milliseconds", 1000 * brute.wall_s, 1000 * exact.wall_s),
    ):
        print(f"{name:28} {one:12,.0f} {other:10,.0f} {one / other:8,.1f}")
    print()
    print(f"{'exact search':24} {'collision':12} {'status':9} {'cost':>9} {'nodes':>8} {'s':>7}")
    for config in ("inverter_board", "motor_drive"):
        task = load_problem(f"configs/{config}.yaml").task
        for detector in ("precedence", "aabb"):
            setup = Setup(collision=(detector,), with_chart=False)
            result = solve(task, "exact", setup, stop=Stop(time_limit_s=60))
            cost = "-" if result.cost is None else f"{result.cost:.5f}"
            print(
                f"{config:24} {detector:12} {result.status.value:9} {cost:>9} "
                f"{result.expanded or 0:8,} {result.wall_s:7.3f}"
            )


if __name__ == "__main__":
    main()
