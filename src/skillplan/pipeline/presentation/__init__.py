"""What is worked out of a task and its plan for who shows it; it decides nothing."""
