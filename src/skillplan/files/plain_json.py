"""Whether a value that a plugin hands over can be written as JSON."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any


def json_fault(value: Mapping[str, Any]) -> str | None:
    """Return why a mapping is not JSON, not-a-number and infinity included, or None if it is."""
    try:
        json.dumps(dict(value), allow_nan=False)
    except (TypeError, ValueError) as error:
        return str(error)
    return None
