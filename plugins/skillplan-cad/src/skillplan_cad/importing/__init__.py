"""The command `skillplan import-cad`: its stages, their cache, and its output files."""
