"""Walking rays through a planar grid: nanoseconds a cell of accumulation, forward model and gradient.

Each kernel is timed interleaved with a plain walk of Amanatides and Woo, compiled by the same numba, and accumulation
also with the same walk in C++ where g++ is found. The C++ reference stores float path lengths and hits, no misses and
no fixed point: it does less. Rays are the returns of a real log at its corrected poses, or those of a simulated drive.
"""

from __future__ import annotations

import ctypes
import math
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from benchmarks._plain_kernels import plain_accumulate, plain_forward, plain_gradient
from benchmarks._walk_kernels import forward_parallel, gradient_parallel
from benchmarks.harness import Arguments, Benchmark, arguments, interleave, ratio
from factorloc.datasets import read_carmen
from factorloc.mapping import DecayRatePosterior, Grid, RayStatistics
from factorloc.mapping._traversal_kernels import FIXED_POINT, accumulate_parallel
from factorloc.mapping.decay_rate import rimmed
from factorloc.mapping.ray_statistics import rays_in_map
from factorloc.scan import Scan, pack
from factorloc.simulation import office_plan, office_routes, simulate_drive

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = npt.NDArray[np.float64]

SOURCE = Path(__file__).with_name("raycast_reference.cpp")
GOALS = {
    ("accumulate, 1 thread", "C++"): 1.6,
    ("accumulate, 2 threads", "C++"): 1.0,
    ("forward, 1 thread", "plain forward"): 0.8,
    ("forward + gradient, 1 thread", "plain forward"): 1.2,
}


def main(argv: list[str] | None = None) -> int:
    """Run the benchmark; the exit code is 1 if a goal is missed."""
    given = arguments("raycast", __doc__ or "", argv, log="intel", resolution=0.1)
    scans, poses, source = _rays_of(given)
    statistics = RayStatistics.from_scans(scans, poses, resolution=given.options["resolution"])
    rays = pack(scans).returns()
    origins, directions = (np.ascontiguousarray(array) for array in rays_in_map(rays, poses))
    problem = _Problem(statistics, origins, directions, rays.ranges)
    rounds = 11 if given.quick else 41
    functions = problem.functions()
    cells = problem.check()
    seconds = interleave(functions, rounds)
    grid = statistics.grid
    bench = Benchmark(
        "raycast",
        {"rays": source, "resolution": grid.resolution, "grid": grid.shape, "rounds": rounds, "quick": given.quick},
    )
    bench.figure("rays", len(origins), "1")
    bench.figure("cells a ray", cells / len(origins), "1")
    for name, values in seconds.items():
        bench.figure(name, np.median(values) / cells * 1e9, "ns/cell")
    fastest = float(np.median(seconds["accumulate, 1 thread"]))
    bench.figure("accumulated, 1 thread", len(origins) / fastest / 1e6, "M rays/s")
    bench.figure("memory of the statistics", 16, "B/cell")
    bench.figure("memory while accumulating", 20, "B/cell and thread")
    for (name, reference), most in GOALS.items():
        if reference in seconds and name in seconds:
            bench.goal(f"{name} / {reference}", ratio(seconds, name, reference), "1", most)
    return bench.finish(given, _picture({name: np.median(v) / cells * 1e9 for name, v in seconds.items()}))


def _rays_of(given: Arguments) -> tuple[tuple[Scan, ...], Array, str]:
    if given.data is not None:
        name = given.options["log"]
        drive = read_carmen(given.data / "carmen" / f"{name}-corrected.log.gz")
        assert drive.truth is not None
        return drive.scans, drive.truth.poses, name
    simulated = simulate_drive(office_plan(), office_routes()[0], seed=1)
    return simulated.scans, simulated.truth.poses, "simulated office"


