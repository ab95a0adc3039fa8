"""HDF5 files of maps: written with checksums throughout, read without believing anything they declare.

Files have the metadata of HDF5 1.10 (superblock 3), in which every header and index carries a checksum, and texts of
fixed length, which lie inside those headers. In the older layout that HDF5 writes by default, one flipped bit may
change an attribute unnoticed or send the library round in circles.
"""

from __future__ import annotations

import io
import math
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from factorloc.errors import MapError, MapFormatError

if TYPE_CHECKING:
    import h5py

__all__ = ["MOST_TEXT", "CheckedFile", "create_array", "create_array_of", "create_text", "creating", "opening"]

MOST_TEXT = 16 * 2**20
"""Longest text, bytes."""

_LIBRARY = ("v110", "v110")
_SIGNATURE = b"\x89HDF\r\n\x1a\n"
_SUPERBLOCK = 3
_SHUFFLE_DEFLATE_CHECKSUM = [2, 1, 3]  # the numbers of these filters in HDF5
_CHUNK_EDGE = {1: 65536, 2: 256, 3: 40}


def _chunks(shape: tuple[int, ...]) -> tuple[int, ...]:
    return tuple(max(min(_CHUNK_EDGE[len(shape)], n), 1) for n in shape)


@contextmanager
def creating(path: Path) -> Iterator[h5py.File]:
    """Open a new file, which is put together in memory and written when the block ends.

    HDF5 cannot be trusted with a full disk: it crashes when it closes what it could not write.
    """
    import h5py

    image = io.BytesIO()
    with h5py.File(image, "w", libver=_LIBRARY) as file:
        yield file
    path.write_bytes(image.getbuffer())


def create_text(file: h5py.File, name: str, text: str) -> None:
    """Add an attribute that holds a text.

    Raises
    ------
    MapError
        If it is too long, or HDF5 would cut it.
    """
    import h5py

    encoded = text.encode()
    if len(encoded) > MOST_TEXT or "\0" in text:
        raise MapError(f"{name}: {len(encoded)} bytes; a map file takes texts up to {MOST_TEXT} bytes, without NUL")
    file.attrs.create(name, np.bytes_(encoded), dtype=h5py.string_dtype("utf-8", max(len(encoded), 1)))


def create_array(file: h5py.File, name: str, values: npt.NDArray[Any]) -> None:
    """Add a dataset in compressed chunks with checksums."""
    create_array_of(file, name, [values], values.shape, values.dtype)


def create_array_of(
    file: h5py.File, name: str, pieces: Iterable[npt.NDArray[Any]], shape: tuple[int, ...], dtype: npt.DTypeLike
) -> None:
    """Add a dataset as :func:`create_array`, piece by piece along the first axis."""
    options: dict[str, Any] = {"chunks": _chunks(shape), "compression": "gzip", "shuffle": True, "fletcher32": True}
    if 0 in shape:  # HDF5 wants chunks no longer than what may be there one day
        options["maxshape"] = tuple(max(n, 1) for n in shape)
    dataset = file.create_dataset(name, shape=shape, dtype=dtype, **options)
    first = 0
    for piece in pieces:
        if piece.size:
            dataset[first : first + len(piece)] = piece
        first += len(piece)


@contextmanager
def opening(path: Path, mend: str) -> Iterator[CheckedFile]:
    """Open a file for reading; whatever HDF5 stumbles over is one clear error.

    Parameters
    ----------
    path : Path
        The file.
    mend : str
        What to do about a file that cannot be used.

    Raises
    ------
    MapFormatError
        If it is missing, no HDF5 file, of another layout, damaged or cut short.
    """
    import h5py

    if not path.is_file():
        raise MapFormatError(f"{path}: {'is a folder; name a file' if path.is_dir() else f'no such file; {mend}'}")
    try:
        with path.open("rb") as stream:
            head = stream.read(len(_SIGNATURE) + 1)
    except OSError as error:
        raise MapFormatError(f"{path}: cannot be read ({error.strerror})") from error
    if head[:-1] != _SIGNATURE:
        raise MapFormatError(f"{path}: no HDF5 file, so no map; {mend}")
    if head[-1] != _SUPERBLOCK:
        raise MapFormatError(f"{path}: HDF5 superblock {head[-1]}, factorloc writes {_SUPERBLOCK}; {mend}")
    try:
        # Map files are renamed into place and never change, so that file systems without locks will do.
        with h5py.File(path, "r", locking=False) as file:
            yield CheckedFile(path, file, mend)
    except MapError:
        raise
    except (ArithmeticError, LookupError, OSError, RuntimeError, TypeError, ValueError) as error:
        reason = " ".join(str(error).split())[:120]
        raise MapFormatError(f"{path}: damaged or cut short ({reason}); {mend}") from error


