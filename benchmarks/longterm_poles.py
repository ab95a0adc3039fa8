"""Poles of the long-term sessions: the local maps along each drive, kept on disk, and the map of the first."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import overload

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from benchmarks.longterm_sessions import LongtermWorld, Recording
from factorloc.config import Block
from factorloc.factors import PoleDetections
from factorloc.geometry import se3
from factorloc.mapping.local_maps import local_maps
from factorloc.mapping.pole_map import PoleMap
from factorloc.mapping.pole_mapping import PoleMapper, PoleMappingSettings
from factorloc.mapping.pole_settings import PoleSettings
from factorloc.mapping.poles import Poles
from factorloc.scan import Scan
from factorloc.simulation import cached
from factorloc.trajectory import Trajectory

__all__ = ["RecordedScans", "detect", "make_map", "new_ground"]

Array = npt.NDArray[np.float64]


class RecordedScans(Sequence[Scan]):
    """Scans of a recording, made when they are asked for; some of them, if rows are given."""

    def __init__(self, recording: Recording, rows: Sequence[int] | None = None) -> None:
        self.recording = recording
        self.rows = list(range(len(recording))) if rows is None else list(rows)

    def __len__(self) -> int:
        return len(self.rows)

    @overload
    def __getitem__(self, index: int) -> Scan: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[Scan]: ...
    def __getitem__(self, index: int | slice) -> Scan | Sequence[Scan]:
        if isinstance(index, slice):
            return RecordedScans(self.recording, self.rows[index])
        return self.recording.scan(self.rows[index])


class _Key(Block):
    """Everything detections follow from."""

    number: int
    world: LongtermWorld
    poles: PoleSettings
    kind: str


def detect(recording: Recording, world: LongtermWorld, settings: PoleSettings, cache: Path) -> PoleDetections:
    """Poles of all local maps along odometry, each at the pose of its newest scan.

    Parameters
    ----------
    recording : Recording
        A session.
    world : LongtermWorld
        What it follows from.
    settings : PoleSettings
        Of the local maps.
    cache : Path
        Folder of all detections.
    """

    def make() -> dict[str, npt.NDArray[np.generic]]:
        poses = np.empty_like(recording.truth)
        poses[0] = np.eye(4)
        for k, motion in enumerate(recording.odometry):
            poses[k + 1] = poses[k] @ motion
        found: list[Poles] = [Poles.none()] * len(recording)
        stamps = np.arange(len(recording), dtype=np.float64)
        for one in local_maps(RecordedScans(recording), Trajectory(stamps, poses), settings):
            newest = int(one.scans[-1])
            found[newest] = Poles.joined([found[newest], one.poles])
        packed = PoleDetections.of(found)
        poles = packed.poles
        return {"offsets": packed.offsets, "positions": poles.positions, "widths": poles.widths,
                "spans": poles.spans, "scores": poles.scores}  # fmt: skip

    key = _Key(number=recording.number, world=world, poles=settings, kind="detections along odometry")
    kept = cached(cache, key, make)
    poles = Poles(*(np.asarray(kept[name], np.float64) for name in ("positions", "widths", "spans", "scores")))
    return PoleDetections(poles, np.asarray(kept["offsets"], np.int64))


def make_map(
    first: Recording, others: Sequence[Recording], world: LongtermWorld, settings: PoleMappingSettings, cache: Path
) -> tuple[PoleMap, dict[int, float]]:
    """Map the first session at its true poses, and of others what lies off all earlier ways.

    Returns
    -------
    PoleMap
    dict of int to float
        Share of the scans of each session that the map was made from.
    """
    fractions: dict[int, float] = {}

    def make() -> dict[str, npt.NDArray[np.generic]]:
        mapper = PoleMapper(settings)
        before = np.zeros((0, 2))
        for recording in [first, *others]:
            rows = new_ground(recording, before, settings.growth_distance)
            fractions[recording.number] = len(rows) / len(recording)
            if len(rows):
                truth = Trajectory(rows.astype(np.float64), recording.truth[rows])
                mapper.add(str(recording.number), RecordedScans(recording, rows.tolist()), truth)
            before = np.concatenate([before, recording.truth[:, :2, 3]])
        poles = mapper.finish().poles
        numbers = np.array(list(fractions))
        return {"positions": poles.positions, "widths": poles.widths, "spans": poles.spans, "scores": poles.scores,
                "numbers": numbers, "fractions": np.array(list(fractions.values()))}  # fmt: skip

    names = "map of " + ", ".join(str(one.number) for one in [first, *others])
    key = _Key(number=first.number, world=world, poles=settings.poles, kind=f"{names} {settings.model_dump_json()}")
    kept = cached(cache, key, make)
    poles = Poles(*(np.asarray(kept[name], np.float64) for name in ("positions", "widths", "spans", "scores")))
    shares = zip(np.asarray(kept["numbers"]).tolist(), np.asarray(kept["fractions"]).tolist(), strict=True)
    return PoleMap.of(poles, str(first.number)), dict(shares)


def new_ground(recording: Recording, before: Array, distance: float) -> npt.NDArray[np.int64]:
    """Scans taken farther than a distance from all earlier poses (N, 2), m."""
    places = se3.to_se2(recording.truth)[:, :2]
    if len(before) == 0:
        return np.arange(len(places), dtype=np.int64)
    return np.flatnonzero(cKDTree(before).query(places)[0] >= distance).astype(np.int64)
