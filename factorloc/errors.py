"""Errors: one root, one subclass a room, one clear line each.

A message names the file or argument, the field, and the mend. The command line prints it as it stands and exits 1;
library code never calls ``sys.exit``.
"""

__all__ = [
    "ConfigError",
    "DataError",
    "EvaluationError",
    "FactorlocError",
    "FactorlocWarning",
    "GeometryError",
    "MapError",
    "MapFormatError",
    "MissingLibraryError",
    "OptimizationError",
    "SimulationError",
]


class FactorlocError(Exception):
    """Root of everything the package raises on purpose."""


class GeometryError(FactorlocError, ValueError):
    """An array of poses, points or rays has the wrong shape, frame or values."""


class DataError(FactorlocError, ValueError):
    """A file of measurements is missing, damaged, empty or of another type."""


class MapError(FactorlocError, ValueError):
    """A map cannot be built or does not fit the scans it is used with."""


class MapFormatError(MapError):
    """A map file is damaged, of another kind, or written by a newer version."""


class OptimizationError(FactorlocError, RuntimeError):
    """A graph cannot be solved: it is empty, singular or not finite."""


class EvaluationError(FactorlocError, ValueError):
    """Two trajectories cannot be compared."""


class SimulationError(FactorlocError, ValueError):
    """A world, lidar or drive is not consistent."""


class ConfigError(FactorlocError, ValueError):
    """A setting is unknown or out of its range."""


class MissingLibraryError(FactorlocError, ImportError):
    """An optional library, or a system library it needs, is not there."""


class FactorlocWarning(UserWarning):
    """Something was left out or repaired; the message counts it."""
