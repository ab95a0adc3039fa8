"""Recovery: notice that scans have come to fit badly, and draw particles elsewhere (augmented MCL).

A filter that is lost sees its likelihoods drop below what they used to be. The share of particles drawn anew is
``1 - fast / slow``, with averages of the likelihood over the last few and over many scans (Probabilistic Robotics,
table 8.3, after Gutmann and Fox 2002), and differs from there in three ways. The likelihood of a scan spans hundreds
of orders of magnitude with the number of its rays, so it is that of a ray: the geometric mean over the rays of a scan.
What a lidar sees, and with it that likelihood, changes by factors along every drive, so lower averages are tolerated
down to a limit. And what was drawn is given time: the fast average then begins anew at the slow one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from pydantic import Field, model_validator

from factorloc.config import Block

__all__ = ["Recovery", "RecoverySettings"]


class RecoverySettings(Block):
    """When a filter takes itself for lost.

    Parameters
    ----------
    slow, fast : float
        Weight of a new scan in the slow and the fast average of likelihoods; slow < fast.
    tolerance : float
        How many times lower than the slow average the fast one may be before particles are drawn anew.
    most : float
        Largest share of particles drawn anew at a time.

    Raises
    ------
    ConfigError
        If the slow average is not the slower one.
    """

    slow: float = Field(0.01, gt=0, lt=1)
    fast: float = Field(0.3, gt=0, le=1)
    tolerance: float = Field(3.0, ge=1)
    most: float = Field(0.9, gt=0, le=1)

    @model_validator(mode="after")
    def _slow_is_slower(self) -> RecoverySettings:
        if self.slow >= self.fast:
            raise ValueError(f"slow {self.slow} must be below fast {self.fast}")
        return self


@dataclass(frozen=True)
class Recovery:
    """Averages of the likelihood of a ray so far.

    They weigh the scans seen as an exponential average does and divide by the weights so far, so that the first scan
    counts no more than any other.

    Parameters
    ----------
    settings : RecoverySettings
        Rates and tolerance.
    slow, fast : float
        Weighted sums of likelihoods.
    scans : int
        Scans seen.
    """

    settings: RecoverySettings
    slow: float = 0.0
    fast: float = 0.0
    scans: int = 0

    def updated(self, likelihood: float) -> Recovery:
        """Return the averages after a scan whose rays have this likelihood (1/m), at least 0."""
        slow, fast = (
            total + rate * (likelihood - total)
            for total, rate in ((self.slow, self.settings.slow), (self.fast, self.settings.fast))
        )
        return replace(self, slow=slow, fast=fast, scans=self.scans + 1)

    @property
    def averages(self) -> tuple[float, float]:
        """Slow and fast average, 1/m; zeros before the first scan."""
        if self.scans == 0:
            return 0.0, 0.0
        seen = (1 - (1 - rate) ** self.scans for rate in (self.settings.slow, self.settings.fast))
        slow, fast = (total / weight for total, weight in zip((self.slow, self.fast), seen, strict=True))
        return slow, fast

    @property
    def share(self) -> float:
        """Share of particles to draw anew, 0 to :attr:`RecoverySettings.most`."""
        slow, fast = self.averages
        if slow <= 0 or fast * self.settings.tolerance >= slow:
            return 0.0
        return min(1 - fast / slow, self.settings.most)

    def acted(self) -> Recovery:
        """Return the averages after particles were drawn anew: the fast one begins again at the slow one."""
        weight = 1 - (1 - self.settings.fast) ** self.scans
        return replace(self, fast=self.averages[0] * weight)
