"""toppra's problem of one path, without what its own constructors do besides.

These describe every limit as text, and look for linear solvers that are not installed; on the short
paths of an arm that takes a third of the time. The numbers are the same.
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
    """Greatest speeds, shape (n,), > 0, alike in both directions."""

    def __init__(self, greatest: Array) -> None:
        LinearConstraint.__init__(self)
        self.vlim = np.stack((-greatest, greatest), axis=1)
        self.dof = len(greatest)


class AccelerationLimits(JointAccelerationConstraint):  # type: ignore[misc]
    """Greatest accelerations, shape (n,), > 0, alike in both directions."""

    def __init__(self, greatest: Array) -> None:
        LinearConstraint.__init__(self)
        self.alim = np.stack((-greatest, greatest), axis=1)
        self.dof = len(greatest)
        self.set_discretization_type(DiscretizationType.Interpolation)
        self.identical = True


class FastestRun(TOPPRA):  # type: ignore[misc]
    """The fastest run along a path on a grid, by the linear solver of toppra itself.

    Parameters
    ----------
    speeds, accelerations
        Limits of the joints.
    path
        Derivatives at the places of the grid, as toppra asks for them.
    grid
        Places from 0 to 1, rising.
    """

    def __init__(
        self, speeds: SpeedLimits, accelerations: AccelerationLimits, path: Any, grid: Array
    ) -> None:
        limits = [speeds, accelerations]
        ParameterizationAlgorithm.__init__(self, limits, path, gridpoints=grid)
        self.solver_wrapper = seidelWrapper(limits, path, self.gridpoints, solve_lp1d=True)
