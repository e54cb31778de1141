"""One search of one solver: its call, here or apart, and what is asked before and after it."""
