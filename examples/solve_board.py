"""Load a task, prove its optimal sequence of skills, and print it.

Run from the repository: ``python examples/solve_board.py [TASK]``.
"""

import sys
from pathlib import Path

import skillplan

BOARD = Path(__file__).parents[1] / "configs" / "inverter_board.yaml"


def main() -> None:
    """Solve a task file, by default the inverter board."""
    path = sys.argv[1] if len(sys.argv) > 1 else BOARD
    task = skillplan.load_problem(path).task
    result = skillplan.solve(task)  # by exact search, with the back ends that the file names
    print(f"{task.name}: {result.status}, {task.cost_text(result.cost)}")
    for step in result.steps:
        print(f"{step.index + 1:3}  {step.skill:<20} {step.cost:.5f} m")
    assert result.status is skillplan.Status.OPTIMAL


if __name__ == "__main__":
    main()
