"""The C helper: compiled here, its port instructions redirected to an array, and everything it refuses."""

import ctypes
import errno
import platform
import shutil
import threading

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.seams import TargetSeams
from drivers.sensoray526 import native
from drivers.sensoray526.native import NativePorts
from hal.errors import BackendError
from hal.seams import OPERATION, TIMED_OUT, Kind

BASE, SIZE = 0x2C0, 0x40
IN_MEMORY = ("RTCTL_PORTS_IN_MEMORY",)

needs_compiler = pytest.mark.skipif(
    platform.machine() != "x86_64" or not (shutil.which("gcc") or shutil.which("cc")), reason="no C compiler for x86-64"
)
pytestmark = needs_compiler


class Memory:
    """Ports that are an array."""

    def __init__(self):
        self.ports = NativePorts(BASE, SIZE, IN_MEMORY)
        library = self.ports.library
        self.words = np.ctypeslib.as_array((ctypes.c_uint16 * 0x8000).in_dll(library, "rtctl_ports_memory"))
        self._accesses = ctypes.c_uint32.in_dll(library, "rtctl_ports_accesses")
        self._refusal = ctypes.c_int.in_dll(library, "rtctl_ports_refusal")
        self.words[:] = 0

    def word(self, offset):
        return int(self.words[(BASE + offset) >> 1])

    def put(self, offset, word):
        self.words[(BASE + offset) >> 1] = word

    @property
    def accesses(self):
        return self._accesses.value

    @accesses.setter
    def accesses(self, value):
        self._accesses.value = value

    def refuse(self, code):
        self._refusal.value = code


@pytest.fixture(scope="module")
def compiled():
    return Memory()


@pytest.fixture
def memory(compiled):
    compiled.words[:] = 0
    compiled.accesses = 0
    yield compiled
    compiled.refuse(0)


def batch(*rows):
    return np.array([(kind, BASE + offset, value, mask, limit, -7) for kind, offset, value, mask, limit in rows], OPERATION)  # fmt: skip


offsets = st.integers(0, 31).map(lambda n: 2 * n)
words = st.integers(0, 0xFFFF)
anything = st.one_of(
    st.tuples(st.just(0), offsets, st.just(0), st.just(0), st.just(0)),
    st.tuples(st.just(1), offsets, words, st.just(0), st.just(0)),
    st.tuples(st.just(2), offsets, st.integers(0, 3), st.integers(0, 3), st.integers(0, 50)),
)


@given(st.lists(anything, max_size=60))
def test_every_operation_is_done_in_order_and_exactly_once(compiled, rows):
    """Against a dictionary: a wrong order changes what is read, a double or missing one the number of accesses."""
    compiled.words[:] = 0
    compiled.accesses = 0
    model, results, accesses, missed = {}, [], 0, 0
    for kind, offset, value, mask, limit in rows:
        word = model.get(offset, 0)
        if kind == Kind.WRITE:
            model[offset] = value
            results.append(-7)
            accesses += 1
        elif kind == Kind.READ:
            results.append(word)
            accesses += 1
        else:
            met = limit > 0 and word & mask == value
            results.append(word if met else TIMED_OUT)
            accesses += 1 if met else limit
            missed += not met
    operations = batch(*rows)
    assert compiled.ports.execute(operations) == missed
    assert operations["result"].tolist() == results
    assert compiled.accesses == accesses


def test_accesses_have_16_bits_and_are_where_they_belong(memory):
    memory.ports.execute(batch((1, 0x34, 0x526A, 0, 0), (1, 0x3E, 0xFFFF, 0, 0)))
    assert (memory.word(0x34), memory.word(0x3E)) == (0x526A, 0xFFFF)
    assert np.count_nonzero(memory.words) == 2


def test_polling_is_bounded(memory):
    operations = batch((2, 0x0E, 4, 4, 400))
    assert memory.ports.execute(operations) == 1
    assert memory.accesses == 400
    assert operations["result"][0] == TIMED_OUT
    memory.put(0x0E, 0x0104)
    assert memory.ports.execute(operations) == 0
    assert memory.accesses == 401
    assert operations["result"][0] == 0x0104


@pytest.mark.parametrize(
    "row", [(0, 0x33, 0, 0, 0), (1, -2, 1, 0, 0), (0, 0x40, 0, 0, 0), (3, 0, 0, 0, 0), (-1, 0, 0, 0, 0)]
)
def test_a_batch_that_leaves_the_card_is_refused_as_a_whole(memory, row):
    with pytest.raises(ValueError, match="operation 1 is none for this card"):
        memory.ports.execute(batch((1, 0, 7, 0, 0), row))
    assert memory.accesses == 0


