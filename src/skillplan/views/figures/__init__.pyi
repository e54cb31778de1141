from .catalogue import RUN_FIGURES as RUN_FIGURES
from .catalogue import TASK_FIGURES as TASK_FIGURES
from .catalogue import CatalogueEntry as CatalogueEntry
from .catalogue import figure_lines as figure_lines
from .catalogue import figure_module as figure_module
from .catalogue import figure_names as figure_names
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
from .hulls_figure import figure_image as figure_image
from .hulls_figure import hulls_figure as hulls_figure
from .label_placement import LabelPlacer as LabelPlacer
from .learning_figure import LearningCurve as LearningCurve
from .learning_figure import LearningPanel as LearningPanel
from .learning_figure import learning_figure as learning_figure
from .q_values_figure import StateValues as StateValues
from .q_values_figure import look as look
from .q_values_figure import q_values_figure as q_values_figure
from .rewards_figure import RewardStep as RewardStep
from .rewards_figure import rewards_figure as rewards_figure
from .sweep_figure import sweep_figure as sweep_figure
from .training_figures import RunCurve as RunCurve
from .training_figures import distances_figure as distances_figure
from .training_figures import over_runs as over_runs
from .training_figures import success_figure as success_figure

__all__ = [
    "PALETTE",
    "RUN_FIGURES",
    "TASK_FIGURES",
    "CatalogueEntry",
    "Heading",
    "LabelPlacer",
    "LearningCurve",
    "LearningPanel",
    "RewardStep",
    "Run",
    "RunCurve",
    "StateValues",
    "WalkSteps",
    "checked_path",
    "distances_figure",
    "figure_bytes",
    "figure_image",
    "figure_lines",
    "figure_module",
    "figure_names",
    "hulls_figure",
    "learning_figure",
    "look",
    "over_runs",
    "q_values_figure",
    "rewards_figure",
    "save_figure",
    "sheet",
    "success_figure",
    "sweep_figure",
    "text_colour",
    "text_width_in",
]
