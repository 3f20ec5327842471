"""What is printed: codes of what would act are read by Python, colours go round the kind of a line and nothing else."""

from __future__ import annotations

import ast
import io
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from itouch.schema.terminal import _UNSAFE, coloured, is_terminal, number_of, plain


@given(st.characters().filter(_UNSAFE.match))
def test_the_code_of_a_character_that_acts_is_one_that_python_reads(character: str) -> None:
    shown = plain(f"a{character}b")
    assert shown.isascii() and shown.isprintable()
    assert ast.literal_eval(f'"{shown}"') == f"a{character}b"


@pytest.mark.parametrize(
    ("line", "shown"),
    [
        ("warning[plate]: dew", "<1;33 warning[plate]:> dew"),
        ("a.xml:3:1: error: no such unit", "<1;31 a.xml:3:1: error:> no such unit"),
        ("  --> a.xml:3", "<34   --> >a.xml:3"),
        ("     |    ^^^ here", "<34      | >   <1;31 ^^^ here>"),
        ("a.xml: ok (2 objects)", "a.xml: <32 ok> (2 objects)"),
        ("ok", "ok"),
    ],
)
def test_colours_go_round_the_kind_of_a_line(line: str, shown: str) -> None:
    found = re.sub(r"\x1b\[([1-9][0-9;]*)m", r"<\1 ", coloured(f"before\n{line}\nafter")).replace("\x1b[0m", ">")
    assert found == f"before\n{shown}\nafter"


@pytest.mark.parametrize("error", [ValueError("closed"), OSError("gone")])
def test_a_stream_that_cannot_say_is_no_terminal(error: Exception) -> None:
    class Stream(io.StringIO):
        def isatty(self) -> bool:
            raise error

    assert not is_terminal(Stream())


def test_what_is_counted_is_in_singular_or_plural() -> None:
    assert number_of(1, "fault") == "1 fault"
    assert (number_of(0, "fault"), number_of(2, "fault")) == ("0 faults", "2 faults")
    assert (number_of(1, "touch", "touches"), number_of(3, "touch", "touches")) == ("1 touch", "3 touches")
