"""How many examples a property test draws: a fifth in every run, all in the whole suite."""

from hypothesis import settings

FEWEST = 20


def examples(count: int) -> int:
    """Return how many examples to draw under the profile in force (see the root's conftest).

    Parameters
    ----------
    count
        Those of the profile `thorough` [-]; any other draws a fifth of them, but 20 at least.
    """
    if settings.get_current_profile_name() == "thorough":
        return count
    return max(min(count, FEWEST), count // 5)
