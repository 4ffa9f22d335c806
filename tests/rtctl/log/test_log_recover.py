from itertools import accumulate

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader

from rtctl.log.format import LogError
from rtctl.log.reader import Log
from rtctl.log.recover import recover
from rtctl.log.scan import Scan
from rtctl.log.writer import LogWriter

ROWS = 60


class Whole:
    """A small whole log, and where its chunks lie: (start, end, rows in it)."""

    def __init__(self, path, table, rows, compression):
        self.rows = rows
        with LogWriter(path, {"/controller": table}, {"seed": "1"}, chunk_bytes=500, compression=compression) as writer:
            writer.write_rows("/controller", self.rows)
            writer.write_json("/events", 2_000_000_000, "the end")
        self.data = path.read_bytes()
        with path.open("rb") as file:
            reader = make_reader(file, validate_crcs=True)
            summary = reader.get_summary()
            topics = {c.id: c.topic for c in summary.channels.values()}
            self.chunks = []
            for index in summary.chunk_indexes:
                rows = [i for i, offset in index.message_index_offsets.items() if topics[i] == "/controller"]
                count = 0
                if rows:
                    at = index.message_index_offsets[rows[0]]
                    count = int.from_bytes(self.data[at + 11 : at + 15], "little") // 16
                self.chunks.append((index.chunk_start_offset, index.chunk_start_offset + index.chunk_length, count))
        assert sum(count for _, _, count in self.chunks) == ROWS
        assert len(self.chunks) > 4

    def rows_of(self, keep):
        """Rows of the chunks for which keep(start, end) holds."""
        edges = [0, *accumulate(count for _, _, count in self.chunks)]
        kept = [self.rows[a:b] for (s, e, _), a, b in zip(self.chunks, edges, edges[1:], strict=False) if keep(s, e)]
        return np.concatenate([self.rows[:0], *kept])


@pytest.fixture(scope="module", params=["zstd", "none"])
def whole(request, tmp_path_factory, small_table, make_rows):
    rows = make_rows(small_table, ROWS, first_tick=970)
    return Whole(tmp_path_factory.mktemp("whole") / "log.mcap", small_table, rows, request.param)


def recovered(folder, data):
    """Report and rows of a recovery, the rows read by the library's own reader."""
    source, target = folder / "damaged.mcap", folder / "whole.mcap"
    source.write_bytes(data)
    target.unlink(missing_ok=True)
    report = recover(source, target)
    with target.open("rb") as file:
        found = [m.data[4:] for _, c, m in make_reader(file, validate_crcs=True).iter_messages(topics="/controller")]
    return report, b"".join(found)


def test_cut_anywhere_keeps_every_complete_chunk(whole):
    (controller,) = {int.from_bytes(whole.data[e + 9 : e + 11], "little") for _, e, n in whole.chunks[:1] if n}
    for cut in range(len(whole.data) + 1):
        scan = Scan(whole.data[:cut])
        found = [bytes(b[26:]) for opcode, b in scan if opcode == 5 and b[0] == controller]
        assert b"".join(found) == whole.rows_of(lambda _, end, cut=cut: end <= cut).tobytes(), cut
        assert scan.closed == (cut == len(whole.data))


def test_cut_log_is_rewritten(tmp_path, whole):
    edges = [edge + near for s, e, _ in whole.chunks for edge in (s, e) for near in (-1, 0, 1)]
    for cut in sorted({*range(0, len(whole.data), 97), *edges, len(whole.data)}):
        report, found = recovered(tmp_path, whole.data[:cut])
        expected = whole.rows_of(lambda _, end, cut=cut: end <= cut)
        assert found == expected.tobytes(), cut
        assert report.rows == len(expected)
        assert report.last_tick == (int(expected["tick"][-1]) if len(expected) else None)
        assert cut < len(whole.data) or report.dropped_bytes == 0


