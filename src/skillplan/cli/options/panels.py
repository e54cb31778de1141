"""The panels of a command's help, in which its options stand."""

TASK, SOLVER, BACK_ENDS = "Task", "Solver", "Back ends"
OUTPUT = "Output"
