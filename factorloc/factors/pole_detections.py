"""Pole detections and pole landmarks: what was seen from the poses of a drive, and what stands in the map."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from pydantic import Field

from factorloc.config import Block
from factorloc.errors import GeometryError, MapError
from factorloc.geometry import se2
from factorloc.mapping.poles import Poles

__all__ = ["PoleDetections", "PoleLandmarks", "PoleMixture"]

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.int64]


class PoleMixture(Block):
    """How likely a detection comes from a landmark, and how likely from none.

    A detection z whose landmark l is there with probability t has the likelihood ratio

        t N(z; l, sigma_z^2 + sigma_l^2) f(width) f(height) / clutter(score),

    and the one of "not in the map" is 1. Widths and heights count by ``exp(-min((difference / sigma)^2 / 2, cap))``: a
    pole half hidden looks short. Clutter is rarer among detections with a high score, as scores of the drive go: what a
    score is worth depends on who gives it.

    Parameters
    ----------
    sigma : float
        Standard deviation of a detection, m.
    landmark_sigma : float
        Standard deviation of a landmark, m.
    clutter : float
        Detections that are not in the map, 1/m^2, at the mean score of the drive.
    width_sigma, height_sigma : float
        Of the differences of widths and of heights, m.
    attribute_cap : float
        The most that a wrong width, or height, costs.
    score_slope : float
        By how much the logarithm of the clutter falls with a standard deviation of the scores of the drive, never by
        more than the cap; 0 where scores say nothing.
    """

    sigma: float = Field(0.1, gt=0)
    landmark_sigma: float = Field(0.08, ge=0)
    clutter: float = Field(0.005, gt=0)
    width_sigma: float = Field(0.15, gt=0)
    height_sigma: float = Field(1.0, gt=0)
    attribute_cap: float = Field(2.0, ge=0)
    score_slope: float = Field(1.0, ge=0)


@dataclass(frozen=True, eq=False)
class PoleDetections:
    """Detections of all local maps of a drive, packed.

    Parameters
    ----------
    poles : Poles
        Detections, each in the frame of the body at the pose of its local map.
    offsets : ndarray of int64, shape (S + 1,)
        First detection of each of S local maps, and their number.

    Raises
    ------
    GeometryError
        If the offsets do not part the poles.
    """

    poles: Poles
    offsets: Index

    def __post_init__(self) -> None:
        offsets = np.asarray(self.offsets, np.int64)
        if offsets.ndim != 1 or len(offsets) < 1 or (np.diff(offsets) < 0).any():
            raise GeometryError("pole detections: offsets must be a row of numbers that do not fall")
        if offsets[0] != 0 or offsets[-1] != len(self.poles):
            raise GeometryError(f"pole detections: offsets end at {offsets[-1]}, there are {len(self.poles)} poles")
        object.__setattr__(self, "offsets", offsets)

    @classmethod
    def of(cls, local_maps: Sequence[Poles]) -> PoleDetections:
        """Pack the poles of each local map; a pose without one has ``Poles.none()``."""
        offsets = np.concatenate([[0], np.cumsum([len(poles) for poles in local_maps])]).astype(np.int64)
        return cls(Poles.joined(local_maps), offsets)

    def __len__(self) -> int:
        return len(self.offsets) - 1

    @property
    def pose_of(self) -> Index:
        """Local map of each detection, shape (K,)."""
        return np.repeat(np.arange(len(self), dtype=np.int64), np.diff(self.offsets))

    def local_map(self, number: int) -> Poles:
        """Poles of one local map."""
        return self.poles.select(np.arange(self.offsets[number], self.offsets[number + 1]))

    def placed(self, poses: npt.ArrayLike) -> Array:
        """Where the detections are in the map at poses (S, 3), shape (K, 2)."""
        return se2.transform(np.asarray(poses, np.float64)[self.pose_of], self.poles.positions)

    def select(self, kept: npt.ArrayLike) -> PoleDetections:
        """Return the detections named by a mask (K,); local maps stay, empty if need be."""
        mask = np.asarray(kept, np.bool_)
        counts = np.bincount(self.pose_of[mask], minlength=len(self))
        return PoleDetections(self.poles.select(mask), np.concatenate([[0], np.cumsum(counts)]).astype(np.int64))

    def rows(self, first: int, last: int) -> PoleDetections:
        """Return the local maps ``first:last``."""
        low, high = int(self.offsets[first]), int(self.offsets[last])
        return PoleDetections(self.poles.select(np.arange(low, high)), self.offsets[first : last + 1] - low)

    def columns(self, mixture: PoleMixture) -> Array:
        """Variance, width, height and log clutter of each detection, shape (K, 4), as kernels take them."""
        poles = self.poles
        out = np.empty((len(poles), 4))
        out[:, 0], out[:, 1], out[:, 2] = mixture.sigma**2, poles.widths, np.diff(poles.spans, axis=1)[:, 0]
        out[:, 3] = np.log(mixture.clutter)
        spread = float(poles.scores.std()) if len(poles) else 0.0
        if spread > 1e-9 * float(np.abs(poles.scores).max(initial=0.0)):
            worth = mixture.score_slope * (poles.scores - poles.scores.mean()) / spread
            out[:, 3] -= np.clip(worth, -mixture.attribute_cap, mixture.attribute_cap)
        return out


@dataclass(frozen=True, eq=False)
class PoleLandmarks:
    """Poles of a map, with how likely each is still there.

    Parameters
    ----------
    poles : Poles
        In the frame of the map.
    trust : array_like, shape (L,), optional
        Probability of each to be there, in (0, 1]; by default all are.

    Raises
    ------
    MapError
        If a trust is missing or no probability.
    """

    poles: Poles
    trust: Array | None = None

    def __post_init__(self) -> None:
        trust = np.ones(len(self.poles)) if self.trust is None else np.asarray(self.trust, np.float64)
        if trust.shape != (len(self.poles),) or not ((trust > 0) & (trust <= 1)).all():
            raise MapError(f"landmarks: trust of shape {trust.shape}; one probability above 0 for each pole")
        object.__setattr__(self, "trust", trust)

    def __len__(self) -> int:
        return len(self.poles)

    @property
    def probabilities(self) -> Array:
        """Trust of each landmark, shape (L,)."""
        assert self.trust is not None  # it was filled in
        return self.trust

    def select(self, which: npt.ArrayLike) -> PoleLandmarks:
        """Landmarks named by a mask or indices."""
        return PoleLandmarks(self.poles.select(which), self.probabilities[np.asarray(which)])

    def columns(self, mixture: PoleMixture) -> Array:
        """Variance, width, height and log trust of each landmark, shape (L, 4), as kernels take them."""
        out = np.empty((len(self), 4))
        out[:, 0], out[:, 1] = mixture.landmark_sigma**2, self.poles.widths
        out[:, 2], out[:, 3] = np.diff(self.poles.spans, axis=1)[:, 0], np.log(self.probabilities)
        return out
