"""The failure table, acted out: every fault an emulator knows, in the middle of an insertion, through the real drivers.

The insertion runs in lockstep on the emulated bench up to some depth, once for each set of devices; then every fault
is injected into a copy of that very moment. What comes out is exact: the same settings give the same table.
"""

import multiprocessing
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from hal.errors import RtctlError
from rtctl.gateway.events import Event, Watcher
from rtctl.hil.insertion import in_lockstep
from rtctl.lifecycle import Motion, Operating
from rtctl.lockstep import Lockstep
from rtctl.settings import Settings, from_table, table_of
from rtctl.simulation import LockstepOperator, Recorder
from rtctl.workflow import Progress, insert_array

DEPTH_MM = 2.0
"""Where things break: the array is inside, every motor turns."""
LONGEST_TICKS = 7000
"""Four sweeps of the telemetry, the slowest sign of all."""
SETTLE_TICKS = 100
"""Drives on a bus take some exchanges to say where they are."""
AFTER_TICKS = 400
"""Time for the reaction to come to rest."""


@dataclass(frozen=True)
class Fault:
    """One line: what breaks in the world, and how it is injected."""

    what: str
    device: str
    fault: str
    value: float = 1.0


@dataclass(frozen=True)
class Outcome:
    """What came of it. Ticks are None for what did not happen; 1 is the first tick that could show it."""

    fault: Fault
    seen_ticks: int | None
    """until the first trouble, or condition, or invalid value"""
    sign: str
    reacted_ticks: int | None
    """until the operating state changed"""
    state: str
    moving: bool
    """still on its way through the insertion at the end"""
    text: str
    """of all that was told first, in the same tick"""


CARDS = (
    Fault("card lost, or wrong base", "card_b", "signature", 65535),
    Fault("ADC never done", "card_b", "adc_never_done"),
    Fault("stale ADC channel", "card_b", "stale_channel", 3),
    Fault("ADC reference drifts by 2 %", "card_b", "reference_drift", 0.02),
    Fault("ADC input saturated", "force_sensor", "gauge_rail", 2),
    Fault("transducer's cable cut", "force_sensor", "cable_off"),
    Fault("gauges noisy", "force_sensor", "noise", 20),
    Fault("load 85 % of rated", "force_sensor", "overload", -0.85),
    Fault("load 110 % of rated", "force_sensor", "overload", -1.1),
    Fault("encoder pulses where none should be", "card_a", "index_add", 3),
    Fault("encoder's index cut", "card_a", "index_suppress", 1),
    Fault("encoder loses counts", "card_a", "encoder_drop", 1),
    Fault("encoder makes an illegal step", "card_a", "ecap", 1),
    Fault("encoder jumps", "card_a", "encoder_glitch", 1),
    Fault("encoder's wires cut", "motor_1", "encoder_cut"),
    Fault("encoder's wires swapped", "motor_1", "encoder_inverted"),
    Fault("set value's wire cut", "motor_1", "command_open"),
    Fault("analog output stuck", "card_a", "dac_freeze", 1),
    Fault("amplifier not ready", "motor_1", "not_ready"),
    Fault("nobody pets the card's watchdog", "card_a", "stop_petting"),
    Fault("telemetry silent", "telemetry", "silence"),
    Fault("telemetry loses samples", "telemetry", "drop", 3),
    Fault("telemetry reorders", "telemetry", "reorder", 3),
    Fault("telemetry's sender starts anew", "telemetry", "new_run"),
    Fault("telemetry corrupt", "telemetry", "corrupt_crc"),
    Fault("telemetry of another length", "telemetry", "bad_length"),
    Fault("telemetry frozen", "telemetry", "freeze"),
    Fault("somebody else sends", "telemetry", "foreign"),
)
NET_FT = (
    Fault("Net F/T silent", "force_sensor", "silence"),
    Fault("Net F/T loses records", "force_sensor", "drop", 3),
    Fault("Net F/T frozen but streaming", "force_sensor", "freeze_ft"),
    Fault("Net F/T starts anew", "force_sensor", "reboot"),
    Fault("Net F/T saturated (status bit 17)", "force_sensor", "status", 17),
    Fault("Net F/T records corrupt", "force_sensor", "corrupt"),
)
DRIVES = (
    Fault("CAN bus off", "drives", "bus_off"),
    Fault("CAN error-passive", "drives", "bus_passive"),
    Fault("CAN transmit queue full", "drives", "tx_full"),
    Fault("drive silent", "drives", "mute", 1),
    Fault("drive starts anew", "drives", "reboot", 1),
    Fault("drive faults", "drives", "drive_fault", 1),
    Fault("drive ignores its set value", "drives", "ignore_setpoint", 1),
    Fault("drive without heartbeat", "drives", "heartbeat_dead", 1),
    Fault("SYNC late by 8 exchanges", "drives", "sync_delay", 8),
)


def with_net_ft(settings: Settings) -> Settings:
    """A Net F/T instead of the transducer on a card."""
    sensor = {"kind": "ati_net_ft", "name": "force_sensor", "counts_per_force": 1e6, "counts_per_torque": 1e6, "force_unit": "N", "torque_unit": "N-mm"}  # fmt: skip
    return _other_devices(settings, [sensor if e["name"] == "force_sensor" else e for e in _devices(settings)])


