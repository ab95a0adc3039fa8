"""Poles found on simulated streets: how many, how surely, how exactly, and how fast.

Stretches of 5 m are driven through streets of full size with the lidars of this field, at 8 m/s and ten turns a
second. The truth is exact, trunks included. A pole counts as there if it stands half a metre inside of the local map,
is free over the least height in it with a cell to spare, and at least 20 rays came back from it: what no ray has met
cannot be found. Every detection that is no pole of the world within half a metre counts as false.

Compared are the published score at the two published set-ups, and the evidence from likelihood ratios, whose settings
were chosen on other streets. Figures of polex (https://github.com/acschaefer/polex), measured once on a street of
another make: precision 0.97, recall 1.00, 5.1 cm, 6.7 s a local map.
"""

from __future__ import annotations

import itertools
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt
from pydantic import Field

from benchmarks._spatial_plain_kernels import plain_accumulate
from benchmarks.harness import Arguments, Benchmark, arguments, new_console, one_line_errors
from benchmarks.poles_detection import match
from benchmarks.poles_extraction_picture import extraction_picture
from benchmarks.poles_extraction_scenes import Stretch, street_stretches
from benchmarks.timing import interleave, ratio, spread
from factorloc.config import Block, read_config
from factorloc.errors import ConfigError
from factorloc.geometry import se3
from factorloc.mapping.grid import Grid
from factorloc.mapping.pole_extractor import PoleExtractor
from factorloc.mapping.pole_settings import BY_EVIDENCE, KITTI_LIKE, NCLT_LIKE, EvidenceSettings, PoleSettings
from factorloc.mapping.poles import Poles
from factorloc.mapping.reflection_window import ReflectionWindow
from factorloc.scan import Scan
from factorloc.simulation import SpatialLidar, StreetSettings, hdl_32e, hdl_64e, os_128, vlp_16

Array = npt.NDArray[np.float64]

SETTINGS = Path(__file__).with_name("poles_extraction.json")

LIDARS: Mapping[str, Callable[[], SpatialLidar]] = {
    "HDL-64E": hdl_64e,
    "HDL-32E": hdl_32e,
    "VLP-16": vlp_16,
    "OS-128": os_128,
}

PUBLISHED, EVIDENCE = "published, KITTI-like", "evidence, 0.2 m"

SET_UPS: Mapping[str, PoleSettings] = {
    PUBLISHED: KITTI_LIKE,
    "published, NCLT-like": NCLT_LIKE,
    "published, 0.2 m": BY_EVIDENCE.replaced(evidence=None, fit=False),
    "evidence, 0.1 m": KITTI_LIKE.replaced(evidence=EvidenceSettings(), fit=True),
    EVIDENCE: BY_EVIDENCE,
}
"""What is compared, by its name in the tables."""


class ExtractionSettings(Block):
    """What ``poles_extraction.json`` holds.

    Parameters
    ----------
    street : StreetSettings
        The streets.
    seeds : list of int
        Which.
    stretches : int
        How many of each, evenly spread.
    speed : float
        m/s.
    lidars : list of str
        Names of lidars.
    least_returns : int
        Rays that have to come back from a pole before it counts as there.
    reach : float
        Farthest a detection is from its pole, m.
    margin : float
        Poles nearer to the rim of a local map do not count, m.
    timed_rays, rounds : int
        Rays of the local map that is timed, and how often.
    goals : dict of str to float
        The most of ``times_plain`` and ``seconds``.
    """

    street: StreetSettings
    seeds: list[int] = Field(min_length=1)
    stretches: int = Field(gt=0)
    speed: float = Field(gt=0)
    lidars: list[str] = Field(min_length=1)
    least_returns: int = Field(gt=0)
    reach: float = Field(gt=0)
    margin: float = Field(ge=0)
    timed_rays: int = Field(gt=0)
    rounds: int = Field(gt=0)
    goals: dict[str, float]


