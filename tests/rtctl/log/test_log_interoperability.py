"""The file as others read it: the mcap library, its ROS 2 decoder, and rosbags, none of which knows our code."""

import json

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.records import Metadata
from mcap.stream_reader import StreamReader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader

from rtctl.log.writer import LogWriter
from rtctl.record import controller_table

EVENT = {"name": "bias taken", "value_n": [0.25, -1.5]}


@pytest.fixture(params=[3, 6])
def recorded(request, tmp_path, make_rows):
    table = controller_table(request.param)
    rows = make_rows(table, 600)
    path = tmp_path / "log.mcap"
    with LogWriter(path, {"/controller": table}, {"seed": "9", "settings": '{"a": "µ"}'}) as writer:
        writer.write_rows("/controller", rows)
        writer.write_json("/events", 600_000_000, EVENT)
    return path, rows


def assert_same(message, row):
    for name in row.dtype.names:
        value = getattr(message, name)
        value = list(value) if isinstance(value, bytes) else value
        assert np.array_equal(np.asarray(value, row.dtype[name].base), row[name], equal_nan=True), name


def test_mcap_reader_sees_an_indexed_ros2_file(recorded):
    path, rows = recorded
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        assert (reader.get_header().profile, reader.get_header().library) == ("ros2", "rtctl")
        summary = reader.get_summary()
        counts = {summary.channels[i].topic: n for i, n in summary.statistics.channel_message_counts.items()}
        assert counts == {"/controller": 600, "/events": 1, "/hash": 1}
        assert len(summary.chunk_indexes) >= 2
        assert {c.message_encoding for c in summary.channels.values()} == {"cdr"}
        assert {s.encoding for s in summary.schemas.values()} == {"ros2msg"}
        assert {s.name for s in summary.schemas.values()} == {"rtctl/msg/Controller", "std_msgs/msg/String"}
        (metadata,) = reader.iter_metadata()
        assert metadata.metadata == {"seed": "9", "settings": '{"a": "µ"}'}
        messages = [m for _, _, m in reader.iter_messages(topics="/controller")]
    assert [m.log_time for m in messages] == rows["time_ns"].tolist()
    assert all(m.publish_time == m.log_time for m in messages)


def test_metadata_comes_before_all_else(recorded):
    path, _ = recorded
    with path.open("rb") as file:
        records = StreamReader(file, validate_crcs=True).records
        next(records)
        assert isinstance(next(records), Metadata)
        assert sum(1 for _ in records) > 600


def test_ros2_decoder_gives_the_values_of_the_rows(recorded):
    path, rows = recorded
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        decoded = [d.decoded_message for d in reader.iter_decoded_messages(topics="/controller")]
        (event,) = reader.iter_decoded_messages(topics="/events")
    assert len(decoded) == len(rows)
    for message, row in zip(decoded, rows, strict=True):
        assert_same(message, row)
    assert json.loads(event.decoded_message.data) == EVENT


def test_rosbags_opens_the_file_as_it_is(recorded):
    path, rows = recorded
    with AnyReader([path]) as bag:
        assert {c.topic: c.msgcount for c in bag.connections if c.msgcount} == {
            "/controller": 600,
            "/events": 1,
            "/hash": 1,
        }
        found = {topic: [] for topic in ("/controller", "/events", "/hash")}
        for connection, time_ns, raw in bag.messages():
            found[connection.topic].append((time_ns, bag.deserialize(raw, connection.msgtype)))
    assert [t for t, _ in found["/controller"]] == rows["time_ns"].tolist()
    for (_, message), row in zip(found["/controller"], rows, strict=True):
        assert_same(message, row)
    assert json.loads(found["/events"][0][1].data) == EVENT
    assert json.loads(found["/hash"][0][1].data)["rows"] == 600
