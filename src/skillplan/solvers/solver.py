"""The base class of solvers."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

from pydantic import BaseModel

from skillplan.model.skill_model import SkillModel
from skillplan.solvers.solution import Solution
from skillplan.solvers.stop import Stop
from skillplan.task import back_end
from skillplan.workers.executor import MakeExecutor


class Solver(ABC):
    """Finds a plan or a policy on a model.

    A solver sees nothing but the model: it never grades itself, and what it claims is
    checked by the referee.

    Parameters
    ----------
    options
        An instance of `Options`; None for the defaults.
    stop
        When to stop; by default never.

    Attributes
    ----------
    name
        Kebab-case, as in the entry point.
    Options
        A pydantic model whose fields carry range and description, so that the command line
        lists, validates and explains them.
    stage
        Of a chain of tasks the only stage that it searches, as ``goals``; None for all.
    polls
        Whether it polls its stop. Under a limit of time or memory one that does not say so is run
        in a process of its own, which is ended; one that does is spared the process.
    jobs
        How many processes it may use at once, >= 1; 1 unless the user allows more. No answer
        may be worse for being allowed more.
    make_executor
        Where those other processes are; None for this machine.
    """

    name: ClassVar[str]
    Options: ClassVar[type[BaseModel]] = back_end.Options
    stage: ClassVar[str | None] = None
    polls: ClassVar[bool] = False
    jobs: int = 1
    make_executor: MakeExecutor | None = None

    def __init__(self, options: BaseModel | None = None, stop: Stop | None = None) -> None:
        self.options = self.Options() if options is None else options
        self.stop = Stop() if stop is None else stop

    @property
    def replans(self) -> int:
        """How often the stages before its own may be replanned, finer; 0 by default."""
        return 0

    def refuses(self, model: SkillModel) -> str | None:
        """Return the reason why this solver cannot serve the model; None if it can."""
        return None

    @abstractmethod
    def solve(self, model: SkillModel, *, seed: int = 0) -> Solution:
        """Search the model.

        Poll ``self.stop()`` and return the best so far once it is true; hand every better
        plan to ``self.stop.incumbent`` so that it survives an interruption.

        Parameters
        ----------
        model
            The skill model; it queries back ends only for the transitions that are looked at.
        seed
            Governs all randomness: the same seed gives the same solution.

        Returns
        -------
        Solution
            A plan or a policy, and what is claimed of it.
        """