@dataclass
class Score:
    """What one set-up found with one lidar.

    Parameters
    ----------
    there, found : int
        Poles that are there, and those of them that were found.
    detections, false : int
        What was reported, and what of it is no pole.
    offsets, width_errors : list of float
        Distances of axes, and errors of widths, of all poles that were found, m.
    """

    there: int = 0
    found: int = 0
    detections: int = 0
    false: int = 0
    offsets: list[float] = field(default_factory=list)
    width_errors: list[float] = field(default_factory=list)

    def add(self, poles: Poles, stretch: Stretch, window: Grid, least_height: float, s: ExtractionSettings) -> None:
        """Add what was found in a local map."""
        truth, low, high = stretch.truth, np.array(window.origin), np.array(window.upper)
        inside = ((truth.positions > low[:2] + s.margin) & (truth.positions < high[:2] - s.margin)).all(1)
        free = np.minimum(truth.spans[:, 1], high[2]) - np.maximum(truth.spans[:, 0], low[2])
        there = inside & (free >= least_height + window.resolution) & (stretch.returns >= s.least_returns)
        pairs = match(poles.positions, truth.positions, s.reach)
        self.there += int(there.sum())
        self.found += int(there[pairs[:, 1]].sum())
        self.detections += len(poles)
        self.false += len(poles) - len(pairs)
        offset = poles.positions[pairs[:, 0]] - truth.positions[pairs[:, 1]]
        self.offsets += np.hypot(*offset.T).tolist()
        self.width_errors += (poles.widths[pairs[:, 0]] - truth.widths[pairs[:, 1]]).tolist()

    @property
    def recall(self) -> float:
        """Share of the poles that were found."""
        return self.found / self.there if self.there else np.nan

    @property
    def precision(self) -> float:
        """Share of the detections that are poles."""
        return 1 - self.false / self.detections if self.detections else np.nan


@one_line_errors
def main(argv: list[str] | None = None) -> int:
    """Run the benchmark; the exit code is 1 if a goal is missed."""
    given = arguments("poles_extraction", __doc__ or "", argv, settings=str(SETTINGS), part="all")
    settings = read_config(given.options["settings"], ExtractionSettings)
    part = given.options["part"]
    if part not in ("all", "scores", "times"):
        raise ConfigError(f"--part {part}: not all, scores or times")
    facts = {"quick": given.quick, "threads": given.threads, "truth": "of our own simulation", **settings.model_dump()}
    bench = Benchmark("poles_extraction", {**facts, "set-ups": {k: v.model_dump() for k, v in SET_UPS.items()}})
    scores: dict[str, dict[str, Score]] = {}
    example: tuple[Stretch, dict[str, Poles]] | None = None
    for lidar in settings.lidars if part != "times" else settings.lidars[:1]:
        scores[lidar] = {name: Score() for name in SET_UPS}
        for stretch in _stretches(lidar, settings, given.quick, 1 if part == "times" else settings.stretches):
            found = {name: _extract(stretch, name, scores[lidar][name], settings) for name in SET_UPS}
            example = example or (stretch, found)
    assert example is not None
    if part != "times":
        add_scores(bench, scores)
    if part != "scores":
        add_times(bench, example[0], settings, given)
    return bench.finish(given, extraction_picture(scores, *example))


def _stretches(lidar: str, settings: ExtractionSettings, quick: bool, count: int) -> Iterator[Stretch]:
    seeds = settings.seeds[:1] if quick or count == 1 else settings.seeds
    console = new_console()
    most = min(2, count) if quick else count
    for seed in seeds:
        stretches = street_stretches(settings.street, LIDARS[lidar](), seed, 5.0, settings.stretches, settings.speed)
        for number, stretch in enumerate(itertools.islice(stretches, most), 1):
            console.print(f"[dim]{lidar}, street {seed}: stretch {number} of {most}[/dim]")
            yield stretch


def _extract(stretch: Stretch, name: str, score: Score, settings: ExtractionSettings) -> Poles:
    set_up = SET_UPS[name]
    part = stretch.begin(set_up.segment_length)
    extractor = PoleExtractor(set_up)
    poles = extractor.extract(part.scans, part.poses)
    score.add(poles, part, extractor.window(part.centre), set_up.least_height, settings)
    return poles


def add_scores(bench: Benchmark, scores: Mapping[str, Mapping[str, Score]]) -> None:
    """Add the figures of all set-ups and lidars, and what makes the evidence worth its place."""
    for lidar, of_lidar in scores.items():
        for name, score in of_lidar.items():
            add_score(bench, f"{lidar}, {name}", score)
        more = of_lidar[EVIDENCE].recall - max(of_lidar[name].recall for name in SET_UPS if "published" in name)
        bench.goal(f"{lidar}, {EVIDENCE}: recall less the best published", more, "1", least=0)
        precisions = [of_lidar[name].precision for name in SET_UPS if "published" in name]
        more = of_lidar[EVIDENCE].precision - np.nanmax([*precisions, 0.0])
        bench.goal(f"{lidar}, {EVIDENCE}: precision less the best published", more, "1", least=0)


