"""What a run has learned, kept as files and followed on the model."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from skillplan.env.observation import Observation
from skillplan.model.skill_model import SkillModel
from skillplan.records.stored.policy_file import fingerprint
from skillplan.records.training.network_policy_file import write_network
from skillplan.records.training.outcome import GreedyRollOut
from skillplan.records.training.run_folder import run_path
from skillplan.solvers.learning.learner import Learned
from skillplan.solvers.learning.network_policy import NetworkPolicy
from skillplan.training.policy_roll_out import greedy_roll_out
from skillplan.training.run_log import writing
from skillplan.training.training_plan import TrainingPlan


@dataclass(frozen=True)
class _Kept:
    """A policy, which of a run's it is, and when and at what cost it was kept."""

    network: NetworkPolicy
    kept: Literal["best", "last"]
    step: int
    cost: float | None = None


def store_policies(
    plan: TrainingPlan, folder: Path, run: int, learned: Learned, steps: int, model: SkillModel
) -> tuple[GreedyRollOut | None, GreedyRollOut]:
    """Write the reported policy of a run and the last one; return what they do.

    Parameters
    ----------
    plan, folder
        What is trained, and where.
    run
        The run's number.
    learned
        Its policies.
    steps
        Environment steps that it has done.
    model
        Of the plan's task.

    Returns
    -------
    best, last
        Followed greedily; the best is None where no policy ever completed the task.

    Raises
    ------
    OptionError
        If a file cannot be written.
    BackEndError
        If a back end fails.
    """
    last = _Kept(learned.last, "last", steps)
    best = None
    if learned.best is not None:
        best = _Kept(learned.best, "best", learned.best_step or 0, learned.best_cost)
    _write(plan, folder, run, "policy", best or last)
    _write(plan, folder, run, "last", last)
    return None if best is None else _followed(plan, model, best), _followed(plan, model, last)


def _write(plan: TrainingPlan, folder: Path, run: int, stem: str, one: _Kept) -> None:
    task = plan.task
    with writing(folder, f"runs/{run:02d}/{stem}.json"):
        write_network(
            run_path(folder, run),
            stem,
            one.network,
            within=folder,
            features=list(_observation(plan).features),
            actions=[skill.name for skill in task.skills],
            observation=plan.options["observation"],
            mask=plan.options["mask"],
            objective=plan.options["objective"],
            solver=plan.solver,
            options=dict(plan.options),
            task={
                "name": task.name,
                "kind": task.kind,
                "sha256": task.sha256,
                "fingerprint": fingerprint(task),
            },
            seed=plan.seeds[run],
            step=one.step,
            cost=one.cost,
            kept=one.kept,
        )


def _followed(plan: TrainingPlan, model: SkillModel, one: _Kept) -> GreedyRollOut:
    mask = str(plan.options["mask"])
    return greedy_roll_out(model, _observation(plan), one.network, mask, one.kept, one.step)


def _observation(plan: TrainingPlan) -> Observation:
    return Observation.of(plan.task, str(plan.options["observation"]))
