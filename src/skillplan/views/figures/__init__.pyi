from .catalogue import RUN_FIGURES as RUN_FIGURES
from .catalogue import TASK_FIGURES as TASK_FIGURES
from .catalogue import CatalogueEntry as CatalogueEntry
from .catalogue import figure_lines as figure_lines
from .catalogue import figure_module as figure_module
from .catalogue import figure_names as figure_names
from .exploded_figure import assembly_film as assembly_film
from .exploded_figure import exploded_picture as exploded_picture
from .exploded_figure import exploded_png as exploded_png
from .figure_file import checked_path as checked_path
from .figure_file import figure_bytes as figure_bytes
from .figure_file import save_figure as save_figure
from .figure_request import Run as Run
from .figure_request import WalkSteps as WalkSteps
from .figure_style import PALETTE as PALETTE
from .figure_style import Heading as Heading
from .figure_style import sheet as sheet
from .figure_style import text_colour as text_colour
from .figure_style import text_width_in as text_width_in
from .gantt_figure import FAILED as FAILED
from .gantt_figure import NOT_SIMULATED as NOT_SIMULATED
from .gantt_figure import PlanBar as PlanBar
from .gantt_figure import gantt_picture as gantt_picture
from .gantt_figure import plan_bars as plan_bars
from .hulls_figure import figure_image as figure_image
from .hulls_figure import hulls_figure as hulls_figure
from .label_placement import LabelPlacer as LabelPlacer
from .layout_figure import layout_picture as layout_picture
from .layout_figure import path_steps as path_steps
from .learning_figure import LearningCurve as LearningCurve
from .learning_figure import LearningPanel as LearningPanel
from .learning_figure import learning_figure as learning_figure
from .picture import COLOURS as COLOURS
from .picture import NUMBER_PX as NUMBER_PX
from .picture import Note as Note
from .picture import Picture as Picture
from .picture import number_rows as number_rows
from .picture import shortened as shortened
from .precedence_figure import precedence_picture as precedence_picture
from .precedence_graph import Bend as Bend
from .precedence_graph import layers_of as layers_of
from .precedence_graph import precedence_graph as precedence_graph
from .q_values_figure import StateValues as StateValues
from .q_values_figure import look as look
from .q_values_figure import q_values_figure as q_values_figure
from .rewards_figure import RewardStep as RewardStep
from .rewards_figure import rewards_figure as rewards_figure
from .solids import Camera as Camera
from .solids import SolidPainter as SolidPainter
from .solids import hull as hull
from .sweep_figure import sweep_figure as sweep_figure
from .training_figures import RunCurve as RunCurve
from .training_figures import distances_figure as distances_figure
from .training_figures import over_runs as over_runs
from .training_figures import success_figure as success_figure

__all__ = [
    "COLOURS",
    "FAILED",
    "NOT_SIMULATED",
    "NUMBER_PX",
    "PALETTE",
    "RUN_FIGURES",
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
    "assembly_film",
    "checked_path",
    "distances_figure",
    "exploded_picture",
    "exploded_png",
    "figure_bytes",
    "figure_image",
    "figure_lines",
    "figure_module",
    "figure_names",
    "gantt_picture",
    "hull",
    "hulls_figure",
    "layers_of",
    "layout_picture",
    "learning_figure",
    "look",
    "number_rows",
    "over_runs",
    "path_steps",
    "plan_bars",
    "precedence_graph",
    "precedence_picture",
    "q_values_figure",
    "rewards_figure",
    "save_figure",
    "sheet",
    "shortened",
    "success_figure",
    "sweep_figure",
    "text_colour",
    "text_width_in",
]
