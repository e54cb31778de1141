"""Figures of the SwarmItFIX bench, the only figures that use its geometry."""
