"""Records of a long benchmark: kept as it goes on, so that one that was broken off goes on where it was."""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import factorloc
from factorloc.files import write_text

__all__ = ["Records"]


class Records:
    """What was measured, by name.

    Parameters
    ----------
    path : Path
        File they are kept in; one of other settings or other code is not taken up.
    settings : object
        What they depend on.
    progress : callable
        Called with the name of each record before it is made, or taken up.

    Attributes
    ----------
    values : dict of str to object
    seconds : dict of str to list of float
        Wall and processor time each took.
    """

    def __init__(self, path: Path, settings: object, progress: Callable[[str], None]) -> None:
        self.path, self.progress = path, progress
        self.key = _digest(settings)
        self.values: dict[str, Any] = {}
        self.seconds: dict[str, list[float]] = {}
        try:
            kept = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return
        if isinstance(kept, dict) and kept.get("key") == self.key:
            self.values, self.seconds = kept["values"], kept["seconds"]

    def get(self, name: str, make: Callable[[], Any]) -> Any:
        """Return a record (what JSON can hold), making and keeping it if there is none."""
        self.progress(name)
        if name not in self.values:
            began = time.perf_counter(), time.process_time()
            self.values[name] = make()
            self.seconds[name] = [time.perf_counter() - began[0], time.process_time() - began[1]]
            write_text(self.path, json.dumps({"key": self.key, "seconds": self.seconds, "values": self.values}))
        return self.values[name]

    def discard(self) -> None:
        """Remove the file: all is done."""
        self.path.unlink(missing_ok=True)


def _digest(settings: object) -> str:
    """Digest of settings and of all code that may have a part in what they lead to."""
    digest = hashlib.sha256(json.dumps(settings, default=str, sort_keys=True).encode())
    for folder in (Path(factorloc.__file__).parent, Path(__file__).parent):
        for file in sorted(folder.rglob("*.py")):
            digest.update(file.read_bytes())
    return digest.hexdigest()
