"""The promises a soak is about, one verdict each."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from rtctl.soak.processes import MODULES, Sample
from rtctl.soak.recorded import Recorded
from rtctl.soak.run import Noted

GROWTH_KIB = {"supervisor": 1024, "real-time": 64, "gateway": 16 * 1024}
"""What a process may hold more in the last quarter than in the second one. The real-time process allocates nothing; a
gateway begins anew after every kill, so its size depends on how old it is."""
GROWTH_SHARE = 0.05
COUNTS = 4
"""Descriptors and threads more: a client that comes or goes, a plan that is being computed."""
FRAMING_BYTES = 64
"""At most, around a row in the log, before compression."""
RATIO = 2.0
"""A tick in an outage may take so many times as long: starting a gateway warms nobody's caches."""


@dataclass(frozen=True)
class Verdict:
    """One promise: whether it was kept, and the figures. `timed` ones say something on a quiet machine only."""

    name: str
    good: bool
    figures: str
    timed: bool = False


def verdicts(noted: Noted, recorded: Recorded, exit_code: int) -> list[Verdict]:
    """All of them, in the order in which one wants to read them."""
    return [*_records(noted, recorded), *_requests(noted), *_growth(noted), _disk(noted, recorded), *_ticks(recorded), _ends(noted, recorded, exit_code)]  # fmt: skip


def _records(noted: Noted, recorded: Recorded) -> Iterator[Verdict]:
    r = recorded
    counted = max(r.told_lost, int(noted.status.get("lost_records", 0)))
    # grid points skipped in a gap are in no row; and what a killed gateway logged last may be counted as lost by the next
    skipped = min(max(int(noted.status.get("missed_ticks", 0)) - r.missed, 0), r.missing)
    lost = r.missing - skipped
    yield Verdict("no record is lost uncounted", r.rows > 0 and lost <= counted and r.rows + r.missing == r.ticks, f"{r.ticks} ticks: {r.rows} rows, {lost} lost, {skipped} skipped unseen; counted as lost {counted}; {r.missed} grid points were skipped before a row")  # fmt: skip
    yield Verdict("every log is whole", r.cut_short <= len(noted.outages) and r.last_is_whole, f"{r.files} files, {r.cut_short} cut short by {len(noted.outages)} kills")  # fmt: skip
    differs = f"differs in tick {r.difference.tick}, signal {r.difference.field}" if r.difference else ""
    why = r.replay_error or differs
    known = r.replayed == r.rows or (r.replay_ended_by_gap and lost <= counted)
    after = "; after lost records the state is not known" if r.replay_ended_by_gap else ""
    yield Verdict("the replay is identical to the bit", not why and known and r.replayed > 0, why or f"{r.replayed} of {r.rows} ticks{after}")  # fmt: skip


def _requests(noted: Noted) -> Iterator[Verdict]:
    sent, answered = (sum(s.get(k, 0) for s in noted.storms) for k in ("sent", "answered"))
    doubled = sum(s.get("doubled", 0) for s in noted.storms)
    unanswered = [tuple(t) for s in noted.storms for t in s.get("unanswered_ns", ())]
    outside, told = (
        sum(not any(o.covers(*t) for o in noted.outages) for t in times)
        for times in (unanswered, noted.operator_unanswered_ns)
    )
    good = bool(answered) and sent == answered + len(unanswered) and not (outside or told or doubled)
    yield Verdict("every request is answered once", good, f"{sent} requests of {len(noted.storms)} storms, {sent / noted.seconds:.0f} a second; {len(unanswered) - outside} unanswered while a gateway was dead, {outside} else; {told} of the operator's; {doubled} answered twice")  # fmt: skip
    accepted = sum(n for k, n in noted.outcomes.items() if k.endswith(": accepted"))
    verbs = len({k.split(":")[0] for k in noted.outcomes})
    yield Verdict("commands are obeyed and refused", 0 < accepted < sum(noted.outcomes.values()), f"{sum(noted.outcomes.values())} of {verbs} kinds, {accepted} accepted")  # fmt: skip


