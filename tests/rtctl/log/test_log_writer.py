import os
import resource
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rtctl.log.format import LogError
from rtctl.log.reader import Log
from rtctl.log.recover import recover
from rtctl.log.writer import LogWriter

HEADER = {"settings": "{}", "seed": "7"}


def in_child(script: str, *arguments: object, limit_bytes: int | None = None) -> subprocess.CompletedProcess:
    def limit() -> None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        if limit_bytes is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (limit_bytes, limit_bytes))

    start = "import sys, os, signal, numpy as np\nfrom pathlib import Path\n" + "\n".join(
        f"from {module} import {name}"
        for module, name in (
            ("rtctl.log.writer", "LogWriter"),
            ("rtctl.log.format", "LogError"),
            ("rtctl.record", "controller_table"),
        )
    )
    return subprocess.run(
        [sys.executable, "-c", f"{start}\n{script}", *map(str, arguments)],
        capture_output=True,
        text=True,
        preexec_fn=limit,
        cwd=Path(__file__).parents[3],
    )


def test_rows_come_back_to_the_bit(tmp_path, table, make_rows):
    rows = make_rows(table, 2500, first_tick=4_700)
    with LogWriter(tmp_path / "log.mcap", {"/controller": table}, HEADER) as writer:
        writer.write_rows("/controller", rows[:900])
        writer.write_json("/events", 5_600_000_000, {"name": "bias taken", "value": 0.25})
        writer.write_rows("/controller", rows[900:])
    log = Log.open(tmp_path / "log.mcap")
    assert log.complete
    assert log.header == HEADER
    assert log.controller.dtype == table.dtype
    assert log.controller.tobytes() == rows.tobytes()
    assert log.events == [{"name": "bias taken", "value": 0.25}]
    assert log.messages["/events"][0].time_ns == 5_600_000_000
    assert [(h["first_tick"], h["last_tick"], h["rows"]) for h in log.hashes] == [
        (4700, 4999, 300),
        (5000, 5999, 1000),
        (6000, 6999, 1000),
        (7000, 7199, 200),
    ]


@settings(max_examples=15, deadline=None)
@given(cuts=st.lists(st.integers(0, 2400), max_size=6))
def test_bytes_do_not_depend_on_batches(tmp_path_factory, small_table, make_rows, cuts):
    rows = make_rows(small_table, 2400)
    folder = tmp_path_factory.mktemp("batches")
    for name, edges in (("whole", []), ("cut", sorted(cuts))):
        with LogWriter(folder / name, {"/controller": small_table}, HEADER, chunk_bytes=4096) as writer:
            for piece in np.split(rows, edges):
                writer.write_rows("/controller", piece)
    assert (folder / "whole").read_bytes() == (folder / "cut").read_bytes()


def test_header_is_on_disk_before_anything_else(tmp_path, table):
    writer = LogWriter(tmp_path / "log.mcap", {"/controller": table}, HEADER)
    log = Log.open(tmp_path / "log.mcap")
    assert log.header == HEADER
    assert not log.complete
    with pytest.raises(LogError, match="no record of the controller"):
        _ = log.controller
    writer.close()
    assert Log.open(tmp_path / "log.mcap").complete


def test_slow_messages_reach_the_disk_within_half_a_second_of_record_time(tmp_path, table):
    writer = LogWriter(tmp_path / "log.mcap", {"/controller": table}, HEADER)
    for i in range(10):
        writer.write_json("/events", i * 200_000_000, i)
        on_disk = len(Log.open(tmp_path / "log.mcap").events)
        assert i - on_disk < 3
    writer.flush()
    assert Log.open(tmp_path / "log.mcap").events == list(range(10))
    writer.close()


