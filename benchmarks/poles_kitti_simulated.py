"""KITTI 05, 06 and 07 with simulated detections: published hand-checked pole maps, true paths, frozen detection rates.

No lidar takes part. Poles of the published maps are seen from the true paths with the rates that were measured on drive
0005 (see ``poles_kitti``): so many are missed, so many are not in the map, and so far off they are; the map that is
localized in has an error of its own of the measured size. Odometry is simulated as well. The table has the form of the
thesis (table 12.2): 2000 particles, 3 m, 5 degrees; each run draws everything anew.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from pydantic import Field
from rich.progress import track as progress_of
from rich.table import Table

from benchmarks.bare_poles import bare_poles
from benchmarks.harness import Benchmark, arguments, new_console, one_line_errors
from benchmarks.longterm_sessions import LongtermOdometry
from benchmarks.simulated_detections import Rates, Sequence
from factorloc.config import Block, read_config
from factorloc.errors import DataError
from factorloc.factors import PoleDetections, PoleLandmarks
from factorloc.geometry import se2, se3, wrap
from factorloc.localization import AroundPose
from factorloc.localization.pole_filter import PoleFilterSettings, filter_poles
from factorloc.localization.pole_smoother import PoleSmootherSettings, smooth_poles
from factorloc.mapping.poles import Poles

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SETTINGS = Path(__file__).with_name("poles_kitti_simulated.json")
METHODS = ("filter", "smoother")
COLUMNS = (
    ("position error", "m"), ("position RMSE", "m"), ("lateral error", "m"), ("lateral sigma", "m"),
    ("longitudinal error", "m"), ("longitudinal sigma", "m"), ("heading error", "deg"), ("heading sigma", "deg"),
    ("heading RMSE", "deg"),
)  # fmt: skip
"""Of table 12.2."""

THESIS = (0.096, 0.111, 0.061, 0.075, 0.060, 0.067, 0.133, 0.188, 0.214)
"""Its last row, on the real scans of sequence 0009."""

Array = npt.NDArray[np.float64]

_QUICK = 5  # one of so many runs is left in a quick run


class SimulatedKittiSettings(Block):
    """What ``poles_kitti_simulated.json`` holds.

    Parameters
    ----------
    seed : int
    sequences : tuple of str
    detection : str
        File beside this one with the rates.
    map_sigma : float
        Error of the map along one axis, m.
    spacing, local_map_spacing : float
        Way between poses, and between local maps, m.
    odometry : LongtermOdometry
    start : (float, float)
        Radius around the first true pose, m, and largest turn, deg.
    runs, smoother_runs : int
    speed : float
        At which the way is driven, to tell how fast methods are, m/s.
    filter : PoleFilterSettings
    smoother : PoleSmootherSettings
    """

    seed: int = Field(ge=0)
    sequences: tuple[str, ...]
    detection: str
    map_sigma: float = Field(ge=0)
    spacing: float = Field(gt=0)
    local_map_spacing: float = Field(gt=0)
    odometry: LongtermOdometry
    start: tuple[float, float]
    runs: int = Field(gt=0)
    smoother_runs: int = Field(gt=0)
    speed: float = Field(gt=0)
    filter: PoleFilterSettings
    smoother: PoleSmootherSettings


@dataclass
class Errors:
    """Errors of all runs in a sequence: m and deg, and speeds as multiples of real time."""

    position: list[Array] = field(default_factory=list)
    sideways: list[Array] = field(default_factory=list)
    ahead: list[Array] = field(default_factory=list)
    angle: list[Array] = field(default_factory=list)
    speed: list[float] = field(default_factory=list)

    def add(self, poses: Array, truth: Array, speed: float) -> None:
        """Compare a path with the truth."""
        offset = se2.rotate(-truth[:, 2], poses[:, :2] - truth[:, :2])
        self.position.append(np.hypot(offset[:, 0], offset[:, 1]))
        self.ahead.append(offset[:, 0])
        self.sideways.append(offset[:, 1])
        self.angle.append(np.degrees(wrap(poses[:, 2] - truth[:, 2])))
        self.speed.append(speed)

    def row(self) -> tuple[float, ...]:
        """All columns, each averaged over runs."""
        position, sideways, ahead, angle = (np.array(e) for e in (self.position, self.sideways, self.ahead, self.angle))

        def mean(errors: Array) -> float:
            return float(np.abs(errors).mean())

        def rms(errors: Array) -> float:
            return float(np.sqrt((errors**2).mean(1)).mean())

        def sigma(errors: Array) -> float:
            return float(errors.std(1).mean())

        return (mean(position), rms(position), mean(sideways), sigma(sideways), mean(ahead), sigma(ahead),
                mean(angle), sigma(angle), rms(angle))  # fmt: skip


class SimulatedKittiBenchmark(Benchmark):
    """Sequences in the form of table 12.2."""

    def _figure_table(self) -> Table:
        table = Table("simulated detections", title=self.name, title_justify="left")
        for name, unit in COLUMNS:
            table.add_column("\n".join([*name.split(), unit]), justify="right")
        for case in dict.fromkeys(name.rpartition(": ")[0] for name in self.figures if name.endswith(COLUMNS[0][0])):
            table.add_row(case, *(f"{self.figures[f'{case}: {name}'][0]:.3f}" for name, _ in COLUMNS))
        table.add_row("thesis, KITTI 0009 (real)", *(f"{value:.3f}" for value in THESIS))
        columns = tuple(f": {name}" for name, _ in COLUMNS)
        rest = [name for name in self.figures if not name.endswith(columns)]
        table.caption = "\n".join(f"{name}: {self.figures[name][0]:.4g} {self.figures[name][1]}" for name in rest)
        table.caption_justify = "left"
        return table


@one_line_errors
def main(argv: list[str] | None = None) -> int:
    """Run the benchmark; it has no goals of its own."""
    given = arguments("poles_kitti_simulated", __doc__ or "", argv, settings=str(SETTINGS), runs=0)
    settings = read_config(given.options["settings"], SimulatedKittiSettings)
    if given.data is None:
        raise DataError("poles_kitti_simulated: no data; set FACTORLOC_DATA or give --data")
    rates = Rates.read(Path(given.options["settings"]).with_name(settings.detection))
    runs = given.options["runs"] or max(settings.runs // (_QUICK if given.quick else 1), 1)
    bench = SimulatedKittiBenchmark(
        "poles_kitti_simulated",
        {"quick": given.quick, "runs made": runs, "rates": vars(rates), **settings.model_dump(mode="json")},
    )
    console, drawn = new_console(), {}
    for name in settings.sequences:
        sequence = Sequence.read(given.data, name, settings.spacing)
        bench.figure(f"{name}: way", float(np.hypot(*np.diff(sequence.truth[:, :2], axis=0).T).sum()), "m")
        bench.figure(f"{name}: poles", len(sequence.poles), "1")
        errors = {who: Errors() for who in METHODS}
        for run in progress_of(range(runs), name, console=console):
            localize(sequence, rates, settings, run, errors)
        for who, of in errors.items():
            for (column, unit), value in zip(COLUMNS, of.row(), strict=True):
                bench.figure(f"{name}, {who}: {column}", value, unit)
            most = np.array([e.max() for e in of.position])
            bench.figure(f"{name}, {who}: largest error of a run, median and worst", float(np.median(most)), "m")
            bench.figure(f"{name}, {who}: worst of all", float(most.max()), "m")
            bench.figure(f"{name}, {who}: speed, median", float(np.median(of.speed)), "x real time")
        drawn[name] = sequence, errors
    return bench.finish(given, picture(drawn))


def localize(
    sequence: Sequence, rates: Rates, settings: SimulatedKittiSettings, run: int, errors: dict[str, Errors]
) -> None:
    """Draw a map error, detections, odometry and a start; localize by both methods."""
    rng = np.random.default_rng([settings.seed, int(sequence.name), run])
    truth, n = sequence.truth, len(sequence.truth)
    landmarks = PoleLandmarks(bare_poles(sequence.poles + rng.normal(0.0, settings.map_sigma, sequence.poles.shape)))
    steps = np.hypot(*np.diff(truth[:, :2], axis=0).T)
    way = np.concatenate([[0.0], np.cumsum(steps)])
    stops = np.unique(np.searchsorted(way, np.arange(0.0, way[-1], settings.local_map_spacing)))
    local = [Poles.none()] * n
    for k in stops.tolist():
        local[k] = rates.detect(sequence.poles, truth[k], rng)
    spatial, covariances = settings.odometry.noise.sample(se3.from_se2(truth), rng)
    motions = se3.to_se2(spatial)
    motions[:, :2] *= 1.0 + settings.odometry.scale * rng.standard_normal()
    axes = np.array([3, 4, 2])
    planar = covariances[:, axes[:, None], axes]
    planar[:, 0, 0] += (settings.odometry.scale * steps) ** 2
    around = AroundPose(truth[0], settings.start[0], float(np.radians(settings.start[1])))
    detections, seconds = PoleDetections.of(local), way[-1] / settings.speed
    filtered = filter_poles(
        landmarks, detections, motions, around, covariances=planar, settings=settings.filter, seed=run
    )
    errors["filter"].add(filtered.trajectory.poses, truth, seconds / filtered.seconds)
    if run < settings.smoother_runs:
        guess = AroundPose(around.sample(1, rng)[0], around.reach, around.heading)
        done = smooth_poles(
            landmarks, detections, motions, guess, covariances=planar, settings=settings.smoother, seed=run
        )
        errors["smoother"].add(done.result.trajectory.poses, truth, seconds / done.result.seconds)


def picture(drawn: dict[str, tuple[Sequence, dict[str, Errors]]]) -> Figure:
    """Draw paths and poles, and the spread of errors along the way."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 7), layout="constrained")
    axes = figure.subplots(2, len(drawn), squeeze=False, height_ratios=[3, 2])
    for column, (name, (sequence, errors)) in enumerate(drawn.items()):
        above, below = axes[0, column], axes[1, column]
        above.plot(*sequence.truth[:, :2].T, color="0.3", lw=1)
        above.scatter(*sequence.poles.T, s=3, color="C2")
        above.set_aspect("equal", "datalim")
        above.set_title(f"KITTI {name}, simulated detections", fontsize=10)
        way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(sequence.truth[:, :2], axis=0).T))])
        for who, colour in zip(METHODS, ("C1", "C0"), strict=True):
            position = np.array(errors[who].position)
            below.plot(way, np.median(position, 0), color=colour, lw=1, label=f"{who}, median")
            below.fill_between(way, *np.quantile(position, [0.05, 0.95], axis=0), color=colour, alpha=0.25, lw=0)
        below.set_xlabel("way (m)")
        below.set_ylabel("position error (m)")
        below.set_ylim(0, 1)
        below.legend(fontsize=8)
    return figure


if __name__ == "__main__":
    sys.exit(main())