def _growth(noted: Noted) -> Iterator[Verdict]:
    for role in MODULES:
        seen = [s for s in noted.samples if s.role == role]
        early, late = _quarter(seen, 1), _quarter(seen, 3)
        if not early or not late:
            yield Verdict(f"the {role} does not grow", False, "not seen often enough")
            continue
        first, last = (float(np.median([s.resident_kib for s in part])) for part in (early, late))
        shared = {max(s.shared_kib for s in part) for part in (early, late)} if role == "real-time" else set()
        more = {
            name: max(getattr(s, name) for s in late) - max(getattr(s, name) for s in early)
            for name in ("descriptors", "threads")
        }
        allowed = max(GROWTH_KIB[role], 0.0 if role == "real-time" else GROWTH_SHARE * first)
        good = last - first <= allowed and len(shared) <= 1 and all(n <= COUNTS for n in more.values())
        memory = f", {shared.pop()} KiB shared" if len(shared) == 1 else ", shared memory changed" if shared else ""
        yield Verdict(f"the {role} does not grow", good, f"{first / 1024:.2f} to {last / 1024:.2f} MiB (may grow by {allowed / 1024:.2f}){memory}; {more['descriptors']:+d} descriptors, {more['threads']:+d} threads")  # fmt: skip


def _quarter(seen: list[Sample], number: int) -> list[Sample]:
    """The samples of one quarter of the run, counted from 0."""
    if not seen:
        return []
    begin, length = seen[0].time_s, seen[-1].time_s - seen[0].time_s
    return [s for s in seen if number <= 4.0 * (s.time_s - begin) / max(length, 1e-9) <= number + 1]


def _disk(noted: Noted, recorded: Recorded) -> Verdict:
    """The log takes what its rows take, and no more."""
    if len(noted.disk) < 2 or not recorded.rows:
        return Verdict("the disk fills as expected", False, "nothing was logged")
    (t0, first), (t1, last) = noted.disk[0], noted.disk[-1]
    a_minute = (last - first) / max(t1 - t0, 1e-9) * 60.0
    a_row = (last - first) / recorded.rows
    most = recorded.row_bytes + recorded.truth_bytes + 2 * FRAMING_BYTES
    return Verdict("the disk fills as expected", 0.0 < a_row <= most, f"{a_minute / 1e6:.1f} MB a minute, {a_row:.0f} bytes a tick, at most {most} uncompressed")  # fmt: skip


def _ticks(recorded: Recorded) -> Iterator[Verdict]:
    """Ticks while a gateway was dead or starting against all others."""
    for name, words in (("tick_ns", "no tick waits for the gateway"), ("lateness_ns", "no tick is late for it")):
        during, outside = recorded.during[name], recorded.outside[name]
        if not len(during) or not len(outside):
            yield Verdict(words, False, "no gateway was killed", timed=True)
            continue
        ratios = {q: float(np.percentile(during, q) / max(np.percentile(outside, q), 1.0)) for q in (50, 99, 99.9)}
        text = ", ".join(f"p{q:g} {np.percentile(during, q) * 1e-3:.1f} us = {ratio:.2f} x" for q, ratio in ratios.items())  # fmt: skip
        largest = f"largest {during.max() * 1e-3:.0f} us, else {outside.max() * 1e-3:.0f}"
        yield Verdict(words, ratios[50] <= RATIO and ratios[99] <= RATIO, f"{len(during)} ticks in outages: {text}; {largest}", timed=True)  # fmt: skip


def _ends(noted: Noted, recorded: Recorded, exit_code: int) -> Verdict:
    died = len(noted.gateways) - 1 - len(noted.outages)
    return Verdict("nothing else dies, and it ends safely", died <= 0 and exit_code == 0 and recorded.ends_safely, f"daemon's exit code {exit_code}, {max(died, 0)} gateways died by themselves, {'without' if recorded.ends_safely else 'WITH'} power at the end")  # fmt: skip
