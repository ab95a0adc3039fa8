"""Session cache: arrays that take long to make, kept on disk under a digest of what they follow from."""

from __future__ import annotations

import hashlib
import logging
import zipfile
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt

from factorloc._version import __version__
from factorloc.config import Block
from factorloc.errors import DataError, SimulationError
from factorloc.files import atomic_path

__all__ = ["MAX_CACHED_BYTES", "cache_key", "cached", "read_arrays", "write_arrays"]

Arrays = dict[str, npt.NDArray[np.generic]]

MAX_CACHED_BYTES = 2 * 2**30
"""An entry may unfold to this many bytes; one that claims more is taken for damaged."""

# All that the readers of zip and npy raise on bytes that are not theirs.
_DAMAGE = (
    OSError, ValueError, EOFError, KeyError, SyntaxError, MemoryError, NotImplementedError, RuntimeError, zlib.error,
    zipfile.BadZipFile,
)  # fmt: skip

_log = logging.getLogger(__name__)


def cache_key(*parts: Block | str | int) -> str:
    """Digest of settings, seeds and names, with the version of the package.

    Parameters
    ----------
    parts : Block, str or int
        All that the arrays follow from, in a fixed order.

    Returns
    -------
    str
        32 hexadecimal digits.
    """
    digest = hashlib.sha256(f"factorloc {__version__}".encode())
    for part in parts:
        text = part.model_dump_json() if isinstance(part, Block) else str(part)
        # Kind and length keep parts apart: ("ab", "c") is not ("a", "bc"), 1 is not "1".
        digest.update(f"\n{type(part).__name__} {len(text.encode())} {text}".encode())
    return digest.hexdigest()[:32]


def cached(folder: Path | str, key: Block | str, make: Callable[[], Mapping[str, npt.ArrayLike]]) -> Arrays:
    """Return arrays from the cache, or make and keep them.

    Parameters
    ----------
    folder : Path or str
        The cache; created if need be. Entries of other versions stay until the folder is deleted, which is always safe.
    key : Block or str
        What the arrays follow from, or :func:`cache_key` of it.
    make : callable
        Makes the arrays, by name; called only if they are not there or their file is damaged, which is logged.

    Returns
    -------
    dict of ndarray
        The arrays.

    Raises
    ------
    SimulationError
        If an array holds Python objects or has no usable name, or all of them exceed ``MAX_CACHED_BYTES``.
    FactorlocError
        If the entry cannot be written.
    """
    path = Path(folder) / f"{cache_key(key)}.npz"
    if path.exists():
        try:
            return read_arrays(path)
        except DataError as error:
            _log.warning("%s; it is made anew", error)
    arrays = {name: np.asarray(values) for name, values in make().items()}
    write_arrays(path, arrays)
    return arrays


def write_arrays(path: Path | str, arrays: Mapping[str, npt.NDArray[np.generic]]) -> None:
    """Write arrays whole or not at all, compressed; see :func:`cached` for what is refused."""
    for name, array in arrays.items():
        if not name or "/" in name or "\\" in name or array.dtype.hasobject:
            raise SimulationError(
                f"cache {path}: array {name!r} of {array.dtype}; needs a plain name and plain numbers"
            )
    size = sum(array.nbytes for array in arrays.values())
    if size > MAX_CACHED_BYTES:
        raise SimulationError(f"cache {path}: {size >> 20} MiB exceed {MAX_CACHED_BYTES >> 20} MiB; split the entry")
    with (
        atomic_path(path) as temporary,
        zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as entry,
    ):
        for name, array in arrays.items():
            with entry.open(f"{name}.npy", "w", force_zip64=True) as stream:
                np.lib.format.write_array(stream, array, allow_pickle=False)


def read_arrays(path: Path | str) -> Arrays:
    """Read arrays that were written by :func:`write_arrays`.

    Raises
    ------
    DataError
        If the file is missing, damaged, of another kind, or unfolds beyond ``MAX_CACHED_BYTES``.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            size = sum(info.file_size for info in archive.infolist())
        if size > MAX_CACHED_BYTES + (1 << 20):
            raise DataError(f"{path}: unfolds to {size >> 20} MiB; is it a cache entry?")
        with np.load(path, allow_pickle=False) as entry:
            return {name: entry[name] for name in entry.files}
    except FileNotFoundError as error:
        raise DataError(f"{path}: no such file") from error
    except _DAMAGE as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise DataError(f"{path}: damaged cache entry ({reason})") from error
