"""Agents of the benchmark as solvers: installed ones, Fast Downward, and learners from elsewhere.

A learner from elsewhere is anything with ``learn(total_timesteps)`` and ``predict(observation)``,
such as an algorithm of Stable-Baselines3.
"""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import inspect
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import partial
from importlib.metadata import PackageNotFoundError, packages_distributions, version
from pathlib import Path
from types import ModuleType
from typing import Any

from skillplan import __version__
from skillplan.errors import OptionError, PluginError, SkillplanError, SolverError
from skillplan.exporters.exporter import Handover
from skillplan.files.regular_file import read_bytes
from skillplan.judge import fast_downward
from skillplan.model.policy_value import evaluate_policy, roll_out
from skillplan.model.replay import replay
from skillplan.model.skill_model import SkillModel
from skillplan.pipeline import registry
from skillplan.pipeline.solving import make_solver
from skillplan.plugins.installed import registered
from skillplan.solvers.solution import Plan, Solution
from skillplan.solvers.solver import Solver
from skillplan.solvers.stop import Stop
from skillplan.task.skill import Skill
from skillplan.task.state import State

RANDOM = "random"
BASELINES = (
    "auto",
    "exact",
    "local-search",
    "cp-sat",
    fast_downward.NAME,
    "learned-model",
    "q-learning",
    "dqn",
    "ppo",
    "stable_baselines3:DQN",
    "stable_baselines3:PPO",
    "sb3_contrib:MaskablePPO",
    RANDOM,
)
"""Agents that run if none is named, as far as they are installed."""

SETTINGS: dict[str, dict[str, int]] = {
    "stable_baselines3:DQN": {"target_update_interval": 500, "buffer_size": 20_000},
    "stable_baselines3:PPO": {"n_steps": 256},
    "sb3_contrib:MaskablePPO": {"n_steps": 256},
}
"""Settings that differ from the defaults of Stable-Baselines3, which are for a million steps."""

_LEARNERS = ("q-learning", "sarsa", "monte-carlo")
# Seeds of NumPy's older generators, which learners use, have 32 bits.
_SEEDS = 2**32
# Greatest size of the file of an agent.
_MOST_BYTES = 2**26
# Modules that agents imported from their own folders, by folder.
_siblings: dict[Path, dict[str, ModuleType]] = {}


def list_baselines() -> list[str]:
    """Return the installed agents of `BASELINES`."""
    installed = []
    for name in BASELINES:
        module = name.partition(":")[0]
        try:
            if module != name and importlib.util.find_spec(module) is None:
                continue
            if module == name:
                make_agent(name, 1)
        except (OptionError, PluginError):
            continue
        installed.append(name)
    return installed


def is_learner(name: str) -> bool:
    """Return whether an agent learns from steps in the environment, or takes them at random.

    Raises
    ------
    PluginError
        If the solver is unknown or broken.
    """
    if name == RANDOM or ":" in name or name in _LEARNERS:
        return True
    if name == fast_downward.NAME:
        return False
    from skillplan.solvers.learning.learner import Learner

    return issubclass(registry.load("solver", name), Learner)


def make_agent(name: str, steps: int) -> Solver:
    """Return an agent by name.

    Parameters
    ----------
    name
        A solver, ``fast-downward``, ``random``, or ``MODULE:NAME`` or ``FILE.py:NAME`` of a
        callable that returns a learner.
    steps
        Environment steps of a learner from elsewhere, and of ``random``, >= 1.

    Raises
    ------
    OptionError, PluginError
        If there is no such agent.
    """
    if name == RANDOM:
        return RandomEpisodes(steps)
    if name == fast_downward.NAME:
        return FastDownward()
    if name.endswith(".py"):
        raise OptionError(f"Agent {name}: write {name}:NAME; NAME is a class or function in it.")
    if ":" in name:
        # Messages name the class.
        named = type("NamedLearner", (ForeignLearner,), {"name": name})
        factory = partial(find_factory(name), **SETTINGS.get(name, {}))
        return named(factory, steps, find_folder(name))  # type: ignore[no-any-return]
    return make_solver(name, {})


