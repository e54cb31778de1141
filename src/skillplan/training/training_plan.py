"""What is trained: one task or the layouts of a family, by one learner, from several seeds."""

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
from skillplan.solvers.learning.carried_over import NamedNetwork
from skillplan.solvers.learning.learner import Learner
from skillplan.solvers.learning.network_policy import NetworkPolicy
from skillplan.task.task import Task


@dataclass(frozen=True)
class WarmStart:
    """What a training begins with; can be sent to another process.

    Parameters
    ----------
    record
        Where it is from, and how much of it the task knows.
    networks
        One for every run, with inputs and outputs of the task.
    """

    record: WarmStartRecord
    networks: tuple[NetworkPolicy, ...]


def warm_start(
    path: str, solver: str, learner: Learner, options: Mapping[str, Any], task: Task, runs: int
) -> WarmStart:
    """Return the networks of earlier runs, made to fit a task.

    The runs take those of the earlier runs in turn: of the runs that have completed their task,
    or else of all that have learned something.

    Parameters
    ----------
    path
        The folder of the earlier training, as the user named it.
    solver, learner, options
        Who learns, and its options.
    task
        What is learned now.
    runs
        How many runs there will be, >= 1.

    Raises
    ------
    OptionError
        If nothing there fits the solver and the task.
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
        raise OptionError(f"--from: the solver {solver!r} begins with no networks of others.")
    if earlier.solver != solver:
        raise OptionError(
            f"--from {path}: has networks of {earlier.solver}, not of {solver}. Add "
            f"--solver {earlier.solver}, or name another folder."
        )
    found = [(run, kept) for run, kept in _policies(folder) if kept.kept == "best"]
    found = found or _policies(folder)
    if not found:
        raise OptionError(f"--from {path}: none of its runs has a policy yet.")
    _check_layers(path, solver, learner, found)
    features = Observation.of(task, str(options["observation"])).features
    actions = [skill.name for skill in task.skills]
    chosen = [found[at % len(found)] for at in range(runs)]
    content = chosen[0][1].content
    known_features = sum(name in set(content.features) for name in features)
    known_skills = sum(name in set(content.actions) for name in actions)
    if not known_features or not known_skills:
        what = "no skill" if not known_skills else "nothing that is observed"
        raise OptionError(
            f"--from {path}: {what} of {earlier.task.name} has a name of {task.name}, so there is "
            "nothing to begin with."
        )
    networks = tuple(
        NamedNetwork(
            one.network, tuple(one.content.features), tuple(one.content.actions)
        ).carried_over(features, actions)
        for _, one in chosen
    )
    record = WarmStartRecord(
        run_dir=path,
        task=earlier.task.name,
        runs=tuple(run for run, _ in chosen),
        skills=len(actions),
        skills_known=known_skills,
        features=len(features),
        features_known=known_features,
        sha256=_digest(networks),
    )
    return WarmStart(record, networks)


def _policies(folder: RunFolder) -> list[tuple[int, StoredNetwork]]:
    return [(one.run, one.policy) for one in folder.runs() if one.policy is not None]


def _check_layers(
    path: str, solver: str, learner: Learner, found: Sequence[tuple[int, StoredNetwork]]
) -> None:
    """See that hidden layers are those of the learner.

    Raises
    ------
    OptionError
        If they are not.
    """
    wanted = learner.hidden_layers
    for _, one in found:
        there = tuple(outputs for _, outputs in one.content.layers[:-1])
        if there != wanted:
            raise OptionError(
                f"--from {path}: its networks have hidden layers of {_units(there)} units, those "
                f"of {solver} here {_units(wanted or ())}. Give {solver} the options it had there: "
                f"{Path(path) / 'manifest.json'} lists them."
            )


def _units(layers: Sequence[int]) -> str:
    return ", ".join(map(str, layers)) or "no"


def _digest(networks: Sequence[NetworkPolicy]) -> str:
    digest = hashlib.sha256()
    for network in networks:
        for array in (*network.weights, *network.biases):
            digest.update(repr(array.shape).encode())
            digest.update(array.tobytes())
    return digest.hexdigest()


GROUP_RUNS = 5
"""So many runs learn side by side at most, however many processes there are."""
LEAST_GROUPS = 2
"""So many groups there are at least, of as many runs or more."""


Groups = tuple[tuple[int, ...], ...]


def even_groups(runs: int) -> Groups:
    """Return the numbers of the runs that learn side by side, in groups as even as can be.

    Runs side by side share the cost of every small operation, so that few large groups are the
    least work; two of them at least, so that a second process has something to do. Nothing else
    goes into it, the number of processes least of all: what is checked and kept is the same.

    Parameters
    ----------
    runs
        How many there are, >= 1.
    """
    count = max(-(-runs // GROUP_RUNS), min(runs, LEAST_GROUPS))
    ends = [-(-runs * group // count) for group in range(count + 1)]
    return tuple(tuple(range(first, end)) for first, end in pairwise(ends))


@dataclass(frozen=True)
class TrainingPlan:
    """What is trained; can be sent to another process.

    Parameters
    ----------
    task
        What the policies are judged on.
    layouts
        What is learned on, the same task or the layouts of its family; at least one.
    solver, options
        Who learns, and all its options, ``steps`` included.
    setup
        Back ends, and the options given for them.
    seeds
        One for every run, at least one.
    family
        Of the layouts; None where the task itself is learned.
    checkpoint_steps
        Steps between two checkpoints, >= 1.
    warm
        Whether verdicts kept on disk are used.
    start
        Networks that the runs begin with; None for drawn ones.
    steps_said
        Whether somebody said how many steps; otherwise they are derived from the task.
    derived
        Which of `options` were chosen by what is learned on, and what else was.
    groups
        Numbers of the runs that learn side by side; `even_groups` of them where none are given.

    Raises
    ------
    ValueError
        If there is no layout, no seed, or less than a step between checkpoints.
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
            object.__setattr__(self, "groups", even_groups(len(self.seeds)))

    @property
    def steps(self) -> int:
        """Environment steps of every run."""
        return int(self.options["steps"])

    def learner(self) -> Learner:
        """Return the solver, with its options."""
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
) -> TrainingPlan:
    """Return the plan of a training, having seen that it can begin.

    Parameters
    ----------
    problem
        The task file.
    solver
        The learner's name.
    setup
        Back ends, and options of all plugins.
    part
        Of a file that describes a chain, the task meant.
    runs
        How many, >= 1, with the seeds from `seed` on.
    steps
        Environment steps of every run; None for the learner's option ``steps``, before which
        this goes. Options that are null are chosen by the task.
    seed
        The first seed, >= 0.
    family
        How many layouts of the file's family are learned on; 0 for the file's own.
    checkpoint_steps
        Steps between two checkpoints, >= 1.
    warm
        Whether verdicts kept on disk are used.
    start
        Folder of an earlier training whose networks the runs begin with; None for drawn ones.

    Raises
    ------
    OptionError
        If an option is wrong, the solver does not learn or refuses the task, the file has no
        family, or the networks do not fit.
    PluginError
        If a plugin is unknown or broken.
    """
    plugin = _learner(solver)
    values = dict(setup.options.get(solver, {}))
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
    made = plan.setup.back_ends(layouts[0], problem.spare_back_ends)
    refusal = plan.learner().refuses(make_model(layouts[0], plan.setup, back_ends=made))
    if refusal is not None:
        raise OptionError(f"The solver {solver!r} cannot serve {task.name!r}: {refusal}")
    if start is None:
        return plan
    begun = warm_start(start, solver, plan.learner(), plan.options, task, runs)
    return replace(plan, start=begun)


def _learner(name: str) -> type[Learner]:
    """Return the class of a learner.

    Raises
    ------
    OptionError
        If the solver does not learn; those that do are named.
    PluginError
        If it is unknown or broken.
    """
    known = registry.names("solver")
    if name not in known:
        raise PluginError(f"Unknown solver {name!r}. {name_hint(name, known)} {_learners(known)}")
    plugin = registry.load("solver", name)
    if not issubclass(plugin, Learner):
        raise OptionError(
            f"The solver {name!r} trains no policies step by step. {_learners(known)}"
        )
    return plugin


def _learners(names: list[str]) -> str:
    """Return the sentence that says which installed solvers learn."""
    found = []
    for name in names:
        try:
            plugin = registry.load("solver", name)
        except PluginError:
            continue  # what is broken can learn nothing
        if issubclass(plugin, Learner):
            found.append(name)
    if not found:
        return "No learner is installed: pip install skillplan-torch."
    return f"Learners installed: {', '.join(found)}."
