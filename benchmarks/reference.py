"""The compiled reference: plain C++ walks, built when they are asked for."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from factorloc.errors import FactorlocError

__all__ = ["CompiledReference", "build_reference"]

SOURCES = tuple(Path(__file__).with_name(f"raycast_{name}.cpp") for name in ("reference", "spatial_reference"))
FLAGS = ("-O3", "-march=native")

_COMPILERS = ("g++", "c++", "clang++")


class CompiledReference:
    """The accumulations of ``raycast_reference.cpp`` and ``raycast_spatial_reference.cpp``.

    Parameters
    ----------
    library : ctypes.CDLL
        Where they are compiled.
    compiler : str
        By what.
    """

    def __init__(self, library: ctypes.CDLL, compiler: str) -> None:
        self.compiler = compiler
        double, real, integer = (
            np.ctypeslib.ndpointer(kind, flags="C_CONTIGUOUS") for kind in (np.float64, np.float32, np.uint32)
        )
        index = ctypes.c_int64
        grid: list[Any] = [double, double, double, index, double, ctypes.c_double]
        self._accumulate, self._accumulate_spatial = library.accumulate, library.accumulate_spatial
        self._accumulate.restype = self._accumulate_spatial.restype = index
        self._accumulate.argtypes = [*grid, index, real, integer]
        self._accumulate_spatial.argtypes = [*grid, index, index, real, integer]

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

    def accumulate_spatial(
        self,
        origins: npt.NDArray[np.float64],
        directions: npt.NDArray[np.float64],
        lengths: npt.NDArray[np.float64],
        low: npt.NDArray[np.float64],
        resolution: float,
        stride_x: int,
        stride_y: int,
        path: npt.NDArray[np.float32],
        hits: npt.NDArray[np.uint32],
    ) -> int:
        """Do what :func:`benchmarks._spatial_plain_kernels.plain_accumulate` does, with the same arguments."""
        rays = (origins, directions, lengths, len(lengths))
        return int(self._accumulate_spatial(*rays, low, resolution, stride_x, stride_y, path, hits))


def build_reference(compilers: tuple[str, ...] = _COMPILERS) -> CompiledReference | None:
    """Compile the references with the first compiler there is; None without any.

    Raises
    ------
    FactorlocError
        If the compiler refuses a source.
    """
    found = next(filter(None, map(shutil.which, compilers)), None)
    if found is None:
        return None
    run: Callable[..., subprocess.CompletedProcess[str]] = subprocess.run
    with tempfile.TemporaryDirectory() as folder:
        library = Path(folder) / "raycast_reference.so"
        command = [found, *FLAGS, "-std=c++17", "-shared", "-fPIC", "-o", str(library), *map(str, SOURCES)]
        done = run(command, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            raise FactorlocError(f"reference: {found} refuses it ({done.stderr.strip().splitlines()[0]})")
        version = run([found, "--version"], capture_output=True, text=True, check=False).stdout.splitlines()[0]
        # Once loaded, the file may go.
        return CompiledReference(ctypes.CDLL(str(library)), f"{version} {' '.join(FLAGS)}")