def find_version(name: str) -> str:
    """Return the distribution of an agent and its version, such as ``ortools 9.15``.

    An agent from a file has the hash of the file instead, such as ``sha256 0f3a...``.

    Raises
    ------
    OptionError
        If the file cannot be read.
    """
    own = f"skillplan {__version__}"
    if name == RANDOM:
        return own
    if name == fast_downward.NAME:
        return f"up-fast-downward {version('up-fast-downward')}"
    if ":" in name:
        place = name.rpartition(":")[0]
        if place.endswith(".py"):
            return _hash_file(place)
        package = place.partition(".")[0]
        names = packages_distributions().get(package, [package])
        try:
            settings = (f"{key}={value}" for key, value in SETTINGS.get(name, {}).items())
            return " ".join([f"{names[0]} {version(names[0])}", *settings])
        except PackageNotFoundError:
            module = importlib.util.find_spec(place)
            return _hash_file(module.origin) if module and module.has_location else name
    entry = next(iter(registered("solver").select(name=name)), None)
    if entry is None or entry.dist is None:
        return own
    text = f"{entry.dist.name} {entry.dist.version}"
    return f"{text}, ortools {version('ortools')}" if name == "cp-sat" else text


def _hash_file(path: str | None) -> str:
    try:
        content = read_bytes(path or "", _MOST_BYTES)
    except OSError as error:
        raise OptionError(f"Agent {path}: cannot be read: {error.strerror}.") from None
    return f"sha256 {hashlib.sha256(content).hexdigest()}"


class FastDownward(Solver):
    """Fast Downward on the task in PDDL, as `verify --with fast-downward` runs it."""

    name = fast_downward.NAME
    # It is ended at the time limit, and reports nothing before.
    polls = True

    def __init__(self, options: Any = None, stop: Stop | None = None) -> None:
        fast_downward.find_driver()
        super().__init__(options, stop)

    def solve(self, model: SkillModel, *, seed: int = 0) -> Solution:
        """Return the plan, with a bound that accounts for rounded costs."""
        limit_s = self.stop.left()["time_limit_s"] or 1e6
        handover = Handover(model, None, False)
        task, answer = fast_downward.plan_with_planner(handover, limit_s)
        if answer.unsolvable:
            return Solution(proved=True)
        if task is None or answer.cost is None:
            return Solution(trace={"reason": answer.silence})
        # The model has exact costs; the planner rounds them.
        skills = [model.task.skill(name) for name in answer.skills]
        cost = replay(model, skills).cost
        rounding = task.scale.rounding(len(skills))
        bound = min(cost, max(0.0, answer.cost / task.scale.per_unit - rounding))
        return Solution(Plan(answer.skills, cost), bound, trace={"rounding": rounding})


class RandomEpisodes(Solver):
    """The cheapest complete episode of applicable actions at random."""

    name = RANDOM
    polls = True

    def __init__(self, steps: int) -> None:
        super().__init__()
        self._steps = steps

    def refuses(self, model: SkillModel) -> str | None:
        """Refuse chance, under which only a policy is an answer."""
        return None if model.task.deterministic else "chance needs a policy, not an episode"

    def solve(self, model: SkillModel, *, seed: int = 0) -> Solution:
        """Return the cheapest episode within the steps and the time limit."""
        from skillplan.env.skill_env import SkillEnv

        env = SkillEnv(model)
        env.action_space.seed(seed % _SEEDS)
        steps, skills, cost, ended = 0, list[str](), 0.0, True
        info: dict[str, Any] = {}
        while steps < self._steps and not self.stop():
            if ended:
                _, info = env.reset()
                skills, cost = [], 0.0
            _, _, complete, late, info = env.step(env.action_space.sample(info["action_mask"]))
            steps += 1
            skills.append(info["skill"])
            cost += info["cost"]
            ended = complete or late
            if complete and info["verdict"] == "feasible":
                best = self.stop.best
                if best is None or best.cost is None or cost < best.cost:
                    self.stop.incumbent(Plan(tuple(skills), cost))
        return Solution(self.stop.best, trace={"steps": steps})


