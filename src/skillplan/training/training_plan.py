"""Plan of a training: one task or the layouts of a family, one learner, several seeds."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

from skillplan.domains.load import Problem
from skillplan.env.observation import Observation
from skillplan.errors import OptionError, PluginError, name_hint
from skillplan.pipeline import registry
from skillplan.pipeline.setup import Setup
from skillplan.pipeline.solving import make_model, make_solver
from skillplan.records.stored.result_folder import is_relational
from skillplan.records.training.network_policy_file import StoredNetwork
from skillplan.records.training.run_folder import Family, RunFolder, WarmStartRecord
from skillplan.solvers.learning.learner import Learner
from skillplan.solvers.learning.network_policy import NamedNetwork, NetworkPolicy
from skillplan.task.task import Task


@dataclass(frozen=True)
class WarmStart:
    """Networks that the runs of a training start from. It can be sent to another process.

    Parameters
    ----------
    record
        Origin of the networks, and the share of the task that they know.
    networks
        One per run, with the inputs and outputs of the task.
    """

    record: WarmStartRecord
    networks: tuple[NetworkPolicy, ...]


def load_warm_start(
    path: str, solver: str, learner: Learner, options: Mapping[str, Any], task: Task, runs: int
) -> WarmStart:
    """Load the networks of an earlier training and adapt them to a task.

    The new runs take the networks of the earlier runs in turn: of runs that completed their task,
    or of all runs with a policy if none did.

    Parameters
    ----------
    path
        Folder of the earlier training.
    runs
        Number of new runs, >= 1.

    Raises
    ------
    OptionError
        If no network there fits the solver and the task.
    """
    if is_relational(path):
        raise OptionError(
            f"--from {path}: is a policy for any board; 'skillplan evaluate {path} --task FILE' "
            "tries it without training."
        )
    try:
        folder = RunFolder(path)
    except OptionError as error:
        raise OptionError(f"--from {error}") from None
    earlier = folder.manifest
    if learner.hidden_layers is None:
        raise OptionError(f"--from: the solver {solver!r} cannot start from other networks.")
    if earlier.solver != solver:
        raise OptionError(
            f"--from {path}: has networks of {earlier.solver}, not of {solver}. Add "
            f"--solver {earlier.solver}, or name another folder."
        )
    policies = [(run, kept) for run, kept in _read_policies(folder) if kept.kept == "best"]
    policies = policies or _read_policies(folder)
    if not policies:
        raise OptionError(f"--from {path}: none of its runs has a policy yet.")
    _check_layers(path, solver, learner, policies)
    features = Observation.of(task, str(options["observation"])).features
    actions = [skill.name for skill in task.skills]
    chosen = [policies[at % len(policies)] for at in range(runs)]
    content = chosen[0][1].content
    known_features = sum(name in set(content.features) for name in features)
    known_skills = sum(name in set(content.actions) for name in actions)
    if not known_features or not known_skills:
        what = "no skill" if not known_skills else "no feature"
        raise OptionError(
            f"--from {path}: {what} of {earlier.task.name} has a name of {task.name}, so there is "
            "nothing to start from."
        )
    networks = tuple(
        NamedNetwork(
            policy.network, tuple(policy.content.features), tuple(policy.content.actions)
        ).carried_over(features, actions)
        for _, policy in chosen
    )
    record = WarmStartRecord(
        run_dir=path,
        task=earlier.task.name,
        runs=tuple(run for run, _ in chosen),
        skills=len(actions),
        skills_known=known_skills,
        features=len(features),
        features_known=known_features,
        sha256=_hash_networks(networks),
    )
    return WarmStart(record, networks)


def _read_policies(folder: RunFolder) -> list[tuple[int, StoredNetwork]]:
    return [(run.run, run.policy) for run in folder.runs() if run.policy is not None]


def _check_layers(
    path: str, solver: str, learner: Learner, policies: Sequence[tuple[int, StoredNetwork]]
) -> None:
    """Check that networks have the hidden layers of the learner."""
    layers = learner.hidden_layers
    for _, policy in policies:
        there = tuple(outputs for _, outputs in policy.content.layers[:-1])
        if there != layers:
            raise OptionError(
                f"--from {path}: its networks have hidden layers of {_join(there)} units, those "
                f"of {solver} here {_join(layers or ())}. Give {solver} the options it had there: "
                f"{Path(path) / 'manifest.json'} lists them."
            )


def _join(layers: Sequence[int]) -> str:
    return ", ".join(map(str, layers)) or "no"


def _hash_networks(networks: Sequence[NetworkPolicy]) -> str:
    digest = hashlib.sha256()
    for network in networks:
        for array in (*network.weights, *network.biases):
            digest.update(repr(array.shape).encode())
            digest.update(array.tobytes())
    return digest.hexdigest()


GROUP_RUNS = 5
"""Largest number of runs that learn together."""
LEAST_GROUPS = 2
"""Smallest number of groups, unless there are fewer runs."""


Groups = tuple[tuple[int, ...], ...]


def make_even_groups(runs: int) -> Groups:
    """Split runs into groups of almost equal size that learn together.

    Large groups need the least work, because their runs share the cost of every small operation.
    With at least two groups, a second process helps. The number of processes has no influence, so
    it does not change the results.
    """
    count = max(-(-runs // GROUP_RUNS), min(runs, LEAST_GROUPS))
    ends = [-(-runs * group // count) for group in range(count + 1)]
    return tuple(tuple(range(first, end)) for first, end in pairwise(ends))


@dataclass(frozen=True)
class TrainingPlan:
    """A training to do. It can be sent to another process.

    Parameters
    ----------
    task
        The task that judges the policies.
    layouts
        The tasks to learn on: the same task, or layouts of its family; at least one.
    seeds
        One per run, at least one.
    family
        Origin of the layouts; None if the task itself is learned.
    warm
        True to use verdicts stored on disk.
    start
        Networks to start from. Default: random ones.
    steps_said
        True if the user gave the number of steps; otherwise it is derived from the task.
    derived
        Values that the task determines, by name.
    groups
        Numbers of the runs that learn together. Default: `make_even_groups`.

    Raises
    ------
    ValueError
        If layouts or seeds are missing, or the checkpoint interval is less than a step.
    """

    task: Task
    layouts: tuple[Task, ...]
    solver: str
    options: Mapping[str, Any]
    setup: Setup
    seeds: tuple[int, ...]
    family: Family | None = None
    checkpoint_steps: int = 1_000
    warm: bool = False
    start: WarmStart | None = None
    steps_said: bool = True
    derived: Mapping[str, Any] = field(default_factory=dict)
    groups: Groups = ()

    def __post_init__(self) -> None:
        if not self.layouts or not self.seeds or self.checkpoint_steps < 1:
            raise ValueError("A training has a layout, a seed, and steps between checkpoints.")
        if not self.groups:
            object.__setattr__(self, "groups", make_even_groups(len(self.seeds)))

    @property
    def steps(self) -> int:
        """Environment steps of every run."""
        return int(self.options["steps"])

    def learner(self) -> Learner:
        """Make the learner with its options."""
        solver = make_solver(self.solver, self.options)
        assert isinstance(solver, Learner)
        return solver


def plan_training(
    problem: Problem,
    solver: str,
    setup: Setup = Setup(),
    *,
    part: str | None = None,
    runs: int = 10,
    steps: int | None = None,
    seed: int = 0,
    family: int = 0,
    checkpoint_steps: int = 1_000,
    warm: bool = False,
    start: str | None = None,
    preset: str | None = None,
) -> TrainingPlan:
    """Plan a training, and check that it can begin.

    Parameters
    ----------
    part
        The task of a chain.
    runs
        Number of runs, >= 1, with seeds from `seed` on.
    steps
        Environment steps per run; overrides the learner's option ``steps``.
    family
        Number of layouts of the file's family to learn on; 0 for the file's own.
    warm
        True to use verdicts stored on disk.
    start
        Folder of an earlier training to start from.
    preset
        Preset of the learner; options of the setup override it.

    Raises
    ------
    OptionError
        If an option or the preset is wrong, the solver does not learn or refuses the task, the
        file has no family, or the networks do not fit.
    PluginError
        If a plugin is unknown or broken.
    """
    plugin = _load_learner(solver)
    values = {**_get_preset(plugin, preset), **setup.options.get(solver, {})}
    options = registry.make_options("solver", solver, plugin, values)
    if steps is not None:
        options = registry.make_options("solver", solver, plugin, {**values, "steps": steps})
    if family and part is not None:
        raise OptionError("--family and --part do not go together: a chain has no family.")
    task = problem.part(part)
    layouts = problem.variants(seed, family) if family else (task,)
    learner = make_solver(solver, options.model_dump())
    assert isinstance(learner, Learner)
    derived = learner.derived(layouts)
    options = options.model_copy(update=derived)
    others = {name: dict(kv) for name, kv in setup.options.items() if name != solver}
    plan = TrainingPlan(
        task=task,
        layouts=layouts,
        solver=solver,
        options=options.model_dump(mode="json"),
        setup=replace(setup, options=others),
        seeds=tuple(range(seed, seed + runs)),
        family=Family(count=family, seed=seed) if family else None,
        checkpoint_steps=checkpoint_steps,
        warm=warm,
        steps_said=steps is not None or values.get("steps") is not None,
        derived={**derived, **learner.scales(layouts[0])},
    )
    back_ends = plan.setup.back_ends(layouts[0], problem.spare_back_ends)
    refusal = plan.learner().find_refusal(make_model(layouts[0], plan.setup, back_ends=back_ends))
    if refusal is not None:
        raise OptionError(f"The solver {solver!r} cannot serve {task.name!r}: {refusal}")
    if start is None:
        return plan
    networks = load_warm_start(start, solver, plan.learner(), plan.options, task, runs)
    return replace(plan, start=networks)


def _load_learner(name: str) -> type[Learner]:
    """Return the class of a learner."""
    known = registry.names("solver")
    if name not in known:
        raise PluginError(
            f"Unknown solver {name!r}. {name_hint(name, known)} {_name_learners(known)}"
        )
    plugin = registry.load("solver", name)
    if not issubclass(plugin, Learner):
        raise OptionError(
            f"The solver {name!r} trains no policies step by step. {_name_learners(known)}"
        )
    return plugin


def _get_preset(learner: type[Learner], preset: str | None) -> Mapping[str, Any]:
    """Return the options of a preset; none without one."""
    if preset is None:
        return {}
    if preset not in learner.presets:
        hint = name_hint(preset, learner.presets) if learner.presets else "It has no presets."
        raise OptionError(f"The solver {learner.name!r} has no preset {preset!r}. {hint}")
    return learner.presets[preset]


def _name_learners(names: list[str]) -> str:
    """Return a sentence that lists the installed learners."""
    learners = []
    for name in names:
        try:
            plugin = registry.load("solver", name)
        except PluginError:
            continue  # a broken plugin cannot be chosen
        if issubclass(plugin, Learner):
            learners.append(name)
    if not learners:
        return "No learner is installed: pip install skillplan-torch."
    return f"Learners installed: {', '.join(learners)}."
