"""The layouts byte by byte: golden datagrams, an independent CRC, byte soup, and there and back."""

import math
import struct
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.cim.icz1 import SIZE, Icz1, encode
from drivers.cim.minimal import Minimal
from drivers.cim.sample import Refusal, Sample, load
from hal.errors import OptionError

GOLDEN = (
    "49435a31 01 08 0030 cafe0123 00000007 000000000123abcd"  # magic, version, sweep start, 48, run, sequence, time
    "15 16 00 15 44fa2000 c1480000 00000002 00000000 d2c9c0f0"  # 21 to 22, 0 of 21, 2001 ohm, -12.5 degrees, sweep, CRC
)
GOLDEN_SAMPLE = Sample(0x123ABCD, 21, 2001.0, 22, 0xCAFE0123, 7, 0, 21, 2, -12.5)
ICZ1 = Icz1()

u8, u32, u64 = (st.integers(0, 2**n - 1) for n in (8, 32, 64))
samples = st.builds(
    Sample, u64, st.integers(1, 22), st.floats(0.0, 40_000.0, exclude_min=True, width=32), st.integers(0, 22), u32, u32,
    st.integers(0, 20), st.just(21), u32, st.floats(width=32, allow_nan=False), st.booleans(), st.booleans(), st.booleans(), st.booleans(),
).filter(lambda s: s.back != s.active)  # fmt: skip


def crc32_bitwise(data: bytes) -> int:
    """CRC-32 from its definition: reflected polynomial EDB88320, all ones before and after."""
    crc = 0xFFFFFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ 0xEDB88320 * (crc & 1)
    return crc ^ 0xFFFFFFFF


def decoded(data: bytes):
    return ICZ1.decode(memoryview(data))


def resealed(data: bytes) -> bytes:
    return data[:-4] + struct.pack(">I", crc32_bitwise(data[:-4]))


def test_golden_datagram():
    data = bytes.fromhex(GOLDEN)
    assert len(data) == 48
    assert data == resealed(data)
    assert encode(GOLDEN_SAMPLE) == data
    assert decoded(data) == GOLDEN_SAMPLE


@given(samples)
def test_what_is_encoded_is_decoded(sample):
    assert decoded(encode(sample)) == sample


@given(samples)
def test_the_checksum_is_that_of_an_independent_implementation(sample):
    data = encode(sample)
    assert data == resealed(data)


@given(samples, st.integers(0, 8 * SIZE - 1))
def test_no_single_bit_error_gets_through(sample, bit):
    data = bytearray(encode(sample))
    data[bit // 8] ^= 1 << bit % 8
    assert isinstance(decoded(bytes(data)), Refusal)


@given(st.binary(max_size=100))
def test_byte_soup_is_no_icz1(data):
    assert isinstance(decoded(data), Refusal)


@given(st.binary(min_size=34, max_size=34))
def test_a_sealed_soup_gives_nothing_out_of_bounds(soup):
    body = b"ICZ1\x01" + soup[:1] + b"\x00\x30" + soup + soup[:2]
    result = decoded(resealed(body + bytes(4)))
    assert isinstance(result, Refusal) or (
        1 <= result.active <= 22 and result.back != result.active and 0 < result.ohm <= 40_000 and result.position < result.sweep_length
    )  # fmt: skip


@given(st.binary(max_size=100), st.sampled_from(["big", "little"]))
def test_byte_soup_in_the_minimal_layout_gives_plausible_numbers_or_nothing(data, order):
    result = Minimal({"byte_order": order}).decode(memoryview(data))
    if len(data) != 20:
        assert result is Refusal.LENGTH
    assert isinstance(result, Refusal) or (
        1 <= result.active <= 22 and 0 < result.ohm <= 40_000 and result.time_us >= 0
    )


@given(st.integers(0, 10**15), st.integers(1, 22), st.floats(0.001, 40_000.0), st.sampled_from(["big", "little"]))
def test_what_is_encoded_in_the_minimal_layout_is_decoded(time_us, electrode, ohm, order):
    layout = Minimal({"byte_order": order})
    result = layout.decode(memoryview(layout.encode(time_us / 1e6, electrode, ohm)))
    assert (result.active, result.ohm) == (electrode, ohm)
    assert abs(result.time_us - time_us) <= 1


def test_golden_datagrams_of_the_minimal_layout():
    big = bytes.fromhex("3ff8000000000000 00000005 409f420000000000")  # 1.5 s, electrode 5, 2000.5 ohm
    little = bytes.fromhex("000000000000f83f 05000000 0000000000429f40")
    for data, order in ((big, "big"), (little, "little")):
        found = Minimal({"byte_order": order}).decode(memoryview(data))
        assert (found.time_us, found.active, found.ohm, found.back, found.run) == (1_500_000, 5, 2000.5, None, None)
        other = Minimal({"byte_order": "little" if order == "big" else "big"}).decode(memoryview(data))
        assert other is Refusal.RANGE


@pytest.mark.parametrize(
    ("at", "value", "why"),
    [
        (0, b"J", Refusal.MAGIC), (4, b"\x02", Refusal.VERSION), (6, b"\x00\x2f", Refusal.LENGTH),
        (24, b"\x00", Refusal.RANGE), (24, b"\x17", Refusal.RANGE), (25, b"\x17", Refusal.RANGE), (25, b"\x15", Refusal.RANGE),
        (26, b"\x15", Refusal.RANGE), (28, struct.pack(">f", 0.0), Refusal.RANGE), (28, struct.pack(">f", -5.0), Refusal.RANGE),
        (28, struct.pack(">f", math.nan), Refusal.RANGE), (28, struct.pack(">f", 40_001.0), Refusal.RANGE),
        (44, b"\x00", Refusal.CHECKSUM),
    ],
)  # fmt: skip
def test_every_rule_of_the_layout(at, value, why):
    data = bytearray.fromhex(GOLDEN)
    data[at : at + len(value)] = value
    assert decoded(bytes(data) if why is Refusal.CHECKSUM else resealed(bytes(data))) is why


@pytest.mark.parametrize(
    "changes", [{"run": None}, {"position": None}, {"ohm": math.inf}, {"sequence": 2**32}, {"time_us": -1}]
)
def test_what_does_not_fit_is_not_encoded(changes):
    with pytest.raises(ValueError, match="ICZ1"):
        encode(replace(GOLDEN_SAMPLE, **changes))


def test_decoders_are_found_by_name():
    assert (load("icz1"), load("minimal")) == (Icz1, Minimal)
    with pytest.raises(OptionError, match="byte_order"):
        Minimal({"byte_order": "middle"})
    with pytest.raises(OptionError, match="unknown key"):
        Icz1({"byte_order": "big"})


def test_a_datagram_in_a_reused_buffer_is_not_kept():
    buffer = bytearray.fromhex(GOLDEN)
    sample = ICZ1.decode(memoryview(buffer))
    buffer[:] = bytes(48)
    assert sample == GOLDEN_SAMPLE
