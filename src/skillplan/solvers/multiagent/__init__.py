"""Plans for several agents that share ground; it never knows what the agents are."""
