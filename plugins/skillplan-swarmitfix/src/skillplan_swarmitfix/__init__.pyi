from .account import account as account
from .base.goal_choice import GoalRule as GoalRule
from .base.goal_choice import LeastSwings as LeastSwings
from .base.goal_choice import choose as choose
from .base.goals import MOST_SPLITS as MOST_SPLITS
from .base.goals import GoalSet as GoalSet
from .base.goals import How as How
from .base.goals import ReachRules as ReachRules
from .base.goals import UnreachableSupport as UnreachableSupport
from .base.goals import candidates as candidates
from .base.goals import goal_sets as goal_sets
from .base.goals import inward_side as inward_side
from .base.goals import quadrilateral as quadrilateral
from .base.goals import unreachable as unreachable
from .base.goals import within_reach as within_reach
from .base.goals_task import goal_of as goal_of
from .base.goals_task import goals_task as goals_task
from .base.goals_task import serve as serve
from .base.locomotion import Agent as Agent
from .base.locomotion import BaseGrounding as BaseGrounding
from .base.locomotion import BasePath as BasePath
from .base.locomotion import FiveStep as FiveStep
from .base.locomotion import Phase as Phase
from .base.locomotion import along as along
from .base.locomotion import at as at
from .base.locomotion import makespan as makespan
from .base.locomotion import timeline as timeline
from .bench.bench import Bench as Bench
from .bench.bench import PinLattice as PinLattice
from .bench.bench import Timings as Timings
from .bench.swings import ALL_TURNS as ALL_TURNS
from .bench.swings import ANGLES_DEG as ANGLES_DEG
from .bench.swings import HEADINGS as HEADINGS
from .bench.swings import LEGS as LEGS
from .bench.swings import SWING_ACTIONS as SWING_ACTIONS
from .bench.swings import Axial as Axial
from .bench.swings import Direction as Direction
from .bench.swings import Swing as Swing
from .bench.swings import SwingAction as SwingAction
from .bench.swings import Turn as Turn
from .bench.swings import corners as corners
from .bench.swings import rotated as rotated
from .bench.swings import triangle_at as triangle_at
from .domain import SwarmitfixDomain as SwarmitfixDomain
from .figures.bench_canvas import open_bench_canvas as open_bench_canvas
from .figures.fleet_figure import draw_fleet as draw_fleet
from .figures.fleet_figure import find_paths as find_paths
from .figures.gantt_figure import Bar as Bar
from .figures.gantt_figure import draw_gantt as draw_gantt
from .figures.placement_figure import BaseGoal as BaseGoal
from .figures.placement_figure import HeadMark as HeadMark
from .figures.placement_figure import assign_colours as assign_colours
from .figures.placement_figure import draw_placement as draw_placement
from .figures.placement_figure import find_links_m as find_links_m
from .figures.placement_figure import format_ranges as format_ranges
from .figures.policy_figure import count_steps_to as count_steps_to
from .figures.policy_figure import draw_policy as draw_policy
from .fleet.simulator import FleetSwing as FleetSwing
from .fleet.simulator import FleetViolation as FleetViolation
from .fleet.simulator import passed_pins as passed_pins
from .fleet.simulator import simulate as simulate
from .fleet.simulator import simulate_timed as simulate_timed
from .fleet.task import fleet_faults as fleet_faults
from .fleet.task import fleet_task as fleet_task
from .fleet.task import robot_at as robot_at
from .heads.grid import HeadGrid as HeadGrid
from .heads.grid import SupportedStretch as SupportedStretch
from .heads.grid import overlap as overlap
from .heads.heads import THIRD_RAD as THIRD_RAD
from .heads.heads import Head as Head
from .heads.heads import HeadKind as HeadKind
from .heads.heads import HeadRules as HeadRules
from .heads.heads import even_heads as even_heads
from .heads.heads import normal_yaw as normal_yaw
from .heads.heads import path_between as path_between
from .heads.heads import same_yaw as same_yaw
from .heads.heads import vertex_heads as vertex_heads
from .heads.task import fewest as fewest
from .heads.task import head_task as head_task
from .heads.task import heads_of as heads_of
from .heads.task import segment_fault as segment_fault
from .job import Job as Job
from .machine_settings import limits_of as limits_of
from .machine_settings import mount_of as mount_of
from .machine_settings import timings_of as timings_of
from .multiagent.configuration_search import ConfigurationSearch as ConfigurationSearch
from .multiagent.configuration_search import ScheduleImprovement as ScheduleImprovement
from .multiagent.configuration_search import search_with_restarts as search_with_restarts
from .multiagent.fleet import FleetSolver as FleetSolver
from .multiagent.joint_search import Objective as Objective
from .multiagent.joint_search import ParallelSchedule as ParallelSchedule
from .multiagent.joint_search import TimedMove as TimedMove
from .multiagent.joint_search import search_jointly as search_jointly
from .multiagent.multi_agent import Move as Move
from .multiagent.multi_agent import MultiAgentProblem as MultiAgentProblem
from .multiagent.multi_agent import NotMultiAgent as NotMultiAgent
from .multiagent.parallel_env import FleetParallelEnv as FleetParallelEnv
from .pkm.kinematics import Matrix as Matrix
from .pkm.kinematics import OutsideWorkspace as OutsideWorkspace
from .pkm.kinematics import PkmGeometry as PkmGeometry
from .pkm.kinematics import PkmJoints as PkmJoints
from .pkm.kinematics import Pose6 as Pose6
from .pkm.kinematics import forward as forward
from .pkm.kinematics import inverse as inverse
from .pkm.kinematics import zyz_angles as zyz_angles
from .pkm.kinematics import zyz_matrix as zyz_matrix
from .pkm.reach import SAFE_LIMITS as SAFE_LIMITS
from .pkm.reach import Mount as Mount
from .pkm.reach import PkmLimits as PkmLimits
from .pkm.reach import horizontal_reach_m as horizontal_reach_m
from .pkm.reach import rule as rule
from .report.bench_playback import compute_base_rows as compute_base_rows
from .report.bench_playback import make_turning as make_turning
from .schema import SwarmitfixConfig as SwarmitfixConfig
from .trajectory.contours import FileContours as FileContours
from .trajectory.dxf_entities import CURVE_TOLERANCE_M as CURVE_TOLERANCE_M
from .trajectory.faults import crossings as crossings
from .trajectory.faults import find_meetings as find_meetings
from .trajectory.files import MAX_BYTES as MAX_BYTES
from .trajectory.files import SUFFIXES as SUFFIXES
from .trajectory.files import read_contours as read_contours
from .trajectory.files import read_trajectory as read_trajectory
from .trajectory.path import TrajectoryFileError as TrajectoryFileError
from .trajectory.path import TrajectoryPath as TrajectoryPath
from .trajectory.path_elements import MAX_CHORDS as MAX_CHORDS
from .trajectory.path_elements import SAME_POINT_M as SAME_POINT_M
from .trajectory.path_elements import Arc as Arc
from .trajectory.path_elements import Element as Element
from .trajectory.path_elements import Line as Line
from .trajectory.path_elements import Point2 as Point2
from .trajectory.path_elements import Spline as Spline
from .trajectory.path_elements import arc_or_line as arc_or_line
from .trajectory.path_elements import circle_of as circle_of
from .trajectory.path_elements import end_directions as end_directions
from .trajectory.path_elements import ending_at as ending_at
from .trajectory.path_elements import measure_m as measure_m
from .trajectory.path_elements import reversed_element as reversed_element
from .trajectory.path_elements import sample as sample
from .trajectory.path_elements import sampling_error_m as sampling_error_m
from .trajectory.path_elements import shown as shown
from .trajectory.workpiece import CORNER_RAD as CORNER_RAD
from .trajectory.workpiece import Corner as Corner
from .trajectory.workpiece import Segment as Segment
from .trajectory.workpiece import Vertex as Vertex
from .trajectory.workpiece import VertexKind as VertexKind
from .trajectory.workpiece import Workpiece as Workpiece