class _Problem:
    """The rays, the grid, and what each competitor writes to."""

    def __init__(self, statistics: RayStatistics, origins: Array, directions: Array, lengths: Array) -> None:
        self.grid: Grid = statistics.grid
        self.origins, self.directions, self.lengths = origins, directions, lengths
        posterior = DecayRatePosterior.from_statistics(statistics)
        self.rates = rimmed(posterior.mean, posterior.prior.mean).ravel()
        self.log_rates = np.log(self.rates)
        self.low = np.array(self.grid.origin)
        self.stride = self.grid.shape[1] + 2
        self.outputs: dict[str, Any] = {}
        self.library = _compiled_reference()

    def functions(self) -> dict[str, Callable[[], object]]:
        """What is timed, by name."""
        found: dict[str, Callable[[], object]] = {}
        if self.library is not None:
            found["C++"] = self._reference
        found["plain accumulate"] = self._plain_accumulate
        for threads in (1, 2):
            plural = "thread" if threads == 1 else "threads"
            found[f"accumulate, {threads} {plural}"] = self._accumulate(threads)
        walk = (self.rates, self.log_rates, self.stride, self.low, self.grid.resolution)
        rays = (self.origins, self.directions, self.lengths)
        n = len(self.lengths)
        out = {name: np.empty(n) for name in ("plain", "own", "plain gradient", "own gradient")}
        jumps = {name: np.empty((n, 4)) for name in ("plain", "own")}
        self.outputs |= out | {f"{name} jumps": array for name, array in jumps.items()}
        found["plain forward"] = lambda: plain_forward(*walk, *rays, out["plain"])
        found["plain forward + gradient"] = lambda: plain_gradient(*walk, *rays, out["plain gradient"], jumps["plain"])
        for threads in (1, 2):
            plural = "thread" if threads == 1 else "threads"
            found[f"forward, {threads} {plural}"] = lambda t=threads: forward_parallel(*walk, *rays, t, out["own"])
            found[f"forward + gradient, {threads} {plural}"] = lambda t=threads: gradient_parallel(
                *walk, *rays, t, out["own gradient"], jumps["own"]
            )
        return found

    def check(self) -> int:
        """Run everything once, compare what was computed, and return the cells visited."""
        functions = self.functions()
        cells = int(self._plain_accumulate())
        for function in functions.values():
            function()
        length = self.lengths.sum()
        hits, path = self._statistics
        assert int(hits.sum()) == len(self.lengths)
        assert abs(path.sum() / FIXED_POINT - length) < 1e-6 * len(self.lengths)
        if self.library is not None:
            assert self._reference() == cells
        for name in ("plain gradient", "own", "own gradient"):
            assert np.abs(self.outputs[name] - self.outputs["plain"]).max() < 1e-6
        assert np.allclose(self.outputs["own jumps"], self.outputs["plain jumps"], rtol=1e-6, atol=1e-4)
        return cells

    def _rim(self, dtype: npt.DTypeLike) -> npt.NDArray[Any]:
        return np.zeros((self.grid.shape[0] + 2) * self.stride, dtype)

    def _plain_accumulate(self) -> int:
        path, hits = self._rim(np.float32), self._rim(np.uint32)
        rays = (self.origins, self.directions, self.lengths)
        return int(plain_accumulate(*rays, self.low, self.grid.resolution, self.stride, path, hits))

    def _accumulate(self, threads: int) -> Callable[[], object]:
        shape = (self.grid.shape[0], self.grid.shape[1])
        returns = np.ones(len(self.lengths), np.bool_)

        def run() -> None:
            hits, misses = np.zeros(shape, np.uint32), np.zeros(shape, np.uint32)
            path = np.zeros(shape, np.int64)
            accumulate_parallel(
                self.origins, self.directions, self.lengths, returns, self.low, self.grid.resolution, shape, threads,
                hits, misses, path,
            )  # fmt: skip
            self._statistics = hits, path

        return run

    def _reference(self) -> int:
        path, hits = self._rim(np.float32), self._rim(np.uint32)
        arrays = [array.ctypes.data_as(ctypes.c_void_p) for array in (self.origins, self.directions, self.lengths)]
        assert self.library is not None
        return int(
            self.library.accumulate(
                *arrays,
                ctypes.c_int64(len(self.lengths)),
                self.low.ctypes.data_as(ctypes.c_void_p),
                ctypes.c_double(self.grid.resolution),
                ctypes.c_int64(self.stride),
                path.ctypes.data_as(ctypes.c_void_p),
                hits.ctypes.data_as(ctypes.c_void_p),
            )
        )


def _compiled_reference() -> ctypes.CDLL | None:
    """The C++ walk, or None where there is no g++."""
    compiler = shutil.which("g++")
    if compiler is None:
        print("no g++: the C++ reference is left out")
        return None
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "reference.so"
        flags = ["-O3", "-march=native", "-std=c++17", "-shared", "-fPIC"]
        subprocess.run([compiler, *flags, str(SOURCE), "-o", str(target)], check=True)
        library = ctypes.CDLL(str(target))
    library.accumulate.restype = ctypes.c_int64
    return library


def _picture(times: dict[str, float]) -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8, 0.4 * len(times) + 1.2), layout="constrained")
    axes = figure.add_subplot()
    colours = ["#999999" if name.startswith(("plain", "C++")) else "#0072B2" for name in times]
    bars = axes.barh(list(times), list(times.values()), color=colours)
    axes.bar_label(bars, fmt="%.2f", padding=3)
    axes.invert_yaxis()
    axes.set_xlabel("ns per cell (grey: references)")
    axes.set_xlim(0, math.ceil(max(times.values()) * 1.15))
    axes.spines[["top", "right"]].set_visible(False)
    return figure


if __name__ == "__main__":
    sys.exit(main())
