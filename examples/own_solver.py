"""A solver of your own, used without installing anything.

The referee replays what it returns, so that its plan can be trusted and its cost compared; to
have it listed by ``skillplan plugins``, give it an entry point as plugins/skillplan-template does.

Run from the repository: ``python examples/own_solver.py``.
"""

from pathlib import Path

from skillplan import Plan, SkillModel, Solution, Solver, State, load_problem, solve

BOARD = Path(__file__).parents[1] / "configs" / "inverter_board.yaml"


class NearestFirst(Solver):
    """Always take the nearest feasible skill that leads somewhere new; go back where stuck."""

    name = "nearest-first"

    def solve(self, model: SkillModel, *, seed: int = 0) -> Solution:
        """Return the first plan met, without any claim of proof."""
        seen: set[State] = set()

        def walk(state: State, skills: tuple[str, ...]) -> Plan | None:
            seen.add(state)
            if model.is_goal(state):
                return Plan(skills)
            if len(skills) == model.step_limit or self.stop():
                return None
            for step in sorted(model.transitions(state), key=lambda step: step.cost):
                if step.next_state not in seen:
                    plan = walk(step.next_state, (*skills, step.skill.name))
                    if plan is not None:
                        return plan
            return None

        return Solution(walk(model.initial, ()))


def main() -> None:
    """Compare the walk with the proved optimum."""
    task = load_problem(BOARD).task
    for solver in (NearestFirst(), "exact"):
        result = solve(task, solver)
        cost, checks = task.cost_text(result.cost), result.checks
        print(
            f"{result.solver}: {result.status}, {cost}, {result.makespan} skills, {checks} checks"
        )


if __name__ == "__main__":
    main()
