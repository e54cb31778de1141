"""Jobs into an order at the least cost: the sequential ordering problem, compiled."""
