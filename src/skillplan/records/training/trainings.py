"""Several trainings side by side: the document ``skillplan.trainings/1``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from skillplan.records import schemas
from skillplan.records.training.result import TrainingResult


def trainings_document(results: Sequence[TrainingResult]) -> dict[str, Any]:
    """Return the document: a training's own for each."""
    return {"schema": schemas.TRAININGS, "rows": [one.document() for one in results]}
