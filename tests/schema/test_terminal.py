"""What is printed: codes of what would act are read by Python, colours go round the kind of a line and nothing else."""

from __future__ import annotations

import ast
import io
import json
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from itouch.schema.terminal import _SPELLED, _UNSAFE, coloured, escaped, is_terminal, number_of, plain


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


SIGNS = "Ü 20 °C, 3 W/m², 5 µm × 2"


@pytest.mark.parametrize(
    ("encoding", "shown"),
    [
        ("utf-8", "Ü 20 °C, 3 W/m², 5 µm × 2"),
        ("latin-1", "Ü 20 °C, 3 W/m², 5 µm × 2"),
        ("cp437", "Ü 20 °C, 3 W/m², 5 µm x 2"),
        ("ascii", "\\u00dc 20 degC, 3 W/m^2, 5 um x 2"),
    ],
)
def test_what_an_encoding_does_not_have_is_spelled_as_in_a_scene(
    encoding: str, shown: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    inner = io.TextIOWrapper(io.BytesIO(), encoding=encoding, newline="")
    monkeypatch.setattr("sys.stdout", inner)
    with escaped():
        print(SIGNS, end="")
        print(SIGNS, end="", file=inner)  # as a library that draws on the terminal itself
    assert inner.buffer.getvalue().decode(encoding) == 2 * shown  # type: ignore[attr-defined]
    assert inner.errors == "strict"


@given(st.text(), st.sampled_from(["ascii", "latin-1", "cp1252", "cp932", "utf-8"]))
def test_any_text_can_be_printed_in_any_encoding_and_a_name_in_json_stays_what_it_is(text: str, encoding: str) -> None:
    names = "".join(each for each in plain(text) if each not in _SPELLED)
    shown = json.dumps(names, ensure_ascii=False).encode(encoding, "itouch.spelled")
    if encoding != "cp932":  # some of its signs are read as others
        assert json.loads(shown.decode(encoding)) == names
