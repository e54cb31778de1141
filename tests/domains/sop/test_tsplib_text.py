"""Reading TSPLIB files: both forms, what is refused and where, and that nothing else is raised."""

from __future__ import annotations

import random
import time
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from skillplan.domains.sop import SopDomain, read_tsplib, tsplib_file
from skillplan.errors import TaskError
from skillplan.pipeline import load_problem
from sop_instances import BEST_KNOWN, instance, instance_text, tsplib_text
from thinned import slow_case

SMALL = """NAME: small.sop
TYPE: SOP
COMMENT: four nodes
DIMENSION: 4
EDGE_WEIGHT_TYPE: EXPLICIT
EDGE_WEIGHT_FORMAT: FULL_MATRIX
EDGE_WEIGHT_SECTION
4
 0  2  3 9
-1  0  4 5
-1  6  0 7
-1 -1 -1 0
EOF
"""
BARE = SMALL.partition("SECTION\n4\n")[2].removesuffix("EOF\n")
COSTS = [[0, 2, 3, 9], [-1, 0, 4, 5], [-1, 6, 0, 7], [-1, -1, -1, 0]]
ENTRY = (
    "(a row for each node: what going on to each one costs, or -1 where that one comes before it)"
)
KNOWN = (
    "Known: COMMENT, DIMENSION, DISPLAY_DATA_TYPE, EDGE_WEIGHT_FORMAT, EDGE_WEIGHT_SECTION, "
    "EDGE_WEIGHT_TYPE, EOF, NAME, TYPE."
)


def spoilt(old: str, new: str, text: str = SMALL) -> str:
    """Return a text with one thing replaced, which must be there."""
    assert old in text
    return text.replace(old, new, 1)


def read(text: str) -> Any:
    return read_tsplib(text, "small.sop").data


def faults(tmp_path: Path, text: str | bytes) -> list[str]:
    """Return the lines of what is said to a file with a text, without its name."""
    path = tmp_path / "small.sop"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(TaskError) as caught:
        load_problem(path)
    return [line.removeprefix(str(path)).removeprefix(":").strip() for line in caught.value.lines()]


class TestForms:
    @pytest.mark.parametrize(
        "text",
        [
            SMALL,
            spoilt("SECTION\n4\n", "SECTION\n"),
            spoilt("EOF\n", ""),
            spoilt("EOF\n", "EOF\n\n \n"),
            spoilt("SECTION\n", "SECTION :\n"),
            spoilt("SECTION\n4\n", "SECTION: 4\n"),
            spoilt("TYPE: SOP", "type : sop"),
            spoilt("TYPE: SOP\n", ""),
            spoilt("COMMENT", "DISPLAY_DATA_TYPE: NO_DISPLAY\nCOMMENT"),
            spoilt("  3 9\n-1", "\n\n3\n9 -1"),
            spoilt("4\n 0", "4 0"),
            SMALL.replace("\n", "\r\n"),
            SMALL.replace("\n", "\r"),
            "\n\n" + SMALL,
            BARE,
            "4\n" + BARE,
            BARE + "EOF",
            " ".join(BARE.split()),
            "\n".join(BARE.split()),
            "4 " + "\n".join(BARE.split()),
            "\t".join(BARE.split()),
        ],
    )
    def test_a_matrix_reads_the_same_however_it_is_written(self, text):
        """With a header or bare, the dimension before it or not, wrapped anywhere."""
        assert COSTS == read(text)["costs"]

    def test_the_header_names_and_describes(self):
        """Without its suffix; of several comments, all."""
        text = spoilt("DIMENSION", "COMMENT: and more\nCOMMENT:\nDIMENSION")
        data = read(text)
        assert ("small", "four nodes and more") == (data["name"], data["description"])

    @pytest.mark.parametrize(
        ("name", "shown"),
        [("br17.10.sop", "br17.10"), ("my matrix (2)", "my_matrix_2_"), ("", "x"), ("...", "x")],
    )
    def test_a_name_is_made_of_what_names_are_made_of(self, name, shown):
        """Where nothing is left, the file's own."""
        document = read_tsplib(spoilt("small.sop", name), "folder/x.sop")
        assert shown == document.data["name"]

    def test_a_bare_matrix_is_called_after_its_file(self):
        """As it has no name of its own."""
        assert "ft53.1" == read_tsplib(BARE, "tsplib/ft53.1.sop").data["name"]

    def test_a_diagonal_entry_that_equals_the_dimension_is_one(self):
        """Where every row has a line of its own."""
        assert 4 == read(spoilt(" 0  2", " 4  2", BARE))["costs"][0][0]