__all__ = [
    "ALL_TURNS",
    "ANGLES_DEG",
    "CORNER_RAD",
    "CURVE_TOLERANCE_M",
    "HEADINGS",
    "LEGS",
    "MAX_BYTES",
    "MAX_CHORDS",
    "MOST_SPLITS",
    "SAFE_LIMITS",
    "SAME_POINT_M",
    "SUFFIXES",
    "SWING_ACTIONS",
    "THIRD_RAD",
    "Agent",
    "Arc",
    "Axial",
    "Bar",
    "BaseGoal",
    "BaseGrounding",
    "BasePath",
    "Bench",
    "ConfigurationSearch",
    "Corner",
    "Direction",
    "Element",
    "FileContours",
    "FiveStep",
    "FleetParallelEnv",
    "FleetSolver",
    "FleetSwing",
    "FleetViolation",
    "GoalRule",
    "GoalSet",
    "Head",
    "HeadGrid",
    "HeadKind",
    "HeadMark",
    "HeadRules",
    "How",
    "Job",
    "LeastSwings",
    "Line",
    "Matrix",
    "Mount",
    "Move",
    "MultiAgentProblem",
    "NotMultiAgent",
    "Objective",
    "OutsideWorkspace",
    "ParallelSchedule",
    "Phase",
    "PinLattice",
    "PkmGeometry",
    "PkmJoints",
    "PkmLimits",
    "Point2",
    "Pose6",
    "ReachRules",
    "ScheduleImprovement",
    "Segment",
    "Spline",
    "SupportedStretch",
    "SwarmitfixConfig",
    "SwarmitfixDomain",
    "Swing",
    "SwingAction",
    "TimedMove",
    "Timings",
    "TrajectoryFileError",
    "TrajectoryPath",
    "Turn",
    "UnreachableSupport",
    "Vertex",
    "VertexKind",
    "Workpiece",
    "account",
    "along",
    "arc_or_line",
    "assign_colours",
    "at",
    "candidates",
    "choose",
    "circle_of",
    "compute_base_rows",
    "corners",
    "count_steps_to",
    "crossings",
    "draw_fleet",
    "draw_gantt",
    "draw_placement",
    "draw_policy",
    "end_directions",
    "ending_at",
    "even_heads",
    "fewest",
    "find_links_m",
    "find_meetings",
    "find_paths",
    "fleet_faults",
    "fleet_task",
    "format_ranges",
    "forward",
    "goal_of",
    "goal_sets",
    "goals_task",
    "head_task",
    "heads_of",
    "horizontal_reach_m",
    "inverse",
    "inward_side",
    "limits_of",
    "make_turning",
    "makespan",
    "measure_m",
    "mount_of",
    "normal_yaw",
    "open_bench_canvas",
    "overlap",
    "passed_pins",
    "path_between",
    "quadrilateral",
    "read_contours",
    "read_trajectory",
    "reversed_element",
    "robot_at",
    "rotated",
    "rule",
    "same_yaw",
    "sample",
    "sampling_error_m",
    "search_jointly",
    "search_with_restarts",
    "segment_fault",
    "serve",
    "shown",
    "simulate",
    "simulate_timed",
    "timeline",
    "timings_of",
    "triangle_at",
    "unreachable",
    "vertex_heads",
    "within_reach",
    "zyz_angles",
    "zyz_matrix",
]
