"""The straight line: set a task up, make its model, solve it, have it judged, certify it."""
