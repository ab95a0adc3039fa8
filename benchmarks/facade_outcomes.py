"""What is collected over poses among facades, the figures that follow, and the published ones beside them."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from benchmarks.harness import Benchmark
from factorloc.evaluation.bounds import bound_coverage
from factorloc.files import write_text
from factorloc.geometry import wrap
from factorloc.localization.bounded_least_squares import estimate_in_bounds
from factorloc.localization.facade_scan import FacadeStep
from factorloc.localization.facade_settings import FacadeSettings
from factorloc.localization.wall_lines import WallLines
from factorloc.mapping.facade_points import FacadePoints
from factorloc.result import Bounds
from factorloc.simulation import cache_key

__all__ = ["PUBLISHED", "PUBLISHED_ROWS", "Outcomes", "add_figures", "kept"]

Array = npt.NDArray[np.float64]

_POSES = ("truth", "bounded", "unbounded", "particles")
_PLAIN = (*_POSES, "outside", "violated", "single", "seconds")

PUBLISHED = {
    "I, LOD2": (0.998, 0.91, 4.2, 1.8, 0.237, 0.241, 0.81, 0.339, 0.343, 0.75, 0.0, 0.00725),
    "II, OSM": (0.998, 1.79, 5.23, 2.39, 0.615, 0.645, 0.85, 0.818, 0.843, 0.83, 0.0, 0.04178),
    "III, KITTI 0027, OSM": (1.0, 1.94, 3.48, 2.7, 1.12, 1.3, 1.18, 1.149, 1.78, 1.2, 0.0, 0.117),
}
"""Published tables: encloses, radii (m, m, deg), RMSE (m) and mean angle (deg) bounded, unbounded and of MCL, and
shares of results outside the feasible set, bounded and unbounded."""

PUBLISHED_ROWS = (
    ("encloses", "1"), ("smaller radius", "m"), ("larger radius", "m"), ("orientation radius", "deg"),
    ("bounded RMSE", "m"), ("unbounded RMSE", "m"), ("MCL RMSE", "m"), ("bounded angle", "deg"),
    ("unbounded angle", "deg"), ("MCL angle", "deg"), ("bounded outside", "1"), ("unbounded outside", "1"),
)  # fmt: skip


@dataclass
class Outcomes:
    """What is collected over poses.

    Parameters
    ----------
    sets : list of Bounds
        Feasible sets, empty ones too.
    truth : list of ndarray
        True poses.
    bounded, unbounded, particles : list of ndarray
        Estimates; NaN where there is none.
    outside : list of (bool, bool)
        Whether the bounded and the unbounded estimate are outside of their set.
    violated, single : list of bool
        Whether assumptions were violated, and whether facades of one direction only were found.
    seconds : list of float
        A pose.
    """

    sets: list[Bounds] = field(default_factory=list)
    truth: list[Array] = field(default_factory=list)
    bounded: list[Array] = field(default_factory=list)
    unbounded: list[Array] = field(default_factory=list)
    particles: list[Array] = field(default_factory=list)
    outside: list[tuple[bool, bool]] = field(default_factory=list)
    violated: list[bool] = field(default_factory=list)
    single: list[bool] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)

    def join(self, other: Outcomes) -> None:
        """Add those of another."""
        for one in fields(self):
            getattr(self, one.name).extend(getattr(other, one.name))

    def to_plain(self) -> dict[str, Any]:
        """As lists and numbers."""
        plain: dict[str, Any] = {name: np.asarray(getattr(self, name)).tolist() for name in _PLAIN}
        plain["sets"] = [[one.orientation, [polygon.tolist() for polygon in one.polygons]] for one in self.sets]
        return plain

    @classmethod
    def from_plain(cls, plain: dict[str, Any]) -> Outcomes:
        """What :meth:`to_plain` told."""
        sets = [Bounds((low, high), tuple(map(np.array, polygons))) for (low, high), polygons in plain["sets"]]
        found = cls(sets)
        for name in _PLAIN:
            kept_values = [np.array(pose) for pose in plain[name]] if name in _POSES else plain[name]
            getattr(found, name).extend(kept_values)
        return found

    def add(
        self, step: FacadeStep, points: FacadePoints, lines: WallLines, pose: Array, bounds: Bounds,
        settings: FacadeSettings, one_direction: float,
    ) -> None:  # fmt: skip
        """Add what one scan gave.

        Parameters
        ----------
        step : FacadeStep
            Of the scan.
        points : FacadePoints
            The scan.
        lines : WallLines
            The map.
        pose : ndarray, shape (3,)
            The truth.
        bounds : Bounds
            What is reported for the pose.
        settings : FacadeSettings
            As it was localized with.
        one_direction : float
            Facades within this of parallel are of one direction, deg.
        """
        self.sets.append(bounds)
        self.truth.append(pose)
        self.violated.append(step.feasible.violated)
        normals = lines.normals[[one.facade for one in step.correspondences.found]]
        least = np.cos(np.radians(one_direction))
        self.single.append(len(normals) == 0 or float(np.abs(normals @ normals[0]).min()) > least)
        if step.estimate is None or step.guess is None:
            self.bounded.append(np.full(3, np.nan))
            self.unbounded.append(np.full(3, np.nan))
            return
        free = estimate_in_bounds(
            points, step.correspondences, lines, step.guess, None, conflicts=step.feasible.conflicts,
            prior=step.prior, settings=settings.least_squares,
        )  # fmt: skip
        self.bounded.append(step.estimate.pose)
        self.unbounded.append(free.pose)
        feasible = step.feasible.bounds
        self.outside.append((not feasible.contains(step.estimate.pose), not feasible.contains(free.pose)))


def kept(
    folder: Path | None, follows_from: tuple[str, ...], make: Callable[[], dict[str, Outcomes]]
) -> dict[str, Outcomes]:
    """Outcomes of a part of a run by kind of map, from a folder if they are there: an interrupted run goes on.

    Parameters
    ----------
    folder : Path or None
        Where they are kept; None keeps nothing.
    follows_from : tuple of str
        All that they follow from, the commit included.
    make : callable
        Makes them.
    """
    if folder is None:
        return make()
    path = folder / f"{cache_key(*follows_from)}.json"
    if path.is_file():
        return {kind: Outcomes.from_plain(plain) for kind, plain in json.loads(path.read_text("utf-8")).items()}
    found = make()
    folder.mkdir(parents=True, exist_ok=True)
    write_text(path, json.dumps({kind: outcomes.to_plain() for kind, outcomes in found.items()}))
    return found


def add_figures(bench: Benchmark, part: str, kind: str, found: Outcomes, well_conditioned: float) -> None:
    """Add coverage, radii and errors of one kind of map."""
    truth = np.array(found.truth)
    coverage = bound_coverage(found.sets, truth)
    violated = np.array(found.violated)
    where = f"{part}, {kind}"
    # A violated scan has no set of its own; what odometry carries along does not count for it.
    bench.figure(f"{where}: encloses", float((coverage.encloses & ~violated).mean()), "1")
    if part == "tracking":
        bench.figure(f"{where}: encloses, sets carried along counted", coverage.share, "1")
    bench.figure(f"{where}: assumptions violated", float(violated.mean()), "1")
    for name, values, unit in zip(
        ("smaller radius", "larger radius", "orientation radius"),
        (coverage.radii * [1.0, 1.0, np.degrees(1.0)]).T, ("m", "m", "deg"), strict=True,
    ):  # fmt: skip
        bench.figure(f"{where}: {name}", float(np.nanmean(values)), unit)
        bench.figure(f"{where}: {name}, median", float(np.nanmedian(values)), unit)
    bench.figure(f"{where}: one direction only", float(np.mean(found.single)), "1")
    good = coverage.radii[:, 1] <= well_conditioned
    bench.figure(f"{where}: well conditioned", float(good.mean()), "1")
    estimates = {"bounded": found.bounded, "unbounded": found.unbounded, "MCL": found.particles}
    for name, poses in estimates.items():
        if len(poses) != len(truth):
            continue
        away = np.array(poses) - truth
        place, angle = np.hypot(away[:, 0], away[:, 1]), np.degrees(np.abs(wrap(away[:, 2])))
        there = np.isfinite(place)
        bench.figure(f"{where}: {name} RMSE", float(np.sqrt(np.mean(place[there] ** 2))), "m")
        bench.figure(f"{where}: {name} median", float(np.median(place[there])), "m")
        bench.figure(f"{where}: {name} RMSE, well conditioned", _rms(place[there & good]), "m")
        bench.figure(f"{where}: {name} largest", float(place[there].max()), "m")
        bench.figure(f"{where}: {name} angle", float(angle[there].mean()), "deg")
        bench.figure(f"{where}: {name} largest angle", float(angle[there].max()), "deg")
    outside = np.array(found.outside, np.float64).reshape(-1, 2)
    bench.figure(f"{where}: bounded outside", float(outside[:, 0].mean()) if len(outside) else np.nan, "1")
    bench.figure(f"{where}: unbounded outside", float(outside[:, 1].mean()) if len(outside) else np.nan, "1")
    bench.figure(f"{where}: seconds a pose", float(np.median(found.seconds)), "s")


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else np.nan
