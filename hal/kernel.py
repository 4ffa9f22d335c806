"""The one way to compile a function: ``@kernel``.

numba's own cache looks only at the file of the function it stores, so an edit in a callee of another
file leaves the old machine code running. Here the cache directory is named by a hash over every
source file that can end up in a kernel; an edit anywhere there gives a new, empty directory, and no other
place is ever looked at.
"""

import ast
import hashlib
import os
import re
import sys
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast, overload

import numba
from numba import types
from numba.core.caching import UserProvidedCacheLocator
from numba.core.dispatcher import Dispatcher

from hal.errors import RtctlError

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("hal", "rtctl", "drivers", "sim_backends")
MAKES_KERNELS = re.compile(r"^from hal\.kernel import .*\b(kernel|specialised)\b", re.MULTILINE)
_DISPATCHERS: list[Any] = []
_SPECIALISED: dict[tuple[Any, Any], Any] = {}
F = TypeVar("F", bound=Callable[..., Any])


class CacheError(RtctlError):
    """Machine code cannot be kept where it belongs."""

    def __init__(self, error: OSError) -> None:
        super().__init__(
            "the kernel cache cannot be written",
            value=str(cache_directory()),
            remedy=f"run `rtctl warmup` as the user who owns it, or set RTCTL_CACHE_DIR ({error.strerror})",
        )


class Locator(UserProvidedCacheLocator):
    """Finds machine code in :func:`cache_directory` and nowhere else.

    numba's own locator wants to write before it reads, and turns to ``__pycache__`` where it may not: a read-only
    cache would be passed over, and code of an earlier revision found.
    """

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> "Locator":
        return cls(py_func, py_file)

    def ensure_cache_path(self) -> None:
        """Called before something is written. Raises CacheError."""
        try:
            super().ensure_cache_path()
        except OSError as error:
            raise CacheError(error) from None


@cache
def kernel_sources() -> tuple[Path, ...]:
    """Every file that makes kernels, and what those files import of ours, transitively."""
    files = [f for p in PACKAGES for f in sorted((ROOT / p).rglob("*.py"))]
    todo = [f for f in files if MAKES_KERNELS.search(f.read_text())]
    found = set(todo)
    while todo:
        for target in _imports(todo.pop()):
            if target not in found:
                found.add(target)
                todo.append(target)
    return tuple(sorted(found))


@cache
def kernel_hash() -> str:
    """Sixteen hex digits that change with any kernel source, numba, or the interpreter."""
    digest = hashlib.sha256(f"{numba.__version__} {sys.implementation.cache_tag}".encode())
    for file in kernel_sources():
        digest.update(str(file.relative_to(ROOT)).encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()[:16]


def cache_directory() -> Path:
    """Where this set of kernels keeps its machine code.

    ``RTCTL_CACHE_DIR``, else systemd's ``CACHE_DIRECTORY``, else inside the environment that runs us.
    Code compiled with bounds checks lives beside, never in, the directory of the unchecked code.
    """
    base = os.environ.get("RTCTL_CACHE_DIR") or os.environ.get("CACHE_DIRECTORY") or f"{sys.prefix}/var/cache/rtctl"
    checked = "-boundscheck" if numba.config.BOUNDSCHECK else ""
    return Path(base) / f"kernels-{kernel_hash()}{checked}"


@overload
def kernel(function: F) -> F: ...
@overload
def kernel(*, signature: Any) -> Callable[[F], F]: ...
def kernel(function: Any = None, *, signature: Any = None) -> Any:
    """Compile `function` on first call: no GIL, IEEE arithmetic, division by zero gives inf or NaN.

    With ``@kernel(signature=...)``, a numba signature, it is compiled at once and for nothing else, so that it can
    be handed to another kernel as a function.
    """
    if function is None:
        return lambda f: _compile(f, [signature])
    return _compile(function, None)


def loaded() -> set[str]:
    """Name and types of every kernel that is ready to be called in this process."""
    return {f"{d.py_func.__qualname__} {s}" for d in _DISPATCHERS for s in d.signatures}


class Pointer(types.WrapperAddressProtocol):
    """Address of a kernel with a signature, to hand to other kernels instead of it.

    numba would look the address up, by name and in the interpreter, in each of their calls: 0.1 ms.
    """

    def __init__(self, dispatcher: Any) -> None:
        (self._signature,) = dispatcher.nopython_signatures
        compiled = dispatcher.get_compile_result(self._signature)
        self._address: int = compiled.library.get_pointer_to_function(compiled.fndesc.llvm_cfunc_wrapper_name)
        self._dispatcher = dispatcher  # the code lives as long as it does

    def __wrapper_address__(self) -> int:
        return self._address

    def signature(self) -> Any:
        """numba's signature of the kernel."""
        return self._signature


def specialised(function: F, arguments: tuple[Any, ...]) -> F:
    """Compile `function` for the types of these `arguments` now, so that it can be cached and called at no cost.

    Kernels with a signature among the arguments are called through their address. Left to itself numba would
    take each for a type of its own, and a function of such arguments is compiled anew in every process.
    """
    signature = tuple(
        types.FunctionType(a.nopython_signatures[0]) if isinstance(a, Dispatcher) else numba.typeof(a)
        for a in arguments
    )
    if (function, signature) not in _SPECIALISED:  # one for a thousand simulations: machine code is never given back
        _SPECIALISED[function, signature] = _compile(function, [signature])
    return cast(F, _SPECIALISED[function, signature])


def direct(specialised_function: F) -> F:
    """The machine code of a function of :func:`specialised`, for a caller who keeps to the types it was made for.

    numba would look at every argument of every call, 0.3 ms for twenty records when the caches are cold; this does not.
    """
    (signature,) = cast(Any, specialised_function).signatures
    return cast(F, cast(Any, specialised_function).get_overload(signature))


def _compile(function: Callable[..., Any], signatures: list[Any] | None) -> Any:
    numba.config.CACHE_DIR = str(cache_directory())
    numba.config.CACHE_LOCATOR_CLASSES = f"{__name__}.{Locator.__name__}"
    dispatcher = numba.njit(signatures, cache=True, nogil=True, error_model="numpy", fastmath=False)(function)
    _DISPATCHERS.append(dispatcher)
    return dispatcher


def compiled_here() -> list[str]:
    """Names of the kernels this process had to compile because the cache did not hold them."""
    return [d.py_func.__qualname__ for d in _DISPATCHERS if d.stats.cache_misses]


def _imports(file: Path) -> list[Path]:
    names = []
    for node in _statements(ast.parse(file.read_text()).body):
        if isinstance(node, ast.ImportFrom) and node.module:
            names += [node.module, *(f"{node.module}.{a.name}" for a in node.names)]
        elif isinstance(node, ast.Import):
            names += [a.name for a in node.names]
    paths = []
    for name in names:
        if name.split(".")[0] in PACKAGES:
            stem = ROOT / name.replace(".", "/")
            paths += [p for p in (stem.with_suffix(".py"), stem / "__init__.py") if p.is_file()]
    return paths


def _statements(body: Iterable[Any]) -> Iterator[ast.stmt]:
    """Every statement, at any depth. Imports are statements, and skipping expressions takes a fifth of the time."""
    for node in body:
        yield node
        for field in ("body", "orelse", "finalbody", "handlers", "cases"):
            yield from _statements(getattr(node, field, ()))
