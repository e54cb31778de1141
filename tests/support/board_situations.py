"""Situations on the paper's board and its like that several tests of physics start from."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from skillplan.pipeline import load_problem
from skillplan.task import Skill, State, Task

BOARD = Path(__file__).parents[2] / "configs" / "inverter_board.yaml"

# The optimum of the paper's Table III.
OPTIMAL = (0, 1, 2, 3, 4, 5, 8, 9, 10, 11, 6, 7, 13, 14, 15)


def state_after(task: Task, actions: Iterable[int]) -> State:
    """Return the state that is predicted after a sequence, feasible or not."""
    state = task.initial
    for action in actions:
        state = task.skills[action].prediction.apply(state)
    return state


def imagined(task: Task, skill: str, *done: str) -> tuple[Skill, State]:
    """Return a skill, and a state in which it is applicable and just these elements are done."""
    chosen = task.skill(skill)
    names = {*chosen.precondition.requires, "at(home)", *(task.operations[part] for part in done)}
    for element in task.operations:
        start = f"at_start({element})"
        if start in task.facts and element not in done and f"held({element})" not in names:
            names.add(start)
    return chosen, task.facts.of(*names)


def changed_product(folder: Path, content: dict[str, Any], *kept: str) -> Task:
    """Return the task of a product file written to a folder, without its chart and its figures.

    Parameters
    ----------
    folder
        Where the file goes, and the meshes with it.
    content
        Of a file in `configs`, as it was changed.
    kept
        Parts and screws that the product is to consist of; all where none is named.
    """
    silent = ("chart", "collision", "actions", "observation", "expect")
    written = {key: value for key, value in content.items() if key not in silent}
    for section in ("parts", "screws"):
        elements = written[section].items()
        written[section] = {name: it for name, it in elements if name in kept or not kept}
    shutil.copytree(BOARD.parent / "meshes", folder / "meshes")
    path = folder / "changed.yaml"
    # JSON is YAML.
    path.write_text(json.dumps(written), "utf-8")
    return load_problem(path).task
