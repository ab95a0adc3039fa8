"""Storage of pole maps: our own HDF5 file, GeoJSON for every map program, and the published arrays of others."""

from __future__ import annotations

import json
import warnings
import zipfile
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from factorloc._version import __version__
from factorloc.errors import FactorlocWarning, MapError, MapFormatError
from factorloc.files import atomic_path
from factorloc.mapping.georeference import Georeference
from factorloc.mapping.hdf5 import CheckedFile, create_array, create_text, creating, opening
from factorloc.mapping.pole_geojson import holds_no_outlines, read_geojson, write_geojson
from factorloc.mapping.pole_map import PoleMap
from factorloc.mapping.poles import Poles

if TYPE_CHECKING:
    import h5py

__all__ = ["POLE_FORMAT", "POLE_KIND", "is_pole_map", "read_pole_map", "write_pole_map"]

POLE_KIND = "factorloc pole map"
"""What the HDF5 file of a pole map says it holds."""

POLE_FORMAT = 1
"""Version of that format."""

_MEND = "make it anew with 'factorloc map poles'"
_GEOJSON = (".geojson", ".json")
_HDF5 = (".h5", ".hdf5")
_FLOATS = {"positions": 2, "widths": 0, "spans": 2, "scores": 0}
_COUNTS = ("seen", "in_view")
_SAME = 0.01  # m; two poles of a file that stand nearer to each other are one, written twice

# What a published array of positions does not say.
_WIDTH, _SPAN, _SCORE = 0.2, (0.0, 2.0), 1.0


def write_pole_map(path: Path | str, pole_map: PoleMap) -> None:
    """Write a map of poles, whole or not at all.

    Parameters
    ----------
    path : Path or str
        ``.h5`` for our own file, exact to the last bit; ``.geojson`` for map programs, exact as well.
    pole_map : PoleMap
        What to write.

    Raises
    ------
    MapError
        If the name ends otherwise.
    FactorlocError
        If the file cannot be written; what was there stays.
    """
    target = Path(path)
    if target.suffix.lower() in _GEOJSON:
        write_geojson(target, pole_map)
    elif target.suffix.lower() in _HDF5:
        with atomic_path(target) as temporary, creating(temporary) as file:
            _write(file, pole_map)
    else:
        raise MapError(f"{target}: pole maps are written as .geojson or .h5; end the name so")


def read_pole_map(path: Path | str) -> PoleMap:
    """Read a map of poles; those a file holds twice are left out, and counted in a warning.

    Parameters
    ----------
    path : Path or str
        ``.h5`` or ``.geojson`` as :func:`write_pole_map` makes them, GeoJSON points of another source, or an ``.npz``
        of published maps: an array ``poleparams`` or ``polemeans`` whose first two columns are x and y, m. What such
        an array does not say is taken as 0.2 m of width, heights from 0 to 2 m, and a score of 1.

    Raises
    ------
    MapFormatError
        If the file is missing, damaged, or of another kind.
    """
    source = Path(path)
    suffix = source.suffix.lower()
    if suffix in _HDF5:
        with opening(source, _MEND) as file:
            pole_map = _read(file)
    elif suffix in _GEOJSON:
        pole_map = read_geojson(source)
    elif suffix == ".npz":
        pole_map = _read_published(source)
    else:
        raise MapFormatError(f"{source}: pole maps end in .geojson, .h5 or .npz; {_MEND}")
    pole_map, twice = pole_map.without_duplicates(_SAME)
    if twice:
        warnings.warn(f"{source}: {twice} poles stand twice in the file; left out", FactorlocWarning, stacklevel=2)
    return pole_map


def is_pole_map(path: Path | str) -> bool:
    """Whether a file holds a map of poles: by its name, in HDF5 by the kind it states, in GeoJSON by its shapes."""
    source = Path(path)
    if source.suffix.lower() == ".geojson":
        return source.is_file() and holds_no_outlines(source)
    if source.suffix.lower() not in _HDF5:
        return source.suffix.lower() == ".npz" and source.is_file()
    with opening(source, _MEND) as file:
        return "kind" in file.file.attrs and file.text("kind") == POLE_KIND


