"""What the drivers cost in a tick: two Sensoray 526, eight encoders and amplifiers, six gauges, on emulated registers."""

import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from bench.figures import Figure, Target, compare, in_turns
from drivers.backend import HardwareBackend
from hal import emulator
from hal.device import Demand, Device, Readings
from hal.emulator import Bench, Station
from hal.frames import VALID, actuator_frame, sensor_frame
from hal.seams import PortIO
from hal.switchboard import Switchboard

PART = "hardware"
CARDS = {"card_a": 0x2C0, "card_b": 0x300}
COUNTERS = 4
AXES = len(CARDS) * COUNTERS
TARGET_US = Target(60.0)
HALF = Target(0.5)
TICKS = 500
ROUNDS = 9
PERIOD_S = 0.001
COUNTS_A_TICK = 7


def measure() -> list[Figure]:
    """Median time of a tick [us]: of the cards' drivers, batch by batch and in turns access by access; of all devices."""
    with tempfile.TemporaryDirectory() as directory:
        batched, single = (_Rig(wrap, Path(directory)) for wrap in (lambda ports: ports, _OneByOne))
        bare = _BareAccesses(Path(directory))
        ours, theirs, registers, whole = in_turns(
            ROUNDS,
            lambda: batched.median_us(batched.cards),
            lambda: single.median_us(single.cards),
            lambda: bare.median_us(bare.repeat),
            lambda: batched.median_us(batched.all),
        )
    note = f"eight encoders, six gauges, eight outputs; median of {ROUNDS} times {TICKS} ticks"
    return [
        Figure(PART, "two cards", "us", float(np.median(ours)), target=TARGET_US, note=note),
        Figure(
            PART, "of it the emulated registers", "us", float(np.median(registers)), note="port accesses on a target"
        ),
        compare(PART, "two cards", "us", ours, theirs, reference_name="one call an access", target=HALF),
        Figure(PART, "with axes and force sensor", "us", float(np.median(whole)), note="read and write of the backend"),
    ]


class _OneByOne:
    """See :class:`hal.seams.PortIO`: every access a call of its own, as without batches."""

    def __init__(self, ports: PortIO) -> None:
        self._ports = ports

    def execute(self, operations: np.ndarray) -> int:
        return sum(self._ports.execute(operations[i : i + 1]) for i in range(len(operations)))

    def close(self) -> None:
        self._ports.close()


class _Listening:
    """See :class:`hal.seams.PortIO`: remembers which batches went where."""

    def __init__(self, ports: PortIO, seen: list[tuple[PortIO, np.ndarray]]) -> None:
        self._ports, self._seen = ports, seen

    def execute(self, operations: np.ndarray) -> int:
        self._seen.append((self._ports, operations))
        return self._ports.execute(operations)

    def close(self) -> None:
        self._ports.close()


class _Rig:
    """The hardware backend on emulated devices, with power and turning encoders."""

    def __init__(self, wrap: Callable[[PortIO], PortIO], directory: Path) -> None:
        table = _devices(directory)
        board = Switchboard()
        self._station = Station(PERIOD_S, 1, board)
        for entry in table:
            rest = {key: value for key, value in entry.items() if key not in ("kind", "name")}
            self._station.emulators[entry["name"]] = emulator.load(entry["kind"])(entry["name"], rest, self._station)
        for base in CARDS.values():
            board.plug_ports(base, wrap(board.ports(base, 0x40)))
        self._backend = HardwareBackend({"devices": table}, period_s=PERIOD_S)
        self._backend.use(board)
        self._backend.open()
        self._cards: list[Device] = [self._backend.devices[name] for name in CARDS]
        self._bench, self._readings, self._demand = Bench(AXES), Readings(AXES), Demand(AXES)
        self._sensors, self._actuators = np.zeros(1, sensor_frame(AXES)), np.zeros(1, actuator_frame(AXES))
        self._actuators["power"] = 1
        self._tick = 0

    def median_us(self, tick: Callable[[], None]) -> float:
        """Of some ticks; what the emulators need between them does not count."""
        taken = np.empty(TICKS)
        for i in range(TICKS):
            self._tick += 1
            self._bench.angle_rad += COUNTS_A_TICK * 2.0 * np.pi / 2000.0
            for emulated in self._station.emulators.values():
                emulated.sense(self._tick, self._bench)
            start = time.perf_counter()
            tick()
            taken[i] = time.perf_counter() - start
        return 1e6 * float(np.median(taken))

    def cards(self) -> None:
        """A tick of the cards alone."""
        for card in self._cards:
            card.begin(self._tick)
        for card in self._cards:
            card.read(self._tick, self._readings)
        for card in self._cards:
            card.write(self._tick, self._demand)

    def all(self) -> None:
        """A tick of the backend."""
        self._backend.read(self._tick, self._sensors)
        assert self._sensors["axes_validity"][0] == VALID
        self._actuators["command_v"] = 0.1 * (self._tick % 5)
        self._backend.write(self._tick, self._actuators)


class _BareAccesses(_Rig):
    """The port accesses of a tick with nobody who makes or reads them."""

    def __init__(self, directory: Path) -> None:
        self._seen: list[tuple[PortIO, np.ndarray]] = []
        super().__init__(self._listen, directory)
        self._seen.clear()
        self.cards()
        self._batches = list(self._seen)

    def _listen(self, ports: PortIO) -> PortIO:
        return _Listening(ports, self._seen)

    def repeat(self) -> None:
        """The batches of one tick."""
        for ports, batch in self._batches:
            ports.execute(batch)


def _devices(directory: Path) -> list[dict[str, Any]]:
    cards = [{"kind": "sensoray526", "name": name, "base": base} for name, base in CARDS.items()]
    axes = [_axis(number) for number in range(AXES)]
    file = directory / "sensor.cal"
    file.write_text(_calibration())
    sensor = {"kind": "ati_daq", "name": "force", "card": "card_a", "inputs": list(range(6)), "calibration": str(file)}
    return [*cards, *axes, sensor]


def _axis(number: int) -> dict[str, Any]:
    card, channel = list(CARDS)[number // COUNTERS], number % COUNTERS
    wiring = {"counter": channel, "output": channel, "enable_line": channel, "ready_line": COUNTERS + channel}
    motor = {"lines": 500, "max_speed_rad_per_s": 60.0, "continuous_a": 0.8, "peak_a": 1.6, "thermal_s": 10.0}
    amplifier = {"mode": "current", "gain_a_per_v": 0.2}
    return {"kind": "lsc_axis", "name": f"axis_{number}", "axis": number, "card": card, **wiring, **motor, **amplifier}


def _calibration() -> str:
    """Of a transducer whose gauges bear one axis each."""
    names, rated = ("Fx", "Fy", "Fz", "Tx", "Ty", "Tz"), (36, 36, 36, 500, 500, 500)
    rows = "".join(
        f'<UserAxis Name="{name}" values="{" ".join(str(most / 4 * (k == i)) for k in range(6))}" max="{most}"/>'
        for i, (name, most) in enumerate(zip(names, rated, strict=True))
    )
    what = 'PartNumber="bench" CalDate="1/1/2026" ForceUnits="N" TorqueUnits="N-mm" DistUnits="mm" HWTempComp="True"'
    return f'<FTSensor Serial="0" BodyStyle="Nano43" Family="DAQ" NumGages="6"><Calibration {what} OutputRange="20" OutputBipolar="True">{rows}</Calibration></FTSensor>'  # fmt: skip