@settings(max_examples=150, deadline=None)
@given(data=st.data())
def test_flipped_bits_cost_only_the_chunks_they_hit(tmp_path_factory, whole, data):
    tail = whole.chunks[0][1]
    places = data.draw(st.lists(st.integers(tail * 8, len(whole.data) * 8 - 1), min_size=1, max_size=3, unique=True))
    damaged = bytearray(whole.data)
    for place in places:
        damaged[place // 8] ^= 1 << place % 8
    report, found = recovered(tmp_path_factory.getbasetemp(), bytes(damaged))
    intact = whole.rows_of(lambda start, end: not any(start <= place // 8 < end for place in places))
    size = whole.rows.dtype.itemsize
    kept = [found[i : i + size] for i in range(0, len(found), size)]
    true = [row.tobytes() for row in whole.rows]
    assert {row.tobytes() for row in intact} <= set(kept)
    assert kept == [row for row in true if row in set(kept)], "no row is altered, doubled or out of order"
    assert report.rows == len(kept)


def test_wrong_length_of_an_index_does_not_hide_the_chunk_after_it(tmp_path, whole):
    (_, end, _), (start, after, _) = whole.chunks[1:3]
    assert whole.data[end] == 7
    damaged = bytearray(whole.data)
    damaged[end + 1 : end + 9] = (after - end - 9).to_bytes(8, "little")
    report, found = recovered(tmp_path, bytes(damaged))
    assert found == whole.rows.tobytes()
    assert 0 < report.dropped_bytes <= start - end


def test_lost_first_chunk_is_named_by_the_summary(tmp_path, whole):
    start, end, count = whole.chunks[0]
    damaged = bytearray(whole.data)
    damaged[end - 5] ^= 0x10
    report, found = recovered(tmp_path, bytes(damaged))
    assert found == whole.rows[count:].tobytes()
    assert report.dropped_bytes >= end - start


def test_recovered_log_is_a_log(tmp_path, whole):
    cut = whole.chunks[3][1] + 40
    report, _ = recovered(tmp_path, whole.data[:cut])
    log = Log.open(tmp_path / "whole.mcap")
    assert log.complete
    assert log.header == {"seed": "1"}
    assert log.controller.tobytes() == whole.rows[: report.rows].tobytes()
    again, _ = recovered(tmp_path, (tmp_path / "whole.mcap").read_bytes())
    assert again.dropped_bytes == 0
    assert again.rows == report.rows
    with (tmp_path / "whole.mcap").open("rb") as file:
        assert len(list(StreamReader(file, validate_crcs=True).records)) > report.rows


def test_damaged_middle_shows_as_missing_ticks(tmp_path, whole):
    start, end, count = whole.chunks[2]
    damaged = bytearray(whole.data)
    damaged[(start + end) // 2] ^= 1
    (tmp_path / "log.mcap").write_bytes(damaged)
    log = Log.open(tmp_path / "log.mcap")
    before = sum(n for _, _, n in whole.chunks[:2])
    assert log.missing_ticks() == [(970 + before, 970 + before + count - 1)]
    assert not log.complete
    assert log.lost_bytes >= end - start


def test_target_is_not_overwritten(tmp_path, whole):
    (tmp_path / "a.mcap").write_bytes(whole.data)
    with pytest.raises(LogError, match="the target exists"):
        recover(tmp_path / "a.mcap", tmp_path / "a.mcap")
    assert (tmp_path / "a.mcap").read_bytes() == whole.data
    with pytest.raises(LogError, match="cannot read"):
        recover(tmp_path / "none.mcap", tmp_path / "b.mcap")
    assert not (tmp_path / "b.mcap").exists()


def test_topic_whose_description_is_lost_does_not_spoil_the_rest(tmp_path, small_table):
    writer = LogWriter(tmp_path / "log.mcap", {"/controller": small_table}, {"seed": "1"})
    writer.write_json("/events", 0, "first")
    writer.flush()
    end = (tmp_path / "log.mcap").stat().st_size
    writer.write_json("/late", 1, "second")
    writer.flush()
    damaged = bytearray((tmp_path / "log.mcap").read_bytes())
    writer.close()
    damaged[end // 2] ^= 1
    (tmp_path / "damaged.mcap").write_bytes(damaged)
    log = Log.open(tmp_path / "damaged.mcap")
    assert (log.header, log.messages) == ({"seed": "1"}, {})
    assert recover(tmp_path / "damaged.mcap", tmp_path / "whole.mcap").rows == 0
    assert Log.open(tmp_path / "whole.mcap").complete
