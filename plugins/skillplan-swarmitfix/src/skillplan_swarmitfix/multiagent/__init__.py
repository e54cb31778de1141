"""Multi-agent path finding (MAPF), independent of the kind of agents."""
