"""Open a recording without knowing its format."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Protocol

from factorloc.datasets.carmen import CarmenReader
from factorloc.datasets.drive import Drive
from factorloc.datasets.kitti_odometry import KittiOdometryReader
from factorloc.datasets.kitti_raw import KittiRawReader
from factorloc.datasets.nclt import NcltReader
from factorloc.errors import DataError

__all__ = ["READERS", "Reader", "open_drive"]


class Reader(Protocol):
    """What reads one format."""

    @property
    def name(self) -> str:
        """The format and its file endings or folders, as named in messages."""

    def matches(self, path: Path) -> bool:
        """Tell from a path, without opening a file, whether this reader is meant."""

    def read(self, path: Path, **options: Any) -> Drive:
        """Read the recording.

        Raises
        ------
        DataError
            If it cannot be read.
        """


READERS: tuple[Reader, ...] = (CarmenReader(), KittiRawReader(), KittiOdometryReader(), NcltReader())
"""Every format known, in the order they are asked."""


def open_drive(path: Path | str, reader: Reader | None = None, **options: Any) -> Drive:
    """Read a recording; the format is guessed from the path.

    Parameters
    ----------
    path : Path or str
        The recording, a file or a folder.
    reader : Reader, optional
        The format, if the path does not tell.
    **options
        Passed on to the reader.

    Raises
    ------
    DataError
        If no format fits, or the recording cannot be read.
    """
    path = Path(path)
    if reader is None:
        reader = next((known for known in READERS if known.matches(path)), None)
    if reader is None:
        formats = "; ".join(known.name for known in READERS)
        raise DataError(f"{path}: no known format; known are: {formats}")
    return reader.read(path, **options)
