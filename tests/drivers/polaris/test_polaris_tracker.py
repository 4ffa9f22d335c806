"""The client against the emulated tracker in memory: start, tools, poses, and every fault of the line and of the tracker."""

import pytest
from polaris_bench import MemoryLine, rom

from drivers.polaris.protocol import frame
from drivers.polaris.tracker import Tracker
from hal.errors import BackendError


@pytest.fixture
def line():
    return MemoryLine()


@pytest.fixture
def tracker(line):
    return Tracker(line, reset_s=0.02, reply_s=0.02)


@pytest.fixture
def tracking(tracker, tmp_path):
    tracker.connect()
    tracker.load(rom(tmp_path, "gripper"))
    tracker.load(rom(tmp_path, "base", size=1024))
    tracker.start()
    return tracker


@pytest.mark.parametrize("hears_break", [True, False])
@pytest.mark.parametrize("baud", [9600, 115_200])
def test_it_starts_whatever_the_session_before_left(hears_break, baud, tmp_path):
    line = MemoryLine(hears_break)
    if baud == 115_200:
        line.device.feed(frame("INIT:") + frame("COMM:50000"))
        line.device.feed(frame("PHRQ:*********1****"))
    tracker = Tracker(line, reset_s=0.02, reply_s=0.02)
    tracker.connect()
    assert (line.breaks, line.baud, line.device.baud) == (1, 115_200, 115_200)
    assert tracker.load(rom(tmp_path, "t")) == 1  # what the session before had loaded is gone
    assert tracker.enabled() == [1]


def test_a_tool_goes_over_in_blocks_and_whole(line, tracker, tmp_path):
    tracker.connect()
    path = rom(tmp_path, "t", size=100)
    tracker.load(path)
    writes = [data for data in line.sent if data.startswith(b"PVWR:")]
    assert [data[5:11] for data in writes] == [b"010000", b"010040"]
    image = b"".join(bytes.fromhex(data[11:139].decode()) for data in writes)
    assert image == path.read_bytes() + bytes(28)


def test_poses_of_several_tools_come_with_their_frames(line, tracking):
    line.device.step = 2
    first, second = tracking.poses(), tracking.poses()
    assert {h: f for h, (f, _) in first.items()} == {1: 3, 2: 3}
    assert {h: f for h, (f, _) in second.items()} == {1: 6, 2: 6}
    _, pose = first[2]
    assert pose.position_mm == (50.0, 20.0, -1000.0)
    assert pose.quaternion == pytest.approx((0.9950, 0.0, 0.0, 0.0998), abs=1e-4)


def test_a_hidden_tool_is_counted_and_never_an_old_pose(line, tracking):
    assert tracking.poses()[1][1] is not None
    line.device.inject("missing", 1)
    for _ in range(3):
        poses = tracking.poses()
        assert poses[1][1] is None
        assert poses[2][1] is not None
    assert tracking.counts == {"missing_gripper": 3}
    line.device.inject("missing", 0)
    assert tracking.poses()[1][1] is not None


def test_a_tool_outside_the_volume_is_no_pose(line, tracking):
    line.device.inject("out_of_volume", 2)
    assert tracking.poses()[2][1] is None
    assert tracking.counts == {"outside_base": 1}


def test_the_same_frame_is_given_once(line, tracking):
    tracking.poses()
    line.device.inject("stalled")
    assert [tracking.poses() for _ in range(3)] == [{}, {}, {}]
    assert tracking.counts == {"repeats": 6}


@pytest.mark.parametrize("fault", ["mute", "corrupt", "noise", "garbled"])
@pytest.mark.parametrize("count", [1, 2])
def test_a_disturbed_line_is_tried_again(line, tracking, fault, count):
    line.device.inject(fault, count)
    assert tracking.poses()[1][1] is not None
    assert tracking.counts == {"desyncs": count}


@pytest.mark.parametrize("fault", ["mute", "corrupt"])
def test_a_lost_reply_to_what_cannot_be_done_twice_is_no_error(line, tracker, fault):
    tracker.connect()
    line.device.inject(fault)
    tracker.start()
    line.device.inject(fault)
    tracker.stop()


@pytest.mark.parametrize(("fault", "says"), [("mute", "does not answer TX"), ("corrupt", "does not answer TX"), ("garbled", "ERROR0")])  # fmt: skip
def test_attempts_are_bounded(line, tracking, fault, says):
    line.device.inject(fault, 3)
    with pytest.raises(BackendError, match=says):
        tracking.poses()


def test_a_tracker_that_started_anew_is_not_taken_for_the_same(line, tracking):
    line.device.inject("restart")
    with pytest.raises(BackendError, match="started anew"):
        tracking.poses()


def test_nobody_there(line, tracker):
    line.device.baud = 19_200
    line.hears_break = False
    with pytest.raises(BackendError, match="does not answer INIT"):
        tracker.connect()


@pytest.mark.parametrize("content", [b"", b"x" * 1025, b"PDF" + bytes(100)])
def test_what_is_no_tool_definition_is_refused(tracker, tmp_path, content):
    tracker.connect()
    path = tmp_path / "wrong.rom"
    path.write_bytes(content)
    with pytest.raises(BackendError, match=r"no tool definition|tool definition is not complete"):
        tracker.load(path)
    with pytest.raises(BackendError, match="cannot be read"):
        tracker.load(tmp_path / "none.rom")


def test_the_context_ends_tracking_and_closes_even_if_the_tracker_is_gone(line, tracking):
    with tracking:
        line.device.inject("mute", 10)
    assert not line.is_open


@pytest.mark.parametrize(
    ("commands", "code"),
    [
        (["PHSR:00"], 0x10), (["INIT:", "TX:0801"], 0x0C), (["INIT:", "TSTART:", "TSTART:"], 0x0C), (["INIT:", "PINIT:01"], 0x08),
        (["INIT:", "PHRQ:*********1****", "PINIT:01"], 0x0D), (["INIT:", "PHRQ:*********1****", "PENA:01D"], 0x0E),
        (["INIT:", "PHRQ:*********1****", "PVWR:010000AB"], 0x07), (["INIT:", "PHRQ:*********1****", "PVWR:010020" + "0" * 128], 0x07),
        (["INIT:", "PHRQ:*********1****", "PVWR:010040" + "0" * 128, "PINIT:01"], 0x13), (["COMM:90000"], 0x06), (["BEEP:1"], 0x01),
        (["INIT:" + "0" * 300], 0x02),
    ],
)  # fmt: skip
def test_the_emulator_is_as_strict_as_the_tracker(line, commands, code):
    answers = [line.device.feed(frame(command)) for command in commands]
    assert answers[-1] == frame(f"ERROR{code:02X}")
    assert all(b"ERROR" not in answer for answer in answers[:-1])


def test_the_emulator_refuses_a_command_with_a_wrong_crc(line):
    assert line.device.feed(b"INIT:E3A6\r") == frame("ERROR04")
    assert line.device.feed(b"INIT:E3A5\rINIT \r") == 2 * frame("OKAY")
