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
    """Symmetric speed limits of joints, shape (n,), > 0, and of the parameter.

    Parameters
    ----------
    rates
        Greatest rates of the parameter at the places of the grid; None for no limit.
    """

    def __init__(self, greatest: Array, rates: Array | None = None) -> None:
        LinearConstraint.__init__(self)
        self.vlim = np.stack((-greatest, greatest), axis=1)
        self.dof = len(greatest)
        self.rates = rates

    def compute_constraint_params(self, path: Any, gridpoints: Array) -> tuple[Any, ...]:
        """Return toppra's bounds, of which the last are those on the squared rate."""
        bounds = super().compute_constraint_params(path, gridpoints)
        if self.rates is not None:
            bounds[-1][:, 1] = np.minimum(bounds[-1][:, 1], self.rates**2)
        return bounds  # type: ignore[no-any-return]


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
