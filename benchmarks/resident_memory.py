"""Resident memory of this process: its peak, and its course."""

from __future__ import annotations

import os
import resource
import sys
import threading
import time
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
import numpy.typing as npt

__all__ = ["MemoryCurve", "peak_resident", "resident"]

_STATM = Path("/proc/self/statm")
_MAXIMUM_UNIT = 1 if sys.platform == "darwin" else 1024


def peak_resident() -> int:
    """Most memory this process ever had resident, bytes, as the system counts it (``ru_maxrss``)."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * _MAXIMUM_UNIT


def resident() -> int:
    """Resident memory now, bytes; its peak where the system does not tell."""
    if not _STATM.exists():
        return peak_resident()
    return int(_STATM.read_text(encoding="ascii").split()[1]) * os.sysconf("SC_PAGE_SIZE")


class MemoryCurve:
    """Samples the resident memory in a thread of its own, while used as a context.

    Parameters
    ----------
    period : float
        Time between two samples, s.
    """

    def __init__(self, period: float = 0.1) -> None:
        self._period = period
        self._began = time.perf_counter()
        self._samples: list[tuple[float, int]] = []
        self._marks: list[tuple[float, str]] = []
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._sample, daemon=True, name="resident memory")

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._done.set()
        self._thread.join()

    def mark(self, name: str) -> None:
        """Note that something begins now."""
        self._marks.append((self.seconds, name))

    @property
    def seconds(self) -> float:
        """Time since the beginning, s."""
        return time.perf_counter() - self._began

    @property
    def samples(self) -> npt.NDArray[np.float64]:
        """Times, s, and bytes, shape (N, 2)."""
        return np.array(self._samples, np.float64).reshape(-1, 2)

    @property
    def marks(self) -> list[tuple[float, str]]:
        """What began when, s."""
        return list(self._marks)

    def _sample(self) -> None:
        while True:
            self._samples.append((self.seconds, resident()))
            if self._done.wait(self._period):
                self._samples.append((self.seconds, resident()))
                return
