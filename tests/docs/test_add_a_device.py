"""The worked example of docs/how-to/add-a-device.md, as it stands there: installed, in a whole controller, and broken."""

import re
import shlex
import shutil
import socket
import struct
import sys
import textwrap
import tomllib
import zlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hal import device, emulator
from hal.backend import load as load_backend
from hal.conformance import CHECKS
from hal.device import Readings, Site
from hal.errors import BackendError, OptionError
from hal.frames import INVALID, VALID
from hal.seams import load as load_seams
from hal.switchboard import Switchboard
from hal.troubles import Trouble
from rtctl.cli import main
from rtctl.commands import Verb
from rtctl.lifecycle import Operating
from rtctl.lockstep import Lockstep
from rtctl.settings import load

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES, PAGE = ROOT / "docs" / "examples", ROOT / "docs" / "how-to" / "add-a-device.md"
FILES = EXAMPLES / "udp_load_cell.py", EXAMPLES / "udp_load_cell_emulator.py"
DEVICE = re.compile(r"\[\[backend\.options\.devices\]\]\n(?:[^\[\n][^\n]*\n)+")
LAST = 2**32 - 1


def blocks(language):
    return re.findall(rf"^```{language}\n(.*?)^```$", PAGE.read_text(), re.MULTILINE | re.DOTALL)


ENTRY_POINTS, SETTINGS = blocks("toml")
EXCERPTS = [b for b in blocks("py") if "import" not in b]
PROGRAMS = [b for b in blocks("py") if "import" in b]
TABLE = tomllib.loads(SETTINGS)["backend"]["options"]["devices"][0]


@pytest.fixture(scope="module", autouse=True)
def workplace(tmp_path_factory):
    """A folder with the package my_lab, installed as pip would with the page's entry points, and the page's my-robot.toml."""
    folder = tmp_path_factory.mktemp("workplace")
    package, installed = folder / "my_lab", folder / "my_lab-1.0.dist-info"
    package.mkdir()
    installed.mkdir()
    for file in FILES:
        shutil.copy(file, package)
    groups = tomllib.loads(ENTRY_POINTS)["project"]["entry-points"]
    lines = [
        line for group, names in groups.items() for line in (f"[{group}]", *(f"{k} = {v}" for k, v in names.items()))
    ]
    (installed / "METADATA").write_text("Metadata-Version: 2.1\nName: my_lab\nVersion: 1.0\n")
    (installed / "entry_points.txt").write_text("\n".join(lines))
    hil = (ROOT / "config" / "planar-hil.toml").read_text()
    (sensor,) = (b for b in DEVICE.findall(hil) if 'name = "force_sensor"' in b)
    (folder / "my-robot.toml").write_text(hil.replace(sensor, SETTINGS))
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(folder)
        patch.chdir(folder)
        yield folder
    for name in [n for n in sys.modules if n.split(".")[0] == "my_lab"]:
        del sys.modules[name]


def settings(*changes):
    return load("my-robot.toml", ("backend.name=rig", *changes))


@pytest.fixture
def rig():
    lockstep = Lockstep(settings(), 3)
    lockstep.advance(60)
    yield lockstep
    lockstep.close()


@pytest.mark.parametrize("check", CHECKS, ids=lambda c: c.__name__)
def test_the_backend_with_it_keeps_every_promise(check):
    check(lambda: load_backend("rig", settings().backend.options, period_s=0.001, seed=7))


def test_the_robot_homes_while_it_tells_what_the_bench_bears(rig):
    """Every tick, to the precision of float32."""
    rig.command(Verb.ENABLE)
    assert rig.advance(200)["powered"]
    rig.command(Verb.HOME)
    told, borne = [], []
    while not told or (told[-1]["is_busy"] and len(told) < 20_000):
        told.append(rig.advance(1).copy())
        borne.append(rig.backend.rig.bench.wrench_in_sensor.copy())
    assert told[-1]["is_homed"]
    assert told[-1]["operating_state"] == Operating.ENABLED
    told = np.array(told)
    assert (told["wrench_validity"] == VALID).all()
    assert not told["wrench_age_ticks"].any()
    assert not told["trouble"].any()
    assert (np.diff(told["wrench_sequence"]) == 1).all()
    assert np.ptp(borne, axis=0).max() > 0.01, "there was something to follow"
    np.testing.assert_allclose(told["wrench_in_sensor"], borne, rtol=1e-6, atol=1e-9)


