"""Records of parameter studies: plans and results, never tables."""
