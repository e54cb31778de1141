"""The SwarmItFIX bench: a walking fixture along a tool's trajectory (Veeramani, Muthuswamy)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, ClassVar

from skillplan.domains.domain import Account, Domain, Overview, Recheck
from skillplan.errors import ChainBroken, Issue
from skillplan.task.task import Task
from skillplan_swarmitfix.account import account, recheck_reach
from skillplan_swarmitfix.base.goals import UnreachableSupport
from skillplan_swarmitfix.faults import issues
from skillplan_swarmitfix.job import Job
from skillplan_swarmitfix.multiagent.multi_agent import (
    MultiAgentProblem,
    NotMultiAgent,
    cost_of_agents_alone,
)
from skillplan_swarmitfix.schema import SwarmitfixConfig
from skillplan_swarmitfix.trajectory.schema import unit_doubt


def overview(config: SwarmitfixConfig) -> Overview:
    """Return extent and length of the trajectory of a faultless file; nothing without one."""
    if config.trajectory is None:
        return Overview()
    job = Job(config)
    workpiece = job.workpiece
    points = [point for segment in workpiece.segments for point in segment.points]
    (x_low, x_high), (y_low, y_high) = ((min(c), max(c)) for c in zip(*points, strict=True))
    chords, off_m = job.sampling
    document = {
        "closed": workpiece.closed,
        "segments": len(workpiece.segments),
        "length_m": workpiece.length_m,
        "extent_m": [[x_low, y_low], [x_high, y_high]],
        "chords": chords,
        "deviation_m": off_m,
        "notes": job.trajectory_notes,
        "crossings_m": [list(point) for point in job.meetings],
        "holes_m": [list(point) for point in config.trajectory.holes],
    }
    form = "closed" if workpiece.closed else "open"
    line = (
        f"trajectory {form}, {workpiece.length_m:.4f} m long, {len(workpiece.segments)} segments, "
        f"x {x_low:.3f} to {x_high:.3f} m, y {y_low:.3f} to {y_high:.3f} m"
    )
    sampled = (f"           {job.sampling_text}",) if job.sampling_text else ()
    notes = [f"           {note}" for note in job.trajectory_notes]
    return Overview({"trajectory": document}, (line, *sampled, *notes))


class SwarmitfixDomain(Domain):
    """Heads, goals and paths of walking bases that support sheet metal from below."""

    kind = "swarmitfix"
    Config = SwarmitfixConfig
    stages = ("heads", "goals", "base")
    former_defaults: ClassVar[Mapping[str, str]] = {"base.reachable": "preferred"}

    def issues(self, config: Any) -> Iterable[Issue]:
        """Return faults of positions, trajectory, reach and robots."""
        return issues(config)

    def warnings(self, config: Any) -> Iterable[Issue]:
        """Yield a doubt about the unit of a trajectory's file, and names of keys that changed."""
        doubt = None if config.trajectory is None else unit_doubt(config.trajectory)
        if doubt is not None:
            yield doubt.under("trajectory")
        if "prefer_reachable" in config.base.model_fields_set:
            message = (
                f"is read as reachable: {config.base.reach_rule}. Write that, or leave it out: "
                "then the machine must reach every support."
            )
            yield Issue(message, ("base", "prefer_reachable"), at_key=True)

    def hints(self, config: Any) -> Iterable[Issue]:
        """Yield why no plan exists, if a support is out of reach."""
        infeasible = Job(config).infeasible
        if infeasible:
            yield Issue(f"no plan exists: {infeasible}.", ("trajectory",), at_key=True)

    def overview(self, config: Any) -> Overview:
        """Return the extent and the length of the trajectory, if there is one."""
        return overview(config)

    def ground(self, config: Any, sha256: str) -> list[Task]:
        """Return the chain of tasks; what follows a level stands on that level's optimum."""
        return Job(config).tasks(sha256)

    def follow(
        self, config: Any, sha256: str, plans: Mapping[str, Sequence[str]], refinement: int = 0
    ) -> list[Task]:
        """Return the chain as it stands on the plans made so far.

        Refined, the heads stand closer together.
        """
        job = Job(config, plans, refinement)
        if refinement and not job.supportable:
            return []
        try:
            return job.tasks(sha256)
        except UnreachableSupport as error:
            raise ChainBroken(f"with the heads so placed: {error}") from None

    def account(
        self, config: Any, plans: Mapping[str, Sequence[str]], refinement: int = 0
    ) -> Account:
        """Return supports, goals and the five steps."""
        return account(Job(config, plans, refinement))

    def recheck(
        self, config: Any, plans: Mapping[str, Sequence[str]], refinement: int = 0
    ) -> Iterable[Recheck]:
        """Yield whether the machine reaches every support of a trajectory."""
        if config.trajectory is not None:
            yield recheck_reach(Job(config, plans, refinement))

    def second_bound(self, task: Task) -> tuple[float, str] | None:
        """Return the sum of the robots' least costs if none blocked another."""
        if not any(skill.agents for skill in task.skills):
            return None
        try:
            bound = cost_of_agents_alone(MultiAgentProblem.from_task(task))
        except NotMultiAgent:
            return None
        return bound, "least cost of every agent alone"

    def default_solver(self, config: Any) -> str:
        """Return ``fleet`` for several bases, else ``exact``."""
        return "exact" if config.robots is None else "fleet"

    def locate(self, fact: str) -> tuple[str | int, ...]:
        """Return the section that a goal comes from."""
        return ("base",)
