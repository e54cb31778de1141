"""`skillplan import-cad`: its stages, what is kept of them, and what is written."""