class ForeignLearner(Solver):
    """A learner with ``learn(total_timesteps)`` and ``predict(observation)``.

    Its answer is the policy that `predict` follows after training. If `predict` has the parameters
    ``action_masks`` or ``deterministic``, it gets the mask and True.

    Parameters
    ----------
    factory
        Returns the learner. It gets the environment as ``env`` or first argument, and ``policy``
        ("MlpPolicy"), ``seed``, ``device`` ("cpu") and ``verbose`` (0) if it has these parameters.
    steps
        Environment steps, >= 1. Training ends after them, even within a roll-out.
    folder
        Folder of the file of the learner, from which it may import; None for a module.
    """

    name = "foreign"
    polls = True

    def __init__(self, factory: Callable[..., Any], steps: int, folder: Path | None = None) -> None:
        super().__init__()
        self._factory = factory
        self._steps = steps
        self._folder = folder

    def solve(self, model: SkillModel, *, seed: int = 0) -> Solution:
        """Train within the steps and the time limit, and return the greedy policy."""
        with importing_from(self._folder):
            return self._solve(model, seed)

    def _solve(self, model: SkillModel, seed: int) -> Solution:
        env = _make_limited_env(model, self.stop, self._steps, seed % _SEEDS)
        learner = _construct(self._factory, env, seed % _SEEDS)
        for method in ("learn", "predict"):
            if not callable(getattr(learner, method, None)):
                kind = type(learner).__name__
                raise SolverError(f"{self.name} made a {kind} without {method}().")
        # At a limit, the policy so far is the answer.
        with suppress(_TrainingEnds):
            learner.learn(total_timesteps=self._steps)
        fresh = SkillModel(model.feasibility)
        policy = _GreedyPolicy(learner, fresh)
        fault = _find_fault(policy, fresh)
        answer = None if fault else policy
        return Solution(answer, trace={"steps": env.steps, **({"reason": fault} if fault else {})})


def _find_fault(policy: Mapping[State, Skill], model: SkillModel) -> str:
    """Return the reason why a policy does not complete a task; empty if it does.

    A learner makes no claim about its policy, so an infeasible step is not a false claim.
    """
    value = None if model.task.deterministic else evaluate_policy(model, policy.get)
    if value is not None:
        return "" if value.cost is not None else value.problem or "it does not complete the task"
    walked = replay(model, roll_out(model, policy.get))
    return "" if walked.complete else walked.violations[0].reason


def find_folder(spec: str) -> Path | None:
    """Return the folder of an agent from a file; None for a module."""
    place = spec.rpartition(":")[0]
    return Path(place).resolve().parent if place.endswith(".py") else None


@contextmanager
def importing_from(folder: Path | None) -> Iterator[None]:
    """Let a file import modules from its folder, hidden from the files of other folders."""
    if folder is None:
        yield
        return
    siblings = _siblings.setdefault(folder, {})
    before = set(sys.modules)
    sys.modules.update({key: siblings[key] for key in siblings.keys() - before})
    sys.path.insert(0, str(folder))
    try:
        yield
    finally:
        with suppress(ValueError):
            sys.path.remove(str(folder))
        for name in set(sys.modules) - before:
            top = name.partition(".")[0]
            own = (folder / f"{top}.py").is_file() or (folder / top / "__init__.py").is_file()
            if top not in before and own:
                siblings[name] = sys.modules.pop(name)


