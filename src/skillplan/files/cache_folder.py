"""Where what took long to work out is kept between runs."""

from __future__ import annotations

import os
from pathlib import Path


def cache_folder() -> Path:
    """Return the folder: ``SKILLPLAN_CACHE_DIR``, or the user's cache."""
    chosen = os.environ.get("SKILLPLAN_CACHE_DIR")
    if chosen:
        return Path(chosen)
    from platformdirs import user_cache_path

    return user_cache_path("skillplan")
