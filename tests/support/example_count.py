"""How many examples a property test draws: a tenth in every run, all in the whole suite."""

from hypothesis import settings


def examples(count: int, fewest: int = 6) -> int:
    """Return how many examples to draw under the profile in force (see the root's conftest).

    Parameters
    ----------
    count
        Those of the profile `thorough` [-]; any other draws a tenth of them.
    fewest
        But not fewer than this many, if `count` is not below it [-].
    """
    if settings.get_current_profile_name() == "thorough":
        return count
    return max(min(count, fewest), count // 10)
