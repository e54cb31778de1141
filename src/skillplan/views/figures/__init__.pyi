from .catalogue import RUN_FIGURES as RUN_FIGURES
from .catalogue import TASK_FIGURES as TASK_FIGURES
from .catalogue import CatalogueEntry as CatalogueEntry
from .catalogue import describe_figures as describe_figures
from .catalogue import list_figure_names as list_figure_names
from .catalogue import load_figure_module as load_figure_module
from .exploded_figure import draw_exploded_view as draw_exploded_view
from .exploded_figure import draw_product as draw_product
from .exploded_figure import film_assembly as film_assembly
from .exploded_figure import render_exploded_png as render_exploded_png
from .figure_file import check_path as check_path
from .figure_file import render_figure as render_figure
from .figure_file import save_figure as save_figure
from .figure_request import Run as Run
from .figure_request import WalkSteps as WalkSteps
from .figure_style import PALETTE as PALETTE
from .figure_style import Heading as Heading
from .figure_style import create_sheet as create_sheet
from .figure_style import darken_colour as darken_colour
from .figure_style import measure_text_in as measure_text_in
from .gantt_figure import FAILED as FAILED
from .gantt_figure import NOT_SIMULATED as NOT_SIMULATED
from .gantt_figure import PlanBar as PlanBar
from .gantt_figure import draw_gantt_picture as draw_gantt_picture
from .gantt_figure import list_plan_bars as list_plan_bars
from .hulls_figure import draw_hulls as draw_hulls
from .hulls_figure import render_image as render_image
from .label_placement import LabelPlacer as LabelPlacer
from .layout_figure import draw_layout as draw_layout
from .layout_figure import list_path_steps as list_path_steps
from .learning_figure import LearningCurve as LearningCurve
from .learning_figure import LearningPanel as LearningPanel
from .learning_figure import draw_learning as draw_learning
from .picture import COLOURS as COLOURS
from .picture import NUMBER_PX as NUMBER_PX
from .picture import SERIES as SERIES
from .picture import Note as Note
from .picture import Picture as Picture
from .picture import place_number_rows as place_number_rows
from .picture import shorten as shorten
from .precedence_figure import draw_precedence as draw_precedence
from .precedence_graph import Bend as Bend
from .precedence_graph import arrange_layers as arrange_layers
from .precedence_graph import build_precedence_graph as build_precedence_graph
from .profile_figure import draw_profile as draw_profile
from .q_values_figure import StateValues as StateValues
from .q_values_figure import choose_look as choose_look
from .q_values_figure import draw_q_values as draw_q_values
from .rewards_figure import RewardStep as RewardStep
from .rewards_figure import draw_rewards as draw_rewards
from .solids import Camera as Camera
from .solids import SolidPainter as SolidPainter
from .solids import find_hull as find_hull
from .sweep_figure import draw_sweep as draw_sweep
from .training_figures import RunCurve as RunCurve
from .training_figures import average_runs as average_runs
from .training_figures import draw_distances as draw_distances
from .training_figures import draw_success as draw_success

__all__ = [
    "COLOURS",
    "FAILED",
    "NOT_SIMULATED",
    "NUMBER_PX",
    "PALETTE",
    "RUN_FIGURES",
    "SERIES",
    "TASK_FIGURES",
    "Bend",
    "Camera",
    "CatalogueEntry",
    "Heading",
    "LabelPlacer",
    "LearningCurve",
    "LearningPanel",
    "Note",
    "Picture",
    "PlanBar",
    "RewardStep",
    "Run",
    "RunCurve",
    "SolidPainter",
    "StateValues",
    "WalkSteps",
    "arrange_layers",
    "average_runs",
    "build_precedence_graph",
    "check_path",
    "choose_look",
    "create_sheet",
    "darken_colour",
    "describe_figures",
    "draw_distances",
    "draw_exploded_view",
    "draw_gantt_picture",
    "draw_hulls",
    "draw_layout",
    "draw_learning",
    "draw_precedence",
    "draw_product",
    "draw_profile",
    "draw_q_values",
    "draw_rewards",
    "draw_success",
    "draw_sweep",
    "film_assembly",
    "find_hull",
    "list_figure_names",
    "list_path_steps",
    "list_plan_bars",
    "load_figure_module",
    "measure_text_in",
    "place_number_rows",
    "render_exploded_png",
    "render_figure",
    "render_image",
    "save_figure",
    "shorten",
]
