"""Positions and locomotion of bases, without the legs of the machine."""