@dataclass(frozen=True)
class CheckedFile:
    """An open file whose types and sizes are checked before anything of that size is read.

    Parameters
    ----------
    path : Path
        Where it lies.
    file : h5py.File
        The open file.
    mend : str
        What to do about a file that cannot be used.
    """

    path: Path
    file: h5py.File
    mend: str

    def refused(self, what: str) -> MapFormatError:
        """Return the error that says what is wrong with the file."""
        return MapFormatError(f"{self.path}: {what}; {self.mend}")

    def _attribute(self, name: str, kinds: str, shapes: tuple[tuple[int, ...], ...]) -> Any:
        if name not in self.file.attrs:
            raise self.refused(f"attribute '{name}' is missing")
        found = self.file.attrs.get_id(name)
        if found.dtype.kind not in kinds or found.shape not in shapes or found.dtype.itemsize > MOST_TEXT:
            raise self.refused(f"attribute '{name}' is of type {found.dtype} and shape {found.shape}")
        return self.file.attrs[name]

    def text(self, name: str) -> str:
        """Text of an attribute."""
        return bytes(self._attribute(name, "S", ((),))).decode()

    def integer(self, name: str) -> int:
        """Whole number of an attribute, not negative."""
        value = int(self._attribute(name, "iu", ((),)))
        if value < 0:
            raise self.refused(f"attribute '{name}' is {value}")
        return value

    def number(self, name: str) -> float:
        """Finite number of an attribute."""
        value = float(self._attribute(name, "f", ((),)))
        if not math.isfinite(value):
            raise self.refused(f"attribute '{name}' is {value}")
        return value

    def vector(self, name: str, kind: str) -> tuple[Any, ...]:
        """Two or three numbers of an attribute, of a kind of numpy (``f`` or ``i``)."""
        return tuple(self._attribute(name, kind, ((2,), (3,))).tolist())

    def array(self, name: str, dtype: npt.DTypeLike, shape: tuple[int, ...]) -> h5py.Dataset:
        """Find a dataset exactly as :func:`create_array` makes it; nothing is read yet.

        Parameters
        ----------
        name : str
            Its name.
        dtype, shape
            What it has to hold.

        Raises
        ------
        MapFormatError
            If it is missing, a link, kept in another file, put together from others, of another type, shape, chunking
            or compression, or if a chunk is missing, too large or without checksum.
        """
        import h5py

        if not isinstance(self.file.get(name, getlink=True), h5py.HardLink):
            raise self.refused(f"'{name}' is missing or a link")
        found = self.file[name]
        if not isinstance(found, h5py.Dataset) or found.is_virtual or found.external is not None:
            raise self.refused(f"'{name}' does not hold its own values")
        if found.shape != shape or found.dtype != dtype:
            raise self.refused(f"'{name}' is of type {found.dtype} and shape {found.shape}, not {dtype} and {shape}")
        settings = found.id.get_create_plist()
        filters = [settings.get_filter(k)[0] for k in range(settings.get_nfilters())]
        chunks = _chunks(shape)
        if found.chunks != chunks or filters != _SHUFFLE_DEFLATE_CHECKSUM:
            raise self.refused(f"'{name}' is not in chunks of {chunks}, compressed and with checksums")
        sizes: list[int] = []
        # A chunk with a filter mask skips some filters, perhaps the checksum.
        found.id.chunk_iter(lambda chunk: sizes.append(-1 if chunk.filter_mask else chunk.size))
        # Deflate lengthens what it cannot compress by less than a thousandth and 16 bytes.
        most = math.prod(chunks) * found.dtype.itemsize * 1.001 + 64
        if len(sizes) != math.prod(-(-n // c) for n, c in zip(shape, chunks, strict=True)):
            raise self.refused(f"'{name}' lacks some of its chunks")
        if sizes and not 0 < min(sizes) <= max(sizes) <= most:
            raise self.refused(f"'{name}' has a chunk of wrong size or without checksum")
        return found
