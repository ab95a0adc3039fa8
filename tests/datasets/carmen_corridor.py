"""A corridor with two niches and an open end, driven by a robot whose odometry drifts, as CARMEN logs.

``python tests/datasets/carmen_corridor.py datasets/samples/corridor.log`` writes the sample log.
"""

import sys
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from factorloc.files import write_text
from factorloc.geometry import se2

NO_RETURN = 81.83
ANGLES = np.radians(-90.0 + np.arange(180))
OUTLINE = np.array(
    [
        [20, 1], [6, 1], [6, 1.5], [5, 1.5], [5, 1], [0, 1],
        [0, -1], [9, -1], [9, -1.8], [10.5, -1.8], [10.5, -1], [20, -1],
    ],
    np.float64,
)  # fmt: skip


def flaser(ranges: Iterable[float], laser, robot, key: float, stamp: float, digits: str = ".6f") -> str:
    values = " ".join(f"{r:.2f}".rstrip("0").rstrip(".") for r in ranges)
    poses = " ".join(f"{v:{digits}}" for v in (*laser, *robot))
    return f"FLASER {len(list(ranges))} {values} {poses} {key:{digits}} robot {stamp:{digits}}"


def odom(pose, stamp: float, digits: str = ".6f") -> str:
    return "ODOM " + " ".join(f"{v:{digits}}" for v in pose) + f" 0 0 0 {stamp:{digits}} robot {stamp:{digits}}"


def cast(pose) -> np.ndarray:
    """Exact ranges of all beams from a pose to the outline; infinity through the open end."""
    p, d = pose[:2], se2.rotate(pose[2], np.stack([np.cos(ANGLES), np.sin(ANGLES)], -1))
    a, e = OUTLINE[:-1] - p, np.diff(OUTLINE, axis=0)
    cross = d[:, None, 0] * e[:, 1] - d[:, None, 1] * e[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        r = (a[:, 0] * e[:, 1] - a[:, 1] * e[:, 0]) / cross
        s = (a[:, 0] * d[:, None, 1] - a[:, 1] * d[:, None, 0]) / cross
    hit = (np.abs(cross) > 1e-12) & (r > 0) & (s >= 0) & (s <= 1)
    return np.where(hit, r, np.inf).min(axis=1)


@dataclass(frozen=True)
class Corridor:
    """True and odometric poses of every step, and what the laser measured there."""

    truth: np.ndarray
    odometry: np.ndarray
    ranges: np.ndarray
    stamps: np.ndarray

    @classmethod
    def drive(cls, steps: int = 90, step: float = 0.13, seed: int = 3) -> "Corridor":
        rng = np.random.default_rng(seed)
        motions = np.column_stack([np.full(steps, step), np.zeros(steps), 0.06 * np.cos(0.3 * np.arange(steps))])
        felt = motions * [1.02, 1, 1.03] + rng.normal(0, [0.004, 0.002, 0.003], motions.shape)
        truth, odometry = [np.array([1.0, 0.1, -0.05])], [np.array([0.3, 4.0, 1.0])]
        for true, measured in zip(motions, felt, strict=True):
            truth.append(se2.compose(truth[-1], true))
            odometry.append(se2.compose(odometry[-1], measured))
        ranges = np.array([cast(pose) for pose in truth])
        ranges = np.where(np.isfinite(ranges), ranges + rng.normal(0, 0.01, ranges.shape), NO_RETURN)
        return cls(np.array(truth), np.array(odometry), ranges, 0.2 * np.arange(steps + 1))

    def raw(self) -> str:
        lines = ["# a simulated corridor, raw", "PARAM robot_frontlaser_offset 0.0 nohost 0"]
        for k, (pose, stamp) in enumerate(zip(self.odometry, self.stamps, strict=True)):
            lines.append(odom(pose, stamp))
            lines.append(flaser(self.ranges[k], pose, pose, 1000 + stamp, stamp))
        return "\n".join([*lines, odom(self.odometry[-1], self.stamps[-1] + 0.1), ""])

    def corrected(self, every: int = 3, robot_poses: np.ndarray | None = None, marks: bool = True) -> str:
        """Every so many scans re-anchored at the truth, the odometry in between relative to it, and NEFF."""
        lines = ["# a simulated corridor, corrected: scans at the true pose, odometry between them"]
        lines += ["# made by tests/datasets/carmen_corridor.py", "PARAM robot_frontlaser_offset 0.0 nohost 0"]
        for k in range(0, len(self.truth), every):
            true, stamp = self.truth[k], self.stamps[k]
            robot = true if robot_poses is None else robot_poses[k]
            lines.append(flaser(self.ranges[k], true, robot, stamp, stamp, ".6g"))
            lines.append(odom(true, 0, ".6g"))
            lines += [f"NEFF {30 - k / 10:g}"] if marks else []
            for j in range(k + 1, min(k + every, len(self.truth) - 1) + 1):
                moved = se2.compose(true, se2.between(self.odometry[k], self.odometry[j]))
                lines.append(odom(moved, self.stamps[j], ".6g"))
        return "\n".join([*lines, ""])


if __name__ == "__main__":
    write_text(Path(sys.argv[1]), Corridor.drive().corrected())
