"""The only importer of numba: the decorators of all kernels, their cache, and the thread count.

Kernels live in files named ``_kernels.py`` or ``_<noun>_kernels.py`` and import nothing but numpy, math, this module
and each other (a test checks it). Compiled code is cached under a folder keyed by a digest of exactly those files,
because numba itself does not notice an edit in a kernel that another file calls.
"""

from __future__ import annotations

import hashlib
import logging
import os
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
import numpy as np
import platformdirs
from numba import prange
from numba.core import event
from threadpoolctl import threadpool_limits

__all__ = [
    "cache_folder",
    "compile_seconds",
    "exact_kernel",
    "in_threads",
    "kernel",
    "prange",
    "set_threads",
    "threads",
]

logger = logging.getLogger(__name__)

F = TypeVar("F", bound=Callable[..., Any])

# fastmath without nnan and ninf: isnan and inf keep their meaning inside kernels, at the same speed.
_FAST_MATH = {"nsz", "arcp", "contract", "afn", "reassoc"}


def _digest() -> str:
    package = Path(__file__).parent
    digest = hashlib.sha256(f"numba {numba.__version__} numpy {np.__version__}".encode())
    for path in [package / "_jit.py", *sorted(package.rglob("_*kernels.py"))]:
        digest.update(path.relative_to(package).as_posix().encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def _writable(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def _choose_cache_folder() -> Path:
    root = os.environ.get("FACTORLOC_CACHE_DIR") or platformdirs.user_cache_dir("factorloc")
    folder = Path(root) / "kernels" / _digest()
    if _writable(folder):
        return folder
    fallback = Path(tempfile.gettempdir()) / f"factorloc-{os.getuid()}" / "kernels" / _digest()
    logger.warning("cannot write the kernel cache %s; using %s (set FACTORLOC_CACHE_DIR to choose)", folder, fallback)
    fallback.mkdir(parents=True, exist_ok=True)
    return fallback


cache_folder = _choose_cache_folder()
"""Where compiled kernels are kept: ``FACTORLOC_CACHE_DIR``, by default the user's cache folder."""


@contextmanager
def _numba_cache(folder: Path) -> Iterator[None]:
    """Point numba at our cache while a kernel is decorated, and leave other users of numba alone."""
    config: Any = numba.config
    before = config.CACHE_DIR
    config.CACHE_DIR = str(folder)
    try:
        yield
    finally:
        config.CACHE_DIR = before


def _decorate(function: F, allocates: bool, **options: Any) -> F:
    # Without numba's runtime, arrays are not counted as they are passed on: two atomic operations, 10 ns, a call.
    options["_nrt"] = allocates or options["parallel"]
    with _numba_cache(cache_folder):
        return cast("F", numba.njit(cache=True, error_model="numpy", nogil=True, **options)(function))


def kernel(function: F | None = None, *, allocates: bool = True, parallel: bool = False, inline: bool = False) -> Any:
    """Compile a kernel with fast arithmetic (reassociation and contraction; NaN and infinity stay exact).

    Parameters
    ----------
    function : callable
        Plain arrays and scalars in and out; never validates.
    allocates : bool
        Whether it makes arrays. One that does not is called faster.
    parallel : bool
        Allow ``prange``. Only for the outermost kernel, and only where a call does more than about 1 ms of work.
    inline : bool
        Inline at every call, for tiny functions in inner loops.
    """
    if function is None:
        return lambda f: kernel(f, allocates=allocates, parallel=parallel, inline=inline)
    chosen = "always" if inline else "never"
    return _decorate(function, allocates, fastmath=_FAST_MATH, parallel=parallel, inline=chosen)


def exact_kernel(
    function: F | None = None, *, allocates: bool = True, parallel: bool = False, inline: bool = False
) -> Any:
    """Compile a kernel with strict IEEE arithmetic, where results must be equal to the last bit.

    Parameters
    ----------
    function : callable
        Plain arrays and scalars in and out; never validates.
    allocates : bool
        Whether it makes arrays.
    parallel : bool
        Allow ``prange``.
    inline : bool
        Have the compiler put it into every caller, however long it is: a loop with a call does not vectorize.
    """
    if function is None:
        return lambda f: exact_kernel(f, allocates=allocates, parallel=parallel, inline=inline)
    return _decorate(function, allocates, parallel=parallel, forceinline=inline)


class _CompileListener(event.Listener):
    """Announces compilation once per process and adds up how long it took."""

    def __init__(self) -> None:
        self.seconds = 0.0
        self._depth = 0
        self._since = 0.0
        self._announced = False

    @staticmethod
    def _ours(data: dict[str, Any]) -> bool:
        function = getattr(data.get("dispatcher"), "py_func", None)
        return (getattr(function, "__module__", None) or "").startswith("factorloc")

    def on_start(self, event: event.Event) -> None:
        if not self._ours(event.data):
            return
        if not self._announced:
            self._announced = True
            logger.info("compiling kernels, once (kept in %s)", cache_folder)
        if self._depth == 0:
            self._since = time.perf_counter()
        self._depth += 1

    def on_end(self, event: event.Event) -> None:
        if not self._ours(event.data):
            return
        self._depth -= 1
        if self._depth == 0:
            self.seconds += time.perf_counter() - self._since


_listener = _CompileListener()
event.register("numba:compile", _listener)  # type: ignore[no-untyped-call]


def compile_seconds() -> float:
    """Seconds this process has spent compiling kernels; 0 when all came from the cache."""
    return _listener.seconds


def threads() -> int:
    """Number of threads the parallel kernels use."""
    return int(numba.get_num_threads())


_PARTS_A_THREAD = 4  # so that a thread with quick parts takes more of them
_pool: ThreadPoolExecutor | None = None


def in_threads(work: Callable[[int, int], None], count: int) -> None:
    """Call ``work(first, last)`` for parts of ``range(count)``, in as many threads as kernels may use.

    Kernels release the interpreter while they run. Dealing parts of a serial kernel to Python threads takes some 50
    microseconds more than a parallel kernel, and spares compiling the kernel a second time.

    Parameters
    ----------
    work : callable
        Runs a kernel on rows ``first:last``; parts must not write to the same memory.
    count : int
        Number of rows.
    """
    global _pool
    parts = min(count, _PARTS_A_THREAD * threads())
    if threads() == 1 or parts < 2:
        work(0, count)
        return
    if _pool is None:
        _pool = ThreadPoolExecutor(os.cpu_count() or 1, thread_name_prefix="factorloc")
    edges = [count * part // parts for part in range(parts + 1)]
    waiting = threading.Semaphore(threads())

    def part(first: int, last: int) -> None:
        with waiting:
            work(first, last)

    list(_pool.map(part, edges[:-1], edges[1:]))


def set_threads(count: int | None) -> int:
    """Limit kernels to ``count`` threads, and linear algebra libraries to one, so that the two never multiply.

    Parameters
    ----------
    count : int or None
        Wanted threads; ``None`` takes all cores this process may use. More than there are is lowered to that.

    Returns
    -------
    int
        The threads in force.
    """
    config: Any = numba.config
    most = int(config.NUMBA_NUM_THREADS)
    if hasattr(os, "sched_getaffinity"):
        most = min(most, len(os.sched_getaffinity(0)))
    chosen = most if count is None else max(1, min(count, most))
    numba.set_num_threads(chosen)
    threadpool_limits(limits=1, user_api="blas")
    return chosen
