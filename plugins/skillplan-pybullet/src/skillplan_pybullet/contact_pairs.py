"""Where `contact-pairs` was before it came to read every engine."""

from skillplan_pinocchio.simulation.contact_pairs import ContactPairsDetector

__all__ = ["ContactPairsDetector"]
