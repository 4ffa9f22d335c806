"""What the processes of an emulated bench share: records in files of memory, each with one owner who is alive."""

import mmap
import os
from pathlib import Path

import numpy as np

from hal.errors import BackendError

ROOT = Path("/dev/shm")
HEADER = np.dtype([("magic", "u8"), ("size", "u8"), ("owner", "i8")])
MAGIC = int.from_bytes(b"rtrig/1\0", "little")
START = "start it first: rtctl bench rig CONFIG"


def path_of(place: str, name: str) -> Path:
    """The file of record `name` of the bench called `place`. Raises BackendError for a name that is no word."""
    for word in (place, name):
        if not word.replace("-", "").replace("_", "").isalnum():
            raise BackendError("no name for a bench", value=word, bound="letters, digits, - and _")
    return ROOT / f"rtctl-rig-{place}-{name}"


def create(place: str, name: str, dtype: np.dtype) -> np.ndarray:
    """A record, shape (1,) and all zero, which lives until :func:`remove`.

    Raises:
        BackendError: a bench of that name is running.
    """
    path = path_of(place, name)
    if path.exists():
        _refuse_the_living(path)
        path.unlink()
    size = HEADER.itemsize + dtype.itemsize
    partial = path.with_suffix(f".{os.getpid()}")
    with partial.open("wb") as file:  # nobody may see it before its header is there
        header = np.zeros(1, HEADER)
        header["magic"], header["size"], header["owner"] = MAGIC, size, os.getpid()
        file.write(header.tobytes())
        file.truncate(size)
    partial.rename(path)
    return _map(path, dtype)


def attach(place: str, name: str, dtype: np.dtype) -> np.ndarray:
    """The record of a running bench, shape (1,).

    Raises:
        BackendError: there is none, its owner is dead, or it is of another version.
    """
    path = path_of(place, name)
    if not path.exists():
        raise BackendError("the emulated bench is not running", value=place, remedy=START)
    header = np.frombuffer(path.read_bytes()[: HEADER.itemsize], HEADER)[0]
    if header["magic"] != MAGIC or header["size"] != HEADER.itemsize + dtype.itemsize:
        raise BackendError(
            "the emulated bench is of another version", value=str(path), remedy="stop it and start it again"
        )
    if not _is_alive(int(header["owner"])):
        raise BackendError("the emulated bench has died", value=place, remedy=START)
    return _map(path, dtype)


def remove(place: str, name: str) -> None:
    """Take the name away; who is attached keeps the memory."""
    path_of(place, name).unlink(missing_ok=True)


def _map(path: Path, dtype: np.dtype) -> np.ndarray:
    with path.open("r+b") as file:
        memory = mmap.mmap(file.fileno(), 0)
    return np.frombuffer(memory, dtype, count=1, offset=HEADER.itemsize)


def _refuse_the_living(path: Path) -> None:
    data = path.read_bytes()[: HEADER.itemsize]
    if len(data) == HEADER.itemsize and _is_alive(owner := int(np.frombuffer(data, HEADER)[0]["owner"])):
        raise BackendError("an emulated bench of this name is running", value=f"process {owner}", remedy="stop it, or choose another name")  # fmt: skip


def _is_alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True
