"""Damaged recordings: the longest valid prefix, no invented sample, the loss is stated, nothing crashes."""

from __future__ import annotations

import random
from pathlib import Path

import numpy as np
import pytest
from campaign import size, tell
from made import written

import itouch
from itouch.recording.reader import Content, parse
from itouch.recording.recording import Recording
from itouch.recording.writer import MAGIC
from itouch_tools.cli.recover import recover

DATA, ENDS, ROWS = written(chunks=size(8, 30))


def ends_of_chunks() -> list[int]:
    """Where the chunks with rows end in the file, twenty rows each; the first chunk has none."""
    at, found = len(MAGIC), []
    while DATA[at] != 0x0F:
        end = at + 9 + int.from_bytes(DATA[at + 1 : at + 9], "little")
        found += [end] if DATA[at] == 6 else []
        at = end
    return found[1:]


CHUNK_ENDS = ends_of_chunks()


def rows_before(place: int) -> int:
    return 20 * sum(end <= place for end in CHUNK_ENDS)


def check_prefix(content: Content, least: int) -> None:
    """What was read is the begin of what was written, to the bit, and at least so much."""
    found = content.rows["probe"]
    assert found.tobytes() == ROWS[: len(found)].tobytes()
    assert len(found) >= least
    assert [int(m["payload"]) for m in content.letters.get("/log/marks", [])] == list(range(len(found) // 20))


def test_an_undamaged_recording_is_whole() -> None:
    content = parse("x", DATA, len(DATA))
    assert Recording(content).whole
    check_prefix(content, len(ROWS))


@pytest.mark.campaign
def test_a_cut_in_the_last_64_kib_keeps_the_rows_before_it() -> None:
    assert len(DATA) > size(20_000, 65536 + 20_000)
    last = min(65536, len(DATA) - ENDS[2])
    step = size(97, 1)
    tried = 0
    for cut in range(len(DATA) - last, len(DATA), step):
        content = parse("x", DATA[:cut], cut)
        check_prefix(content, rows_before(cut))
        assert len(content.rows["probe"]) == rows_before(cut)
        recording = Recording(content)
        assert recording.losses
        assert not recording.whole
        tried += 1
    tell(f"cut at {tried} of the last {last} bytes: every prefix whole, every loss stated")


@pytest.mark.campaign
def test_single_bit_flips_lose_no_earlier_row() -> None:
    generator, stated, nothing = random.Random(7), 0, 0
    for _ in range(size(300, 10_000)):
        place, bit = generator.randrange(len(DATA)), generator.randrange(8)
        broken = bytearray(DATA)
        broken[place] ^= 1 << bit
        try:
            content = parse("x", bytes(broken), len(broken))
        except itouch.RecordingError as error:
            assert place < ENDS[2], f"byte {place} bit {bit}: {error}"
            nothing += 1
            continue
        check_prefix(content, rows_before(place))
        if len(content.rows["probe"]) < len(ROWS):
            assert content.losses
            stated += 1
    tell(f"bit flips: {stated} lost a part and said so, {nothing} hit the head, the others lost nothing")


def test_two_chunks_swapped_or_one_missing() -> None:
    """Chunks that are right by themselves but not in their place are not believed."""
    first, second, third = ENDS[7], ENDS[8], ENDS[9]
    missing = DATA[:first] + DATA[second:]
    content = parse("x", missing, len(missing))
    check_prefix(content, 100)
    assert len(content.rows["probe"]) == 100
    swapped = DATA[:first] + DATA[second:third] + DATA[first:second] + DATA[third:]
    content = parse("x", swapped, len(swapped))
    assert len(content.rows["probe"]) == 100
    assert content.losses


@pytest.mark.parametrize("part", [0.2, 0.5, 0.93, 0.999])
def test_recover_makes_a_whole_file(part: float, tmp_path: Path) -> None:
    from mcap.reader import make_reader

    broken, mended = tmp_path / "b.mcap", tmp_path / "m.mcap"
    cut = int(ENDS[4] + part * (len(DATA) - ENDS[4]))
    broken.write_bytes(DATA[:cut])
    found = recover(str(broken), str(mended))
    assert found.losses
    recording = itouch.read(mended)
    assert recording.whole
    assert np.array_equal(recording["probe"], ROWS[: rows_before(cut)])
    assert recording.attachments == {"scene.xml": b"<itouch/>"}
    with open(mended, "rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        count = sum(1 for _ in reader.iter_messages(topics=["/probe"]))
        assert count == rows_before(cut)
    assert [path.name for path in tmp_path.iterdir() if path.suffix == ".part"] == []


def test_files_that_are_no_recordings_are_refused(tmp_path: Path) -> None:
    for name, data in (("a", b""), ("b", b"hello"), ("c", MAGIC), ("d", MAGIC + bytes(200)), ("e", DATA[: ENDS[1]])):
        path = tmp_path / f"{name}.mcap"
        path.write_bytes(data)
        with pytest.raises(itouch.RecordingError, match=str(path)):
            itouch.read(path)
    with pytest.raises(itouch.RecordingError, match="No such file"):
        itouch.read(tmp_path / "none.mcap")
