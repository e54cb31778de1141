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
    """Base class of solvers: finds a plan or a policy on a model.

    A solver sees only the model. The referee checks its claims.

    Parameters
    ----------
    options
        An instance of `Options`; None for the defaults.
    stop
        Stopping criterion; never by default.

    Attributes
    ----------
    name
        Name in kebab case, as in the entry point.
    Options
        A pydantic model whose fields have a range and a description, so that the command line
        lists, validates and explains them.
    stage
        The only stage of a chain that it searches, such as ``goals``; None for all.
    polls
        True if it polls its stop. Under a limit of time or memory a solver that does not is run in
        a process of its own, which can be ended.
    counts_waits
        True if it adds up the time of a plan, from which the waits for arriving parts follow.
    seeded
        True if its solution depends on the seed. Runs of a solver without are no samples.
    jobs
        Number of processes it may use, >= 1. More processes must not give a worse answer.
    make_executor
        Returns the executor of these processes; None for this machine.
    """

    name: ClassVar[str]
    Options: ClassVar[type[BaseModel]] = back_end.Options
    stage: ClassVar[str | None] = None
    polls: ClassVar[bool] = False
    seeded: ClassVar[bool] = True
    counts_waits: ClassVar[bool] = False
    jobs: int = 1
    make_executor: MakeExecutor | None = None

    def __init__(self, options: BaseModel | None = None, stop: Stop | None = None) -> None:
        self.options = self.Options() if options is None else options
        self.stop = Stop() if stop is None else stop

    @property
    def replans(self) -> int:
        """Number of times that the stages before its own may be replanned, finer; 0 by default."""
        return 0

    def refuses(self, model: SkillModel) -> str | None:
        """Return the reason why this solver cannot serve the model; None if it can."""
        return None

    def find_refusal(self, model: SkillModel) -> str | None:
        """Return the reason of `refuses`, or that the solver cannot count waits."""
        if model.task.counts_waits and not self.counts_waits:
            return (
                "parts arrive at a time ('arrives_s'), and how long the arm waits for them depends "
                "on more than the state; take exact, or cost: distance"
            )
        return self.refuses(model)

    @abstractmethod
    def solve(self, model: SkillModel, *, seed: int = 0) -> Solution:
        """Search the model.

        Poll ``self.stop()`` and return the best so far once it is true. Pass every better plan to
        ``self.stop.incumbent``, so that it survives an interruption.

        Parameters
        ----------
        model
            The skill model, which queries back ends only for the transitions that are needed.
        seed
            Seed of all random numbers: the same seed gives the same solution.

        Returns
        -------
        Solution
            A plan or a policy, with its claims.
        """
