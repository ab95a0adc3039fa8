"""Separators: sets known by what can be proven to lie inside of them and what outside."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from factorloc.errors import GeometryError
from factorloc.intervals.box import Box
from factorloc.intervals.contractor import AnyOf, Contractor, InSequence, Relaxed

__all__ = ["Separator", "relaxed_separator"]


@dataclass(frozen=True)
class Separator:
    """A set by two contractors: one for its points, one for those of its complement.

    ``a & b``, ``a | b`` and ``~a`` are intersection, union and complement. Points of the border may belong to both.

    Parameters
    ----------
    outer : Contractor
        Whose solutions are the set; what it takes away is outside.
    inner : Contractor
        Whose solutions are the complement; what it takes away is inside.
    """

    outer: Contractor
    inner: Contractor

    @property
    def constraint(self) -> str:
        """What the points of the set satisfy."""
        return self.outer.constraint

    def separate(self, box: Box) -> tuple[Box, Box]:
        """Take away what is outside, and what is inside.

        Parameters
        ----------
        box : Box
            Of any batch.

        Returns
        -------
        outer : Box
            With all points of the set.
        inner : Box
            With all points not in the set. No point of the box is outside both.
        """
        return self.outer.contract(box), self.inner.contract(box)

    def __invert__(self) -> Separator:
        return Separator(self.inner, self.outer)

    def __and__(self, other: Separator) -> Separator:
        return Separator(InSequence((self.outer, other.outer)), AnyOf((self.inner, other.inner)))

    def __or__(self, other: Separator) -> Separator:
        return Separator(AnyOf((self.outer, other.outer)), InSequence((self.inner, other.inner)))


def relaxed_separator(separators: Sequence[Separator], q: int) -> Separator:
    """Points in all but ``q`` of several sets; a point is in none such if it is outside of more than ``q``.

    Raises
    ------
    GeometryError
        If ``q`` is negative or not below the number of separators.
    """
    if not 0 <= q < len(separators):
        raise GeometryError(f"q: {q}; at least 0 and below the number of separators, {len(separators)}")
    outer, inner = (
        tuple(separator.outer for separator in separators),
        tuple(separator.inner for separator in separators),
    )
    return Separator(Relaxed(outer, q), Relaxed(inner, len(separators) - q - 1))
