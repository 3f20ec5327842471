"""Samples of a calibration are read from the files that people have; a study that is not there is one message."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from itouch.schema import ItouchError
from itouch_tools.cli import main
from itouch_tools.cli.calibrate import _samples


def read(folder: Path, text: str, *columns: str) -> list[list[float]]:
    (folder / "samples.csv").write_text(text, encoding="utf-8")
    options: Any = SimpleNamespace(samples=str(folder / "samples.csv"))
    return _samples(options, columns).tolist()  # type: ignore[no-any-return]


@pytest.mark.parametrize(
    "text",
    [
        "1 2\n3 4\n", "1,2\n3,4", "1; 2\n\n3; 4\n", "given read\n1 2\n3 4\n", "given,2nd\n1,2\n3,4\n",
        "# by hand\n1 2\n3 4\n",
    ],
)  # fmt: skip
def test_samples_may_have_a_heading_and_any_separator(tmp_path: Path, text: str) -> None:
    assert read(tmp_path, text, "given", "read") == [[1.0, 2.0], [3.0, 4.0]]


@pytest.mark.parametrize("text", ["reading\n1\n2\n", "1\n2\n"])
def test_samples_of_one_column(tmp_path: Path, text: str) -> None:
    assert read(tmp_path, text, "read") == [[1.0], [2.0]]


@pytest.mark.parametrize(("row", "number"), [("1 x", 2), ("1", 2), ("1 2 3", 2), ("nan 1", 2)])
def test_a_row_that_is_no_sample_is_told_with_its_number(tmp_path: Path, row: str, number: int) -> None:
    with pytest.raises(ItouchError, match=f"^sample {number} is '{row}', not 2 numbers: given, read"):
        read(tmp_path, f"given read\n1 2\n{row}\n", "given", "read")


@pytest.mark.parametrize("command", ["power", "audit"])
def test_a_study_that_is_not_there_is_one_message(
    tmp_path: Path, command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["study", command, str(tmp_path / "none.xml")]) == 2
    said = capsys.readouterr().err
    assert "none.xml" in said
    assert "Traceback" not in said
