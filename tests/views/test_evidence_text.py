"""Evidence in one line."""

import pytest

from skillplan.views import format_evidence


@pytest.mark.parametrize(
    ("evidence", "text"),
    [
        ({}, ""),
        (
            {"force_n": 12.3456, "bodies": ["left finger", "pcb"]},
            "force_n 12.35, bodies left finger pcb",
        ),
        ({"sensed": {"held": True, "jaw_width_m": 0.0}}, "sensed (held yes, jaw_width_m 0)"),
        ({"moved_mm": {}, "bodies": []}, "moved_mm none, bodies none"),
        ({"offset_m": [-0.0, 0.25]}, "offset_m 0 0.25"),
        ({"tool": None, "steps": 1042}, "tool unknown, steps 1042"),
    ],
)
def test_it_reads_well(evidence, text):
    """Figures of four digits, lists with blanks, what belongs to one thing in brackets."""
    assert text == format_evidence(evidence)
