"""How wide texts are in figures and pictures.

A page needs nothing else of matplotlib, whose figures take four times as long to import.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from matplotlib.font_manager import FontProperties
from matplotlib.path import Path
from matplotlib.textpath import text_to_path


@lru_cache(maxsize=4096)
def text_width_in(text: str, size_pt: float) -> float:
    """Return how wide a text is [in] at a font size [pt]."""
    if not text.strip():
        return 0.0
    font = FontProperties(family="DejaVu Sans")
    outlines, codes = text_to_path.get_text_path(font, text, ismath=False)
    drawn_pt = np.asarray(outlines)[np.asarray(codes) != Path.CLOSEPOLY, 0]
    # Outlines of fonts have points at their extremes: ten times as fast as to bound the curves.
    drawn_pt = drawn_pt * (size_pt / text_to_path.FONT_SCALE)
    return float(drawn_pt.max() - drawn_pt.min()) / 72
