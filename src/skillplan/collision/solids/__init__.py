"""True shapes at their poses, not boxes: how far one falls onto another, how deep they overlap."""
