"""What every plugin's options owe the command line."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel


def assert_options_described(plugin: type[Any]) -> None:
    """Assert that every option says what it is, so that the command line can.

    Raises
    ------
    AssertionError
        If a field has no description.
    """
    model: type[BaseModel] = plugin.Options
    for name, field in model.model_fields.items():
        assert field.description, f"option {name!r} of {plugin.name!r} has no description"
