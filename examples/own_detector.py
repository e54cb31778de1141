"""A collision detector of your own, combined with built-in ones.

A verdict names the facts that it rests on, so that it is reused wherever they are the same. To
choose a detector by name on the command line, give it an entry point as
plugins/skillplan-template does for a solver.

Run from the repository: ``python examples/own_detector.py``.
"""

from pathlib import Path

from skillplan import Detector, Setup, Skill, SkillModel, State, Verdict, load_problem
from skillplan.checks.feasibility import Feasibility
from skillplan.solvers.search.exact import ExactSolver

BOARD = Path(__file__).parents[1] / "configs" / "inverter_board.yaml"


class ShadowDetector(Detector):
    """Forbid placing the clock in the shadow of the transformer, where no camera sees it."""

    name = "shadow"

    def check(self, skill: Skill, state: State) -> Verdict:
        """Return the verdict on one skill; see :meth:`skillplan.BackEnd.check`."""
        none, transformer = self.task.facts.none, self.task.facts.of("placed(transformer)")
        if skill.name != "place(clock)":
            return Verdict.feasible(none, none)
        if "placed(transformer)" in state:
            return Verdict.infeasible("the transformer hides the place", transformer, none)
        return Verdict.feasible(none, transformer)


def main() -> None:
    """Solve the board with the chart, the boxes and the shadow."""
    task = load_problem(BOARD).task
    built_in = Setup(collision=("precedence", "aabb")).back_ends(task)
    for back_ends in (built_in, [*built_in, ShadowDetector(task)]):
        feasibility = Feasibility(task, back_ends)
        plan = ExactSolver().solve(SkillModel(feasibility)).plan
        assert plan is not None
        places = [name for name in plan.skills if name.startswith("place")]
        print(", ".join(feasibility.queried))
        print(f"  {task.cost_text(plan.cost)}: {' '.join(places)}")


if __name__ == "__main__":
    main()
