"""Over real sockets on the loopback: the device, the relay and the replay, each as a lab runs it."""

import signal
import socket
import subprocess
import sys
import time

import pytest
from cim_bench import SAMPLE_TICKS, CimBench
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.cim import recording, relay, replay
from drivers.cim.device import CimTelemetry
from drivers.cim.icz1 import Icz1, encode
from drivers.cim.minimal import Minimal
from drivers.cim.sample import Sample
from drivers.seams import TargetSeams
from hal.device import Readings, Site
from hal.errors import BackendError
from hal.frames import INVALID, VALID
from hal.switchboard import Switchboard
from hal.troubles import Trouble

ICZ1 = Icz1()


@pytest.fixture
def peer():
    """A socket on a port of its own, with the address as text."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as made:
        made.bind(("127.0.0.1", 0))
        made.settimeout(5.0)
        yield made


def address(of: socket.socket) -> str:
    return "{}:{}".format(*of.getsockname())


def free_address() -> str:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as made:
        made.bind(("127.0.0.1", 0))
        return address(made)


def target_of(text: str) -> tuple[str, int]:
    host, port = text.split(":")
    return host, int(port)


def arrived(device, tick):
    """Read one tick after the loopback has delivered."""
    readings = Readings(4)
    time.sleep(0.01)
    device.read(tick, readings)
    return readings


def good(number, run=9):
    return encode(Sample(1_000_000 + 70_000 * number, 21 - number % 21, 1500.0 + number, 22 - number % 21, run, number, number % 21, 21, number // 21))  # fmt: skip


def test_the_device_on_a_socket_hears_its_peer_and_counts_others(peer):
    local = free_address()
    device = CimTelemetry("cim", {"local": local, "peer": address(peer)}, Site(0.001, 50, TargetSeams()))
    device.open()
    peer.sendto(good(0), target_of(local))
    r = arrived(device, 100)
    assert (r.impedance_validity, r.impedance_pair, r.impedance_ohm, r.impedance_age_ticks) == (VALID, 0, 1500.0, 0)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        for n in range(1, 4):
            stranger.sendto(good(n), target_of(local))
    r = arrived(device, 101)
    assert (r.trouble, r.trouble_value) == (Trouble.TELEMETRY_CORRUPT, 3)
    assert (r.impedance_sequence, r.impedance_ohm) == (1, 1500.0)
    assert device.health().errors["foreign"] == 3
    assert arrived(device, 1101).trouble == Trouble.TELEMETRY_SILENT
    device.close()
    device.close()


def test_a_port_in_use_is_refused_at_opening(peer):
    device = CimTelemetry("cim", {"local": address(peer), "peer": "127.0.0.1:9"}, Site(0.001, 50, TargetSeams()))
    with pytest.raises(BackendError, match="uses the port"):
        device.open()


@given(st.lists(st.binary(max_size=64), max_size=20))
@settings(max_examples=50)
def test_byte_soup_never_raises_and_never_gives_a_sample(soup):
    board = Switchboard()
    table = {"local": "a:1", "peer": "b:2"}
    sender = board.plug_datagrams("a:1", "b:2")
    device, readings = CimTelemetry("cim", table, Site(0.001, 50, board)), Readings(4)
    device.open()
    for data in soup:
        sender.send(data)
    device.read(0, readings)
    assert (readings.impedance_validity, readings.impedance_sequence) == (INVALID, 0)
    assert sum(n for name, n in device.health().errors.items() if name.startswith("refused")) == len(soup)


def test_the_minimal_layout_through_the_device():
    board, layout = Switchboard(), Minimal({"byte_order": "little"})
    table = {"local": "a:1", "peer": "b:2", "decoder": "minimal", "decoder_options": {"byte_order": "little"}}
    device, readings = CimTelemetry("cim", table, Site(0.001, 50, board)), Readings(4)
    sender = board.plug_datagrams("a:1", "b:2")
    device.open()
    for n in range(42):
        sender.send(layout.encode(0.07 * n, 1 + n % 21, 1000.0 + n))
        readings.clear()
        device.read(70 * n, readings)
        assert (readings.impedance_validity, readings.impedance_pair) == (VALID, 20 - n % 21)
        assert readings.trouble == Trouble.NONE


def test_what_the_device_records_is_what_came(tmp_path):
    bench = CimBench(record_to=str(tmp_path))
    bench.emulator.inject("bad_length")  # refused datagrams are recorded, too
    bench.run(3 * SAMPLE_TICKS)
    bench.emulator.inject("bad_length", 0)
    bench.run(2 * SAMPLE_TICKS)
    bench.device.close()
    (path,) = tmp_path.iterdir()
    assert path.name == "cim-0001.cimrec"
    found = list(recording.read(path))
    assert [t for t, _ in found] == [0, 70_000, 140_000, 210_000, 280_000]
    assert [len(d) for _, d in found] == [47, 47, 47, 48, 48]
    bench.device.open()
    bench.device.close()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["cim-0001.cimrec", "cim-0002.cimrec"]


def test_a_recording_that_was_cut_off_is_good_until_there(tmp_path):
    recorder = recording.Recorder(str(tmp_path), "cut")
    for n in range(3):
        recorder.note(n, memoryview(good(n)))
    recorder.close()
    whole = recorder.path.read_bytes()
    for cut in (1, 47, 57):
        recorder.path.write_bytes(whole[:-cut])
        assert list(recording.read(recorder.path)) == [(0, good(0)), (1, good(1))]


@pytest.mark.parametrize("content", [b"", b"RIFFxxxxxxxxxxxxx", None])
def test_what_is_no_recording_is_refused(tmp_path, content, capsys):
    path = tmp_path / "x"
    if content is not None:
        path.write_bytes(content)
    assert replay.main([str(path), "--to", "127.0.0.1:9"]) == 2
    assert "recording" in capsys.readouterr().err


def test_a_directory_that_is_not_there_is_refused_at_opening(tmp_path):
    bench = CimBench()
    table = {"local": "a:1", "peer": "b:2", "record_to": str(tmp_path / "none")}
    device = CimTelemetry("cim", table, Site(0.001, 50, bench.switchboard))
    with pytest.raises(BackendError, match="record_to"):
        device.open()
    device.close()


def test_a_replay_sends_every_datagram_in_order_and_at_its_pace(tmp_path, peer):
    recorder = recording.Recorder(str(tmp_path), "r")
    for n in range(8):
        recorder.note(5_000_000 + 70_000 * n, memoryview(good(n)))
    recorder.close()
    begin = time.monotonic()
    assert replay.main([str(recorder.path), "--to", address(peer), "--speed", "2"]) == 0
    assert time.monotonic() - begin >= 7 * 0.035
    assert [peer.recv(100) for _ in range(8)] == [good(n) for n in range(8)]


def test_the_relay_translates_what_it_believes(peer, tmp_path):
    """Its own process, ended by Ctrl-C as a person would; losses before it are losses behind it."""
    local, layout = free_address(), Minimal({"byte_order": "little"})
    command = [
        sys.executable, "-m", "drivers.cim.relay", "--local", local, "--peer", address(peer), "--to", address(peer),
        "--layout", "minimal", "--layout-option", "byte_order=little", "--record", str(tmp_path),
    ]  # fmt: skip
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        assert "ICZ1 to" in process.stdout.readline()
        received = []
        for time_s, electrode in ((10.0, 1), (10.07, 2), (10.21, 4), (10.28, 21), (10.35, 1), (1.0, 1)):
            peer.sendto(layout.encode(time_s, electrode, 700.0 + electrode), target_of(local))
            received.append(ICZ1.decode(memoryview(peer.recv(100))))
        peer.sendto(b"not ours", target_of(local))
        time.sleep(0.1)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=10)
    finally:
        process.kill()
        process.wait()
    assert (process.returncode, err) == (0, "")
    assert "passed 6" in out
    assert "refused_length 1" in out
    assert [(s.active, s.back, s.ohm, s.time_us) for s in received[:3]] == [(1, 2, 701.0, 10_000_000), (2, 3, 702.0, 10_070_000), (4, 5, 704.0, 10_210_000)]  # fmt: skip
    assert [s.sequence for s in received] == [0, 1, 3, 4, 5, 0]
    assert [s.position for s in received] == [0, 1, 3, 20, 0, 0]
    assert [s.sweep for s in received[:5]] == [0, 0, 0, 0, 1]
    assert len({s.run for s in received[:5]}) == 1
    assert received[5].run != received[0].run
    (path,) = tmp_path.iterdir()
    assert len(list(recording.read(path))) == 7


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--to", "127.0.0.1"], "no such address"),
        (["--to", "127.0.0.1:9", "--layout", "nic"], "no such layout"),
        (["--to", "127.0.0.1:9", "--layout-option", "byte_order=pdp"], "byte_order"),
        (["--to", "127.0.0.1:9", "--record", "/nonexistent"], "record_to"),
    ],
)
def test_the_relay_says_why_it_cannot_begin(arguments, says, capsys):
    assert relay.main(["--local", "127.0.0.1:0", "--peer", "127.0.0.1:9", *arguments]) == 2
    assert says in capsys.readouterr().err


@pytest.mark.parametrize(
    ("tool", "arguments", "says"),
    [
        (relay, ["--local", "a:1", "--peer", "b:2", "--to", "c:3", "--sample-period", "9"], "0.001 to 1 s"),
        (relay, ["--local", "a:1", "--peer", "b:2", "--to", "c:3", "--layout-option", "x"], "NAME=VALUE"),
        (replay, ["x", "--to", "c:3", "--speed", "0"], "0.01 to 1000"),
    ],
)
def test_arguments_out_of_bounds_are_refused(tool, arguments, says, capsys):
    with pytest.raises(SystemExit):
        tool.main(arguments)
    assert says in capsys.readouterr().err
