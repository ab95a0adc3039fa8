"""The compiled reference: a plain C++ walk, built when it is asked for."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.typing as npt

from factorloc.errors import FactorlocError

__all__ = ["CompiledReference", "build_reference"]

SOURCE = Path(__file__).with_name("raycast_reference.cpp")
FLAGS = ("-O3", "-march=native")

_COMPILERS = ("g++", "c++", "clang++")


class CompiledReference:
    """The accumulation of ``raycast_reference.cpp``.

    Parameters
    ----------
    library : ctypes.CDLL
        Where it is compiled.
    compiler : str
        By what.
    """

    def __init__(self, library: ctypes.CDLL, compiler: str) -> None:
        self.compiler = compiler
        self._accumulate = library.accumulate
        self._accumulate.restype = ctypes.c_int64
        double, real, integer = (
            np.ctypeslib.ndpointer(kind, flags="C_CONTIGUOUS") for kind in (np.float64, np.float32, np.uint32)
        )
        self._accumulate.argtypes = [
            double, double, double, ctypes.c_int64, double, ctypes.c_double, ctypes.c_int64, real, integer,
        ]  # fmt: skip

    def accumulate(
        self,
        origins: npt.NDArray[np.float64],
        directions: npt.NDArray[np.float64],
        lengths: npt.NDArray[np.float64],
        low: npt.NDArray[np.float64],
        resolution: float,
        stride: int,
        path: npt.NDArray[np.float32],
        hits: npt.NDArray[np.uint32],
    ) -> int:
        """Do what :func:`benchmarks._plain_kernels.plain_accumulate` does, with the same arguments."""
        return int(self._accumulate(origins, directions, lengths, len(lengths), low, resolution, stride, path, hits))


def build_reference(compilers: tuple[str, ...] = _COMPILERS) -> CompiledReference | None:
    """Compile the reference with the first compiler there is; None without any.

    Raises
    ------
    FactorlocError
        If the compiler refuses the source.
    """
    found = next(filter(None, map(shutil.which, compilers)), None)
    if found is None:
        return None
    run: Callable[..., subprocess.CompletedProcess[str]] = subprocess.run
    with tempfile.TemporaryDirectory() as folder:
        library = Path(folder) / "raycast_reference.so"
        command = [found, *FLAGS, "-std=c++17", "-shared", "-fPIC", "-o", str(library), str(SOURCE)]
        done = run(command, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            raise FactorlocError(f"{SOURCE.name}: {found} refuses it ({done.stderr.strip().splitlines()[0]})")
        version = run([found, "--version"], capture_output=True, text=True, check=False).stdout.splitlines()[0]
        # Once loaded, the file may go.
        return CompiledReference(ctypes.CDLL(str(library)), f"{version} {' '.join(FLAGS)}")
