"""Frames and boot streams: bytes worked out by hand, then anything at all."""

from __future__ import annotations

import random
import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from itouch_usb_arm import boot
from itouch_usb_arm.virtual import VirtualBackend, VirtualFalcon, VirtualTime, descriptors
from itouch_usb_arm.wire import Buttons, Leds, Scanner, command, decode, encode, reply_of

INT16 = st.integers(-32768, 32767)


def test_a_command_frame_equals_one_by_hand() -> None:
    # 1 = 0x0001 -> B A A A; -2 = 0xFFFE -> O P P P; 4095 = 0x0FFF -> P P P A; homing and red = 9 -> 0x4a = J.
    assert command((1, -2, 4095), homing=True, leds=Leds.RED) == b"<BAAAOPPPPPPAJA>"
    assert command((0, 0, 0), homing=False, leds=Leds.OFF) == b"<AAAAAAAAAAAAAA>"


def test_a_reply_frame_equals_one_by_hand() -> None:
    # 0x1234 -> E D C B; -1 -> P P P P; 0 -> A A A A; centre button, all homed = 0x74 -> 0x41 + 0x74 = 0xb5.
    reply = reply_of(decode(b"<EDCBPPPPAAAA\xb5A>"))
    assert reply.encoders == (0x1234, -1, 0)
    assert reply.buttons == Buttons.CENTRE == 4
    assert reply.homed == (True, True, True)


@given(st.tuples(INT16, INT16, INT16), st.integers(0, 127))
def test_frames_are_decoded_as_they_were_encoded(values: tuple[int, int, int], info: int) -> None:
    assert decode(encode(values, info)) == (values, info)


@pytest.mark.parametrize(
    "frame",
    [b"", b"<AAAAAAAAAAAAAA", b"[AAAAAAAAAAAAAA>", b"<AAAAAAAAAAAAAA]", b"<AAAAQAAAAAAAAA>", b"<AAAAAAAAAAAA@A>",
     b"<AAAAAAAAAAAA\xc1A>", b"<@AAAAAAAAAAAAA>"],
)  # fmt: skip
def test_malformed_frames_are_refused(frame: bytes) -> None:
    with pytest.raises(ValueError, match="frame"):
        decode(frame)


def test_a_motor_beyond_the_limit_is_refused() -> None:
    with pytest.raises(ValueError, match="-4095 to 4095"):
        command((0, 4096, 0), homing=True, leds=Leds.OFF)


@settings(max_examples=200, deadline=None)
@given(st.lists(st.tuples(INT16, INT16, INT16), max_size=6), st.integers(0, 2**32))
def test_the_scanner_finds_every_whole_frame_in_any_stream(values: list[tuple[int, int, int]], seed: int) -> None:
    """Garbage between frames that holds no '<' costs no frame; pieces may come in any size."""
    rng = random.Random(seed)
    stream = b""
    for triple in values:
        stream += bytes(rng.choice(b"AP>\x00\xff") for _ in range(rng.randrange(20))) + encode(
            triple, rng.randrange(128)
        )
    scanner, found = Scanner(), []
    while stream:
        size = rng.randrange(1, 20)
        found += scanner.feed(stream[:size])
        stream = stream[size:]
    assert [numbers.values for numbers in found] == values


@settings(max_examples=300, deadline=None)
@given(st.tuples(INT16, INT16, INT16), st.integers(0, 15))
def test_a_frame_that_lost_a_byte_is_passed_over_and_the_next_one_found(values: tuple[int, int, int], at: int) -> None:
    scanner = Scanner()
    whole = encode(values, 0x70)
    assert scanner.feed(whole[:at] + whole[at + 1 :]) == []
    assert [numbers.values for numbers in scanner.feed(encode((1, 2, 3), 0))] == [(1, 2, 3)]
    assert scanner.skipped > 0
    assert scanner.pending == 0


@given(st.binary(max_size=200))
def test_the_scanner_survives_any_bytes(data: bytes) -> None:
    scanner = Scanner()
    frames = scanner.feed(data)
    assert scanner.skipped + scanner.pending + 16 * len(frames) == len(data)
    assert scanner.pending < 16


BLOCKS = [boot.Block(0x3F8000, (1, 2, 3)), boot.Block(0x8000, (0xFFFF,))]


def test_a_boot_stream_equals_one_by_hand() -> None:
    stream = boot.build([boot.Block(0x3F8000, (0x1234,))], entry=0x3F8002)
    assert stream == (
        b"\xaa\x08" + bytes(16) + b"\x3f\x00\x02\x80" + b"\x01\x00" + b"\x3f\x00\x00\x80" + b"\x34\x12" + b"\x00\x00"
    )
    image = boot.parse(stream)
    assert image.entry == 0x3F8002
    assert image.blocks == (boot.Block(0x3F8000, (0x1234,)),)


def test_a_leading_autobaud_letter_is_not_sent_twice() -> None:
    stream = boot.build(BLOCKS, entry=0)
    assert boot.parse(b"A" + stream) == boot.parse(stream)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda s: b"", "begins with nothing"),
        (lambda s: b"MZ" + s[2:], "begins with 4d 5a"),
        (lambda s: s[:-1], "ends at byte"),
        (lambda s: s[:30], "in the middle of"),
        (lambda s: s + b"x", "1 bytes follow"),
        (lambda s: s[:22] + b"\0\0", "no block"),
    ],
)
def test_a_file_that_is_no_boot_stream(change: object, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        boot.parse(change(boot.build(BLOCKS, entry=0x3F8002)))  # type: ignore[operator]


@given(st.binary(max_size=120))
def test_any_file_is_an_image_or_an_error(data: bytes) -> None:
    try:
        image = boot.parse(b"\xaa\x08" + bytes(20) + data)
    except ValueError:
        return
    assert boot.build(image.blocks, entry=image.entry) == image.data


def test_the_simulated_bus_says_what_the_descriptors_say() -> None:
    backend = VirtualBackend(VirtualFalcon(time=VirtualTime(), running=True, seed=0))
    device, told = backend.get_device_descriptor(None), backend.get_configuration_descriptor(None, 0)
    assert struct.unpack("<BBHBBBBHHHBBBB", descriptors.DEVICE) == (
        device.bLength, device.bDescriptorType, device.bcdUSB, device.bDeviceClass, device.bDeviceSubClass,
        device.bDeviceProtocol, device.bMaxPacketSize0, device.idVendor, device.idProduct, device.bcdDevice,
        device.iManufacturer, device.iProduct, device.iSerialNumber, device.bNumConfigurations,
    )  # fmt: skip
    assert struct.unpack_from("<BBHBBBBB", descriptors.CONFIGURATION) == (
        told.bLength, told.bDescriptorType, told.wTotalLength, told.bNumInterfaces, told.bConfigurationValue,
        told.iConfiguration, told.bmAttributes, told.bMaxPower,
    )  # fmt: skip
