"""skillplan: in which order a robot uses its skills, with a proof or an honest gap.

Names are imported when first used, so that ``import skillplan`` is instant.
"""

from __future__ import annotations

import importlib
import sys
from typing import TYPE_CHECKING, Any

__version__ = "0.2.0"

# Every public name and the module that it is imported from when first used. Type checkers read
# the imports below instead; a test holds the two together.
_HOMES = {
    "Account": "skillplan.domains.domain",
    "BackEnd": "skillplan.task.back_end",
    "Case": "skillplan.task.skill",
    "ChainResult": "skillplan.records.chain_result",
    "Condition": "skillplan.task.state",
    "Detector": "skillplan.collision.detector",
    "Domain": "skillplan.domains.domain",
    "Engine": "skillplan.physics.engine",
    "Facts": "skillplan.task.state",
    "Outcome": "skillplan.task.skill",
    "Plan": "skillplan.solvers.solution",
    "Policy": "skillplan.solvers.solution",
    "Problem": "skillplan.domains.load",
    "Result": "skillplan.records.result",
    "Scene": "skillplan.task.scene",
    "Setup": "skillplan.pipeline.setup",
    "Skill": "skillplan.task.skill",
    "SkillEnv": "skillplan.env.skill_env",
    "SkillModel": "skillplan.model.skill_model",
    "SkillVectorEnv": "skillplan.env.skill_vector_env",
    "SkillplanError": "skillplan.errors",
    "Solution": "skillplan.solvers.solution",
    "Solver": "skillplan.solvers.solver",
    "State": "skillplan.task.state",
    "Status": "skillplan.records.result",
    "Stop": "skillplan.solvers.stop",
    "Task": "skillplan.task.task",
    "TaskError": "skillplan.errors",
    "Transition": "skillplan.model.skill_model",
    "Verdict": "skillplan.task.verdict",
    "load_problem": "skillplan.pipeline.setup",
    "make_model": "skillplan.pipeline.solving",
    "solve": "skillplan.pipeline.solving",
    "solve_chain": "skillplan.pipeline.chain",
    "solve_problem": "skillplan.pipeline.solving",
}

__all__ = sorted(_HOMES)

if TYPE_CHECKING:
    from skillplan.collision.detector import Detector as Detector
    from skillplan.domains.domain import Account as Account
    from skillplan.domains.domain import Domain as Domain
    from skillplan.domains.load import Problem as Problem
    from skillplan.env.skill_env import SkillEnv as SkillEnv
    from skillplan.env.skill_vector_env import SkillVectorEnv as SkillVectorEnv
    from skillplan.errors import SkillplanError as SkillplanError
    from skillplan.errors import TaskError as TaskError
    from skillplan.model.skill_model import SkillModel as SkillModel
    from skillplan.model.skill_model import Transition as Transition
    from skillplan.physics.engine import Engine as Engine
    from skillplan.pipeline.chain import solve_chain as solve_chain
    from skillplan.pipeline.setup import Setup as Setup
    from skillplan.pipeline.setup import load_problem as load_problem
    from skillplan.pipeline.solving import make_model as make_model
    from skillplan.pipeline.solving import solve as solve
    from skillplan.pipeline.solving import solve_problem as solve_problem
    from skillplan.records.chain_result import ChainResult as ChainResult
    from skillplan.records.result import Result as Result
    from skillplan.records.result import Status as Status
    from skillplan.solvers.solution import Plan as Plan
    from skillplan.solvers.solution import Policy as Policy
    from skillplan.solvers.solution import Solution as Solution
    from skillplan.solvers.solver import Solver as Solver
    from skillplan.solvers.stop import Stop as Stop
    from skillplan.task.back_end import BackEnd as BackEnd
    from skillplan.task.scene import Scene as Scene
    from skillplan.task.skill import Case as Case
    from skillplan.task.skill import Outcome as Outcome
    from skillplan.task.skill import Skill as Skill
    from skillplan.task.state import Condition as Condition
    from skillplan.task.state import Facts as Facts
    from skillplan.task.state import State as State
    from skillplan.task.task import Task as Task
    from skillplan.task.verdict import Verdict as Verdict


def __getattr__(name: str) -> Any:
    home = _HOMES.get(name)
    if home is None:
        raise AttributeError(f"module 'skillplan' has no attribute {name!r}")
    value = getattr(importlib.import_module(home), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])


def _register() -> None:
    # Whoever has loaded Gymnasium already may make the environment by its name.
    if "gymnasium" in sys.modules:
        importlib.import_module("skillplan.env")


_register()
