"""The documentation: ``make docs`` builds it, with warnings as errors."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "_ext"))

import skillplan

project = "skillplan"
author = "The skillplan developers"
project_copyright = "the skillplan developers"
version = release = skillplan.__version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "generated_reference",
    "public_names",
]
exclude_patterns = ["_build", "_ext"]
nitpicky = True

# Every heading is a place to link to; a link that leads nowhere is a warning, and so an error.
myst_heading_anchors = 4
myst_enable_extensions = ["colon_fence", "deflist", "dollarmath"]
suppress_warnings = ["misc.highlighting_failure"]

html_theme = "furo"
html_title = f"skillplan {version}"
html_static_path = ["_static"]
html_css_files = ["skillplan.css"]
smartquotes = False  # options begin with two dashes
pygments_style = "friendly"
pygments_dark_style = "monokai"

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
default_role = "code"
napoleon_google_docstring = False
napoleon_use_rtype = False

linkcheck_timeout = 20
