"""Pole persistence: how likely each landmark still stands, learned from session to session."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from pydantic import Field

from factorloc.config import Block
from factorloc.mapping.pole_map import PoleMap

__all__ = ["PersistenceSettings", "persistence"]

Array = npt.NDArray[np.float64]

_MOST_VIEWS = 20  # local maps of one session are not independent: more of them say no more


class PersistenceSettings(Block):
    """What happens to poles between sessions, and how they are seen.

    Parameters
    ----------
    survival : float
        Probability of a pole to stand in the next session still.
    new : float
        Probability of what was found for the first time to be there the next time: a parked van is, a moment later,
        no landmark. A pole that was found in the first session of a map is as new as any.
    found : float
        Probability of a local map to find a pole that is there and in view.
    mistaken : float
        Probability of it to find one that is not.
    least : float
        No pole is trusted less.
    """

    survival: float = Field(0.98, gt=0, le=1)
    new: float = Field(0.8, gt=0, lt=1)
    found: float = Field(0.6, gt=0, lt=1)
    mistaken: float = Field(0.05, gt=0, lt=1)
    least: float = Field(0.01, gt=0, lt=1)


def persistence(pole_map: PoleMap, settings: PersistenceSettings | None = None) -> Array:
    """Filter the existence of every pole through the sessions of its map (Rosen, Mason and Leonard, ICRA 2016).

    Two states, there or gone for good: ``P`` falls by the survival from session to session, and

        odds <- odds (found / mistaken)^seen ((1 - found) / (1 - mistaken))^(in view - seen).

    Parameters
    ----------
    pole_map : PoleMap
        Counts by poles and sessions, in order.
    settings : PersistenceSettings, optional
        Probabilities.

    Returns
    -------
    ndarray, shape (L,)
        Probability of each pole to be there in the session after the last.
    """
    settings = settings or PersistenceSettings()
    in_view = np.minimum(pole_map.in_view, _MOST_VIEWS)
    rate = np.divide(pole_map.seen, pole_map.in_view, out=np.zeros(pole_map.seen.shape), where=pole_map.in_view > 0)
    seen = rate * in_view
    hit = np.log(settings.found / settings.mistaken)
    miss = np.log((1 - settings.found) / (1 - settings.mistaken))
    probability = np.full(len(pole_map), settings.new)
    born = np.zeros(len(pole_map), np.bool_)
    for session in range(len(pole_map.sessions)):
        now = seen[:, session] > 0
        # What made it a landmark is no evidence that it stays: counts speak from the next session on.
        old = born & (in_view[:, session] > 0)
        log_odds = np.log(probability) - np.log1p(-probability)
        log_odds += np.where(old, seen[:, session] * hit + (in_view - seen)[:, session] * miss, 0.0)
        probability = np.where(born, settings.survival / (1 + np.exp(-np.clip(log_odds, -50, 50))), probability)
        born |= now
        probability = np.clip(probability, settings.least, 1 - 1e-6)
    return np.asarray(probability)
