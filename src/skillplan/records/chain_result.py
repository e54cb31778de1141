"""The results for a chain of tasks, and their sums for the whole chain."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import chain
from typing import Any

from skillplan.domains.domain import Account
from skillplan.records import schemas
from skillplan.records.result import Origin, Result, Status, tolerance
from skillplan.solvers.solution import relative_gap
from skillplan.task.task import Task

_WEAKEST_FIRST = (Status.FAILED, Status.WRONG, Status.REFUSED, Status.INFEASIBLE, Status.UNSOLVED)


@dataclass(frozen=True)
class ChainPart:
    """One task of a chain with its result.

    Parameters
    ----------
    optimum
        The cost that exact search proved for the task; None without a proof.
    reused
        True if a policy stored for an earlier task answered, without planning again.
    """

    task: Task
    result: Result
    optimum: float | None = None
    reused: bool = False

    @property
    def path(self) -> list[str]:
        """The places from the start on; empty if the task is not about walking."""
        places = [place.name for place in self.task.places_in(self.task.initial)]
        if len(places) != 1 or self.result.cost is None:
            return []
        return [*places, *(step.place for step in self.result.steps if step.place is not None)]

    @property
    def ends(self) -> tuple[str | None, str | None]:
        """The places of start and goal."""
        first = [place.name for place in self.task.places_in(self.task.initial)]
        last = [place.name for place in self.task.places_in(self.task.goal.requires)]
        return (first[0] if len(first) == 1 else None, last[0] if len(last) == 1 else None)

    @property
    def keeps_policy(self) -> bool:
        """True if the part has a new policy, which is saved with the result."""
        return self.result.policy is not None and not self.reused

    def document(self) -> dict[str, Any]:
        """Return the part as JSON values: its result, and its start and goal."""
        start, goal = self.ends
        return {
            "name": self.task.name,
            "stage": self.task.stage,
            "start": start,
            "goal": goal,
            "path": self.path,
            "optimum": self.optimum,
            "reused_policy": self.reused,
            **self.result.document(),
            "policy": self.keeps_policy,
        }


@dataclass(frozen=True)
class ChainResult:
    """The result of one solver on one chain.

    Parameters
    ----------
    name, kind, sha256
        Name and kind of the file, and the hash of its content.
    parts
        The solved tasks, at least one. If one was not solved, the tasks after it are missing.
    expected
        Number of tasks in all.
    account
        Figures and sentences of the domain about the whole job.
    replans
        Number of times that the upper levels were planned again because a lower one had failed.
    broken
        Reason why a stage could not begin with the plans before it; empty if it could.
    origin
        The task file and how it was read; None if the tasks are not from a file.

    Raises
    ------
    ValueError
        If there are no parts, or more than expected.
    """

    name: str
    kind: str
    sha256: str
    solver: str
    seed: int
    parts: tuple[ChainPart, ...]
    expected: int
    account: Account = field(default_factory=Account)
    replans: int = 0
    broken: str = ""
    origin: Origin | None = None

    def __post_init__(self) -> None:
        if not 1 <= len(self.parts) <= self.expected:
            raise ValueError(f"{len(self.parts)} parts of {self.expected} are not a chain.")

    @property
    def stage(self) -> str:
        """The stage that the chain is about: the last one."""
        return self.parts[-1].task.stage if self.complete else ""

    @property
    def main(self) -> tuple[ChainPart, ...]:
        """The parts of the last stage, whose costs add up."""
        return tuple(part for part in self.parts if part.task.stage == self.stage)

    @property
    def complete(self) -> bool:
        """True if every part is solved."""
        solved = all(part.result.cost is not None for part in self.parts)
        return solved and len(self.parts) == self.expected

    @property
    def status(self) -> Status:
        """The status of the whole, which is that of its weakest part at best."""
        statuses = [part.result.status for part in self.parts]
        for status in _WEAKEST_FIRST:
            if status in statuses:
                return status
        if not self.complete:
            return Status.UNSOLVED
        proved = all(self._proved(part) for part in self.parts if part.task.stage != self.stage)
        gap = self.gap
        return Status.OPTIMAL if proved and gap is not None and gap <= 1e-9 else Status.SOLVED

    @staticmethod
    def _proved(part: ChainPart) -> bool:
        cost, optimum = part.result.cost, part.optimum
        if part.result.status is Status.OPTIMAL:
            return True
        return cost is not None and optimum is not None and cost <= optimum + tolerance(cost)

    @property
    def back_end_failed(self) -> bool:
        """True if a back end failed in a part."""
        return any(part.result.back_end_failed for part in self.parts)

    @property
    def reason(self) -> str:
        """The reason for the status, and what to know before executing the plan."""
        for part in self.parts:
            if part.result.cost is None:
                return f"{part.task.name}: {part.result.reason}"
        if self.broken:
            return self.broken
        if self.interrupted:
            return "interrupted"
        parts = [self.account.caveat] if self.account.caveat else []
        if self.status is Status.SOLVED and self.proved_by_level:
            parts.insert(0, "every stage is the best, proved, given the ones before")
        return "; ".join(parts)

    @property
    def proved_by(self) -> tuple[str, ...]:
        """Back ends under which every part was checked; empty if a part makes no claim."""
        names = [part.result.proved_by for part in self.parts]
        return tuple(dict.fromkeys(chain.from_iterable(names))) if all(names) else ()

    @property
    def not_checked(self) -> tuple[str, ...]:
        """Sentences about unchecked properties of any part, each once."""
        sentences = chain.from_iterable(part.result.not_checked for part in self.parts)
        return tuple(dict.fromkeys((*self.account.not_checked, *sentences)))

    @property
    def cost(self) -> float | None:
        """The main parts' costs in all; None while the chain is not complete."""
        if not self.complete:
            return None
        return float(sum(part.result.cost or 0.0 for part in self.main))

    @property
    def cost_unit(self) -> str:
        """Unit of the main parts' costs."""
        return self.parts[-1].result.cost_unit if self.complete else ""

    @property
    def lower_bound(self) -> float | None:
        """No path through the main parts costs less, with any plans of the stages before.

        None if earlier stages were planned without a proof across them: other plans of these
        stages, even of the same cost, may leave cheaper paths.
        """
        if not self.complete or self.account.lower_bound is not None:
            return self.account.lower_bound
        if len(self.main) < len(self.parts):
            return None
        return self._sum_of_bounds()

    @property
    def bound_given(self) -> float | None:
        """No path through the main parts costs less, given the plans of the stages before."""
        if not self.complete or self.account.bound_given is not None:
            return self.account.bound_given
        return self._sum_of_bounds()

    @property
    def bound_method(self) -> str:
        """The method that proved the lower bound; empty without one."""
        if self.lower_bound is None:
            return ""
        if self.account.lower_bound is not None:
            return "the account of the whole job"
        methods = [part.result.bound_method for part in self.main]
        return "; ".join(dict.fromkeys(filter(None, methods)))

    def _sum_of_bounds(self) -> float | None:
        bounds = [part.result.lower_bound for part in self.main]
        known = [bound for bound in bounds if bound is not None]
        return float(sum(known)) if len(known) == len(bounds) else None

    @property
    def proved_by_level(self) -> bool:
        """True if every stage is proved to be optimal, given the plans of the stages before."""
        cost, bound = self.cost, self.bound_given
        if cost is None or bound is None or cost > bound + tolerance(cost):
            return False
        return all(self._proved(part) for part in self.parts if part.task.stage != self.stage)

    @property
    def gap(self) -> float | None:
        """(cost - lower bound) / cost; None if either is missing."""
        return relative_gap(self.cost, self.lower_bound)

    @property
    def makespan(self) -> int | None:
        """Number of skills of the main parts; None while the chain is not complete."""
        return sum(part.result.makespan or 0 for part in self.main) if self.complete else None

    @property
    def makespan_s(self) -> float | None:
        """Time of the whole [s]; None while the chain is not complete."""
        if not self.complete or self.account.makespan_s is not None:
            return self.account.makespan_s
        return sum(part.result.makespan_s or 0.0 for part in self.main)

    @property
    def wall_s(self) -> float:
        """Time that solving took [s], reused policies counted once."""
        return sum(part.result.wall_s for part in self.parts if not part.reused)

    @property
    def iterations(self) -> int | None:
        """Iterations of the main parts; None while the chain is not complete."""
        if not self.complete:
            return None
        return sum(part.result.expanded or 0 for part in self.main if not part.reused)

    @property
    def interrupted(self) -> bool:
        """True if the user stopped it."""
        return any(part.result.interrupted for part in self.parts)

    def document(self) -> dict[str, Any]:
        """Return the JSON document ``skillplan.result/1`` of a chain."""
        main = self.main
        steps = [step for part in main for step in part.result.document()["steps"]]
        bound = self.lower_bound
        extra: Mapping[str, Any] = self.account.document
        return {
            "schema": schemas.RESULT,
            "task": {"name": self.name, "kind": self.kind, "sha256": self.sha256},
            "origin": None if self.origin is None else self.origin.document(),
            "solver": self.solver,
            "seed": self.seed,
            "physics": self.parts[-1].result.physics,
            "collision": self.parts[-1].result.collision,
            "status": self.status.value,
            "reason": self.reason,
            "proved_by": list(self.proved_by),
            "simulation": None,
            "not_checked": list(self.not_checked),
            "cost": self.cost,
            "cost_unit": self.cost_unit,
            "lower_bound": bound,
            "bound_method": self.bound_method,
            "gap": self.gap,
            "bound_given_stages_before": self.bound_given,
            "proved_by_level": self.proved_by_level,
            "makespan": self.makespan,
            "makespan_s": self.makespan_s,
            "timed_by": self.parts[-1].result.timed_by,
            "dwells_from": list(self.parts[-1].result.dwells_from),
            "skills": [step["skill"] for step in steps],
            "actions": [step["action"] for step in steps],
            "steps": [{**step, "index": index} for index, step in enumerate(steps)],
            "stats": {
                "states": sum(part.result.states for part in self.parts),
                "expanded": self.iterations,
                "checks": sum(part.result.checks for part in self.parts),
                "cache_hits": sum(part.result.cache_hits for part in self.parts),
                "trajectories": sum(part.result.trajectories for part in self.parts),
                "wall_s": self.wall_s,
            },
            "trace": {},
            "policy": any(part.keeps_policy for part in self.parts),
            "replans": self.replans,
            "sequences": [part.document() for part in main],
            "stages": [part.document() for part in self.parts if part.task.stage != self.stage],
            **extra,
        }
