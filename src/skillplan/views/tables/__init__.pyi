from .benchmark import smallest_difference as smallest_difference
from .chain import tabulate_appendix as tabulate_appendix
from .chain import tabulate_chain as tabulate_chain
from .chain import tabulate_chain_comparison as tabulate_chain_comparison
from .installation import tabulate_import as tabulate_import
from .installation import tabulate_listing as tabulate_listing
from .questions import tabulate_chart as tabulate_chart
from .questions import tabulate_evaluation as tabulate_evaluation
from .results import render_csv_files as render_csv_files
from .results import tabulate_comparison as tabulate_comparison
from .results import tabulate_plan as tabulate_plan
from .sweep import tabulate_settings as tabulate_settings
from .sweep import tabulate_starts as tabulate_starts
from .training import tabulate_layouts as tabulate_layouts
from .training import tabulate_methods as tabulate_methods
from .training import tabulate_training as tabulate_training
from .trials import tabulate_simulation as tabulate_simulation

__all__ = [
    "render_csv_files",
    "smallest_difference",
    "tabulate_appendix",
    "tabulate_chain",
    "tabulate_chain_comparison",
    "tabulate_chart",
    "tabulate_comparison",
    "tabulate_evaluation",
    "tabulate_import",
    "tabulate_layouts",
    "tabulate_listing",
    "tabulate_methods",
    "tabulate_plan",
    "tabulate_settings",
    "tabulate_simulation",
    "tabulate_starts",
    "tabulate_training",
]