CASES = {
    "unknown keyword": (
        spoilt("DIMENSION", "DIMENTION"),
        "4:1: unknown keyword 'DIMENTION'. Did you mean 'DIMENSION'?",
    ),
    "keyword of other problems": (
        spoilt("DIMENSION", "CAPACITY: 3\nDIMENSION"),
        f"4:1: unknown keyword 'CAPACITY'. {KNOWN}",
    ),
    "misspelt section": (
        spoilt("EDGE_WEIGHT_SECTION", "EDGE_WEIGHT_SECTON"),
        "7:1: unknown keyword 'EDGE_WEIGHT_SECTON'. Did you mean 'EDGE_WEIGHT_SECTION'?",
    ),
    "section left out": (
        spoilt("EDGE_WEIGHT_SECTION\n", ""),
        "7:1: numbers begin, but EDGE_WEIGHT_SECTION does not stand above them. Write it there.",
    ),
    "EOF in the header": (
        SMALL.partition("EDGE_WEIGHT_SECTION")[0] + "EOF\n",
        "7:1: EDGE_WEIGHT_SECTION is missing. Write it, and the matrix.",
    ),
    "cut off in the header": (
        SMALL[:60],
        "5:1: the file ends before EDGE_WEIGHT_SECTION. Write it, and the matrix.",
    ),
    "cut off after the header": (
        SMALL.partition("4\n 0")[0],
        "7:19: the 4 x 4 numbers are missing.",
    ),
    "cut off in the matrix": (
        SMALL.partition("-1 -1 -1")[0],
        "11:10: there are 12 numbers instead of 16, 4 x 4. The rest is missing.",
    ),
    "no dimension": (
        spoilt("DIMENSION: 4\n", ""),
        "6:1: DIMENSION is missing. Write 'DIMENSION: ' and the number of nodes.",
    ),
    "another dimension in the header": (
        spoilt("DIMENSION: 4", "DIMENSION: 5"),
        "8:1: this says 4 nodes, but DIMENSION says 5. Make them agree.",
    ),
    "another dimension in the section": (
        spoilt("\n4\n", "\n5\n"),
        "8:1: this says 5 nodes, but DIMENSION says 4. Make them agree.",
    ),
    "dimension one": (
        spoilt("DIMENSION: 4", "DIMENSION: 1"),
        "4:1: DIMENSION must be a whole number from 2 to 2000, not '1'.",
    ),
    "dimension too large": (
        spoilt("DIMENSION: 4", "DIMENSION: 2001"),
        "4:1: DIMENSION must be a whole number from 2 to 2000, not '2001'.",
    ),
    "dimension in words": (
        spoilt("DIMENSION: 4", "DIMENSION: four"),
        "4:1: DIMENSION must be a whole number from 2 to 2000, not 'four'.",
    ),
    "dimension without value": (
        spoilt("DIMENSION: 4", "DIMENSION"),
        "4:1: DIMENSION has no value. Write 'DIMENSION: ...'.",
    ),
    "keyword without colon": (
        spoilt("TYPE: SOP", "TYPE SOP"),
        "2:1: must be 'KEYWORD: value', EDGE_WEIGHT_SECTION or a number, not 'TYPE SOP'.",
    ),
    "keyword twice": (
        spoilt("TYPE: SOP\n", "TYPE: SOP\nTYPE: SOP\n"),
        "3:1: TYPE stands twice. Keep one.",
    ),
    "another type": (
        spoilt("TYPE: SOP", "TYPE: ATSP"),
        "2:1: TYPE must be SOP, not 'ATSP'. A task is a path on which some nodes come before "
        "others, by entries -1.",
    ),
    "costs by coordinates": (
        spoilt("EXPLICIT", "EUC_2D"),
        "5:1: EDGE_WEIGHT_TYPE must be EXPLICIT, not 'EUC_2D'. Write the costs out as numbers.",
    ),
    "half a matrix": (
        spoilt("FULL_MATRIX", "LOWER_DIAG_ROW"),
        "6:1: EDGE_WEIGHT_FORMAT must be FULL_MATRIX, not 'LOWER_DIAG_ROW'. Write every row out "
        "in full.",
    ),
    "a number too few": (
        spoilt("4 5\n", "4\n"),
        "10:1: there are 15 numbers instead of 16, 4 x 4. This line has 3 where 4 are needed.",
    ),
    "a number too few in a wrapped matrix": (
        spoilt("4 5\n", "4 ").replace("4\n 0", "4 0"),
        "11:1: there are 15 numbers instead of 16, 4 x 4. The rest is missing.",
    ),
    "a number too many": (
        spoilt("4 5\n", "4 5 6\n"),
        "10:1: there are 17 numbers instead of 16, 4 x 4. This line has 5 where 4 are needed.",
    ),
    "a row too few": (
        spoilt("-1  6  0 7\n", ""),
        "12:1: there are 12 numbers instead of 16, 4 x 4. The rest is missing.",
    ),
    "a row too many": (
        spoilt("-1  6  0 7\n", "-1  6  0 7\n-1  6  0 7\n"),
        "13:1: there are 20 numbers instead of 16, 4 x 4. Here is the first too many.",
    ),
    "bare and not square": (
        "1 2 3\n4 5 6\n",
        "1:1: 6 numbers make no square matrix. There are 2 lines of 3.",
    ),
    "bare and ragged": (
        spoilt("4 5\n", "4\n", BARE),
        "2:1: 15 numbers make no square matrix. This line has 3 where 4 are needed.",
    ),
    "bare with a dimension and too few": (
        "4\n" + spoilt("4 5\n", "4\n", BARE),
        "3:1: there are 15 numbers instead of 16, 4 x 4. This line has 3 where 4 are needed.",
    ),
    "a single number": ("7\n", f"1:1: costs: must have at least 2 entries, not 1 {ENTRY}."),
    "a word": (spoilt("6", "six"), "11:5: must be a number or EOF, not 'six'."),
    "a misspelt end": (spoilt("EOF", "EOFF"), "13:1: must be a number or EOF, not 'EOFF'."),
    "another section": (
        spoilt("EOF", "DISPLAY_DATA_SECTION\nEOF"),
        "13:1: must be a number or EOF, not 'DISPLAY_DATA_SECTION'.",
    ),
    "a decimal": (
        spoilt("6", "6.5"),
        "11:5: must be a whole number, not 6.5. Scale the costs until all are whole.",
    ),
    "an exponent": (
        spoilt("6", "1e3"),
        "11:5: must be a whole number, not 1e3. Scale the costs until all are whole.",
    ),
    "commas": (
        spoilt("-1  6  0 7", "-1,6,0,7"),
        "11:1: must be a number, not '-1,6,0,7'. Separate numbers by blanks.",
    ),
    "a sign by itself": (spoilt("6", "-"), "11:5: must be a number, not '-'."),
    "digits of another script": (spoilt("6", "٦"), "11:5: must be a number, not '٦'."),
    "digits with an underscore": (spoilt("6", "1_0"), "11:5: must be a number, not '1_0'."),
    "below -1": (spoilt("6", "-2"), f"11:5: costs[2][1]: must be >= -1, not -2 {ENTRY}."),
    "too large": (
        spoilt("6", "1099511627777"),
        f"11:5: costs[2][1]: must be <= 1099511627776, not 1099511627777 {ENTRY}.",
    ),
    "endless digits": (
        spoilt("6", "9" * 5000),
        "11:5: a number of 5000 digits is too large; 1,099,511,627,776 is the most.",
    ),
    "a circle": (
        spoilt("-1  0  4 5\n-1  6  0 7", "-1  0 -1 5\n-1 -1  0 7"),
        "11:4: costs[2][1]: the order has a cycle: node 1 before 2 before 1. Write a "
        "cost for one of these -1.",
    ),
    "something before the start": (
        spoilt(" 0  2", " 0 -1"),
        "9:4: costs[0][1]: node 1 cannot come before node 0, where one starts. Write a cost, >= 0.",
    ),
    "something after the end": (
        spoilt("4 5", "4 -1"),
        "10:10: costs[1][3]: node 3, the last, cannot come before node 1. Write a cost, >= 0.",
    ),
    "an end that need not be": (
        spoilt("-1 -1 -1 0", "-1  3 -1 0"),
        "12:5: costs[3][1]: node 3, the last, must come after all others, but need not come after "
        "node 1. Write -1 there in its row.",
    ),
    "no order at all": (
        spoilt("-1 -1 -1 0", "1 1 1 0", BARE).replace("-1", "1"),
        "4:3: costs[3][1]: node 3, the last, must come after all others, but need not come after "
        "nodes 1, 2. Write -1 there in its row.",
    ),
    "something after EOF": (
        SMALL + "5\n",
        "14:1: nothing may follow EOF, but '5' does. Remove it.",
    ),
    "empty": (
        "",
        "1:1: is empty. Give a TSPLIB header and EDGE_WEIGHT_SECTION, or a square matrix.",
    ),
    "blank": (
        "\n \n",
        "1:1: is empty. Give a TSPLIB header and EDGE_WEIGHT_SECTION, or a square matrix.",
    ),
    "prose": (
        "Expensive all,\nhere it is.\n",
        "1:1: must be 'KEYWORD: value', EDGE_WEIGHT_SECTION or a number, not 'Expensive all,'.",
    ),
    "YAML": (
        "kind: sop\nname: x\ncosts:\n- [0, 1]\n- [-1, 0]\n",
        "1:1: this is YAML, it seems. Let the file's name end in .yaml.",
    ),
    "a control character": (
        spoilt("small.sop", "sma\0l"),
        "1:10: character U+0000 is not allowed in a .sop file. Remove it.",
    ),
    "binary": (
        b"\x89PNG\r\n" + bytes(range(256)),
        "1:1: byte 0x89 is not UTF-8. Save the file as UTF-8.",
    ),
    "too many bytes": (
        " " * (16 * 2**20 + 1),
        "is larger than the 16,777,216 bytes that a task file may have.",
    ),
}


