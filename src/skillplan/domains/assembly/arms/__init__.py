"""Arms and tools as a task file says them; it never moves one."""
