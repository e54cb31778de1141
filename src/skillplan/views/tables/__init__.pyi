from .chain import appendix_tables as appendix_tables
from .chain import chain_comparison_tables as chain_comparison_tables
from .chain import chain_tables as chain_tables
from .installation import listing_table as listing_table
from .questions import chart_table as chart_table
from .questions import evaluation_table as evaluation_table
from .results import comparison_table as comparison_table
from .results import csv_files as csv_files
from .results import plan_table as plan_table
from .sweep import setting_table as setting_table
from .sweep import start_table as start_table
from .training import layouts_table as layouts_table
from .training import training_tables as training_tables
from .trials import simulation_tables as simulation_tables

__all__ = [
    "appendix_tables",
    "chain_comparison_tables",
    "chain_tables",
    "chart_table",
    "comparison_table",
    "csv_files",
    "evaluation_table",
    "layouts_table",
    "listing_table",
    "plan_table",
    "setting_table",
    "simulation_tables",
    "start_table",
    "training_tables",
]
