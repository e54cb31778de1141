"""What the tests of the plugin share: tasks with grasps, states, and the maker's meshes."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from skillplan import load_problem
from skillplan.physics import choose_grasp
from skillplan.robots import panda_hand
from skillplan.task import Grasp, GraspKind

ROOT = Path(__file__).parents[3]


@pytest.fixture(scope="session")
def panda_files():
    """Return the folder with the description of the arm that pybullet brings along."""
    if sys.version_info >= (3, 12):
        pytest.importorskip("pybullet_data", reason="pybullet has no wheels for this Python")
    import pybullet_data

    return Path(pybullet_data.getDataPath()) / "franka_panda"


@pytest.fixture(scope="session")
def mesh_corners(panda_files):
    """Return a function from a link's name to the corners of its collision mesh [m]."""

    def corners(name):
        lines = (panda_files / "meshes" / "collision" / f"{name}.obj").read_text("utf-8")
        return np.array(
            [[float(x) for x in row.split()[1:4]] for row in lines.splitlines() if row[:2] == "v "]
        )

    return corners


@pytest.fixture(scope="session")
def regrasped():
    """Return a function that gives bodies of a task other grasps."""

    def change(task, **grasps):
        bodies = tuple(
            replace(body, grasps=(grasps[body.name],) if body.name in grasps else body.grasps)
            for body in task.scene.bodies
        )
        return replace(task, scene=replace(task.scene, bodies=bodies))

    return change


@pytest.fixture(scope="session")
def gripping(regrasped):
    """Return a function that lets a task's hand take by suction what is too wide for its jaws."""

    def change(task):
        grasps = {
            body.name: Grasp(GraspKind.SUCTION, (0.0, 0.0, body.height_m))
            for body in task.scene.bodies
            if body.name in task.operations and choose_grasp(body).width_m > panda_hand.OPENING_M
        }
        return regrasped(task, **grasps)

    return change


@pytest.fixture(scope="session")
def product_task():
    """Return a function from the name of a file in `configs` to its task."""
    return lambda name: load_problem(str(ROOT / "configs" / f"{name}.yaml")).task


@pytest.fixture(scope="session")
def board(product_task):
    """Return the inverter board, held as its file says."""
    return product_task("inverter_board")
