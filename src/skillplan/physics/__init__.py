"""Physics engines: execute a skill's motion. They know tasks, never collision or solvers."""
