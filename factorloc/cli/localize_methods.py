"""What ``factorloc localize`` runs: the smoother, or Monte Carlo localization."""

from __future__ import annotations

import enum
from pathlib import Path
from typing import TYPE_CHECKING, Any

from factorloc.cli.console import console, progress_bar

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from factorloc.config import Block
    from factorloc.datasets import Drive
    from factorloc.mapping import BrickStatistics, RayStatistics
    from factorloc.result import Result

__all__ = ["Method", "by_particles", "by_smoothing"]


class Method(enum.StrEnum):
    """How a recording is localized."""

    SMOOTHER = "smoother"
    MCL = "mcl"


def by_smoothing(
    statistics: RayStatistics | BrickStatistics,
    drive: Drive,
    start: npt.NDArray[np.float64],
    config: Path | None,
) -> tuple[Block, dict[str, Result]]:
    """Track and smooth a drive; returns the settings and both results."""
    from factorloc.config import read_config
    from factorloc.localization import LocalizationSettings, localize

    settings = LocalizationSettings() if config is None else read_config(config, LocalizationSettings)
    with progress_bar("tracking", len(drive)) as progress:
        found = localize(statistics, drive.scans, drive.odometry, start, settings=settings, **_about(drive, progress))
    return settings, {"tracked": found.tracked, "smoothed": found.smoothed}


def by_particles(
    statistics: RayStatistics | BrickStatistics,
    drive: Drive,
    start: npt.NDArray[np.float64] | None,
    config: Path | None,
    *,
    model: str,
    floor: float,
    particles: int | None,
    height: float,
    seed: int,
) -> tuple[Block, dict[str, Result]]:
    """Localize a drive by particles, from anywhere if there is no start; returns the settings and the result.

    Raises
    ------
    ConfigError
        If a setting is wrong.
    MapError
        If there is no such model, or nowhere to start.
    """
    from factorloc.config import read_config
    from factorloc.errors import MapError
    from factorloc.localization import FreeSpace, MonteCarloSettings, localize_by_particles
    from factorloc.mapping.sensor_models import make_sensor_model

    settings = MonteCarloSettings() if config is None else read_config(config, MonteCarloSettings)
    if particles is not None:
        kld = settings.kld.replaced(most=particles, least=min(settings.kld.least, particles))
        settings = settings.replaced(kld=kld)
    # A most likely map excludes every ray that ends where none did before: no particle would explain any scan.
    options = {"floor": floor} if model in ("decay-rate", "reflection") else {}
    sensor_model = make_sensor_model(statistics, model, **options)
    stands_at = float(start[2, 3]) if start is not None and start.ndim == 2 else height
    anywhere: FreeSpace | None = None
    try:
        anywhere = FreeSpace.of(statistics, height=stands_at)
    except MapError as error:
        if start is None:
            raise
        console.print(f"the filter will not look elsewhere if it is lost: {error}", markup=False)
    begin = anywhere if start is None else start
    assert begin is not None  # where nothing is free, a start was given
    with progress_bar("filtering", len(drive)) as progress:
        found = localize_by_particles(
            sensor_model, drive.scans, drive.odometry, begin, settings=settings, free_space=anywhere, seed=seed,
            **_about(drive, progress),
        )  # fmt: skip
    kept = {what: count for what, count in found.rejected.items() if count}
    console.print("filtered: " + ", ".join(f"{count} {what}" for what, count in kept.items()))
    return settings, {"filtered": found}


def _about(drive: Drive, progress: Any) -> dict[str, Any]:
    return {"known": drive.odometry_known, "covariances": drive.odometry_covariances, "progress": progress}
