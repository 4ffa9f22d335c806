"""Where two records of one run differ, in signals that both have."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from rtctl.log.hashing import output_fields
from rtctl.replaying.fingerprint import PREFIX, fingerprints
from rtctl.replaying.stages import along_the_tick


@dataclass(frozen=True)
class Difference:
    """The first tick that was not reproduced, and in it the value nearest to the cause.

    `logged` is None if the log holds only its fingerprint. `others` differ in the same tick, in the order of the tick.
    """

    tick: int
    field: str
    logged: Any
    replayed: Any
    others: tuple[str, ...] = ()


def compared(logged: np.dtype, replayed: np.dtype) -> tuple[list[str], list[str]]:
    """Output signals that both layouts have, or of which the log has fingerprints; and those that only one has."""
    ours = output_fields(replayed)
    theirs = {name.removeprefix(PREFIX): name for name in output_fields(logged)}
    common = [n for n in ours if n in theirs and (theirs[n] != n or logged[n] == replayed[n])]
    return along_the_tick(common), along_the_tick({*ours, *theirs} - set(common))


def differing(logged: np.ndarray, replayed: np.ndarray) -> dict[str, np.ndarray]:
    """Signal -> rows (k,) in which its bytes differ, in the order of the tick; arrays have shape (n,)."""
    found = {}
    for name in compared(logged.dtype, replayed.dtype)[0]:
        if name in (logged.dtype.names or ()):
            a, b = (np.ascontiguousarray(rows[name]).view("u1").reshape(len(rows), -1) for rows in (logged, replayed))
        else:
            a, b = logged[PREFIX + name][:, None], fingerprints(replayed[name])[:, None]
        rows = np.flatnonzero((a != b).any(axis=1))
        if len(rows):
            found[name] = rows
    return found


def first_difference(logged: np.ndarray, replayed: np.ndarray) -> Difference | None:
    """The first row in which a signal differs, both (n,); None if all that can be compared is the same to the bit."""
    rows = differing(logged, replayed)
    if not rows:
        return None
    first = min(int(r[0]) for r in rows.values())
    names = [name for name, r in rows.items() if r[0] == first]
    value = logged[names[0]][first].tolist() if names[0] in (logged.dtype.names or ()) else None
    tick = int(logged["tick"][first])
    return Difference(tick, names[0], value, replayed[names[0]][first].tolist(), tuple(names[1:]))
