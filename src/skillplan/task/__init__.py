"""Pure data: states, conditions, skills, scenes, tasks, and the loading of task files."""
