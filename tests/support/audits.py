"""An audit of a finished search, as searches do it."""

from skillplan.checks import Feasibility, ask_again, draw_reused


def audit(feasibility: Feasibility, size: int, seed: int, *, expensive: bool) -> int:
    """Check a sample of the reused verdicts again, and return its size."""
    drawn = draw_reused(feasibility, size, seed, expensive=expensive)
    ask_again(feasibility.back_ends, drawn)
    return len(drawn)
