"""Records of training runs: folders, metrics, policies and outcomes; never how they are shown."""
