"""Training runs on the command line: train, evaluate and draw them."""
