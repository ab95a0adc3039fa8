"""Temporary stub; being written."""

MapInfo = read_map = read_map_info = None


def write_map(path, statistics, provenance=None):
    """Nothing yet."""
