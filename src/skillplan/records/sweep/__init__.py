"""Records of parameter studies: what was varied and what came of it; never how it is shown."""
