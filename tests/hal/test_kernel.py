"""The kernel cache: an edit anywhere takes effect, nothing stale is found, trouble is told clearly.

The real package is copied, edited and run in processes of its own.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from hal.kernel import PACKAGES, ROOT, cache_directory, kernel_hash, kernel_sources
from rtctl.handover import write_settings
from rtctl.settings import load

CALLER = """
import hal.kernel
from hal.kernel import compiled_here, kernel
from rtctl import admittance

@kernel
def outer(force):
    return 10.0 * admittance.deadband(force, 0.03)

print(outer(0.06), compiled_here(), hal.kernel.kernel_hash(), hal.kernel.cache_directory())
"""


@pytest.fixture(scope="module")
def copy(tmp_path_factory):
    """A copy of our packages with a caller in a file of its own."""
    copy = tmp_path_factory.mktemp("copy")
    for package in ("hal", "rtctl"):
        shutil.copytree(ROOT / package, copy / package, ignore=shutil.ignore_patterns("__pycache__"))
    (copy / "rtctl" / "caller.py").write_text(CALLER)
    return copy


def run(copy, **environment):
    """value, kernels compiled, hash, cache directory of a run of the caller; None and the error if it fails."""
    variables = {k: v for k, v in os.environ.items() if k not in ("RTCTL_CACHE_DIR", "CACHE_DIRECTORY")}
    variables |= {"PYTHONPATH": str(copy), "RTCTL_CACHE_DIR": str(copy / "cache"), **environment}
    done = subprocess.run(
        [sys.executable, "-m", "rtctl.caller"], cwd=copy, env=variables, capture_output=True, text=True, timeout=120
    )
    if done.returncode:
        return None, done.stderr
    value, rest = done.stdout.split(" ", 1)
    names, rest = rest.split("] ", 1)
    return float(value), names.strip("[").replace("'", "").split(", "), *rest.split()


def test_an_edited_callee_in_another_file_takes_effect_on_the_next_start(copy):
    value, compiled, before, directory = run(copy)
    assert value == pytest.approx(5.0)
    assert "outer" in compiled

    (copy / "sitecustomize.py").write_text(CANNOT_WRITE)
    try:
        value, compiled, same, where = run(copy)
    finally:
        (copy / "sitecustomize.py").unlink()
    assert (value, same, where) == (pytest.approx(5.0), before, directory)
    assert compiled == [""], "a warm cache is found, and read without being written"

    source = copy / "rtctl" / "admittance.py"
    text = source.read_text()
    source.write_text(text.replace("1.0 - zeta / force", "2.0 - zeta / force"))
    try:
        value, compiled, after, _ = run(copy)
    finally:
        source.write_text(text)
    assert value == pytest.approx(15.0)
    assert after != before
    assert "outer" in compiled, "the caller's own file is unchanged, its machine code is not"


CANNOT_WRITE = """
import os, tempfile

def refuse(*_, **__):
    raise PermissionError(13, "Permission denied")

os.makedirs = tempfile.TemporaryFile = refuse
"""


def test_code_with_bounds_checks_has_a_place_of_its_own(copy):
    *_, digest, checked = run(copy, NUMBA_BOUNDSCHECK="1")
    assert checked == str(copy / "cache" / f"kernels-{digest}-boundscheck")
    assert Path(checked).is_dir()


def test_a_cache_that_cannot_be_written_is_refused_with_its_name_and_never_replaced_by_another(copy):
    value, error = run(copy, RTCTL_CACHE_DIR="/proc/rtctl")
    assert value is None
    message = error.strip().splitlines()[-1]
    assert "the kernel cache cannot be written" in message
    assert "/proc/rtctl/kernels-" in message
    assert "RTCTL_CACHE_DIR" in message
    assert not [*(copy / "rtctl").rglob("*.nbi")], "machine code goes nowhere else"


def test_a_warm_up_that_cannot_write_says_so():
    fd = write_settings(load("planar-sim"))
    environment = {**os.environ, "RTCTL_CACHE_DIR": "/proc/rtctl"}
    command = [sys.executable, "-m", "rtctl.warmup", str(fd)]
    done = subprocess.run(command, env=environment, pass_fds=[fd], capture_output=True, text=True, timeout=120)
    os.close(fd)
    assert done.returncode == 1
    assert done.stderr.startswith("rtctl: the kernel cache cannot be written")
    assert "Traceback" not in done.stderr


@pytest.fixture
def elsewhere(copy, monkeypatch):
    """The hash of the copy's sources, computed in this process."""

    def clear():
        kernel_sources.cache_clear()
        kernel_hash.cache_clear()

    def digest():
        clear()
        return kernel_hash()

    with monkeypatch.context() as patch:
        patch.setattr("hal.kernel.ROOT", copy)
        yield digest
    clear()


@pytest.mark.parametrize(
    ("file", "counts"),
    [("rtctl/llc.py", True), ("rtctl/commands.py", True), ("hal/frames.py", True), ("rtctl/gateway/lease.py", False)],
)
def test_the_hash_follows_every_file_that_can_end_up_in_a_kernel(copy, elsewhere, file, counts):
    before, source = elsewhere(), copy / file
    text = source.read_text()
    source.write_text(text + "\nEXTRA = 1\n")
    try:
        assert (elsewhere() != before) == counts
    finally:
        source.write_text(text)
    assert elsewhere() == before


def test_the_cache_lies_where_the_environment_says(monkeypatch):
    monkeypatch.delenv("RTCTL_CACHE_DIR", raising=False)
    monkeypatch.delenv("CACHE_DIRECTORY", raising=False)
    assert str(cache_directory()).startswith(sys.prefix)
    monkeypatch.setenv("CACHE_DIRECTORY", "/var/cache/rtctl")
    assert str(cache_directory()).startswith("/var/cache/rtctl/kernels-")
    monkeypatch.setenv("RTCTL_CACHE_DIR", "/elsewhere")
    assert str(cache_directory()).startswith("/elsewhere/kernels-")
    assert kernel_hash() in cache_directory().name


def test_the_hash_covers_every_file_that_can_end_up_in_a_kernel():
    sources = {str(f.relative_to(ROOT)) for f in kernel_sources()}
    for needed in ("rtctl/tick.py", "rtctl/llc.py", "rtctl/lifecycle.py", "rtctl/commands.py", "rtctl/memory.py",
                   "rtctl/robots/planar_3rpr.py", "hal/frames.py", "rtctl/exchange/control.py"):  # fmt: skip
        assert needed in sources
    users = {
        str(f.relative_to(ROOT))
        for p in PACKAGES
        for f in (ROOT / p).rglob("*.py")
        if "from hal.kernel import" in f.read_text() and "kernel\n" in f.read_text()
    }
    assert users <= sources
