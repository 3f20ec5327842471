"""What a participant's keys do, without a screen: go on from a page, choose, type a number, stop."""

from __future__ import annotations

import importlib
from typing import Any

import pyglet
import pytest

pyglet.options.shadow_window = False  # as where pictures are drawn without a window
key: Any = importlib.import_module("pyglet.window").key
AskingWindow = importlib.import_module("itouch_tools.viewer.participant_window").AskingWindow


def window(*page: str) -> Any:
    """Return a window that has not been opened."""
    made: Any = object.__new__(AskingWindow)
    made._face, made._choices, made._typed, made._asking, made._chosen = "shown", (), "", False, 0
    made.page, made.answer, made.stopped = page, "", False
    return made


@pytest.mark.parametrize("symbol", [key.ENTER, key.RETURN, key.NUM_ENTER, key.SPACE])
def test_a_page_of_instructions_is_left_by_enter_or_space_and_nothing_is_answered(symbol: int) -> None:
    asked = window("Put your finger on the plate.")
    asked.ask(("warm", "cold"))
    asked.on_key_press(symbol, 0)
    assert (asked.page, asked._face, asked.answer) == ((), None, "")
    asked.on_key_press(symbol, 0)
    assert asked.take() == "warm"


@pytest.mark.parametrize("symbol", [key.A, key.RIGHT, key._2, key.BACKSPACE])
def test_no_other_key_leaves_it(symbol: int) -> None:
    asked = window("Put your finger on the plate.")
    asked.on_key_press(symbol, 0)
    assert (asked.page, asked._face) == (("Put your finger on the plate.",), "shown")


@pytest.mark.parametrize(
    ("symbols", "answer"),
    [
        ((key._2,), "cold"), ((key.NUM_3,), "same"), ((key._4,), ""), ((key.RIGHT, key.ENTER), "cold"),
        ((key.LEFT, key.SPACE), "same"), ((key.TAB, key.DOWN, key.DOWN, key.ENTER), "warm"),
    ],
)  # fmt: skip
def test_a_choice_is_made_by_its_number_or_by_arrows(symbols: tuple[int, ...], answer: str) -> None:
    asked = window()
    asked.ask(("warm", "cold", "same"))
    for symbol in symbols:
        asked.on_key_press(symbol, 0)
    assert asked.take() == answer
    asked.on_key_press(key._1, 0)
    assert asked.take() == ("" if answer else "warm"), "a question is answered once"


def test_a_number_is_typed_mended_and_ended_by_enter() -> None:
    asked = window()
    asked.ask(())
    asked.on_key_press(key.ENTER, 0)
    assert asked.take() == "", "nothing was typed yet"
    for letter in ("3", "x", "7", ".", "5"):
        asked.on_text(letter)
    asked.on_key_press(key.BACKSPACE, 0)
    asked.on_key_press(key.ENTER, 0)
    assert asked.take() == "37."


def test_escape_asks_to_stop_also_on_a_page() -> None:
    asked = window("Welcome.")
    asked.on_key_press(key.ESCAPE, 0)
    assert asked.stopped and asked.page == ("Welcome.",)
