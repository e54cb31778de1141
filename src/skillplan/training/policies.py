"""Policies on a model: greedy and sampled roll-outs, random actions, and the proved optimum."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from skillplan.checks.verdict_cache import VerdictCache
from skillplan.env.observation import Observation
from skillplan.env.skill_vector_env import SkillVectorEnv
from skillplan.env.transition_table import COMPLETE
from skillplan.errors import ModelTooLarge
from skillplan.model.policy_value import evaluate_policy, roll_out
from skillplan.model.replay import replay
from skillplan.model.skill_model import SkillModel
from skillplan.pipeline.setup import Setup
from skillplan.pipeline.solving import DEFAULT_SOLVER, solve
from skillplan.records.evaluation import Optimum
from skillplan.records.result import Status
from skillplan.records.stored.policy_file import fingerprint
from skillplan.records.training.network_policy_file import StoredRule, write_network
from skillplan.records.training.result import GreedyRollOut, RandomBaseline, Tally
from skillplan.records.training.run_folder import get_run_path
from skillplan.solvers.learning.learner import Learned, NetworkChoice
from skillplan.solvers.learning.network_policy import ActionRule, NetworkPolicy, random_actions
from skillplan.solvers.stop import Stop
from skillplan.task.task import Task
from skillplan.training.run_files import writing
from skillplan.training.training_plan import TrainingPlan

Choose = Callable[[Any, NDArray[np.bool_], NDArray[np.float64]], NDArray[np.int64]]


def roll_out_greedily(
    model: SkillModel,
    observation: Observation,
    policy: NetworkPolicy,
    mask: str,
    kept: Literal["best", "last"] = "best",
    step: int | None = None,
) -> GreedyRollOut:
    """Follow a policy greedily and let the model judge it.

    Parameters
    ----------
    observation
        Observation of the policy.
    mask
        Restriction of its choice, as it learned: ``none``, ``applicable`` or ``feasible``.
    kept, step
        Kind of the policy, and the step at which it was kept.

    Raises
    ------
    BackEndError
        If a back end fails.
    """
    task = model.task

    choose = NetworkChoice(policy, model, observation.kind, mask)
    skills = roll_out(model, choose)
    replayed = replay(model, skills)
    done = [step.skill for step in replayed.steps]
    if len(done) < len(skills) and replayed.violations:
        done.append(skills[len(done)].name)
    cost: float | None
    if task.deterministic:
        cost = replayed.cost if replayed.complete else None
        reason = (
            ""
            if replayed.complete
            else _explain_failure(replayed.violations[0].reason, done, replayed.feasible)
        )
    else:
        try:
            value = evaluate_policy(model, choose)
            cost, reason = value.cost, value.problem or ""
        except ModelTooLarge as error:
            cost, reason = None, f"its expected cost is not known: {error}"
    actions = tuple(task.action(name) for name in done)
    return GreedyRollOut(kept, actions, tuple(done), cost, step, reason)


def _explain_failure(reason: str, done: list[str], feasible: bool) -> str:
    if feasible:
        return f"after {len(done)} skills {reason}"
    return f"{done[-1]} at step {len(done)}: {reason}"


def sample_roll_outs(
    env: SkillVectorEnv, policy: NetworkPolicy, episodes: int, seed: int, rule: ActionRule
) -> Tally:
    """Count how often a policy completes the task if it draws its actions by a rule.

    Parameters
    ----------
    env
        The environment of the training; it is reset. As many places as episodes are fastest.

    Raises
    ------
    ValueError
        If `episodes` is below 1.
    BackEndError
        If a back end fails.
    """
    return _run_episodes(env, partial(rule.draw, policy), episodes, seed)[0]


def measure_random_baseline(
    env: SkillVectorEnv, episodes: int, seed: int, mask: str = "applicable"
) -> RandomBaseline:
    """Measure uniformly random actions.

    Parameters
    ----------
    env
        Its mask restricts the actions; it is reset.
    mask
        Name of the environment's mask.

    Raises
    ------
    ValueError
        If `episodes` is below 1.
    BackEndError
        If a back end fails.
    """
    tally, best_cost = _run_episodes(
        env, lambda _, masks, uniforms: random_actions(masks, uniforms), episodes, seed
    )
    return RandomBaseline(tally, best_cost, mask)


def _run_episodes(
    env: SkillVectorEnv, choose: Choose, episodes: int, seed: int
) -> tuple[Tally, float | None]:
    """Count the episodes that succeed, and find the lowest cost.

    Only the first episode of every place counts. The first episodes to end would over-represent
    early failures.
    """
    if episodes < 1:
        raise ValueError(f"There must be at least one episode, not {episodes}.")
    chance = np.random.Generator(np.random.PCG64(seed))
    successes, best, done = 0, np.inf, 0
    while done < episodes:
        count = min(env.num_envs, episodes - done)
        observed, infos = env.reset(seed=int(chance.integers(2**62)))
        costs, going = np.zeros(env.num_envs), np.arange(env.num_envs) < count
        while going.any():
            uniforms = chance.random(env.num_envs)
            observed, _, _, _, infos = env.step(choose(observed, infos["action_mask"], uniforms))
            costs[going] += infos["cost"][going]
            complete = going & (infos["end"] == COMPLETE)
            successes += int(complete.sum())
            best = min(best, float(costs[complete].min(initial=np.inf)))
            going &= infos["end"] == 0
        done += count
    return Tally(successes, episodes), float(best) if np.isfinite(best) else None


def prove_optimum(
    task: Task,
    setup: Setup,
    cache: VerdictCache | None = None,
    stop: Stop | None = None,
    *,
    jobs: int = 1,
) -> Optimum:
    """Prove the lowest cost of a task, under chance the lowest expected cost.

    Parameters
    ----------
    task, setup, cache, jobs
        As for `skillplan.pipeline.solving.solve`.
    stop
        Limits of the proof.

    Raises
    ------
    BackEndError
        If a back end fails.
    """
    solver = DEFAULT_SOLVER if task.deterministic else "value-iteration"
    result = solve(task, solver, setup, stop=stop, cache=cache, jobs=jobs)
    if result.status is not Status.OPTIMAL:
        reason = f"{solver}: {result.status.value}"
        reason += f", {result.reason}" if result.reason else ""
        return Optimum(solver=solver, reason=reason, wall_s=result.wall_s)
    actions = tuple(step.action for step in result.steps) if task.deterministic else ()
    return Optimum(
        result.cost, actions, solver, wall_s=result.wall_s, not_checked=result.not_checked
    )


@dataclass(frozen=True)
class _Kept:
    """A policy of a run, with the step and cost at which it was kept."""

    network: NetworkPolicy
    kept: Literal["best", "last"]
    step: int
    cost: float | None = None


def store_policies(
    plan: TrainingPlan, folder: Path, run: int, learned: Learned, steps: int, model: SkillModel
) -> tuple[GreedyRollOut | None, GreedyRollOut]:
    """Write the best and the last policy of a run, and follow both greedily.

    Returns
    -------
    best, last
        Greedy roll-outs; the best is None if no policy completed the task.

    Raises
    ------
    OptionError, BackEndError
        If a file cannot be written, or a back end fails.
    """
    last = _Kept(learned.last, "last", steps)
    best = None
    if learned.best is not None:
        best = _Kept(learned.best, "best", learned.best_step or 0, learned.best_cost)
    _write(plan, folder, run, "policy", best or last)
    _write(plan, folder, run, "last", last)
    return None if best is None else _follow(plan, model, best), _follow(plan, model, last)


def _write(plan: TrainingPlan, folder: Path, run: int, stem: str, policy: _Kept) -> None:
    task, rule = plan.task, plan.learner().own_rule
    with writing(folder, f"runs/{run:02d}/{stem}.json"):
        write_network(
            get_run_path(folder, run),
            stem,
            policy.network,
            within=folder,
            features=list(_get_observation(plan).features),
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
            step=policy.step,
            cost=policy.cost,
            kept=policy.kept,
            own_rule=StoredRule(kind=rule.kind, value=rule.value),
        )


def _follow(plan: TrainingPlan, model: SkillModel, policy: _Kept) -> GreedyRollOut:
    mask = str(plan.options["mask"])
    return roll_out_greedily(
        model, _get_observation(plan), policy.network, mask, policy.kept, policy.step
    )


def _get_observation(plan: TrainingPlan) -> Observation:
    return Observation.of(plan.task, str(plan.options["observation"]))
