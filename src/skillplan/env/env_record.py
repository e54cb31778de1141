"""Where one place of a vectorised environment is, as JSON values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from skillplan.model.skill_model import SkillModel


@dataclass(frozen=True)
class PlaceRecord:
    """All that a place goes on from.

    Parameters
    ----------
    model
        Number of the model that is done there.
    bits
        The state's.
    steps
        Steps done in the episode.
    generator
        The place's random numbers.
    """

    model: int
    bits: int
    steps: int
    generator: np.random.Generator

    def document(self) -> dict[str, Any]:
        """Return it as JSON values; whole numbers of any length are in hexadecimal."""
        numbers: Any = self.generator.bit_generator.state
        return {
            "model": self.model,
            "facts": hex(self.bits),
            "steps": self.steps,
            "generator": {
                "state": hex(numbers["state"]["state"]),
                "increment": hex(numbers["state"]["inc"]),
                "half_left": int(numbers["has_uint32"]),
                "half": int(numbers["uinteger"]),
            },
        }

    @classmethod
    def read(cls, document: Mapping[str, Any], models: Sequence[SkillModel]) -> PlaceRecord:
        """Return the record of a document.

        Parameters
        ----------
        document
            What `document` returned.
        models
            Those of the environment.

        Raises
        ------
        ValueError
            If it is none, or of other models.
        """
        try:
            model, steps = int(document["model"]), int(document["steps"])
            bits = int(document["facts"], 16)
            numbers = document["generator"]
            generator = np.random.Generator(np.random.PCG64())
            generator.bit_generator.state = {
                "bit_generator": "PCG64",
                "state": {
                    "state": int(numbers["state"], 16),
                    "inc": int(numbers["increment"], 16),
                },
                "has_uint32": int(numbers["half_left"]),
                "uinteger": int(numbers["half"]),
            }
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            raise ValueError(f"This is no state of a place: {error!r}.") from None
        if not 0 <= model < len(models) or not 0 <= steps < models[model].step_limit:
            raise ValueError("This is the state of a place of other tasks.")
        models[model].task.facts.state(bits)
        return cls(model, bits, steps, generator)