def find_factory(spec: str) -> Callable[..., Any]:
    """Return the callable of ``MODULE:NAME`` or ``FILE.py:NAME``.

    Raises
    ------
    OptionError
        If it cannot be imported, or is not callable.
    """
    place, _, name = spec.rpartition(":")
    try:
        if place.endswith(".py"):
            title = Path(place).stem
            # A file named as a loaded library does not replace the library.
            title = f"{title}_agent" if title in sys.modules else title
            file = importlib.util.spec_from_file_location(title, place)
            assert file is not None
            assert file.loader is not None
            module = importlib.util.module_from_spec(file)
            with importing_from(find_folder(spec)):
                # Dataclasses look their module up.
                sys.modules[title] = module
                file.loader.exec_module(module)
        else:
            module = importlib.import_module(place)
        factory = getattr(module, name)
    except Exception as error:
        words = f"{type(error).__name__}: {error}"
        raise OptionError(f"Agent {spec}: cannot be imported: {words}.") from None
    if not callable(factory):
        raise OptionError(f"Agent {spec}: {name} is not callable.")
    return factory  # type: ignore[no-any-return]


def _construct(factory: Callable[..., Any], env: Any, seed: int) -> Any:
    parameters = inspect.signature(factory).parameters
    known = {"policy": "MlpPolicy", "seed": seed, "device": "cpu", "verbose": 0}
    given = {name: value for name, value in known.items() if name in parameters}
    return factory(env=env, **given) if "env" in parameters else factory(env, **given)


class _TrainingEnds(Exception):
    """The time or the steps of a training are over."""


def _make_limited_env(model: SkillModel, stop: Stop, steps: int, seed: int) -> Any:
    """Return the environment of a model, which raises `_TrainingEnds` at a limit.

    Its actions, and its first episode unless the learner seeds it, have the seed.
    """
    import gymnasium

    from skillplan.env.skill_env import SkillEnv

    class LimitedEnv(gymnasium.Wrapper[Any, Any, Any, Any]):
        steps = 0
        first_seed: int | None = seed

        def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
            seed = self.first_seed if seed is None else seed
            self.first_seed = None
            return super().reset(seed=seed, options=options)

        def step(self, action: Any) -> Any:
            if stop() or self.steps >= limit:
                raise _TrainingEnds
            self.steps += 1
            return super().step(action)

        def action_masks(self) -> Any:
            return env.action_masks()

    limit, env = steps, SkillEnv(model)
    env.action_space.seed(seed)
    return LimitedEnv(env)


class _GreedyPolicy(Mapping[State, Skill]):
    """The choices of a learner; a state is decided when it is first looked up."""

    def __init__(self, learner: Any, model: SkillModel) -> None:
        from skillplan.env.observation import Observation

        self._learner, self._model = learner, model
        self._observation = Observation.of(model.task, "markov")
        self._choices: dict[State, Skill] = {}
        parameters = inspect.signature(learner.predict).parameters
        self._takes_mask = "action_masks" in parameters
        self._given = {"deterministic": True} if "deterministic" in parameters else {}

    def __getitem__(self, state: State) -> Skill:
        if state not in self._choices:
            self._choices[state] = self._decide(state)
        return self._choices[state]

    def __iter__(self) -> Iterator[State]:
        return iter(self._choices)

    def __len__(self) -> int:
        return len(self._choices)

    def _decide(self, state: State) -> Skill:
        import numpy as np

        skills, given = self._model.task.skills, dict[str, Any](self._given)
        if self._takes_mask:
            mask = np.zeros(len(skills), dtype=np.int8)
            mask[[self._model.task.action(skill) for skill in self._model.applicable(state)]] = 1
            given["action_masks"] = mask
        answer = self._learner.predict(self._observation.encode(state), **given)
        action = int(np.asarray(answer[0] if isinstance(answer, tuple) else answer).item())
        if not 0 <= action < len(skills):
            raise SkillplanError(f"the action {action} does not exist")
        return skills[action]