@pytest.mark.parametrize("compression", ["zstd", "none"])
def test_killed_process_loses_at_most_one_chunk(tmp_path, table, make_rows, compression):
    rows = make_rows(table, 1700)
    np.save(tmp_path / "rows.npy", rows)
    script = """
rows = np.load(sys.argv[1])
writer = LogWriter(sys.argv[2], {"/controller": controller_table(3)}, {"seed": "7"}, compression=sys.argv[3])
for i in range(0, len(rows), 20):
    writer.write_rows("/controller", rows[i:i + 20])
os.kill(os.getpid(), signal.SIGKILL)
"""
    done = in_child(script, tmp_path / "rows.npy", tmp_path / "log.mcap", compression)
    assert done.returncode == -signal.SIGKILL, done.stderr
    log = Log.open(tmp_path / "log.mcap")
    assert not log.complete
    assert log.header == {"seed": "7"}
    kept = len(log.controller)
    assert len(rows) - 192 * 1024 // table.dtype.itemsize - 1 <= kept < len(rows)
    assert log.controller.tobytes() == rows[:kept].tobytes()
    assert [h["last_tick"] for h in log.hashes] == [999]


def test_file_size_limit_fails_once_and_is_counted(tmp_path):
    script = """
table = controller_table(3)
rows = np.zeros(100, table.dtype)
writer = LogWriter(sys.argv[1], {"/controller": table}, {"seed": "7"}, compression="none")
errors = 0
for i in range(20):
    rows["tick"] = np.arange(i * 100, i * 100 + 100)
    rows["time_ns"] = rows["tick"] * 1_000_000
    try:
        writer.write_rows("/controller", rows)
    except LogError as error:
        errors += 1
writer.write_json("/events", 0, "lost too")
writer.close()
print(errors, writer.failed, writer.dropped)
"""
    done = in_child(script, tmp_path / "log.mcap", limit_bytes=500_000)
    assert done.returncode == 0, done.stderr
    errors, failed, dropped = done.stdout.split()
    assert (errors, failed) == ("1", "True")
    kept = Log.open(tmp_path / "log.mcap").controller
    assert kept["tick"].tolist() == list(range(len(kept)))
    assert len(kept) > 300
    assert len(kept) + int(dropped) == 2001
    assert recover(tmp_path / "log.mcap", tmp_path / "whole.mcap").rows == len(kept)


def test_full_disk_fails_once_and_keeps_what_was_written(tmp_path, table, make_rows):
    disk = tmp_path / "disk"
    disk.mkdir()
    if (
        os.geteuid() != 0
        or subprocess.run(["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", disk], capture_output=True).returncode
    ):
        pytest.skip("may not mount a small file system")
    try:
        rows = make_rows(table, 4000)
        writer = LogWriter(disk / "log.mcap", {"/controller": table}, HEADER)
        with pytest.raises(LogError, match="No space left"):
            writer.write_rows("/controller", rows)
        assert writer.failed
        writer.write_rows("/controller", rows[:10])
        writer.close()
        log = Log.open(disk / "log.mcap")
        kept = len(log.controller)
        assert kept > 1000
        assert log.controller.tobytes() == rows[:kept].tobytes()
        assert writer.dropped == len(rows) + 10 - kept
        assert recover(disk / "log.mcap", tmp_path / "whole.mcap").rows == kept
        del log
    finally:
        subprocess.run(["umount", "-l", disk], check=True)


def test_existing_log_is_not_overwritten(tmp_path, table):
    (tmp_path / "log.mcap").write_bytes(b"precious")
    with pytest.raises(LogError, match="there is a log of that name"):
        LogWriter(tmp_path / "log.mcap", {"/controller": table}, HEADER)
    assert (tmp_path / "log.mcap").read_bytes() == b"precious"


def test_missing_folder_is_told(tmp_path, table):
    with pytest.raises(LogError, match="No such file"):
        LogWriter(tmp_path / "no" / "log.mcap", {"/controller": table}, HEADER)


def test_misuse_is_an_error(tmp_path, table, small_table, make_rows):
    writer = LogWriter(tmp_path / "log.mcap", {"/controller": table}, HEADER)
    with pytest.raises(ValueError, match="dtype"):
        writer.write_rows("/controller", make_rows(small_table, 3))
    writer.close()
    writer.close()
    with pytest.raises(ValueError, match="closed"):
        writer.write_rows("/controller", make_rows(table, 3))
    assert writer.dropped == 0