def test_other_arrays_are_refused(memory):
    with pytest.raises(TypeError, match="contiguous array"):
        memory.ports.execute(np.zeros((4, 6), np.int32))
    with pytest.raises(TypeError, match="contiguous array"):
        memory.ports.execute(np.zeros(4, OPERATION)[::2])


def test_a_thread_asks_for_its_own_right_and_sees_an_absent_card_without(memory):
    """An access without the right would be a segmentation fault."""
    memory.put(0x34, 0x526A)
    seen = []

    def use():
        operations = batch((0, 0x34, 0, 0, 0), (1, 0x00, 5, 0, 0), (2, 0x0E, 4, 4, 9))
        seen.append((memory.ports.execute(operations), operations["result"].tolist()))

    for code in (errno.EPERM, 0):
        memory.refuse(code)
        thread = threading.Thread(target=use)
        thread.start()
        thread.join()
        assert memory.accesses == (0 if code else 2 + 9)
    assert seen == [(1, [0xFFFF, -7, TIMED_OUT]), (1, [0x526A, -7, TIMED_OUT])]


@pytest.mark.parametrize(
    ("code", "words"),
    [(errno.EPERM, "CAP_SYS_RAWIO"), (errno.ENOSYS, "X86_IOPL_IOPERM"), (errno.EINVAL, "Invalid argument")],
)
def test_without_the_right_it_says_what_is_missing(memory, code, words):
    memory.refuse(code)
    with pytest.raises(BackendError, match=words):
        NativePorts(BASE, SIZE, IN_MEMORY)


def test_closing_gives_the_right_back_once(memory):
    ports = NativePorts(BASE + 0x40, SIZE, IN_MEMORY)
    ports.close()
    ports.close()
    memory.refuse(errno.EPERM)
    look = np.array([(0, BASE + 0x40, 0, 0, 0, 0)], OPERATION)
    ports.execute(look)
    assert (int(look["result"][0]), memory.accesses) == (0xFFFF, 0)


@pytest.mark.parametrize(
    ("base", "size"), [(0x2C1, 0x40), (0x2D0, 0x40), (0x2C0, 0x80), (0x10000, 0x40), (-0x40, 0x40)]
)
def test_no_card_is_at_an_odd_or_impossible_base(base, size):
    with pytest.raises(BackendError, match="no card can be at this I/O address"):
        TargetSeams().ports(base, size)


def test_another_architecture_is_refused(monkeypatch):
    monkeypatch.setattr(platform, "machine", lambda: "aarch64")
    with pytest.raises(BackendError, match="x86-64") as caught:
        NativePorts(BASE, SIZE)
    assert "aarch64" in str(caught.value)


def test_without_a_compiler_it_says_what_to_install_unless_it_is_compiled_already(monkeypatch, tmp_path):
    monkeypatch.setenv("RTCTL_CACHE_DIR", str(tmp_path))
    with monkeypatch.context() as without:
        without.setattr(shutil, "which", lambda _: None)
        with pytest.raises(BackendError, match="install gcc"):
            native.build()
    made = native.build()
    assert made.parent == tmp_path
    monkeypatch.setattr(shutil, "which", lambda _: None)
    assert native.build() == made
    assert [p.name for p in tmp_path.iterdir()] == [made.name]


def test_what_cannot_be_compiled_or_kept_is_told(monkeypatch, tmp_path):
    monkeypatch.setenv("RTCTL_CACHE_DIR", str(tmp_path))
    with pytest.raises(BackendError, match="does not compile"):
        native.build(('RTCTL_BROKEN="', "inw=1+"))
    (tmp_path / "file").touch()
    monkeypatch.setenv("RTCTL_CACHE_DIR", str(tmp_path / "file"))
    with pytest.raises(BackendError, match="cannot be kept"):
        native.build()


def test_the_real_port_instructions_compile_without_a_warning(monkeypatch, tmp_path):
    """Loaded, never called: this machine may have such ports."""
    monkeypatch.setenv("RTCTL_CACHE_DIR", str(tmp_path))
    library = ctypes.CDLL(str(native.build()))
    assert library.rtctl_ports_execute
    with pytest.raises(ValueError, match="rtctl_ports_memory"):
        ctypes.c_uint16.in_dll(library, "rtctl_ports_memory")
