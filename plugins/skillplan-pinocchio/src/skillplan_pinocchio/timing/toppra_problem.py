"""toppra's problem for one path, without the overhead of its constructors.

Those describe every limit as text and probe for linear solvers that are not installed, a third of
the time on an arm's short paths. Results are the same.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from toppra.algorithm import TOPPRA
from toppra.algorithm.algorithm import ParameterizationAlgorithm
from toppra.constraint import (
    DiscretizationType,
    JointAccelerationConstraint,
    JointVelocityConstraint,
    LinearConstraint,
)
from toppra.solverwrapper.cy_seidel_solverwrapper import seidelWrapper

from skillplan_pinocchio.kinematics.joint_path import Array


class SpeedLimits(JointVelocityConstraint):  # type: ignore[misc]
    """Symmetric speed limits, shape (n,), > 0."""

    def __init__(self, greatest: Array) -> None:
        LinearConstraint.__init__(self)
        self.vlim = np.stack((-greatest, greatest), axis=1)
        self.dof = len(greatest)


class AccelerationLimits(JointAccelerationConstraint):  # type: ignore[misc]
    """Symmetric acceleration limits, shape (n,), > 0."""

    def __init__(self, greatest: Array) -> None:
        LinearConstraint.__init__(self)
        self.alim = np.stack((-greatest, greatest), axis=1)
        self.dof = len(greatest)
        self.set_discretization_type(DiscretizationType.Interpolation)
        self.identical = True


class FastestRun(TOPPRA):  # type: ignore[misc]
    """The fastest run along a path on a grid, by toppra's own linear solver.

    Parameters
    ----------
    path
        Derivatives at the places of the grid, in toppra's interface.
    grid
        Increasing places from 0 to 1.
    """

    def __init__(
        self, speeds: SpeedLimits, accelerations: AccelerationLimits, path: Any, grid: Array
    ) -> None:
        limits = [speeds, accelerations]
        ParameterizationAlgorithm.__init__(self, limits, path, gridpoints=grid)
        self.solver_wrapper = seidelWrapper(limits, path, self.gridpoints, solve_lp1d=True)
