"""Devices, emulated by what their kernel would write: a terminal with keys, and pipes with input events."""

import contextlib
import fcntl
import os
import pty
import signal
import struct
import subprocess
import sys
import termios
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rtctl.operator.hand_devices import GAMEPAD, SPACE_MOUSE, HandDevice, find
from rtctl.operator.input_events import GET_IDENTITY, GRAB, DeviceError, EventDevice
from rtctl.operator.keyboard import HOLD_S, Keyboard, KeyboardError
from rtctl.operator.message import NO_BUTTON, Button
from rtctl.operator.publisher import PERIOD_S, REST, Sample, publish
from rtctl.operator.scripted import Scripted

SYN, KEY, REL, ABS = 0, 1, 2, 3
DEADMAN_OF_PAD, DEADMAN_OF_MOUSE = 311, 256


class Kernel:
    """Writes input events into a pipe, as the event interface would."""

    def __init__(self, layout, ranges=None, speeds=(2.0, 0.1)):
        self.out, self.into = os.pipe()
        os.set_blocking(self.out, False)
        self.events = EventDevice(self.out, ranges or {}, "fake")
        self.device = HandDevice(self.events, layout, *speeds)

    def write(self, *events, report=True):
        for kind, code, value in [*events, *([(SYN, 0, 0)] if report else [])]:
            os.write(self.into, struct.pack("llHHi", 1700, 5, kind, code, value))
        return self

    def sample(self, now_s=1.0):
        return self.device.sample(now_s)


@pytest.fixture
def pad():
    kernel = Kernel(GAMEPAD, {0: (-32768, 32767), 1: (-32768, 32767), 3: (0, 255), 4: (0, 255)})
    yield kernel
    for fd in (kernel.out, kernel.into):
        os.close(fd)


@pytest.fixture
def mouse():
    kernel = Kernel(SPACE_MOUSE)
    yield kernel
    for fd in (kernel.out, kernel.into):
        os.close(fd)


def test_a_stick_at_its_end_asks_for_full_speed_and_near_its_centre_for_nothing(pad):
    pad.write((ABS, 1, -32768), (ABS, 0, 32767), (ABS, 3, 0))
    sample = pad.sample()
    assert sample.twist == pytest.approx((2.0, -2.0, 0, 0, 0, 0.1), abs=1e-4)
    assert not sample.deadman
    pad.write((ABS, 1, 3000), (ABS, 0, -3000), (ABS, 3, 127))
    assert pad.sample().twist == pytest.approx(REST)
    pad.write((ABS, 1, -18022))
    assert pad.sample().twist[0] == pytest.approx(2.0 * (0.55 - 0.1) / 0.9, rel=1e-3)


def test_buttons_and_deadman_are_levels(pad):
    pad.write((KEY, DEADMAN_OF_PAD, 1), (KEY, 305, 1), (KEY, 315, 1))
    assert (pad.sample().deadman, pad.sample().buttons) == (True, Button.STOP | Button.INSERT)
    pad.write((KEY, DEADMAN_OF_PAD, 2), (KEY, 305, 0))
    assert (pad.sample().deadman, pad.sample().buttons) == (True, Button.INSERT)
    pad.write((KEY, DEADMAN_OF_PAD, 0))
    assert not pad.sample().deadman


def test_after_an_overrun_nothing_is_held_until_it_is_pressed_again(pad):
    pad.write((KEY, DEADMAN_OF_PAD, 1), (ABS, 1, -32768))
    assert pad.sample().deadman
    pad.write((SYN, 3, 0), (KEY, DEADMAN_OF_PAD, 1), (ABS, 1, -32768))
    assert pad.sample() == Sample()
    pad.write((ABS, 0, 0))
    assert not pad.sample().deadman
    pad.write((KEY, DEADMAN_OF_PAD, 0)).write((KEY, DEADMAN_OF_PAD, 1))
    assert pad.sample().deadman


def test_an_event_may_come_in_two_pieces(pad):
    event = struct.pack("llHHi", 0, 0, KEY, DEADMAN_OF_PAD, 1)
    os.write(pad.into, event[:7])
    assert not pad.sample().deadman
    os.write(pad.into, event[7:])
    assert pad.sample().deadman


def test_an_unplugged_device_is_an_error(pad):
    pad.write((KEY, DEADMAN_OF_PAD, 1))
    os.close(pad.into)
    pad.into = os.open("/dev/null", os.O_RDONLY)
    with pytest.raises(DeviceError, match="gone"):
        pad.sample()


