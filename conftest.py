"""Keeps pytest out of the three root links: their rooms are tested under the package's own path."""

collect_ignore = ["factors", "mapping", "intervals"]
