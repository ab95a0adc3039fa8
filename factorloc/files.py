"""Files: written whole or not at all, read with bounded decompression."""

from __future__ import annotations

import bz2
import contextlib
import gzip
import lzma
import os
import tempfile
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO, cast

from factorloc.errors import DataError, FactorlocError

__all__ = ["atomic_path", "open_text", "write_text"]

MAX_DECOMPRESSED_BYTES = 4 * 2**30
"""A compressed text file may unfold to this many bytes; more is taken for a bomb."""

_MAX_LINE_BYTES = 16 * 2**20
_OPENERS: dict[str, Callable[[Path], object]] = {".gz": gzip.GzipFile, ".bz2": bz2.BZ2File, ".xz": lzma.LZMAFile}


@contextlib.contextmanager
def atomic_path(target: Path | str) -> Iterator[Path]:
    """Yield a temporary path beside ``target``; rename it onto ``target`` when the block succeeds.

    Parameters
    ----------
    target : Path or str
        The file to write. Its folder is created.

    Yields
    ------
    Path
        Where to write instead. An ``OSError`` of the block is taken for a failure to write it (a full disk).

    Raises
    ------
    FactorlocError
        If the target cannot be written, or is a folder or device; what was there stays, and no temporary file does.
    """
    target = Path(target)
    try:
        # A device would be replaced by a file.
        if target.exists() and not target.is_file():
            raise FactorlocError(f"{target}: is a {'folder' if target.is_dir() else 'device'}; name a file")
        target.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(prefix=f".{target.name}.", suffix=target.suffix, dir=target.parent)
    except OSError as error:
        raise FactorlocError(f"{target}: cannot be written ({error.strerror}); choose another output") from error
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        # mkstemp makes the file private; give it the mode any other new file would have.
        mask = os.umask(0)
        os.umask(mask)
        temporary.chmod(0o666 & ~mask)
        temporary.replace(target)
    except OSError as error:
        raise FactorlocError(f"{target}: cannot be written ({error.strerror or error})") from error
    finally:
        temporary.unlink(missing_ok=True)


def write_text(target: Path | str, text: str) -> None:
    """Write ``text`` to ``target`` atomically, in UTF-8.

    Parameters
    ----------
    target : Path or str
        The file to write.
    text : str
        Its whole content.

    Raises
    ------
    FactorlocError
        If the target cannot be written.
    """
    with atomic_path(target) as temporary:
        temporary.write_text(text, encoding="utf-8")


def open_text(path: Path | str, max_bytes: int = MAX_DECOMPRESSED_BYTES) -> Iterator[tuple[int, str]]:
    """Yield the numbered lines of a text file: plain, gzip, bzip2 or xz, guessed from its name.

    Parameters
    ----------
    path : Path or str
        The file.
    max_bytes : int
        Largest decompressed size accepted.

    Yields
    ------
    int
        Line number, from 1.
    str
        The line without its end; undecodable bytes are replaced, so that the reader can count the line as damaged.

    Raises
    ------
    DataError
        If the file is missing, a folder, not what its ending says, cut short, or unfolds beyond ``max_bytes``.
    """
    path = Path(path)
    if path.is_dir():
        raise DataError(f"{path}: is a folder; name a file")
    opener = _OPENERS.get(path.suffix.lower())
    total = 0
    try:
        with cast("IO[bytes]", opener(path) if opener else path.open("rb")) as stream:
            number = 0
            while line := stream.readline(_MAX_LINE_BYTES):
                number += 1
                total += len(line)
                if total > max_bytes or len(line) == _MAX_LINE_BYTES:
                    limit = f"{max_bytes >> 20} MiB" if total > max_bytes else f"{_MAX_LINE_BYTES >> 20} MiB a line"
                    raise DataError(f"{path}: unfolds beyond {limit} at line {number}; is it a log?")
                yield number, line.rstrip(b"\r\n").decode("utf-8", errors="replace")
    except FileNotFoundError as error:
        raise DataError(f"{path}: no such file") from error
    except (EOFError, OSError, lzma.LZMAError, zlib.error) as error:
        if isinstance(error, OSError) and error.errno is not None:
            raise DataError(f"{path}: cannot be read ({error.strerror})") from error
        kind = path.suffix.lower().lstrip(".") or "text"
        raise DataError(f"{path}: damaged or cut short, or not {kind} ({error}); fetch it again") from error