@pytest.mark.parametrize(("text", "message"), CASES.values(), ids=CASES)
def test_a_malformed_file_is_one_clear_message(tmp_path, text, message):
    """Where, what, and what instead."""
    assert [message] == faults(tmp_path, text)


@pytest.mark.parametrize(
    "most", [3, slow_case(2000, reason="four million numbers; 16 in every run")]
)
def test_too_many_nodes_are_one_clear_message(tmp_path, monkeypatch, most):
    """Said before anything is made of the numbers; a lower limit is put in its place."""
    assert most in (3, tsplib_file.MOST_NODES)
    monkeypatch.setattr(tsplib_file, "MOST_NODES", most)
    n = most + 1
    message = f"1:1: the matrix is {n} x {n}; at most {most} nodes can be ordered."
    assert [message] == faults(tmp_path, "0 " * n**2)


def test_several_faults_are_told_at_once(tmp_path):
    """In the order of their lines."""
    text = spoilt("DIMENSION", "DIMENTION", spoilt("TYPE: SOP", "TYPE: TSP"))
    places = [line.partition(" ")[0] for line in faults(tmp_path, text)]
    assert ["2:1:", "4:1:"] == places


@pytest.mark.parametrize("name", BEST_KNOWN)
def test_a_published_file_reads_alike_in_every_form(name):
    """Also bare, and wrapped at random."""
    costs = instance(name).config.costs  # type: ignore[attr-defined]
    numbers = instance_text(name).partition("EDGE_WEIGHT_SECTION")[2].removesuffix("EOF\n").split()
    draw = random.Random(name)
    wrapped = "".join(number + draw.choice((" ", "  ", "\n")) for number in numbers)
    assert costs == read(wrapped)["costs"]
    assert costs == read(tsplib_text(costs))["costs"]