def _write(file: h5py.File, pole_map: PoleMap) -> None:
    place = pole_map.georeference
    texts = {
        "kind": POLE_KIND,
        "factorloc": __version__,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "frame": pole_map.frame,
        "sessions": json.dumps(pole_map.sessions),
        "provenance": json.dumps(pole_map.provenance),
        "crs": "" if place is None else place.crs,
    }
    for name, text in texts.items():
        create_text(file, name, text)
    file.attrs["format"] = np.int64(POLE_FORMAT)
    file.attrs["pole_count"] = np.int64(len(pole_map))
    if place is not None:
        file.attrs["T_crs_map"] = place.T_crs_map
    for name in _FLOATS:
        create_array(file, name, getattr(pole_map.poles, name))
    for name in _COUNTS:
        create_array(file, name, getattr(pole_map, name))


def _read(file: CheckedFile) -> PoleMap:
    if "kind" not in file.file.attrs or (kind := file.text("kind")) != POLE_KIND:
        holds = f"holds '{kind[:80]}'" if "kind" in file.file.attrs else "an HDF5 file"
        raise file.refused(f"{holds}, no map of poles")
    if (version := file.integer("format")) > POLE_FORMAT:
        raise MapFormatError(
            f"{file.path}: pole map format {version}, this factorloc reads up to {POLE_FORMAT}; update factorloc"
        )
    sessions, provenance = json.loads(file.text("sessions")), json.loads(file.text("provenance"))
    if not (isinstance(sessions, list) and all(type(name) is str for name in sessions)):
        raise file.refused("attribute 'sessions' is no JSON array of texts")
    if not (isinstance(provenance, dict) and all(type(text) is str for text in provenance.values())):
        raise file.refused("attribute 'provenance' is no JSON object of texts")
    count, crs = file.integer("pole_count"), file.text("crs")

    def values(name: str, dtype: npt.DTypeLike, columns: int) -> npt.NDArray[Any]:
        return np.asarray(file.array(name, dtype, (count, columns) if columns else (count,))[()])

    try:
        poles = Poles(**{name: values(name, np.float64, columns) for name, columns in _FLOATS.items()})
        seen, in_view = (values(name, np.int64, len(sessions)) for name in _COUNTS)
        place = Georeference(crs, np.array(file.vector("T_crs_map", "f"))) if crs else None
        return PoleMap(poles, seen, in_view, tuple(sessions), file.text("frame"), place, provenance)
    except MapFormatError:
        raise
    except MapError as error:
        raise file.refused(str(error)) from error


def _read_published(path: Path) -> PoleMap:
    try:
        with np.load(path, allow_pickle=False) as packed:
            name = next((name for name in ("poleparams", "polemeans") if name in packed.files), None)
            table = None if name is None else np.asarray(packed[name], np.float64)
    except FileNotFoundError as error:
        raise MapFormatError(f"{path}: no such file; name a map of poles") from error
    except (OSError, ValueError, EOFError, zipfile.BadZipFile) as error:
        raise MapFormatError(f"{path}: damaged, or no archive of plain arrays ({error}); fetch it again") from error
    if table is None:
        raise MapFormatError(f"{path}: holds neither 'poleparams' nor 'polemeans'; is it a map of poles?")
    if table.ndim != 2 or table.shape[1] < 2:
        raise MapFormatError(f"{path}: '{name}' has shape {table.shape}; expected a row for each pole, x and y first")
    n = len(table)
    try:
        poles = Poles(table[:, :2], np.full(n, _WIDTH), np.tile(_SPAN, (n, 1)), np.full(n, _SCORE))
    except MapError as error:
        raise MapFormatError(f"{path}: {error}") from error
    return PoleMap.of(poles, session=path.stem, provenance={"published map": path.name})
