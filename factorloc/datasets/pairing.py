"""Pair the scans of a raw log with those of the corrected log made from it.

Times do not serve: they are rounded, repeat and run backwards. The range arrays do, in file order.
"""

from __future__ import annotations

import warnings
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from factorloc.datasets.drive import Drive
from factorloc.errors import DataError, FactorlocWarning
from factorloc.scan import Scan
from factorloc.trajectory import Trajectory

__all__ = ["match_scans", "pair_raw_with_corrected"]

Array = npt.NDArray[np.float64]

_MOST_DIGITS = 16


def match_scans(raw: Sequence[Scan], corrected: Sequence[Scan], *, allow_missing: int = 0) -> npt.NDArray[np.int64]:
    """Find each corrected scan among the raw ones by its ranges, rounded to the digits that were printed.

    Both sequences keep their order, so the match must be increasing. It is unique where matching from the front and
    matching from the back agree.

    Parameters
    ----------
    raw, corrected : sequence of Scan
        N and M scans in file order.
    allow_missing : int
        How many corrected scans need not be found.

    Returns
    -------
    ndarray of int64, shape (M,)
        Index among the raw scans, or -1 where there is none.

    Raises
    ------
    DataError
        If too many scans are missing, their order differs, or a match is not unique.
    """
    if len({len(scan) for scan in (*raw, *corrected)}) > 1:
        raise DataError("raw and corrected scans have different beam counts; they are not of one log")
    raw_keys, corrected_keys = _keys(raw, corrected)
    places: dict[bytes, list[int]] = defaultdict(list)
    for place, key in enumerate(raw_keys):
        places[key].append(place)
    missing = [k for k, key in enumerate(corrected_keys) if key not in places]
    if len(missing) > allow_missing:
        raise DataError(
            f"{len(missing)} of {len(corrected)} corrected scans are not among the {len(raw)} raw ones "
            f"(first: scan {missing[0]}); are the two of one log?"
        )
    candidates = [places.get(key, []) for key in corrected_keys]
    front = _increasing(candidates)
    mirrored = [[-place for place in reversed(of)] for of in reversed(candidates)]
    back = [None if place is None else -place for place in reversed(_increasing(mirrored))]
    unsure = [k for k, (one, other) in enumerate(zip(front, back, strict=True)) if one != other]
    if unsure:
        raise DataError(
            f"corrected scan {unsure[0]} equals several raw ones ({len(unsure)} such scans); order does not tell"
        )
    return np.array([-1 if place is None else place for place in front], np.int64)


def pair_raw_with_corrected(raw: Drive, corrected: Drive, *, allow_missing: int = 0) -> Drive:
    """Join the truth of a corrected log with the odometry of the raw log it was made from.

    Parameters
    ----------
    raw : Drive
        Read from the raw log: odometry, no truth.
    corrected : Drive
        Read from the corrected log: truth.
    allow_missing : int
        How many corrected scans need not be found; they are left out, with a warning that counts them.

    Returns
    -------
    Drive
        Scans and truth of the corrected log, with odometry (composed across the raw scans in between), stamps and keys
        of the raw one.

    Raises
    ------
    DataError
        If the drives are not a raw and a corrected one, or do not pair completely and uniquely.

    Warns
    -----
    FactorlocWarning
        If corrected scans were left out.
    """
    if raw.truth is not None:
        raise DataError(f"{raw.name}: was read as a corrected log; the first of the pair must be raw")
    if corrected.truth is None:
        raise DataError(f"{corrected.name}: was read as a raw log; the second of the pair must be corrected")
    try:
        rows = match_scans(raw.scans, corrected.scans, allow_missing=allow_missing)
    except DataError as error:
        raise DataError(f"{raw.name}: {error}") from None
    found = rows >= 0
    if not found.all():
        left_out = f"{(~found).sum()} of {len(found)} corrected scans are not in the raw log; left out"
        warnings.warn(f"{raw.name}: {left_out}", FactorlocWarning, stacklevel=2)
    driven, reference = raw.select(rows[found]), corrected.select(found)
    assert reference.truth is not None
    stamped = zip(reference.scans, driven.stamps, strict=True)
    return replace(
        driven,
        name=corrected.name,
        scans=tuple(replace(scan, stamp=float(stamp)) for scan, stamp in stamped),
        truth=Trajectory(driven.stamps, reference.truth.poses),
        reports=(*raw.reports, *corrected.reports),
    )


def _increasing(candidates: Sequence[Sequence[int]]) -> list[int | None]:
    """Take the first increasing match; None where there is no candidate."""
    result: list[int | None] = []
    last: float = -np.inf
    for k, places in enumerate(candidates):
        later = [place for place in places if place > last]
        if places and not later:
            raise DataError(f"corrected scan {k} stands in another order than the raw one; file order must be kept")
        result.append(later[0] if later else None)
        last = later[0] if later else last
    return result


def _keys(raw: Sequence[Scan], corrected: Sequence[Scan]) -> tuple[list[bytes], list[bytes]]:
    """Range arrays as bytes, at the limits both logs share and the digits the corrected one prints."""
    low = max(scans[0].range_limits[0] for scans in (raw, corrected))
    high = min(scans[0].range_limits[1] for scans in (raw, corrected))
    fine, printed = (np.array([scan.ranges for scan in scans]).clip(low, high) for scans in (raw, corrected))
    measured = printed[(printed > low) & (printed < high)]
    digits = range(_MOST_DIGITS)
    decimals = next((d for d in digits if np.allclose(np.round(measured, d), measured, 0, 1e-10)), _MOST_DIGITS)
    significant = next(
        (s for s in digits if np.allclose(_round(measured, _places(measured, s)), measured, 1e-12, 0)), _MOST_DIGITS
    )
    keys = []
    for table in (fine, printed):
        rounded = _round(table, np.minimum(_places(table, significant), decimals), exact=True)
        keys.append([row.tobytes() for row in np.rint(rounded * 10.0**decimals).astype(np.int64)])
    return keys[0], keys[1]


def _places(values: Array, significant: int) -> Array:
    """Decimal places at which values have so many significant digits."""
    return np.asarray(significant - 1 - np.floor(np.log10(np.where(values > 0, values, 1.0))))


def _round(values: Array, places: Array, *, exact: bool = False) -> Array:
    """Round to decimal places; exactly as printing does if asked for."""
    scaled = values * 10.0**places
    result = np.rint(scaled) / 10.0**places
    if exact:
        # Printing rounds the binary number itself, which lies beside the tie that its multiple seems to be.
        ties = np.abs(scaled - np.floor(scaled) - 0.5) < 1e-6
        result[ties] = [
            round(value, int(place)) for value, place in zip(values[ties].tolist(), places[ties], strict=True)
        ]
    return np.asarray(result)