FAULTS = [
    ("silence", 1, Trouble.SENSOR_SILENT, 6, INVALID),
    ("corrupt", 1, Trouble.DATAGRAM_CORRUPT, 1, INVALID),
    ("not_a_number", 1, Trouble.DATAGRAM_CORRUPT, 1, INVALID),
    ("drop", 3, Trouble.DATAGRAM_GAP, 4, VALID),
    ("freeze", 1, Trouble.SENSOR_SILENT, 6, INVALID),
    ("reboot", 1000, Trouble.SENSOR_SILENT, 6, INVALID),
]
"""Name, value, what is told, after how many ticks, and the wrench ten ticks later."""


@pytest.mark.parametrize(("fault", "value", "trouble", "told", "then"), FAULTS, ids=[f[0] for f in FAULTS])
def test_its_faults_are_told_and_mended(rig, fault, value, trouble, told, then):
    rig.backend.rig.inject("force_sensor", fault, value)
    assert next(n for n in range(1, 100) if rig.advance(1)["trouble"] == trouble) == told
    record = rig.advance(10)
    assert record["wrench_validity"] == then
    assert np.isnan(record["wrench_in_sensor"]).all() == (then == INVALID)
    assert record["wrench_age_ticks"] == (0 if then == VALID else told + 10)
    rig.backend.rig.inject("force_sensor", fault, 0)
    rig.advance(2)
    record = rig.advance(1)
    assert (record["trouble"], record["wrench_validity"], record["wrench_age_ticks"]) == (0, VALID, 0)


def test_settings_faults_and_kinds_that_are_wrong_are_refused(rig):
    table = {k: v for k, v in TABLE.items() if k not in ("kind", "name")}
    site = Site(0.001, 50, Switchboard())
    with pytest.raises(OptionError, match="silent_tick"):
        device.load(TABLE["kind"])("force_sensor", {**table, "silent_tick": 3}, site)
    with pytest.raises(OptionError, match="peer"):
        device.load(TABLE["kind"])("force_sensor", {}, site)
    with pytest.raises(BackendError, match="no such fault"):
        rig.backend.rig.inject("force_sensor", "explode")
    with pytest.raises(BackendError, match="no emulator"):
        emulator.load("udp_load_cel")


def datagram(number, force=1.0):
    """From the manual, by the way of zlib and struct alone."""
    body = struct.pack(">4sI6f", b"LCEL", number, 0.0, 0.0, force, 0.0, 0.0, 0.0)
    return body + struct.pack(">I", zlib.crc32(body))


class Desk:
    """The driver, and whatever a test sends it."""

    def __init__(self):
        switchboard = Switchboard()
        table = {k: v for k, v in TABLE.items() if k not in ("kind", "name")}
        self.driver = device.load(TABLE["kind"])("force_sensor", table, Site(0.001, 50, switchboard))
        self.line = switchboard.plug_datagrams(TABLE["local"], TABLE["peer"])
        self.driver.open()
        self.readings, self.tick = Readings(0), 0

    def read(self, *sent):
        for data in sent:
            self.line.send(data)
        self.tick += 1
        self.readings.clear()
        self.driver.read(self.tick, self.readings)
        return self.readings


def test_golden_bytes():
    """Their sum comes from a shift register over the polynomial, bit by bit, not from zlib."""
    golden = bytes.fromhex("4c43454c 00000007 3f800000 c0000000 40400000 00000000 00000000 3f000000 0d48000f")
    readings = Desk().read(golden)
    assert readings.wrench_validity == VALID
    assert readings.wrench_in_sensor.tolist() == [1.0, -2.0, 3.0, 0.0, 0.0, 0.5]


