"""Speed of localization among poles: weights of particles beside a k-d tree, and whole drives beside real time.

5000 particles weigh 30 detections in a map of 1500 poles: by a table of the log-likelihood, by an exact search of the
nearest pole, and by scipy's k-d tree (one worker, the rest in numpy), all on one thread, interleaved. Before anything
is timed, the exact search must have computed the same as the tree, and the table nearly. Then a drive of a kilometre
with simulated detections is filtered with as many particles, and smoothed.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import numpy.typing as npt
from pydantic import Field
from scipy.spatial import cKDTree

from benchmarks.bare_poles import bare_poles
from benchmarks.bars import Bar, plot_bars
from benchmarks.harness import Benchmark, arguments, one_line_errors
from benchmarks.timing import interleave, ratio, spread
from factorloc.config import Block, read_config
from factorloc.errors import MapError
from factorloc.factors import PoleDetections, PoleLandmarks
from factorloc.geometry import se2
from factorloc.localization.pole_filter import PoleFilterSettings, filter_poles
from factorloc.localization.pole_smoother import smooth_poles
from factorloc.mapping.pole_likelihood import PoleLikelihood, pole_scan
from factorloc.mapping.poles import Poles

SETTINGS = Path(__file__).with_name("poles_speed.json")
TREE, EXACT, FIELD = "k-d tree", "exact nearest pole", "log-likelihood table"

Array = npt.NDArray[np.float64]

_NOISE = np.array([0.014, 0.01, 0.003])  # of a motion of one metre: m, m, rad


class MapSettings(Block):
    """Poles, and the edge of the square they stand in, m."""

    poles: int = Field(gt=0)
    extent: float = Field(gt=0)


class LikelihoodSettings(Block):
    """Of :class:`factorloc.mapping.pole_likelihood.PoleLikelihood`."""

    sigma: float
    epsilon: float
    gate: float
    resolution: float


class DriveSettings(Block):
    """A drive: metres, m/s, metres between local maps, share of poles found, clutter a local map, reach in m."""

    length: int = Field(gt=0)
    speed: float = Field(gt=0)
    local_map_spacing: int = Field(gt=0)
    found: float
    clutter: float
    reach: float


class PoleSpeedSettings(Block):
    """What ``poles_speed.json`` holds; goals: most time as a multiple of the tree, and a multiple of real time."""

    seed: int
    map: MapSettings
    particles: int
    poles: int
    spread: tuple[float, float, float]
    likelihood: LikelihoodSettings
    drive: DriveSettings
    rounds: int
    goals: dict[str, float]


@one_line_errors
def main(argv: list[str] | None = None) -> int:
    """Run the benchmark; the exit code is 1 if a goal is missed."""
    given = arguments("poles_speed", __doc__ or "", argv, settings=str(SETTINGS), rounds=0)
    settings = read_config(given.options["settings"], PoleSpeedSettings)
    rounds = given.options["rounds"] or (5 if given.quick else settings.rounds)
    bench = Benchmark("poles_speed", {"quick": given.quick, "threads": given.threads, **settings.model_dump()})
    rng = np.random.default_rng(settings.seed)
    poles = rng.uniform(0, settings.map.extent, (settings.map.poles, 2))
    groups = {"weights of particles": time_weights(bench, settings, poles, rounds, rng)}
    time_drives(bench, settings, poles, rng)
    return bench.finish(given, plot_bars(groups, "ms"))


def time_weights(
    bench: Benchmark, settings: PoleSpeedSettings, poles: Array, rounds: int, rng: np.random.Generator
) -> list[Bar]:
    """Time all three on the same particles and detections.

    Raises
    ------
    MapError
        If they do not agree.
    """
    s = settings.likelihood
    middle = np.array([settings.map.extent / 2, settings.map.extent / 2, 0.4])
    particles = middle + rng.normal(0, 1, (settings.particles, 3)) * settings.spread
    near = np.argsort(np.hypot(*(poles - middle[:2]).T))[: settings.poles]
    seen = se2.transform(se2.inverse(middle), poles[near]) + rng.normal(0, 0.1, (settings.poles, 2))
    scan = pole_scan(seen)
    exact = PoleLikelihood(poles, s.sigma, s.epsilon, s.gate, None)
    table = PoleLikelihood(poles, s.sigma, s.epsilon, s.gate, s.resolution)
    tree = cKDTree(poles)

    def by_tree() -> Array:
        c, sine = np.cos(particles[:, 2])[:, None], np.sin(particles[:, 2])[:, None]
        x = particles[:, :1] + c * seen[:, 0] - sine * seen[:, 1]
        y = particles[:, 1:2] + sine * seen[:, 0] + c * seen[:, 1]
        distances, _ = tree.query(np.stack([x.ravel(), y.ravel()], 1), workers=1)
        return np.asarray(exact.log_score(distances).reshape(x.shape).sum(1))

    functions: dict[str, Callable[[], Array]] = {
        TREE: by_tree,
        EXACT: partial(exact.scan_log_likelihoods, scan, particles),
        FIELD: partial(table.scan_log_likelihoods, scan, particles),
    }
    wanted, found, nearly = (function() for function in functions.values())
    if not np.allclose(wanted, found, atol=1e-9) or np.corrcoef(wanted, nearly)[0, 1] < 0.999:
        raise MapError("poles_speed: the likelihoods do not agree; nothing was timed")
    bench.figure("table: RMS of the difference of log-likelihoods", np.sqrt(np.mean((nearly - wanted) ** 2)), "1")
    bench.figure("all particles: standard deviation of log-likelihoods", wanted.std(), "1")
    seconds = interleave(functions, rounds)
    bars = []
    for name, of in seconds.items():
        value, quartiles = float(np.median(of)) * 1e3, tuple(1e3 * v for v in spread(of))
        bench.figure(f"{name}: {settings.particles} x {settings.poles}", value, "ms", (quartiles[0], quartiles[1]))
        bars.append(Bar(name, value, (quartiles[0], quartiles[1])))
    bench.goal("table, time / tree", ratio(seconds, FIELD, TREE), "1", settings.goals["field"])
    bench.goal("exact search, time / tree", ratio(seconds, EXACT, TREE), "1", settings.goals["exact"])
    return bars


def time_drives(bench: Benchmark, settings: PoleSpeedSettings, poles: Array, rng: np.random.Generator) -> None:
    """Filter and smooth a drive around a square, twice: the first time compiles."""
    d = settings.drive
    side = d.length / 4
    corner = settings.map.extent / 2 - side / 2
    motions = np.tile([1.0, 0.0, 0.0], (d.length, 1))
    turning = [int(side * k) + j for k in (1, 2, 3) for j in range(-5, 5)]
    motions[turning, 2] = np.pi / 20
    truth = np.empty((d.length + 1, 3))
    truth[0] = corner, corner, 0.0
    for k, motion in enumerate(motions):
        truth[k + 1] = se2.compose(truth[k], motion)
    noisy = se2.compose(motions, se2.exp(rng.normal(0, 1, motions.shape) * _NOISE))
    local = []
    for k, pose in enumerate(truth):
        seen = se2.transform(se2.inverse(pose), poles)
        seen = seen[(np.abs(seen) < d.reach).all(1) & (rng.random(len(seen)) < d.found)]
        clutter = rng.uniform(-d.reach, d.reach, (rng.poisson(d.clutter), 2))
        points = np.concatenate([seen + rng.normal(0, 0.08, seen.shape), clutter])
        local.append(bare_poles(points) if k % d.local_map_spacing == 0 else Poles.none())
    detections, landmarks = PoleDetections.of(local), PoleLandmarks(bare_poles(poles))
    covariances = np.tile(np.diag(_NOISE**2), (d.length, 1, 1))
    real = d.length / d.speed
    bench.figure("drive: detections", len(detections.poles), "1")
    for name in ("filter", "smoother"):
        for _ in range(2):
            if name == "filter":
                result = filter_poles(
                    landmarks, detections, noisy, truth[0], covariances=covariances,
                    settings=PoleFilterSettings(particles=settings.particles),
                )  # fmt: skip
            else:
                result = smooth_poles(
                    landmarks, detections, noisy, truth[0] + [1.5, -1.0, 0.05], covariances=covariances
                ).result
        error = np.hypot(*(result.trajectory.poses[:, :2] - truth[:, :2]).T)
        bench.figure(f"drive, {name}: mean position error", error.mean(), "m")
        bench.figure(f"drive, {name}: time", result.seconds, "s")
        bench.goal(f"drive, {name}: speed", real / result.seconds, "x real time", least=settings.goals["real_time"])


if __name__ == "__main__":
    sys.exit(main())
