"""How many examples a property test draws: few in every run, many in the whole suite."""

from hypothesis import settings


def examples(fast: int, thorough: int) -> int:
    """Return how many examples to draw under the profile in force (see the root's conftest).

    For tests whose examples are expensive; all others take the number of the profile itself.
    """
    return thorough if settings.get_current_profile_name() == "thorough" else fast
