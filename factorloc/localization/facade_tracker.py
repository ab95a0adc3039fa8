"""Facade tracker: one drive among facades, carried on scan by scan."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import numpy.typing as npt

from factorloc.localization.bounded_least_squares import estimate_in_bounds
from factorloc.localization.bounded_motion import propagate, widen
from factorloc.localization.correspondence import Correspondences
from factorloc.localization.correspondences import find_correspondences
from factorloc.localization.facade_hypotheses import Hypothesis, chosen, poses_of, weighed, without_twins
from factorloc.localization.facade_places import FacadePlaces
from factorloc.localization.facade_scan import FacadeStep, middle_of
from factorloc.localization.facade_settings import FacadeSettings
from factorloc.localization.feasible_layers import Layer, as_layers, hull_of_layers
from factorloc.localization.feasible_set import FeasibleSet, intersect_pieces
from factorloc.localization.start_pieces import split_layers
from factorloc.localization.wall_belief import WallBelief
from factorloc.localization.wall_lines import WallLines
from factorloc.mapping.facade_points import FacadePoints
from factorloc.result import Bounds

__all__ = ["FacadeTracker", "Finder"]

Array = npt.NDArray[np.float64]
Finder = Callable[[FacadePoints, WallLines, Bounds], Correspondences]


class FacadeTracker:
    """Where a body may be, and what is believed of it, from scan to scan.

    Parameters
    ----------
    walls : WallLines
        The map.
    start : Bounds
        Where the drive begins.
    guess : array_like, shape (3,), optional
        And where the search for the first pose does; the middle of the start by default.
    settings : FacadeSettings
        All settings.
    find : callable, optional
        Finds the correspondences of a scan with the map from a start; :func:`find_correspondences` by default.

    Attributes
    ----------
    known : Bounds
        Where the body may be, as it is reported.
    layers : tuple of Layer
        The same with all that is less probable, as it is carried along.
    hypotheses : list of Hypothesis
        Beliefs of the pose.
    """

    def __init__(
        self,
        walls: WallLines,
        start: Bounds,
        guess: npt.ArrayLike | None,
        settings: FacadeSettings,
        find: Finder | None = None,
    ) -> None:
        self.walls, self.settings = walls, settings
        self.find = find or partial(find_correspondences, settings=settings.correspondences)
        self.known, self.layers = start, as_layers(start)
        self.places = FacadePlaces(walls, settings.places, settings.least_squares)
        self.margin, self.scans, self.contradictions = (0.0, 0.0), 0, 0
        begin = middle_of(start) if guess is None else np.asarray(guess, np.float64)
        self.hypotheses = [Hypothesis(WallBelief.within_bounds(start, begin), 0.0)]

    @property
    def belief(self) -> WallBelief:
        """The one that most speaks for."""
        return chosen(self.hypotheses).belief

    def move(self, motion: Array, errors: Array) -> None:
        """Carry everything along by a motion ``T_before_after`` with bounded errors (m and rad)."""
        settings = self.settings
        spare = settings.forgetting_position, settings.forgetting_heading
        self.margin = settings.margin_position, settings.margin_heading
        self.known = propagate(self.known, motion, errors)
        self.layers = _changed(self.layers, partial(propagate, motion=motion, errors=errors, spare=spare))
        self.hypotheses = [
            replace(one, belief=one.belief.moved(motion, settings.motion_sigma * errors)) for one in self.hypotheses
        ]

    def localize(self, points: FacadePoints) -> FacadeStep:
        """Intersect with what a scan leaves, and find the most likely pose.

        Parameters
        ----------
        points : FacadePoints
            The scan.
        """
        settings = self.settings
        parts = split_layers(self.layers, settings.piece_position, settings.piece_heading, settings.most_pieces)
        around = [widen(hull_of_layers(part), *self.margin) for part in parts]
        asked = [self.find(points, self.walls, one) for one in around]
        if not asked:
            asked, parts = [Correspondences.none(len(points))], [self.layers]
        pieces = [(one.found, part) for one, part in zip(asked, parts, strict=True)]
        if any(one.found for one in asked):
            feasible = intersect_pieces(pieces, self.walls, settings.feasible)
        else:
            feasible = FeasibleSet(self.known, self.layers, (), 0)
        if not feasible.violated and self._contradicts(points, feasible.bounds):
            feasible = replace(feasible, bounds=replace(feasible.bounds, polygons=()), layers=())
        if feasible.violated:
            self.layers = _changed(
                self.layers, partial(widen, position=settings.recovery_position, heading=settings.recovery_heading)
            )
            self.known = hull_of_layers(self.layers)
            step = FacadeStep(asked[feasible.piece], feasible, None, None)
        else:
            self.layers, self.known = feasible.layers, feasible.bounds
            step = self._estimate(points, asked, parts, feasible)
        self._stay()
        return step

    def _contradicts(self, points: FacadePoints, bounds: Bounds) -> bool:
        """Whether a set leaves out what all scans before spoke for, and no place of it fits this one far better.

        Houses of a row look alike: now and then most lines of one scan are those of the next house. Sets that go on to
        contradict are right.
        """
        settings = self.settings.hypotheses
        belief = self.belief
        sigmas = belief.sigmas_to(bounds.nearest(belief.pose))
        self.contradictions = self.contradictions + 1 if sigmas > settings.contradicted else 0
        if not 0 < self.contradictions <= settings.most_contradictions or self.scans < settings.settled:
            return False
        fit = self.places.scores(points, poses_of(belief, settings.around)).max()
        place = self.places.best(points, bounds, 1)
        return bool(self.places.scores(points, place)[0] <= fit + settings.doubtful)

    def _estimate(
        self,
        points: FacadePoints,
        asked: Sequence[Correspondences],
        parts: Sequence[tuple[Layer, ...]],
        feasible: FeasibleSet,
    ) -> FacadeStep:
        def update(one: Hypothesis) -> Hypothesis:
            found = _around(asked, parts, one.belief.pose, feasible.piece)
            return self._updated(one, points, found, feasible)

        updated = [update(one) for one in self.hypotheses]
        updated += [update(one) for one in self._elsewhere(points, updated, feasible)]
        self.scans += 1
        self.hypotheses = without_twins(weighed(updated, self.settings.hypotheses), self.settings.hypotheses)
        first = self.hypotheses[0]
        assert first.prior is not None
        begin = first.prior.pose
        correspondences = _around(asked, parts, begin, feasible.piece)
        return FacadeStep(correspondences, feasible, first.estimate, begin, first.prior)

    def _elsewhere(
        self, points: FacadePoints, updated: Sequence[Hypothesis], feasible: FeasibleSet
    ) -> list[Hypothesis]:
        """Hypotheses that begin at other places of a feasible set: at first the best, later one that fits far better.

        Parameters
        ----------
        points : FacadePoints
            The scan.
        updated : sequence of Hypothesis
            Those there are, after it.
        feasible : FeasibleSet
            What it leaves.
        """
        settings = self.settings.hypotheses
        if self.scans == 0:
            places = self.places.best(points, feasible.bounds, settings.most)
            return [Hypothesis.at_place(place, 0.0, settings) for place in places]
        believed = max(range(len(updated)), key=lambda k: updated[k].score)
        place = self.places.best(points, feasible.bounds, 1)
        if self.places.scores(points, place)[0] <= updated[believed].fit + settings.doubtful:
            return []
        handicap = settings.handicap * min(self.scans / settings.settled, 1.0)
        return [Hypothesis.at_place(place[0], updated[believed].score - handicap, settings)]

    def _updated(
        self, one: Hypothesis, points: FacadePoints, correspondences: Correspondences, feasible: FeasibleSet
    ) -> Hypothesis:
        """A hypothesis after a scan, with its fit."""
        settings = self.settings
        estimate = estimate_in_bounds(
            points, correspondences, self.walls, one.belief.pose, feasible.bounds,
            conflicts=feasible.conflicts, prior=one.belief, settings=settings.least_squares,
        )  # fmt: skip
        fit = self.places.scores(points, poses_of(estimate.belief, settings.hypotheses.around)).max()
        return Hypothesis(estimate.belief, one.score, one.belief, estimate, float(fit))

    def _stay(self) -> None:
        """Hold beliefs within what is possible, and forget walls that are far."""
        for k, one in enumerate(self.hypotheses):
            pose = self.known.nearest(one.belief.pose)
            near = self.walls.facades.within(pose[:2], self.settings.remembered)
            belief = one.belief.at(pose).limited_to(self.walls.facades.buildings[near], near)
            self.hypotheses[k] = replace(one, belief=belief)


def _changed(layers: Sequence[Layer], change: partial[Bounds]) -> tuple[Layer, ...]:
    return tuple(Layer(layer.cost, tuple(change(one) for one in layer.slices)) for layer in layers)


def _around(
    asked: Sequence[Correspondences], parts: Sequence[tuple[Layer, ...]], pose: Array, otherwise: int
) -> Correspondences:
    """Correspondences of the piece that holds a pose."""
    for one, part in zip(asked, parts, strict=True):
        if any(slice_.contains(pose) for layer in part for slice_ in layer.slices):
            return one
    return asked[otherwise]
