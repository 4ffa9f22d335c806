"""Port accesses as a text that can be kept: golden traces of a card, recorded on the target and replayed anywhere.

One operation a line, all numbers but the limit hexadecimal; an empty line ends a batch, # begins a remark::

    R 2f4 526a              read: port, word
    W 2c6 8001              write: port, word
    P 2ce 0004 0004 400 0004    poll: port, mask, wanted, limit, word or ---- when timed out
"""

from pathlib import Path

import numpy as np

from hal.errors import BackendError
from hal.seams import OPERATION, TIMED_OUT, Kind, PortIO


class PortRecorder:
    """See :class:`hal.seams.PortIO`: passes batches on, and writes what came of them to a file when it is closed."""

    def __init__(self, ports: PortIO, file: Path) -> None:
        self._ports, self._file = ports, file
        self._lines: list[str] = []

    def execute(self, operations: np.ndarray) -> int:
        """Pass the batch on and remember it."""
        timed_out = self._ports.execute(operations)
        self._lines += [*(_line(o) for o in operations), ""]
        return timed_out

    def close(self) -> None:
        """Write the trace and release the ports."""
        self._file.write_text("\n".join(self._lines) + "\n")
        self._ports.close()


class PortReplayer:
    """See :class:`hal.seams.PortIO`: gives the answers of a trace to a driver that asks exactly its questions.

    Raises:
        BackendError: the file is no trace.
    """

    def __init__(self, file: Path) -> None:
        self._batches = [_batch(lines, file) for lines in _split(file.read_text())]
        self._next = self._asked = 0

    def execute(self, operations: np.ndarray) -> int:
        """Answer as the card did. Raises BackendError, with the number of the operation, when the trace knows another."""
        if self._next == len(self._batches):
            raise BackendError("the trace is at its end", value=f"batch {self._next}", remedy="record a longer one")
        recorded = self._batches[self._next]
        for number in range(max(len(operations), len(recorded))):
            asked = _question(operations[number]) if number < len(operations) else "the end of the batch"
            known = _question(recorded[number]) if number < len(recorded) else "the end of the batch"
            if asked != known:
                raise BackendError(f"operation {self._asked + number} is not that of the trace", value=asked, bound=known, remedy="record anew if the driver was changed on purpose")  # fmt: skip
        answered = operations["kind"] != Kind.WRITE
        operations["result"][answered] = recorded["result"][answered]
        self._next += 1
        self._asked += len(recorded)
        return int((recorded["result"][recorded["kind"] == Kind.POLL] == TIMED_OUT).sum())

    def close(self) -> None:
        """Nothing to release."""

    @property
    def left(self) -> int:
        """Batches that nobody asked for yet."""
        return len(self._batches) - self._next


def _question(o: np.void) -> str:
    if o["kind"] == Kind.READ:
        return f"R {o['port']:x}"
    if o["kind"] == Kind.WRITE:
        return f"W {o['port']:x} {o['value']:04x}"
    return f"P {o['port']:x} {o['mask']:04x} {o['value']:04x} {o['limit']}"


def _line(o: np.void) -> str:
    if o["kind"] == Kind.WRITE:
        return _question(o)
    return f"{_question(o)} " + ("----" if o["result"] == TIMED_OUT else f"{o['result']:04x}")


def _split(text: str) -> list[list[str]]:
    lines = [line.partition("#")[0].strip() for line in text.splitlines() if not line.startswith("#")]
    batches: list[list[str]] = [[]]
    for line in lines:
        if line:
            batches[-1].append(line)
        elif batches[-1]:
            batches.append([])
    return [batch for batch in batches if batch]


def _batch(lines: list[str], file: Path) -> np.ndarray:
    return np.array([_operation(line, file) for line in lines], OPERATION)


def _operation(line: str, file: Path) -> tuple[int, ...]:
    kind, *fields = line.split()
    try:
        if kind == "R":
            port, word = (int(f, 16) for f in fields)
            return int(Kind.READ), port, 0, 0, 0, word
        if kind == "W":
            port, word = (int(f, 16) for f in fields)
            return int(Kind.WRITE), port, word, 0, 0, 0
        if kind == "P":
            port, mask, wanted = (int(f, 16) for f in fields[:3])
            limit, found = fields[3:]
            return int(Kind.POLL), port, wanted, mask, int(limit), TIMED_OUT if found == "----" else int(found, 16)
    except ValueError:
        pass
    raise BackendError(f"{file.name} is no trace of a card", value=line, bound="R, W or P with its numbers")
