"""Contractors: what every constraint can do to boxes, and how contractors are combined."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from factorloc.errors import GeometryError
from factorloc.intervals._sweep_kernels import relax
from factorloc.intervals.box import Box
from factorloc.intervals.interval import Interval

__all__ = ["AnyOf", "Contractor", "Fixpoint", "InSequence", "Relaxed", "relaxed_intersection"]


@runtime_checkable
class Contractor(Protocol):
    """Shrinks boxes without losing a solution of its constraint.

    Attributes
    ----------
    constraint : str
        The constraint on the variables, which are the sides of the box in order.
    minimal : bool
        Whether the result is the smallest box around the solutions inside, up to outward rounding.
    """

    @property
    def constraint(self) -> str: ...  # noqa: D102

    @property
    def minimal(self) -> bool: ...  # noqa: D102

    def contract(self, box: Box) -> Box:
        """Return boxes inside the given ones that hold all their solutions; empty where there is none."""
        ...


def _all_constraints(contractors: Sequence[Contractor], word: str) -> str:
    if not contractors:
        raise GeometryError("contractors: none given; name at least one")
    return f" {word} ".join(contractor.constraint for contractor in contractors)


@dataclass(frozen=True)
class InSequence:
    """Solutions of all of several constraints: one contractor after the other.

    Parameters
    ----------
    contractors : tuple of Contractor
        At least one.
    """

    contractors: tuple[Contractor, ...]

    @property
    def constraint(self) -> str:
        """All constraints."""
        return _all_constraints(self.contractors, "and")

    @property
    def minimal(self) -> bool:
        """Only for a single one; what two leave need not share a solution."""
        return len(self.contractors) == 1 and self.contractors[0].minimal

    def contract(self, box: Box) -> Box:
        """Shrink boxes."""
        for contractor in self.contractors:
            box = contractor.contract(box)
        return box


@dataclass(frozen=True)
class AnyOf:
    """Solutions of at least one of several constraints: the hull of what each leaves.

    Parameters
    ----------
    contractors : tuple of Contractor
        At least one.
    """

    contractors: tuple[Contractor, ...]

    @property
    def constraint(self) -> str:
        """All constraints."""
        return _all_constraints(self.contractors, "or")

    @property
    def minimal(self) -> bool:
        """If all are: the hull of a union is the hull of the hulls."""
        return all(contractor.minimal for contractor in self.contractors)

    def contract(self, box: Box) -> Box:
        """Shrink boxes."""
        first, *others = (contractor.contract(box) for contractor in self.contractors)
        for other in others:
            first = first | other
        return first


@dataclass(frozen=True)
class Relaxed:
    """Solutions of all but ``q`` of several constraints, whichever they are.

    Parameters
    ----------
    contractors : tuple of Contractor
        More than ``q``.
    q : int
        Number of constraints that may fail.

    Raises
    ------
    GeometryError
        If ``q`` is negative or not below the number of contractors.
    """

    contractors: tuple[Contractor, ...]
    q: int

    def __post_init__(self) -> None:
        if not 0 <= self.q < len(self.contractors):
            raise GeometryError(f"q: {self.q}; at least 0 and below the number of contractors, {len(self.contractors)}")

    @property
    def constraint(self) -> str:
        """All constraints, and how many may fail."""
        return f"all but {self.q} of: {_all_constraints(self.contractors, '; ')}"

    @property
    def minimal(self) -> bool:
        """Never claimed: on several axes, sides are relaxed each on its own."""
        return False

    def contract(self, box: Box) -> Box:
        """Shrink boxes."""
        return relaxed_intersection([contractor.contract(box) for contractor in self.contractors], self.q)


def relaxed_intersection(boxes: Sequence[Box], q: int) -> Box:
    """Hull of the points in all but ``q`` of some boxes.

    Exact in one dimension (Marzullo's sweep over sorted bounds). On several axes it is an outer bound: each side is the
    exact hull for its own axis, but different boxes may fail on different axes.

    Parameters
    ----------
    boxes : sequence of Box
        Of one shape; an empty box fails everywhere.
    q : int
        Number of boxes that may fail.

    Raises
    ------
    GeometryError
        If ``q`` is negative or not below the number of boxes.
    """
    if not 0 <= q < len(boxes):
        raise GeometryError(f"q: {q}; at least 0 and below the number of boxes, {len(boxes)}")
    shape = boxes[0].bounds.shape
    lo, hi = (np.stack([bound.ravel() for bound in bounds]) for bounds in (
        [box.lo for box in boxes], [box.hi for box in boxes]))  # fmt: skip
    out = np.empty(lo.shape[1]), np.empty(lo.shape[1])
    relax(lo, hi, len(boxes) - q, np.empty(len(boxes)), np.empty(len(boxes)), *out)
    return Box(Interval.from_bounds(out[0].reshape(shape), out[1].reshape(shape)))


@dataclass(frozen=True)
class Fixpoint:
    """A contractor repeated until it takes little away.

    Parameters
    ----------
    contractor : Contractor
        Repeated.
    ratio : float
        Boxes none of whose bounded sides shrank below this ratio of its length are done.
    rounds : int
        Most repetitions: some contractors converge slowly.

    Raises
    ------
    GeometryError
        If the ratio is not in (0, 1), or there is no round.
    """

    contractor: Contractor
    ratio: float = 0.99
    rounds: int = 100

    def __post_init__(self) -> None:
        if not (0 < self.ratio < 1 and self.rounds >= 1):
            raise GeometryError(f"fixpoint: ratio {self.ratio}, rounds {self.rounds}; 0 < ratio < 1, rounds >= 1")

    @property
    def constraint(self) -> str:
        """As that of the contractor."""
        return self.contractor.constraint

    @property
    def minimal(self) -> bool:
        """As the contractor."""
        return self.contractor.minimal

    def contract(self, box: Box) -> Box:
        """Shrink boxes; those of a batch that are done are left alone."""
        flat = box.flat()
        lo, hi = flat.lo.copy(), flat.hi.copy()
        active = np.flatnonzero(~flat.is_empty)
        for _ in range(self.rounds):
            if not active.size:
                break
            before = flat.select(active)
            after = self.contractor.contract(before)
            lo[:, active], hi[:, active] = after.lo, after.hi
            flat = Box(Interval.from_bounds(lo, hi))
            shrunk = (after.width < self.ratio * before.width).any(0)
            active = active[shrunk & ~after.is_empty]
        return Box(Interval.from_bounds(lo.reshape(box.bounds.shape), hi.reshape(box.bounds.shape)))
