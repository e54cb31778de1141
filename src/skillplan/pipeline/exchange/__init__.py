"""Plans handed to tools of others, read back from them, and judged by them."""
