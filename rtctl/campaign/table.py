"""The table of a campaign on disk: CSV, one line a row, each written at once, so that no end of a process spoils it."""

import csv
import errno
import fcntl
import io
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import TracebackType
from typing import BinaryIO, Self

from hal.errors import RtctlError
from rtctl.campaign.row import Row

ANOTHER_FILE = "name another file"
DIFFERENT = {"config_hash": "with other settings", "kernel_hash": "by another version of the program"}
"""What it means if the column `Table.identity` names has another value."""


class CampaignError(RtctlError):
    """The table of a campaign cannot be written, or it is that of another one."""

    exit_code = 6


class Table:
    """The rows of a campaign; a context manager.

    Args:
        path: the file; it is made if there is none.
        columns: names of the columns, in order.
        identity: value of every column of `DIFFERENT`, which all rows of one campaign have.

    Attributes:
        known: seed -> row of what the file held when it was opened.

    Raises:
        CampaignError: the file cannot be written, is in use, or is not a table of this campaign. It is left as it was.
    """

    def __init__(self, path: Path, columns: tuple[str, ...], identity: Mapping[str, str]) -> None:
        self._path, self._columns, self._identity = path, columns, identity
        try:
            self._file: BinaryIO = path.open("a+b", buffering=0)
        except OSError as error:
            raise CampaignError("the table cannot be written", value=str(path), remedy=f"{error.strerror}; {ANOTHER_FILE}") from None  # fmt: skip
        try:
            self._lock()
            self.known: dict[int, Row] = self._read()
        except OSError as error:
            self._file.close()
            raise self._refuse(f"this is no file a table can be kept in ({error.strerror})", str(path)) from None
        except BaseException:
            self._file.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()

    def append(self, row: Row) -> None:
        """Write one row. Raises CampaignError if the disk is full, or the like."""
        line = _line(row.get(name, "") for name in self._columns)
        try:
            if self._file.write(line) != len(line):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        except OSError as error:
            raise CampaignError("the table cannot be written", value=str(self._path), remedy=f"{error.strerror}; then run the same command again") from None  # fmt: skip

    def _lock(self) -> None:
        """Two campaigns in one file would mix their rows."""
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise CampaignError("another campaign is writing this table", value=str(self._path), remedy=f"wait for its end, or {ANOTHER_FILE}") from None  # fmt: skip

    def _read(self) -> dict[int, Row]:
        """What is there, with a line that was not written to its end cut off, and the heading if there was none."""
        self._file.seek(0)
        content = self._file.read()
        heading = _line(self._columns)
        if heading.startswith(content):  # empty, or ended within the heading
            self._file.truncate(0)
            self._file.write(heading)
            return {}
        if not content.startswith(heading):
            raise self._refuse("the file holds something else, or the columns of another version")
        whole = content[: content.rfind(b"\n") + 1]
        known = dict(map(self._parse, whole[len(heading) :].splitlines(), range(2, 2 + whole.count(b"\n"))))
        self._file.truncate(len(whole))
        return known

    def _parse(self, line: bytes, number: int) -> tuple[int, Row]:
        try:
            (cells,) = csv.reader([line.decode()])
            row = dict(zip(self._columns, cells, strict=True))
            seed = int(row["seed"])
        except ValueError:
            raise self._refuse(f"line {number} of the file is not a row of the table", line) from None
        for name, value in self._identity.items():
            if row[name] != value:
                raise self._refuse(f"the table was begun {DIFFERENT[name]} ({name})", row[name], value)
        return seed, row

    def _refuse(self, what: str, value: object = None, bound: str = "") -> CampaignError:
        remedy = f"{ANOTHER_FILE}, or use the settings and the version with which {self._path} was begun"
        return CampaignError(what, value=value, bound=bound, remedy=remedy)


def _line(cells: Iterable[str]) -> bytes:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow(cells)
    return text.getvalue().encode()
