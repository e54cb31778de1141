"""Records of executions in simulation and of detectors tried on them; never how they are shown."""