def with_drives(settings: Settings) -> Settings:
    """EPOS4 drives in CST on one CAN bus instead of cards and linear amplifiers; the transducer stays on its card."""
    gone = {e["name"] for e in _devices(settings) if e["kind"] == "lsc_axis"} | {"card_a"}
    motors = [e for e in _devices(settings) if e["kind"] == "lsc_axis"]
    nodes = [
        {
            "node": m["axis"] + 1, "axis": m["axis"], "mode": "cst", "counts_per_rad": 2 * m["lines"] * m["gear"] / np.pi,
            "gain_a_per_v": m["gain_a_per_v"], "rated_current_a": m["continuous_a"], "current_limit_a": m["peak_a"],
            "max_speed_rad_per_s": m["max_speed_rad_per_s"], "following_error_rad": 10.0, "quick_stop_rad_per_s2": 4000.0,
        }
        for m in motors
    ]  # fmt: skip
    bus = {"kind": "epos_bus", "name": "drives", "channel": "can0", "nodes": nodes}
    return _other_devices(settings, [bus, *(e for e in _devices(settings) if e["name"] not in gone)])


SETS = ((in_lockstep, CARDS), (with_net_ft, NET_FT), (with_drives, DRIVES))
"""Devices and what can break of them."""


def run(settings: Settings) -> Iterator[Outcome]:
    """Act out every fault on the emulated bench of `settings`, those of planar-hil. Raises RtctlError."""
    for make, faults in SETS:
        scene = Scene(make(settings))
        for fault in faults:
            yield scene.play(fault)


class Scene:
    """An insertion in lockstep that has come to DEPTH_MM and goes on; every play starts from this very moment.

    Raises:
        RtctlError: it did not come so far.
    """

    def __init__(self, settings: Settings) -> None:
        self._names = settings.backend.device_names
        self._prefixes = tuple(f"{name}: " for name in self._names)
        self._lockstep = Lockstep(settings, seed=0)

        class Deep(Exception):
            """Far enough."""

        def watch(progress: Progress) -> None:
            if progress.name == "insert" and progress.depth_mm >= DEPTH_MM:
                raise Deep

        recorder = Recorder(self._names)
        self._lockstep.sink = recorder.take
        self._lockstep.advance(SETTLE_TICKS)
        try:
            insert_array(LockstepOperator(self._lockstep, recorder), settings, self._lockstep.controller.robot, watch)
        except Deep:
            self._lockstep.sink = lambda _records, _truths: None
            return
        raise RtctlError("the insertion ended before anything could be broken", bound=f"{DEPTH_MM:g} mm")

    def play(self, fault: Fault) -> Outcome:
        """Inject `fault` into a copy of the moment, in a process of its own, and look what happens."""
        context = multiprocessing.get_context("fork")
        here, there = context.Pipe(duplex=False)
        child = context.Process(target=self._play_apart, args=(fault, there))
        child.start()
        there.close()
        try:
            outcome = here.recv()
        except EOFError:
            raise RtctlError("a fault could not be acted out", value=fault.what) from None
        finally:
            child.join()
        if isinstance(outcome, RtctlError):
            raise outcome
        return outcome

    def _play_apart(self, fault: Fault, pipe: Any) -> None:
        try:
            pipe.send(self._play(fault))
        except RtctlError as error:
            pipe.send(RtctlError(f"{fault.what}: {error}"))

    def _play(self, fault: Fault) -> Outcome:
        backend: Any = self._lockstep.backend
        watcher = Watcher(self._names)
        before = self._lockstep.advance(1).copy()
        watcher.watch(np.array([before]))
        backend.rig.inject(fault.device, fault.fault, fault.value)
        seen, sign, reacted, record = None, "", None, before
        told: list[Event] = []
        for ticks in range(1, LONGEST_TICKS + 1):
            record = self._lockstep.advance(1)
            events = [e for e in watcher.watch(np.array([record])) if e.kind == "condition" and e.remedy]
            told = told or sorted(events, key=lambda e: e.text.startswith(self._prefixes), reverse=True)
            if seen is None and (sign := _sign(before, record)):
                seen = ticks
            if reacted is None and record["operating_state"] != before["operating_state"]:
                reacted = ticks
            if (reacted and ticks >= reacted + AFTER_TICKS) or record["motion"] == Motion.HOLD:
                break
        return Outcome(
            fault,
            seen,
            sign,
            reacted,
            Operating(int(record["operating_state"])).name,
            bool(record["motion"] == Motion.INSERT),
            "; ".join(dict.fromkeys(e.text for e in told)),
        )


def _sign(before: Any, record: Any) -> str:
    """What shows in a record that something is wrong, in a word; empty for nothing."""
    if record["trouble"] and record["trouble"] != before["trouble"]:
        return "trouble"
    for group in ("axes", "wrench", "impedance"):
        if record[f"{group}_validity"] != before[f"{group}_validity"]:
            return f"{group} {('invalid', 'valid', 'saturated', 'frozen')[int(record[f'{group}_validity'])]}"
    if int(record["condition_active"]) & ~int(before["condition_active"]):
        return "condition"
    return ""


def _devices(settings: Settings) -> list[Mapping[str, Any]]:
    return list(settings.backend.options["devices"])


def _other_devices(settings: Settings, devices: list[Mapping[str, Any]]) -> Settings:
    table = table_of(in_lockstep(settings))
    table["backend"]["options"] = {**table["backend"]["options"], "devices": [dict(e) for e in devices]}
    return from_table(table)
