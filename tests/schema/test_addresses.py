"""Addresses as scenes write them: HOST:PORT, with brackets round what has colons of its own."""

from __future__ import annotations

import pytest

from itouch.plugin import schema


@pytest.mark.parametrize(
    ("text", "port", "expected"),
    [
        ("localhost:502", None, ("localhost", 502)),
        ("t7.lab", 502, ("t7.lab", 502)),
        ("t7.lab:503", 502, ("t7.lab", 503)),
        ("[::1]:80", None, ("::1", 80)),
        ("[fe80::2]", 502, ("fe80::2", 502)),
    ],
)
def test_host_and_port(text: str, port: int | None, expected: tuple[str, int]) -> None:
    assert schema.host_port(text, port=port) == expected


@pytest.mark.parametrize("port", [None, 502])
@pytest.mark.parametrize(
    "text", ["", ":", ":80", "a:", "a:0", "a:65536", "a:²", "a:٣", "a:-1", "a: 1", "a b:1", "::1", "::1:80", "[]:1", "[a:1", "[]"]
)  # fmt: skip
def test_a_bad_address_is_refused(text: str, port: int | None) -> None:
    with pytest.raises(ValueError, match="must be HOST"):
        schema.host_port(text, port=port)


def test_without_a_usual_port_it_must_be_written() -> None:
    with pytest.raises(ValueError, match="'localhost' must be HOST:PORT"):
        schema.host_port("localhost")
