"""Multi-agent path finding (MAPF): plans for several agents; it never knows what the agents are."""
