"""Known files: where they come from, under which licence, and how far their lasers reach."""

from __future__ import annotations

import hashlib
import os
import re
from dataclasses import dataclass
from pathlib import Path

import platformdirs

from factorloc.errors import DataError

__all__ = ["COMPRESSIONS", "KNOWN_FILES", "KnownFile", "data_folder", "known_max_range", "log_name"]

COMPRESSIONS = (".gz", ".bz2", ".xz")
"""Endings of compressed files."""

_ENDINGS = re.compile(r"(-corrected)?(\.(log|clf))?(\.(gz|bz2|xz))?$", re.IGNORECASE)
_CC_BY = "CC BY 3.0"
_RADISH = "Radish, http://ais.informatik.uni-freiburg.de/slamevaluation/datasets.php"
_PLE = "Radish, as kept at https://github.com/acschaefer/ple"


@dataclass(frozen=True)
class KnownFile:
    """A file that tests, benchmarks and notebooks know by name.

    Parameters
    ----------
    path : str
        Where it lies in the data folder.
    sha256 : str
        Digest of the file as fetched.
    source : str
        Where it comes from.
    licence : str
        Under which terms.
    """

    path: str
    sha256: str
    source: str = _PLE
    licence: str = _CC_BY

    def locate(self, folder: Path | None = None) -> Path:
        """Return the path of the file in a data folder (that of :func:`data_folder` by default).

        Raises
        ------
        DataError
            If it is not there.
        """
        path = (data_folder() if folder is None else folder) / self.path
        if not path.is_file():
            raise DataError(f"{path}: no such file; fetch it from {self.source}")
        return path

    def verify(self, folder: Path | None = None) -> Path:
        """Return the path of the file after comparing its digest.

        Raises
        ------
        DataError
            If it is not there or not the file that is known.
        """
        path = self.locate(folder)
        with path.open("rb") as stream:
            digest = hashlib.file_digest(stream, "sha256").hexdigest()
        if digest != self.sha256:
            raise DataError(f"{path}: sha256 {digest[:12]}... instead of {self.sha256[:12]}...; fetch it again")
        return path


KNOWN_FILES = (
    KnownFile("carmen/aces-corrected.log.gz", "5434d44384166250608a64d3a8c32de84512f82c46cb60a2657f138592024569"),
    KnownFile("carmen/belgioioso-corrected.log.gz", "a130e3e6d9e5ec5e6a7f94cbb5cb6bca2df2626c7ed6bebb7b7a282253b10f6e"),
    KnownFile("carmen/edmonton-corrected.log.gz", "96599a91e0cc9cb2570dbb92f92bbdf1e3a405b16aa99f6d3ce1a703011befdb"),
    KnownFile("carmen/fhw-corrected.log.gz", "4233abbfbc15baaddc730aceb3482dc660b25c9d5757005fff97a3fe083595b8"),
    KnownFile(
        "carmen/freiburg-campus-corrected.log.gz", "534fae978c3a28fd9994c9b3327a36a2752df8339e232b9b70f96f67f76341b0"
    ),
    KnownFile(
        "carmen/infinite-corridor-corrected.log.gz", "6a63c51eb97aa4e720fe207e91f926c283f77b4c534903983f9c5a6cbed6ebc4"
    ),
    KnownFile("carmen/intel-corrected.log.gz", "71bef16e9926506cf7417995ef35ace09dbd5de067fd042a3aab85188b5480dc"),
    KnownFile("carmen/seattle-corrected.log.gz", "5719198036b788d78a877ca04efdbfb07c2518508310f51d49c198bf1956bb4b"),
    KnownFile("carmen_raw/aces.clf.bz2", "b663e2976ed0621c2bec0cc20c4e7cc117b88db5bac6f921d3fbaa9685d2232a", _RADISH),
    KnownFile("carmen_raw/aces.relations", "11a15800a751b6f9413078a021d49c7cda85a768c2a465433b4fae7ef57b03d5", _RADISH),
    KnownFile("carmen_raw/intel.clf.bz2", "d9ce4addefc9405d5e78fd883d2214766552537d262009f8e6f0137885f9f72a", _RADISH),
)
"""Every file in use, with its digest."""

_MAX_RANGES = {
    "aces": 50.0,
    "belgioioso": 80.99,
    "edmonton": 10.0,
    "fhw": 50.0,
    "freiburg-campus": 80.99,
    "infinite-corridor": 50.0,
    "intel": 50.0,
    "seattle": 50.0,
}


def data_folder() -> Path:
    """Return the folder of real data: ``FACTORLOC_DATA``, or else the user's own data folder.

    Raises
    ------
    DataError
        If it does not exist.
    """
    named = os.environ.get("FACTORLOC_DATA")
    folder = Path(named) if named else platformdirs.user_data_path("factorloc", appauthor=False)
    if not folder.is_dir():
        raise DataError(f"{folder}: no such folder; set FACTORLOC_DATA to where the data lies")
    return folder


def log_name(path: Path | str) -> str:
    """Return the name of a log without folder, endings and the word ``-corrected``."""
    return _ENDINGS.sub("", Path(path).name, count=1)


def known_max_range(name: str) -> float | None:
    """Return the maximum range (m) of the laser of a known log, or None."""
    return _MAX_RANGES.get(name)
