"""Stored policies of training runs, evaluated on their task and on unseen layouts of its family."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import replace

from skillplan.checks.verdict_cache import VerdictCache
from skillplan.domains.load import Problem
from skillplan.env.observation import Observation
from skillplan.env.skill_vector_env import SkillVectorEnv
from skillplan.errors import OptionError
from skillplan.model.skill_model import SkillModel
from skillplan.pipeline.setup import Setup
from skillplan.pipeline.solving import make_model
from skillplan.records.evaluation import Optimum
from skillplan.records.task_difference import describe_changes, resolve_config
from skillplan.records.training.network_policy_file import StoredNetwork
from skillplan.records.training.result import (
    GreedyRollOut,
    LayoutOutcome,
    RunOutcome,
    RunStatus,
    Sampling,
    Tally,
    TrainingResult,
    summarise_training,
)
from skillplan.records.training.run_folder import RunFolder, StoredRun, get_run_path
from skillplan.records.training.shortfall import Shortfall, analyse_shortfall
from skillplan.solvers.learning.network_policy import GREEDY, ActionRule
from skillplan.solvers.stop import Stop
from skillplan.task.task import Task
from skillplan.training.policies import (
    measure_random_baseline,
    prove_optimum,
    roll_out_greedily,
    sample_roll_outs,
)

# Largest number of episodes that run in parallel.
_MOST_PLACES = 1_024
_NO_POLICY = "it has no policy yet: its training was cut off; train --resume goes on"


def check_same_task(folder: RunFolder, problem: Problem, *, quoted: bool = True) -> None:
    """Check that the runs have learned this task file.

    Parameters
    ----------
    quoted
        True if the message may quote the file.

    Raises
    ------
    OptionError
        If its content has changed; the message names the changes.
    """
    if problem.sha256 == folder.manifest.task.sha256:
        return
    if not quoted:
        raise OptionError(
            f"{problem.source}: is not the task that {folder.path} has learned, which names it. "
            f"--task {folder.task_copy} takes the learned one; --task {problem.source} shows the "
            "changes."
        )
    changed = describe_changes(folder.config, resolve_config(problem))
    raise OptionError(
        f"{problem.source}: is not the task that {folder.path} has learned: {changed}. "
        f"--task {folder.task_copy} takes the learned one; --changed-task evaluates on this one."
    )


class RunsEvaluation:
    """The policies of a folder of runs, to be evaluated on a task.

    Parameters
    ----------
    sampling
        Number of the sampled roll-outs per run, and temperature, if it is not the policies' own
        rule. The random baseline gets as many as all runs together.
    changed_task
        True if the policies may have been learned on another task.

    Raises
    ------
    OptionError
        If no policy can act on the task.
    """

    def __init__(
        self, folder: RunFolder, task: Task, sampling: Sampling, *, changed_task: bool = False
    ) -> None:
        self.folder = folder
        self.task = task
        self._stored = folder.runs()
        rules = [run.policy.own_rule for run in self._stored if run.policy is not None]
        self.sampling = replace(sampling, own_rule=rules[0] if rules else GREEDY)
        self.changed_task = changed_task
        self._observation = Observation.of(task, folder.manifest.observation)
        policies = [run.policy for run in self._stored if run.policy is not None]
        misfits = [policy.misfit(task, self._observation) for policy in policies]
        if misfits and all(misfits):
            raise OptionError(f"No policy of {folder.path} can act on {task.name}: {misfits[0]}.")

    def evaluate(self, model: SkillModel, setup: Setup, optimum: Optimum) -> TrainingResult:
        """Evaluate all policies and a random baseline.

        Raises
        ------
        BackEndError
            If a back end fails.
        """
        begin_s = time.perf_counter()
        manifest, stored = self.folder.manifest, self._stored
        env = SkillVectorEnv(
            model,
            min(self.sampling.episodes, _MOST_PLACES),
            observation=manifest.observation,
            mask=manifest.mask,
            objective=manifest.objective,
        )
        outcomes = tuple(self._evaluate_run(model, env, run) for run in stored)
        episodes = self.sampling.episodes * len(stored)
        baseline = measure_random_baseline(env, episodes, self.sampling.seed, manifest.mask)
        return TrainingResult(
            task=self.task,
            run_dir=str(self.folder.path),
            solver=manifest.solver,
            steps=manifest.steps,
            outcomes=outcomes,
            optimum=optimum,
            options=manifest.options,
            derived_options=manifest.derived_options,
            physics=setup.physics_choice(self.task).name,
            collision=setup.detector_names(self.task),
            baseline=baseline,
            sampling=self.sampling,
            checks=model.stats.checks,
            executions=model.feasibility.executions,
            wall_s=time.perf_counter() - begin_s,
            shortfall=self._shortfall(outcomes),
            warm_start=manifest.warm_start,
            interrupted=any(not run.failure and run.steps < manifest.steps for run in stored),
            family=manifest.family is not None,
            notes=self._notes(),
        )

    def _shortfall(self, outcomes: Sequence[RunOutcome]) -> Shortfall | None:
        """Explain why runs do not complete the task; None on another task than they learned."""
        manifest = self.folder.manifest
        if self.task.sha256 != manifest.task.sha256 or manifest.family is not None:
            return None
        episodes = {
            run.run: run.episodes
            for run, outcome in zip(self._stored, outcomes, strict=True)
            if outcome.status is RunStatus.INCOMPLETE and run.episodes
        }
        return analyse_shortfall(
            self.task, manifest.solver, manifest.options, manifest.steps, episodes
        )

    def _notes(self) -> tuple[str, ...]:
        manifest = self.folder.manifest
        notes = []
        if self.task.sha256 != manifest.task.sha256:
            notes.append(f"task       another one than was learned, {manifest.task.name}")
        if manifest.family is not None:
            notes.append(
                f"family     learned on {manifest.family.count} layouts of the family, tried on "
                "the file's own"
            )
        return tuple(notes)

    def policies(self) -> list[StoredNetwork]:
        """Return the usable policies of the runs."""
        return [
            run.policy for run in self._stored if run.policy is not None and not self._fault(run)
        ]

    def greedy(self, model: SkillModel, policy: StoredNetwork) -> GreedyRollOut:
        """Follow a policy greedily on the task or another layout of its family."""
        content, seen = policy.content, Observation.of(model.task, policy.content.observation)
        return roll_out_greedily(
            model, seen, policy.network, content.mask, content.kept, content.step
        )

    def _fault(self, stored: StoredRun) -> str | None:
        """Explain why the policy of a run cannot be evaluated; None if it can."""
        if stored.policy is None:
            where = get_run_path(self.folder.path, stored.run)
            done = stored.steps >= self.folder.manifest.steps
            lost = f"its policy.json is missing from {where}. Train again, or use a copy"
            return stored.failure or (lost if done else _NO_POLICY)
        manifest = self.folder.manifest
        for policy in (stored.policy, stored.last or stored.policy):
            content, there = policy.content, policy.content.task
            if not self.changed_task and there.sha256 != manifest.task.sha256:
                return f"its policy was learned on another task, {there.name}"
            for key in ("observation", "mask", "objective"):
                if getattr(content, key) != getattr(manifest, key):
                    return f"its policy was learned with another {key} than manifest.json has"
            misfit = policy.misfit(self.task, self._observation)
            if misfit is not None:
                return misfit
        return None

    def _evaluate_run(
        self, model: SkillModel, env: SkillVectorEnv, stored: StoredRun
    ) -> RunOutcome:
        known = bool(stored.episodes or stored.steps)
        record = (
            summarise_training(stored.episodes, stored.steps, stored.wall_s, stored.latest_figures)
            if known
            else None
        )
        fault, policy = self._fault(stored), stored.policy
        if policy is None or fault is not None:
            nothing = Tally()
            return RunOutcome(stored.run, stored.seed, fault or "", None, None, nothing, record)
        best, last = stored.best, stored.last or policy
        return RunOutcome(
            stored.run,
            stored.seed,
            stored.failure,
            None if best is None else self.greedy(model, best),
            self.greedy(model, last),
            self._sample(env, policy, stored.run, self.sampling.rule),
            record,
            None if self.task.deterministic else self._sample(env, policy, stored.run, GREEDY),
        )

    def _sample(
        self, env: SkillVectorEnv, policy: StoredNetwork, run: int, rule: ActionRule
    ) -> Tally:
        # The random numbers of a run do not depend on the other runs.
        drawn = self.sampling
        seed = drawn.seed + (run + 1) * 2**64
        return sample_roll_outs(env, policy.network, drawn.episodes, seed, rule)


def draw_unseen_layouts(
    evaluation: RunsEvaluation, problem: Problem, count: int
) -> tuple[Task, ...]:
    """Return layouts of a file's family that no run has learned on.

    They continue the random sequence of the training.

    Raises
    ------
    OptionError
        If the file has no family.
    """
    family = evaluation.folder.manifest.family
    seed, seen = (0, 0) if family is None else (family.seed, family.count)
    return problem.variants(seed, seen + count)[seen:]


def evaluate_layouts(
    evaluation: RunsEvaluation,
    layouts: tuple[Task, ...],
    setup: Setup,
    make_stop: Callable[[], Stop],
    *,
    jobs: int = 1,
) -> Iterator[LayoutOutcome]:
    """Yield the greedy results of all policies on every layout, and the proved optimum.

    Policies and proof both start with an empty verdict cache.

    Parameters
    ----------
    make_stop
        Makes the limits for the proof of one layout.

    Raises
    ------
    BackEndError
        If a back end fails.
    """
    for task in layouts:
        optimum = prove_optimum(task, setup, VerdictCache(), make_stop(), jobs=jobs)
        answers, times_s = [], []
        for policy in evaluation.policies():
            # Like exact search, every policy starts with a model without verdicts.
            begin_s = time.perf_counter()
            model = make_model(task, setup, VerdictCache(), jobs=jobs)
            with closing(model.feasibility):
                answers.append(evaluation.greedy(model, policy))
            times_s.append(time.perf_counter() - begin_s)
        yield LayoutOutcome(task.name, optimum, tuple(answers), tuple(times_s))
