"""Records of simulations and of comparisons of back ends; never tables."""
