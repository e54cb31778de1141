"""What bears the parts of a product as it stands on the table, in the end and on the way there."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from skillplan_cad.product import Product, Vector
from skillplan_cad.relation import Relation
from skillplan_cad.writing.upright import Upright

# A face looks down where its normal does by so much; and straight down.
_DOWN, _FLAT = 0.1, 0.999
_KINDS = ("plane", "cylinder", "thread", "free")
_GROUND_M = 1e-4


class Bearing:
    """Which parts lie on which, and which on the table.

    Parameters
    ----------
    product, relation
        Parts, and where they touch.
    upright
        How the product stands.
    """

    def __init__(self, product: Product, relation: Relation, upright: Upright) -> None:
        self._heights = {part.name: upright.bottom(part)[2] for part in product}
        self._contacts = [
            (contact.parts, [upright.vector(normal) for normal in contact.normals], contact.kind)
            for contact in relation.contacts
        ]

    def height_m(self, part: str) -> float:
        """Return how far the lowest point of a part is above the table [m]."""
        return self._heights[part]

    def flat_on(self, part: str) -> list[str]:
        """Return what a part lies on with a face that is level."""
        return self._beneath(part, _FLAT, ("plane",))

    def hangs_in(self, part: str) -> list[str]:
        """Return what a part touches, from wherever."""
        pairs = [parts for parts, _, _ in self._contacts if part in parts]
        return [one if other == part else other for one, other in pairs]

    def borne(self, parts: Iterable[str]) -> list[str]:
        """Return which of some parts lie on the table, or on others of these that do."""
        left = list(parts)
        while True:
            kept = [part for part in left if self.is_borne(part, left)]
            if len(kept) == len(left):
                return kept
            left = kept

    def is_borne(self, part: str, others: Sequence[str]) -> bool:
        """Whether a part lies on the table or on any of some others."""
        if self._heights[part] < _GROUND_M:
            return True
        beneath = self._beneath(part, _DOWN)
        return any(other in beneath for other in others if other != part)

    def waits_for(self, order: Sequence[str]) -> Mapping[str, str]:
        """Return for each part that lies on nothing when it comes what later bears it.

        Parameters
        ----------
        order
            Names of parts as they come.
        """
        found: dict[str, str] = {}
        for number, part in enumerate(order):
            if not self.is_borne(part, order[:number]):
                beneath = self._beneath(part, _DOWN)
                later = [other for other in order[number:] if other in beneath]
                if later:
                    found[part] = later[0]
        return found

    def _beneath(self, part: str, least: float, kinds: Sequence[str] = _KINDS) -> list[str]:
        found = []
        for (one, other), normals, kind in self._contacts:
            if part not in (one, other) or kind not in kinds:
                continue
            # Normals look out of the first of both.
            sign = -1.0 if part == one else 1.0
            if any(sign * _height(normal) > least for normal in normals):
                found.append(other if part == one else one)
        return found


def _height(vector: Vector) -> float:
    return vector[2]
