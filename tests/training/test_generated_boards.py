"""Families of boards at random: what the words mean, and that boards are the same again."""

import pytest

from skillplan.errors import OptionError
from skillplan.training import GeneratedFamily


def test_a_family_is_a_range_of_parts():
    assert GeneratedFamily(6, 12) == GeneratedFamily.parse("generated:6-12")
    assert GeneratedFamily(8, 8) == GeneratedFamily.parse("generated:8")
    assert "generated:6-12" == str(GeneratedFamily(6, 12))


@pytest.mark.parametrize("text", ["generated:", "generated:a-b", "generated:6-12-14", "drawn:6"])
def test_other_words_are_refused_with_an_example(text):
    with pytest.raises(OptionError, match="such as generated:6-12"):
        GeneratedFamily.parse(text)


@pytest.mark.parametrize("text", ["generated:0-3", "generated:9-8", "generated:6-999"])
def test_ranges_that_no_board_has_are_refused(text):
    with pytest.raises(OptionError, match="LEAST-MOST with"):
        GeneratedFamily.parse(text)


def test_boards_lie_in_the_family_and_are_the_same_again():
    family = GeneratedFamily(3, 6)
    boards = list(family.boards(40, 2))
    assert {3, 4, 5, 6} == {board.parts for board in boards}
    assert all(1 <= board.tools <= 4 and 0.1 <= board.density <= 0.5 for board in boards)
    assert boards == list(family.boards(40, 2))
    assert boards[:7] == list(family.boards(7, 2))


def test_two_seeds_share_no_board():
    family = GeneratedFamily(3, 6)
    seeds = [{board.seed for board in family.boards(40, seed)} for seed in (0, 1, 2**32)]
    assert 120 == len(set.union(*seeds))


def test_tasks_are_those_of_the_boards():
    family = GeneratedFamily(3, 4)
    for board, task in zip(family.boards(3, 0), family.tasks(3, 0), strict=True):
        assert board.task_name == task.name
        assert board.parts == len(task.operations)