@st.composite
def matrices(draw: st.DrawFn) -> list[list[int]]:
    """Any costs, and -1 where a random order has it, closed or not."""
    n = draw(st.integers(2, 9))
    inner = draw(st.permutations(range(1, n - 1)))
    place = {node: i for i, node in enumerate((0, *inner, n - 1))}
    cost = st.one_of(st.integers(0, 20), st.integers(0, 2**40))
    rows = [[draw(cost) for _ in range(n)] for _ in range(n)]
    for i in range(n):
        for j in range(n):
            if place[j] < place[i] and (j == 0 or i == n - 1 or draw(st.booleans())):
                rows[i][j] = -1
    return rows


@given(matrices(), st.booleans(), st.booleans())
def test_what_is_written_in_either_form_reads_back(costs, header, dimension):
    """Any square matrix whose order has no circle, and it is a task."""
    text = tsplib_text(costs, header=header, dimension=dimension)
    document = read_tsplib(text, "any.sop")
    assert costs == document.data["costs"]
    domain = SopDomain()
    config = domain.Config.model_validate(document.data)
    assert [] == list(domain.issues(config))
    (task,) = domain.ground(config, "")
    assert len(costs) - 1 == len(task.skills)


@given(
    st.one_of(
        st.text(max_size=60),
        st.lists(
            st.sampled_from(
                [*SMALL.split(), *"\n\r\t:+-", "4", "0", "9", "-7", "3.5", "1e9", "TYPE:", "X:"]
            ),
            max_size=40,
        ).map(" ".join),
        st.lists(st.sampled_from(SMALL.splitlines()), max_size=16).map("\n".join),
    )
)
def test_no_text_raises_anything_but_task_errors(text):
    """Whatever stands there is a task, or is refused in words with a place in the file."""
    domain = SopDomain()
    try:
        document = domain.read(text, "any.sop")
    except TaskError as error:
        lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
        for issue in error.issues:
            assert 1 <= issue.line <= len(lines)
            assert 1 <= issue.column <= len(lines[issue.line - 1]) + 1
            assert issue.message
        return
    costs = document.data["costs"]
    assert all(len(row) == len(costs) for row in costs)


@pytest.mark.slow(reason="a file of many nodes; small ones in every run")
def test_a_large_file_is_read_and_grounded_at_once(tmp_path):
    """380 nodes, as the largest of TSPLIB has: about 0.1 s; the limit leaves room for noise."""
    draw = random.Random(0)
    n = 380
    costs = [[draw.randrange(10_000) for _ in range(n)] for _ in range(n)]
    for i in range(n):
        costs[i][0] = -1
        for j in range(1, i):
            if i == n - 1 or draw.random() < 0.5:
                costs[i][j] = -1
    path = tmp_path / "large.sop"
    path.write_text(tsplib_text(costs))
    began = time.perf_counter()
    problem = load_problem(path)
    took_s = time.perf_counter() - began
    assert n - 1 == len(problem.task.skills)
    assert 2.0 > took_s