def test_a_3d_mouse_with_relative_axes_is_at_rest_when_it_says_nothing(mouse):
    mouse.write((REL, 1, -350), (REL, 0, 175)).write((REL, 5, -350))
    sample = mouse.sample(1.0)
    assert sample.twist == pytest.approx((2.0, -2.0 * 0.4 / 0.9, 0, 0, 0, 0.1))
    mouse.write((REL, 0, 175))
    assert mouse.sample(1.05).twist == pytest.approx((0, -2.0 * 0.4 / 0.9, 0, 0, 0, 0.1)), "zeros are not reported"
    assert mouse.sample(1.2).twist == pytest.approx(REST)


def test_a_3d_mouse_with_absolute_axes_and_its_buttons():
    mouse = Kernel(SPACE_MOUSE, dict.fromkeys(range(6), (-500, 500)))
    mouse.write((ABS, 2, -500), (ABS, 3, 500), (KEY, DEADMAN_OF_MOUSE, 1))
    sample = mouse.sample()
    assert sample.twist == pytest.approx((0, 0, 2.0, 0, -0.1, 0))
    assert sample.deadman
    mouse.write((KEY, 257, 1))
    assert mouse.sample().buttons == Button.STOP
    os.close(mouse.out)
    os.close(mouse.into)


@given(st.lists(st.tuples(st.integers(0, 6), st.integers(0, 0x2FF), st.integers(-(2**31), 2**31 - 1)), max_size=60))
def test_whatever_a_device_says_its_twist_stays_within_full_speed(events):
    pad = Kernel(GAMEPAD, {0: (-128, 127), 1: (0, 255)})
    sample = pad.write(*events).sample()
    os.close(pad.out)
    os.close(pad.into)
    assert all(abs(v) <= 2.0 for v in sample.twist[:3])
    assert all(abs(w) <= 0.1 for w in sample.twist[3:])


def fake_ioctl(bus, ranges, grabbed):
    """The kernel's answers; request numbers as in linux/input.h on every machine with asm-generic ioctl numbers."""

    def ioctl(_fd, request, argument):
        if request == 0x80084502:  # EVIOCGID
            return struct.pack("4H", bus, 0x045E, 0x028E, 1)
        if request == 0x40044590:  # EVIOCGRAB
            grabbed.append(argument)
            return 0
        code = request - 0x80184540  # EVIOCGABS
        if code in ranges:
            return struct.pack("6i", 0, *ranges[code], 16, 128, 0)
        raise OSError(22, "Invalid argument")

    return ioctl


def test_a_device_is_opened_for_us_alone_with_the_ranges_the_kernel_tells(tmp_path, monkeypatch):
    assert (GET_IDENTITY, GRAB) == (0x80084502, 0x40044590)
    path, grabbed = tmp_path / "event5", []
    os.mkfifo(path)
    keep_open = os.open(path, os.O_RDWR)
    monkeypatch.setattr(fcntl, "ioctl", fake_ioctl(3, {1: (0, 255)}, grabbed))
    with EventDevice.open(path) as events:
        os.write(keep_open, struct.pack("llHHi", 0, 0, ABS, 1, 255) + struct.pack("llHHi", 0, 0, ABS, 0, 255))
        events.update(1.0)
        assert events.axis(1, 1.0) == 1.0
        assert events.axis(0, 1.0) == 0.0, "an axis whose range is not known says nothing"
        assert grabbed == [1]
    monkeypatch.setattr(fcntl, "ioctl", fake_ioctl(5, {}, grabbed))
    with pytest.raises(DeviceError, match="Bluetooth"):
        EventDevice.open(path)
    os.close(keep_open)


def test_what_is_no_input_device_is_told(tmp_path):
    with pytest.raises(DeviceError, match="no input device"):
        EventDevice.open(tmp_path / "event9")
    plain = tmp_path / "event8"
    plain.touch()
    with pytest.raises(DeviceError, match="spacenavd"):
        EventDevice.open(plain)


def test_a_device_is_found_if_there_is_exactly_one(tmp_path):
    with pytest.raises(DeviceError, match="no single gamepad"):
        find(GAMEPAD, tmp_path)
    one = tmp_path / "usb-Pad-event-joystick"
    one.touch()
    (tmp_path / "usb-3Dconnexion_SpaceNavigator-event-if00").touch()
    (tmp_path / "usb-Keyboard-event-kbd").touch()
    assert find(GAMEPAD, tmp_path) == one
    assert find(SPACE_MOUSE, tmp_path).name.startswith("usb-3D")
    (tmp_path / "usb-Pad2-event-joystick").touch()
    with pytest.raises(DeviceError, match="no single gamepad"):
        find(GAMEPAD, tmp_path)


