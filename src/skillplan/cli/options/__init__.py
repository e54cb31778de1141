"""Options of commands: those that several share, and how their values are read."""
