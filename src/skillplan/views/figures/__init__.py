"""Records as figures that any kind of task may have; never a domain by name."""
