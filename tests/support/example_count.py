"""How many examples a property test draws: a thirtieth in every run, more in the whole suite."""

from hypothesis import settings


def examples(count: int, fewest: int = 4) -> int:
    """Return how many examples to draw under the profile in force (see the root's conftest).

    Parameters
    ----------
    count
        Those of the profile `thorough` [-]; `whole` draws two fifths, others a thirtieth of them.
    fewest
        But not fewer than this many, if `count` is not below it [-].
    """
    shares = {"thorough": 1.0, "whole": 0.4}
    share = shares.get(settings.get_current_profile_name(), 1 / 30)
    return max(min(count, fewest), int(count * share))