def add_score(bench: Benchmark, name: str, score: Score) -> None:
    """Add the figures of a set-up."""
    offsets, widths = np.array(score.offsets), np.array(score.width_errors)
    bench.figure(f"{name}: poles there", score.there, "1")
    bench.figure(f"{name}: recall", score.recall, "1")
    bench.figure(f"{name}: precision", score.precision, "1")
    bench.figure(f"{name}: mean position error", offsets.mean() if len(offsets) else np.nan, "m")
    bench.figure(f"{name}: position RMSE", np.sqrt((offsets**2).mean()) if len(offsets) else np.nan, "m")
    bench.figure(f"{name}: mean width error", np.abs(widths).mean() if len(widths) else np.nan, "m")
    bench.figure(f"{name}: width bias", widths.mean() if len(widths) else np.nan, "m")


def add_times(bench: Benchmark, stretch: Stretch, settings: ExtractionSettings, given: Arguments) -> None:
    """Time a local map of so many rays at 0.1 m, from scans to poles, beside one plain pass of the same rays."""
    share = min(1.0, settings.timed_rays / stretch.rays)
    scans = [scan.select(np.arange(round(share * len(scan)))) for scan in stretch.scans]
    rays = sum(map(len, scans))
    extractor = PoleExtractor(KITTI_LIKE)
    grid = extractor.window(stretch.centre)
    clipped = clip(scans, stretch.poses, grid)
    strides = (grid.shape[1] + 2) * (grid.shape[2] + 2), grid.shape[2] + 2
    size = int(np.prod(np.array(grid.shape) + 2))
    path, hits = np.zeros(size, np.float32), np.zeros(size, np.uint32)
    functions: dict[str, Callable[[], object]] = {
        "plain numba pass": lambda: plain_accumulate(*clipped, np.zeros(3), grid.resolution, *strides, path, hits),
        "mapping alone": lambda: ReflectionWindow.from_scans(scans, stretch.poses, grid),
    }
    for name in (PUBLISHED, "evidence, 0.1 m", EVIDENCE):
        chosen = PoleExtractor(SET_UPS[name])
        functions[name] = lambda chosen=chosen: chosen.extract(scans, stretch.poses)  # type: ignore[misc]
    seconds = interleave(functions, 2 if given.quick else settings.rounds)
    bench.figure("timed: rays", rays, "1")
    for name, values in seconds.items():
        bench.figure(f"timed: {name}", float(np.median(values)), "s", spread(values))
    times = ratio(seconds, PUBLISHED, "plain numba pass")
    bench.figure("timed: evidence, 0.1 m, to a plain pass", ratio(seconds, "evidence, 0.1 m", "plain numba pass"), "1")
    bench.goal(f"{PUBLISHED}: time to a plain pass", times, "1", most=settings.goals["times_plain"])
    bench.goal(f"{PUBLISHED}: time", float(np.median(seconds[PUBLISHED])), "s", most=settings.goals["seconds"])


def clip(scans: list[Scan], poses: Array, grid: Grid) -> tuple[Array, Array, Array]:
    """Rays of scans cut off at the faces of a grid, from its lowest corner: origins, directions and lengths."""
    origins, directions, lengths = [], [], []
    upper = np.array(grid.shape) * grid.resolution
    for scan, pose in zip(scans, poses, strict=True):
        sensor = se3.compose(pose, scan.T_body_sensor)
        o = scan.origins @ sensor[:3, :3].T + sensor[:3, 3] - grid.origin
        d = scan.directions @ sensor[:3, :3].T
        with np.errstate(divide="ignore", invalid="ignore"):
            one, other = -o / d, (upper - o) / d
        begin = np.maximum(np.fmin(one, other).max(1), 0.0) + 1e-7
        end = np.minimum(np.fmax(one, other).min(1), scan.ranges) - 1e-7
        keep = end > begin
        origins.append(o[keep] + d[keep] * begin[keep, None])
        directions.append(d[keep])
        lengths.append((end - begin)[keep])
    return np.concatenate(origins), np.concatenate(directions), np.concatenate(lengths)


if __name__ == "__main__":
    sys.exit(main())
