from .collision.detector import Detector as Detector
from .domains.domain import Account as Account
from .domains.domain import Domain as Domain
from .domains.load import Problem as Problem
from .env.skill_env import SkillEnv as SkillEnv
from .env.skill_vector_env import SkillVectorEnv as SkillVectorEnv
from .errors import SkillplanError as SkillplanError
from .errors import TaskError as TaskError
from .model.skill_model import SkillModel as SkillModel
from .model.skill_model import Transition as Transition
from .physics.engine import Engine as Engine
from .pipeline.chain import solve_chain as solve_chain
from .pipeline.setup import Setup as Setup
from .pipeline.setup import load_problem as load_problem
from .pipeline.solving import make_model as make_model
from .pipeline.solving import solve as solve
from .pipeline.solving import solve_problem as solve_problem
from .records.chain_result import ChainResult as ChainResult
from .records.result import Result as Result
from .records.result import Status as Status
from .solvers.solution import Plan as Plan
from .solvers.solution import Policy as Policy
from .solvers.solution import Solution as Solution
from .solvers.solver import Solver as Solver
from .solvers.stop import Stop as Stop
from .task.back_end import BackEnd as BackEnd
from .task.scene import Scene as Scene
from .task.skill import Case as Case
from .task.skill import Outcome as Outcome
from .task.skill import Skill as Skill
from .task.state import Condition as Condition
from .task.state import Facts as Facts
from .task.state import State as State
from .task.task import Task as Task
from .task.verdict import Verdict as Verdict

__version__: str

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
    "solve_problem",
]
