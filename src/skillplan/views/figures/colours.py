"""Colours of figures and pictures.

They are those of Okabe and Ito ("Color universal design", 2008), which people with any of the
common colour vision deficiencies distinguish; nothing is shown by colour alone.
"""

from __future__ import annotations

INK = "#1a1a1a"
MUTED = "#5f6368"
FAINT = "#c9cdd2"
PAPER = "#ffffff"
BLUE, ORANGE, GREEN, RED = "#0072b2", "#e69f00", "#009e73", "#d55e00"
PURPLE, SKY, OLIVE, GREY = "#cc79a7", "#56b4e9", "#8a7a00", "#6e6e6e"
PALETTE = (BLUE, ORANGE, GREEN, RED, PURPLE, SKY, OLIVE, GREY)
