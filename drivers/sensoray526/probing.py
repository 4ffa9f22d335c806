"""What can be seen of a card without moving anything: the lines of ``rtctl devices probe``."""

from typing import TYPE_CHECKING

import numpy as np

from drivers.sensoray526 import scan
from drivers.sensoray526.eeprom import read_calibration
from drivers.sensoray526.registers import LINES, SIGNATURES
from hal.device import Finding, Readings
from hal.errors import BackendError
from hal.seams import PortIO
from hal.troubles import say

if TYPE_CHECKING:
    from drivers.sensoray526.device import Sensoray526

SCANS = 200
NOISE_LIMIT_V = 0.01
"""0.05 % of the full scale of 20 V (07 section 7)."""


def probe(card: "Sensoray526", ports: PortIO) -> list[Finding]:
    """Findings on signature, EEPROM, references, inputs, counters, lines, watchdog, in this order."""
    findings = [
        Finding("signature", f"{card.signature:04X}", card.signature in SIGNATURES),
        _eeprom(card, ports),
    ]
    counts, voltages = np.empty((SCANS, len(card.count))), np.empty((SCANS, len(card.voltage_v)))
    errors = np.zeros(len(card.count), np.bool_)
    readings = Readings(0)
    for i in range(SCANS):
        card.begin(i)
        card.read(i, readings)
        counts[i], voltages[i] = card.count, card.voltage_v
        errors |= card.count_error
    if readings.trouble:
        text, remedy = say(readings.trouble, readings.trouble_value)
        findings.append(Finding("scans", text, False, remedy))
    if card.used("input"):
        findings.append(_references(card))
    findings += [_input(channel, voltages[:, channel], bool(card.railed[channel])) for channel in card.used("input")]
    findings += [_counter(channel, counts[:, channel], bool(errors[channel])) for channel in card.used("counter")]
    levels = "".join("H" if high else "L" for high in card.line)
    findings.append(Finding("lines 0 .. 7", levels, len(levels) == LINES))
    findings.append(_watchdog(card))
    return findings


def _eeprom(card: "Sensoray526", ports: PortIO) -> Finding:
    try:
        again = read_calibration(ports, card.options.base)
    except BackendError as error:
        return Finding("EEPROM", error.what, False, error.remedy)
    same = again == card.calibration
    return Finding("EEPROM", f"reference {again.reference_v:.5f} V", same, "" if same else "it reads differently every time: replace the card")  # fmt: skip


def _references(card: "Sensoray526") -> Finding:
    high, ground = (int(scan.signed(int(word))) for word in card.scan_words()[:2])
    off = abs((high - ground) * 10.0 / card.calibration.reference_v / scan.FULL_SCALE - 1.0)
    good = off <= scan.GAIN_TOLERANCE and abs(ground) <= scan.OFFSET_TOLERANCE_LSB and high != scan.TOP
    remedy = "let the card warm up; have it calibrated if it stays"
    if high == scan.TOP:
        remedy = "the +10 V reference is beyond the converter's range, so voltages cannot be calibrated: see the manual"
    return Finding("references", f"+10 V {high}, 0 V {ground}", good, "" if good else remedy)


def _input(channel: int, voltage_v: np.ndarray, railed: bool) -> Finding:
    mean_v, rms_v = float(np.mean(voltage_v)), float(np.std(voltage_v))
    remedy = ""
    if not np.isfinite(mean_v):
        remedy = "see scans"
    elif railed:
        remedy = "at its rail: is the sensor's cable connected?"
    elif rms_v == 0.0:
        remedy = "it does not change at all: is it converted?"
    elif rms_v > NOISE_LIMIT_V:
        remedy = "noisy: check shield and ground"
    return Finding(f"input {channel}", f"{mean_v:+.4f} V, noise {1e3 * rms_v:.2f} mV rms", not remedy, remedy)


def _counter(channel: int, count: np.ndarray, error: bool) -> Finding:
    span = int(np.ptp(count))
    remedy = ""
    if error:
        remedy = "illegal steps: check cable and shield"
    elif span > 1:
        remedy = "it counts although nothing should move: check the encoder's supply and shield"
    return Finding(f"counter {channel}", f"moved by {span} counts", not remedy, remedy)


def _watchdog(card: "Sensoray526") -> Finding:
    o = card.options
    if o.watchdog_code < 0:
        return Finding("watchdog", "off", False, "wire it into the enable chain, and set watchdog_code: without it outputs hold their last value when the controller dies")  # fmt: skip
    wired = f"line {o.watchdog_line}" if o.watchdog_line >= 0 else "no line"
    return Finding("watchdog", f"code {o.watchdog_code}, {o.watchdog_interval_s:g} s, seen on {wired}", True)