@pytest.fixture
def terminal():
    """(the person's side, the program's side) of a terminal."""
    person, program = pty.openpty()
    yield person, program
    for fd in (person, program):
        with contextlib.suppress(OSError):
            os.close(fd)


def typed(person, keyboard, keys, now_s):
    os.write(person, keys)
    keyboard.wait(1.0)
    return keyboard.sample(now_s)


def test_a_key_counts_for_a_moment_and_as_long_as_it_repeats(terminal):
    person, program = terminal
    with Keyboard(program, 2.0, 0.1) as keyboard:
        assert typed(person, keyboard, b"w", 1.0) == Sample((2.0, 0, 0, 0, 0, 0), deadman=True)
        assert keyboard.sample(1.0 + 0.9 * HOLD_S).deadman
        assert keyboard.sample(1.0 + HOLD_S) == Sample()
        for k in range(10):
            assert typed(person, keyboard, b"e", 2.0 + 0.09 * k) == Sample((0, 0, 0, 0, 0, -0.1), deadman=True)
            assert keyboard.sample(2.08 + 0.09 * k).deadman


@pytest.mark.parametrize(
    ("keys", "sample"),
    [
        (b"wwd", Sample((0, -2.0, 0, 0, 0, 0), deadman=True)),
        (b"w d", Sample(buttons=Button.STOP)),
        (b" ", Sample(buttons=Button.STOP)),
        (b"+", Sample(buttons=Button.FASTER, deadman=True)),
        (b"wz", Sample()),
        (b"W", Sample()),
        (b"\x1b[a", Sample()),
        (b"\x1bw", Sample()),
        (b"\xc3\xa4", Sample()),
    ],
)
def test_meaning_of_keys(terminal, keys, sample):
    person, program = terminal
    with Keyboard(program, 2.0, 0.1) as keyboard:
        typed(person, keyboard, b"w", 1.0)
        assert typed(person, keyboard, keys, 1.01) == sample


def test_what_was_typed_before_is_not_meant_for_the_robot(terminal):
    person, program = terminal
    os.write(person, b"wwww\n")
    time.sleep(0.05)
    with Keyboard(program, 2.0, 0.1) as keyboard:
        assert keyboard.sample(1.0) == Sample()


def test_the_terminal_is_put_back_after_an_error_and_keys_end_with_it(terminal):
    _, program = terminal
    before = termios.tcgetattr(program)
    with contextlib.suppress(ZeroDivisionError), Keyboard(program, 2.0, 0.1):
        assert not termios.tcgetattr(program)[3] & (termios.ICANON | termios.ECHO)
        raise ZeroDivisionError
    assert termios.tcgetattr(program) == before
    with pytest.raises(KeyboardError, match="terminal"):
        Keyboard(os.open("/dev/null", os.O_RDONLY), 2.0, 0.1)


def test_a_closed_terminal_ends_the_device(terminal):
    person, program = terminal
    keyboard = Keyboard(program, 2.0, 0.1)
    os.close(person)
    assert keyboard.sample(1.0) is None


UNTIL_KILLED = """
import sys, time
from rtctl.cli.operate import ended_by_signals
from rtctl.operator.keyboard import Keyboard
with ended_by_signals(), Keyboard(sys.stdin.fileno(), 1.0, 0.1):
    print("ready", flush=True)
    time.sleep(30)
"""


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGINT])
def test_a_program_that_is_asked_to_end_puts_the_terminal_back(terminal, number):
    _, program = terminal
    before = termios.tcgetattr(program)
    process = subprocess.Popen([sys.executable, "-c", UNTIL_KILLED], stdin=program, stdout=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "ready\n"
    assert termios.tcgetattr(program) != before
    process.send_signal(number)
    assert process.wait(10) == 0
    assert termios.tcgetattr(program) == before


def test_a_script_is_published_at_the_rate_and_a_change_at_once():
    held = Sample((1.0, 0, 0, 0, 0, 0), deadman=True)
    pressed = Sample(buttons=Button.STOP)
    sent = []
    script = Scripted([(0.2, Sample()), (0.3, held), (0.1, pressed)])
    publish(script, lambda sample: sent.append((time.monotonic(), sample)))
    kinds = [sample for _, sample in sent]
    order = [a for a, b in zip(kinds, [*kinds[1:], None], strict=True) if a != b]
    assert order == [Sample(), held, pressed]
    assert 0.3 / PERIOD_S / 3 < kinds.count(held) <= 0.3 / PERIOD_S + 2
    assert all(sample.buttons in (NO_BUTTON, Button.STOP) for sample in kinds)
