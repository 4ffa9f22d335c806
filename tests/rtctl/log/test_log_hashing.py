import hashlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rtctl.log.hashing import OutputHash, check_hashes, hash_rows, split_seconds
from rtctl.record import INPUTS, TIMING


def digest_by_hand(rows):
    state = hashlib.blake2b(digest_size=16)
    for row in rows:
        for name in rows.dtype.names:
            if name not in INPUTS | TIMING | {"reserved"}:
                state.update(row[name].tobytes())
    return state.hexdigest()


def test_entries_are_the_hash_of_output_fields_row_by_row(table, make_rows):
    rows = make_rows(table, 2100, first_tick=2950)
    expected = [
        {"first_tick": int(p["tick"][0]), "last_tick": int(p["tick"][-1]), "rows": len(p), "blake2b": digest_by_hand(p)}
        for p in (rows[:50], rows[50:1050], rows[1050:2050], rows[2050:])
    ]
    assert hash_rows(rows) == expected


@settings(max_examples=20, deadline=None)
@given(cuts=st.lists(st.integers(0, 3000), max_size=5), first=st.integers(0, 5000))
def test_batches_do_not_matter(small_table, make_rows, cuts, first):
    rows = make_rows(small_table, 3000, first_tick=first)
    running = OutputHash(rows.dtype)
    entries = [running.add(p) for batch in np.split(rows, sorted(cuts)) for p in split_seconds(batch)]
    assert [e for e in (*entries, running.finish()) if e] == hash_rows(rows)
    assert running.finish() is None


def test_every_output_byte_counts_and_nothing_else_does(table, make_rows):
    rows = make_rows(table, 5)
    before = hash_rows(rows)[0]["blake2b"]
    for name in table.dtype.names:
        if name == "tick":
            continue
        offset, size = table.dtype.fields[name][1], table.dtype.fields[name][0].itemsize
        for byte in (offset, offset + size - 1):
            changed = rows.copy()
            changed[3:4].view("u1")[byte] ^= 1
            same = hash_rows(changed)[0]["blake2b"] == before
            assert same == (name in INPUTS | TIMING | {"reserved"}), name


def test_check_finds_the_seconds_that_differ_even_when_cut(table, make_rows):
    rows = make_rows(table, 3000)
    logged = hash_rows(rows[:1400]) + hash_rows(rows[1400:])
    assert check_hashes(rows, logged) == []
    changed = rows.copy()
    changed["depth_mm"][1500] = np.nextafter(changed["depth_mm"][1500], 1.0)
    assert [e["first_tick"] for e in check_hashes(changed, logged)] == [1400]
    assert check_hashes(np.delete(rows, 2500), logged) == [logged[-1]]


@pytest.mark.parametrize("count", [0, 1])
def test_few_rows(table, make_rows, count):
    assert len(hash_rows(make_rows(table, count))) == count
