"""The detector `contact-pairs`, which reads pybullet where no engine is beside it."""

from __future__ import annotations

from skillplan_pinocchio.simulation import contact_pairs
from skillplan_pybullet.engine import PybulletEngine


class ContactPairsDetector(contact_pairs.ContactPairsDetector):
    """A verdict on forces between bodies that should not touch, and on bodies pushed aside."""

    __doc__ = contact_pairs.ContactPairsDetector.__doc__

    engine_alone = PybulletEngine
