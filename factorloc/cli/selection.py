"""Which scans of a drive a command takes."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from factorloc.errors import ConfigError

__all__ = ["SELECTION_HELP", "select_scans"]

SELECTION_HELP = "Scans to use: all, even, odd, first-half, second-half, or start:stop:step."


def select_scans(count: int, wanted: str) -> npt.NDArray[np.int64]:
    """Indices of the scans a selection names.

    Parameters
    ----------
    count : int
        Scans there are.
    wanted : str
        ``all``, ``even``, ``odd``, ``first-half``, ``second-half`` or a Python slice.

    Raises
    ------
    ConfigError
        If the selection is unknown or empty.
    """
    names = {
        "all": slice(None),
        "even": slice(0, None, 2),
        "odd": slice(1, None, 2),
        "first-half": slice(0, count // 2),
        "second-half": slice(count // 2, None),
    }
    if wanted in names:
        chosen = names[wanted]
    else:
        try:
            parts = [int(part) if part else None for part in wanted.split(":")]
            if not 2 <= len(parts) <= 3 or (len(parts) == 3 and parts[2] is not None and parts[2] < 1):
                raise ValueError
        except ValueError:
            raise ConfigError(f"--scans {wanted}: not a selection; use {', '.join(names)} or start:stop:step") from None
        chosen = slice(*parts)
    rows = np.arange(count, dtype=np.int64)[chosen]
    if len(rows) == 0:
        raise ConfigError(f"--scans {wanted}: selects none of the {count} scans")
    return rows