def test_the_sequence_goes_on_where_the_number_wraps_and_where_it_starts_anew():
    desk = Desk()
    assert [desk.read(datagram(n)).wrench_sequence for n in (LAST - 1, LAST, 0, 1)] == [1, 2, 3, 4]
    for _ in range(50):
        desk.read()
    readings = desk.read(datagram(0, 2.0))
    assert (readings.wrench_sequence, readings.wrench_validity, readings.trouble) == (5, VALID, 0)


def test_doubles_and_late_ones_are_no_news():
    desk = Desk()
    desk.read(datagram(10, 1.0))
    readings = desk.read(datagram(10, 9.0), datagram(9, 9.0))
    assert (readings.wrench_sequence, readings.wrench_age_ticks, readings.wrench_in_sensor[2]) == (1, 1, 1.0)


def test_a_flood_does_not_hold_up_the_tick():
    desk = Desk()
    assert desk.read(*(datagram(n) for n in range(500))).wrench_sequence < 100
    for _ in range(20):
        desk.read()
    assert desk.driver.health().errors["refused"] == 0
    assert desk.line.receive(bytearray(64)) == -1


@given(st.lists(st.one_of(st.binary(max_size=80), st.binary(min_size=36, max_size=36)), max_size=5))
def test_soup_never_raises_and_is_never_a_wrench(soup):
    readings = Desk().read(*soup)
    assert readings.wrench_validity == INVALID
    assert np.isnan(readings.wrench_in_sensor).all()
    assert (readings.trouble == Trouble.DATAGRAM_CORRUPT) == bool(soup)


@given(st.integers(0, 287))
def test_one_wrong_bit_is_seen(bit):
    data = bytearray(datagram(3))
    data[bit // 8] ^= 1 << bit % 8
    assert Desk().read(data).wrench_validity == INVALID


def test_over_real_sockets_only_the_load_cell_is_heard():
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as cell,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger,
    ):
        for s in (cell, stranger):
            s.bind(("127.0.0.1", 0))
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
            free.bind(("127.0.0.1", 0))
            local = free.getsockname()
        table = {"local": f"127.0.0.1:{local[1]}", "peer": f"127.0.0.1:{cell.getsockname()[1]}"}
        driver = device.load(TABLE["kind"])("force_sensor", table, Site(0.001, 50, load_seams("target")))
        driver.open()
        stranger.sendto(datagram(1, 9.0), local)
        cell.sendto(datagram(1, 1.0), local)
        stranger.sendto(datagram(2, 9.0), local)
        readings = Readings(0)
        driver.read(1, readings)  # on loopback what was sent has arrived
        assert readings.wrench_in_sensor[2] == 1.0
        assert driver.health().errors == {"refused": 0, "lost": 0, "foreign": 2}
        driver.close()
        driver.close()
        readings.clear()
        driver.read(2, readings)
        assert readings.wrench_validity == INVALID


@pytest.mark.parametrize("excerpt", EXCERPTS, ids=lambda e: e.split("(")[0].split()[-1])
def test_the_page_shows_what_the_files_say(excerpt):
    assert any(textwrap.indent(excerpt, indent) in file.read_text() for file in FILES for indent in ("", "    "))


def test_the_command_of_the_page_inserts(capsys):
    (block,) = blocks("sh")
    assert main(shlex.split(block)[1:]) == 0, capsys.readouterr().err


def test_the_programs_of_the_page_run_and_the_table_tells_what_comes_out(capsys):
    scope = {"__name__": "example"}
    breaking, promises = PROGRAMS
    exec(compile(breaking, PAGE.name, "exec"), scope)
    told = [line.split(" ", 3) for line in capsys.readouterr().out.splitlines()]
    rows = [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in PAGE.read_text().splitlines()
        if line.startswith("| `")
    ]
    assert [[f[0], f[1]] for f in told] == [[re.match(r"`(\w+)`", r[0])[1], r[1].split()[0]] for r in rows]
    assert [f[2] for f in told] == [r[4] for r in rows]
    assert all(r[3] in f[3] for f, r in zip(told, rows, strict=True)), told
    assert {f[0] for f in told} == set(emulator.load(TABLE["kind"]).faults) == {f[0] for f in FAULTS}
    exec(compile(promises, PAGE.name, "exec"), scope)
