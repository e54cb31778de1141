"""Milling paths and workpieces, from YAML, DXF, CSV and G-code; never a bench."""
