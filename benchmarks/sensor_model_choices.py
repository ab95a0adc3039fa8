"""The models that are compared, and what is chosen for them on training scans."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from concurrent.futures import Executor
from functools import partial
from typing import Any

import numpy as np
from pydantic import Field

from benchmarks.left_out import Statistics, leave_one_out
from benchmarks.sensor_model_scenes import Scene, evenly, thinned
from factorloc.config import Block
from factorloc.mapping.beta_prior import BetaPrior, CellwiseBetaPrior, estimate_beta_prior
from factorloc.mapping.decay_rate import DecayRateMap, DecayRatePosterior
from factorloc.mapping.distance_transform import DistanceField
from factorloc.mapping.end_point import EndPointModel
from factorloc.mapping.noisy_decay_rate import NoisyDecayRateMap
from factorloc.mapping.normalized_end_point import NormalizedEndPointModel
from factorloc.mapping.out_of_range import OutOfRangePrior
from factorloc.mapping.prior import CellwiseGammaPrior, GammaPrior, estimate_prior
from factorloc.mapping.reflection import ReflectionMap, ReflectionPosterior
from factorloc.mapping.sensor_model import SensorModel

__all__ = [
    "BARE", "END_POINT", "FIELD", "FILLED", "FILLED_FMP", "FMP", "LEFT_OUT", "MLM", "MODELS", "NOISY", "PUBLISHED",
    "TYPES", "Choices", "TrainingGrid", "choose", "make_model",
]  # fmt: skip

TYPES = ("REF", "DEC")
"""Reflection and decay-rate model."""
MLM, FMP, BARE = "MLM", "FMP", "MLM without floor"
FILLED, FILLED_FMP = "MLM, best in unseen space", "FMP, best in unseen space"
PUBLISHED, LEFT_OUT = "FMP, published prior", "FMP, leave-one-out prior"
END_POINT, NOISY, FIELD = "end point, normalized", "noisy decay rate", "end point"
MODELS = (
    *(f"{kind} {form}" for kind in TYPES for form in (BARE, MLM, FILLED, FMP, FILLED_FMP, PUBLISHED, LEFT_OUT)),
    END_POINT,
    NOISY,
    FIELD,
)
"""Names of all models; the last one is no probability and only weighs particles."""

_FARTHEST = 20  # cells a distance field reaches


class TrainingGrid(Block):
    """What is chosen from.

    Parameters
    ----------
    decay_floors : tuple of float
        1/m.
    reflection_floors : tuple of float
        Probabilities.
    unseen_rates, unseen_reflections : tuple of float
        Rates (1/m) and probabilities of unseen space, where all maps have the prior of the cells by default.
    end_point_sigmas : tuple of float
        Standard deviations of an end's distance, in cells.
    noise_sigmas, false_rates : tuple of float
        Of the noisy model, m and shares.
    """

    decay_floors: tuple[float, ...] = Field(min_length=1)
    reflection_floors: tuple[float, ...] = Field(min_length=1)
    unseen_rates: tuple[float, ...] = Field(min_length=1)
    unseen_reflections: tuple[float, ...] = Field(min_length=1)
    end_point_sigmas: tuple[float, ...] = Field(min_length=1)
    noise_sigmas: tuple[float, ...] = Field(min_length=1)
    false_rates: tuple[float, ...] = Field(min_length=1)


class Choices(Block):
    """What was chosen: of all rays of training scans, each in the map of the others, the most likely.

    Parameters
    ----------
    decay_floor, reflection_floor : float
        1/m, and a probability.
    unseen_rate, unseen_reflection, posterior_unseen_rate, posterior_unseen_reflection : float
        Of MLM with these floors, and of FMP, 1/m and probabilities.
    end_point_sigma : float
        m.
    noise_sigma, false_rate : float
        m, and a share.
    scores : dict of str to dict of str to float
        Nats per ray of all that could be chosen.
    """

    decay_floor: float
    reflection_floor: float
    unseen_rate: float
    unseen_reflection: float
    posterior_unseen_rate: float
    posterior_unseen_reflection: float
    end_point_sigma: float
    noise_sigma: float
    false_rate: float
    scores: dict[str, dict[str, float]]


def choose(scene: Scene, grid: TrainingGrid, scans: int, rays: int, pool: Executor) -> Choices:
    """Choose on evenly spread training scans.

    Priors are those of the whole map: what one scan of hundreds adds to them is left in, for every choice alike.

    Parameters
    ----------
    scene : Scene
    grid : TrainingGrid
    scans : int
        How many scans at most.
    rays : int
        Rays of a spatial scan at most.
    pool : Executor
    """
    gamma, beta = estimate_prior(scene.statistics), estimate_beta_prior(scene.statistics)
    resolution, shares = scene.statistics.grid.resolution, OutOfRangePrior.from_scans(scene.training)
    sigmas = [resolution * cells for cells in grid.end_point_sigmas]

    def decays(map_: Statistics) -> Iterator[tuple[Any, SensorModel]]:
        return ((floor, DecayRateMap(map_, gamma, floor)) for floor in grid.decay_floors)

    def reflections(map_: Statistics) -> Iterator[tuple[Any, SensorModel]]:
        return ((floor, ReflectionMap(map_, beta, floor)) for floor in grid.reflection_floors)

    def ends(map_: Statistics) -> Iterator[tuple[Any, SensorModel]]:
        field = DistanceField.from_statistics(map_, _FARTHEST * resolution)
        return ((sigma, NormalizedEndPointModel(_end_points(field, sigma, shares))) for sigma in sigmas)

    def noisy(map_: Statistics) -> Iterator[tuple[Any, SensorModel]]:
        posterior = DecayRatePosterior(map_, gamma)
        return (
            ((sigma, rate), NoisyDecayRateMap.from_posterior(posterior, sigma, rate))
            for sigma in grid.noise_sigmas
            for rate in grid.false_rates
        )

    rows = evenly(len(scene.training), scans)
    some = partial(
        leave_one_out, scene.statistics, [scene.training[row] for row in rows], scene.training_poses[rows], pool=pool,
        margin=_FARTHEST * resolution, weighed=partial(thinned, most=rays),
    )  # fmt: skip
    scores: dict[str, dict[Any, float]] = some({"DEC": decays, "REF": reflections, END_POINT: ends, NOISY: noisy})
    best = _best(scores)

    def filled_decays(map_: Statistics) -> Iterator[tuple[Any, SensorModel]]:
        return ((rate, DecayRateMap(map_, _rate(rate), best["DEC"])) for rate in (gamma.mean, *grid.unseen_rates))

    def filled_reflections(map_: Statistics) -> Iterator[tuple[Any, SensorModel]]:
        shares = (beta.mean, *grid.unseen_reflections)
        return ((share, ReflectionMap(map_, _share(share), best["REF"])) for share in shares)

    def posterior_decays(map_: Statistics) -> Iterator[tuple[Any, SensorModel]]:
        rates = (gamma.mean, *grid.unseen_rates)
        return ((rate, DecayRatePosterior(map_, _gamma_elsewhere(map_, gamma, rate))) for rate in rates)

    def posterior_reflections(map_: Statistics) -> Iterator[tuple[Any, SensorModel]]:
        shares = (beta.mean, *grid.unseen_reflections)
        return ((share, ReflectionPosterior(map_, _beta_elsewhere(map_, beta, share))) for share in shares)

    names = [f"{kind} {form}" for form in (FILLED, FILLED_FMP) for kind in TYPES]
    families = (filled_reflections, filled_decays, posterior_reflections, posterior_decays)
    scores |= some(dict(zip(names, families, strict=True)))
    best = _best(scores)
    return Choices(
        decay_floor=best["DEC"],
        reflection_floor=best["REF"],
        unseen_rate=best[names[1]],
        unseen_reflection=best[names[0]],
        posterior_unseen_rate=best[names[3]],
        posterior_unseen_reflection=best[names[2]],
        end_point_sigma=best[END_POINT],
        noise_sigma=best[NOISY][0],
        false_rate=best[NOISY][1],
        scores={name: {str(choice): value for choice, value in of.items()} for name, of in scores.items()},
    )


def _best(scores: Mapping[str, Mapping[Any, float]]) -> dict[str, Any]:
    return {name: max(of, key=lambda choice: of[choice]) for name, of in scores.items()}


def _rate(mean: float) -> GammaPrior:
    """A prior of which maximum likelihood heeds but the mean."""
    return GammaPrior(1.0, 1.0 / mean)


def _share(mean: float) -> BetaPrior:
    return BetaPrior(mean, 1.0 - mean)


def _gamma_elsewhere(map_: Statistics, prior: GammaPrior, mean: float) -> CellwiseGammaPrior:
    """The prior where rays have been, and one of the same shape and another mean where none has."""
    crossed, path = map_.path_fixed > 0, prior.shape / mean
    return CellwiseGammaPrior(
        prior.shape, path, np.full(crossed.shape, prior.shape), np.where(crossed, prior.path, path)
    )


def _beta_elsewhere(map_: Statistics, prior: BetaPrior, mean: float) -> CellwiseBetaPrior:
    visited = (map_.hits > 0) | (map_.misses > 0)
    hits, misses = mean * (prior.hits + prior.misses), (1 - mean) * (prior.hits + prior.misses)
    return CellwiseBetaPrior(hits, misses, np.where(visited, prior.hits, hits), np.where(visited, prior.misses, misses))


def make_model(name: str, scene: Scene, choices: Choices) -> SensorModel:
    """Make one of the :data:`MODELS` of a scene's map."""
    map_ = scene.statistics
    rule: Any = {PUBLISHED: "published", LEFT_OUT: "leave-one-out"}.get(name[4:], "marginal")
    if name in (END_POINT, FIELD):
        field = DistanceField.from_statistics(map_, _FARTHEST * map_.grid.resolution)
        scores = _end_points(field, choices.end_point_sigma, OutOfRangePrior.from_scans(scene.training))
        return scores if name == FIELD else NormalizedEndPointModel(scores)
    form = name[4:]
    if name.startswith("REF"):
        beta = _share(choices.unseen_reflection) if form == FILLED else estimate_beta_prior(map_, rule)
        floor = choices.reflection_floor if form in (MLM, FILLED) else 0.0
        if form == FILLED_FMP:
            beta = _beta_elsewhere(map_, beta, choices.posterior_unseen_reflection)
        return ReflectionMap(map_, beta, floor) if MLM in form else ReflectionPosterior(map_, beta)
    gamma = _rate(choices.unseen_rate) if form == FILLED else estimate_prior(map_, rule)
    if name == NOISY:
        return NoisyDecayRateMap.from_posterior(
            DecayRatePosterior(map_, gamma), choices.noise_sigma, choices.false_rate
        )
    if form == FILLED_FMP:
        gamma = _gamma_elsewhere(map_, gamma, choices.posterior_unseen_rate)
    floor = choices.decay_floor if form in (MLM, FILLED) else 0.0
    return DecayRateMap(map_, gamma, floor) if MLM in form else DecayRatePosterior(map_, gamma)


def _end_points(field: DistanceField, sigma: float, shares: OutOfRangePrior) -> EndPointModel:
    return EndPointModel(field, sigma, out_of_range=shares)
