"""Figures of the SwarmItFIX bench, the only ones that know its geometry."""
