"""skillplan: in which order a robot uses its skills, with a proof or an honest gap.

Names are imported when first used, so that ``import skillplan`` is instant.
"""

from __future__ import annotations

import importlib
import sys
from typing import TYPE_CHECKING, Any

__version__ = "0.2.0"

_HOMES = {
    "Account": "skillplan.domains.domain",
    "BackEnd": "skillplan.task.back_end",
    "Case": "skillplan.task.skill",
    "ChainResult": "skillplan.records.chain_result",
    "Condition": "skillplan.task.condition",
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
    "make_model": "skillplan.pipeline.run",
    "solve": "skillplan.pipeline.run",
    "solve_chain": "skillplan.pipeline.chain",
}

__all__ = [
    "Account",
    "BackEnd",
    "Case",
    "ChainResult",
    "Condition",
    "Detector",
    "Domain",
    "Engine",
    "Facts",
    "Outcome",
    "Plan",
    "Policy",
    "Problem",
    "Result",
    "Scene",
    "Setup",
    "Skill",
    "SkillEnv",
    "SkillModel",
    "SkillVectorEnv",
    "SkillplanError",
    "Solution",
    "Solver",
    "State",
    "Status",
    "Stop",
    "Task",
    "TaskError",
    "Transition",
    "Verdict",
    "load_problem",
    "make_model",
    "solve",
    "solve_chain",
]

if TYPE_CHECKING:
    from skillplan.collision.detector import Detector
    from skillplan.domains.domain import Account, Domain
    from skillplan.domains.load import Problem
    from skillplan.env.skill_env import SkillEnv
    from skillplan.env.skill_vector_env import SkillVectorEnv
    from skillplan.errors import SkillplanError, TaskError
    from skillplan.model.skill_model import SkillModel, Transition
    from skillplan.physics.engine import Engine
    from skillplan.pipeline.chain import solve_chain
    from skillplan.pipeline.run import make_model, solve
    from skillplan.pipeline.setup import Setup, load_problem
    from skillplan.records.chain_result import ChainResult
    from skillplan.records.result import Result, Status
    from skillplan.solvers.solution import Plan, Policy, Solution
    from skillplan.solvers.solver import Solver
    from skillplan.solvers.stop import Stop
    from skillplan.task.back_end import BackEnd
    from skillplan.task.condition import Condition
    from skillplan.task.scene import Scene
    from skillplan.task.skill import Case, Outcome, Skill
    from skillplan.task.state import Facts, State
    from skillplan.task.task import Task
    from skillplan.task.verdict import Verdict


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
