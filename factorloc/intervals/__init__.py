"""Guaranteed bounds: intervals, boxes and the contractors that shrink them.

Nothing here knows of gtsam or of lidar maps. What is computed from intervals encloses all results of the numbers
inside: bounds are rounded outwards, in every operation and without a change of the processor's rounding mode.
"""

from factorloc.intervals.box import Box
from factorloc.intervals.constraints import (
    Cosine,
    Distance,
    Heading,
    Line,
    Linear,
    OnAxes,
    Polar,
    Product,
    RigidMotion,
    SegmentHull,
    Sine,
    Square,
    Sum,
)
from factorloc.intervals.contractor import AnyOf, Contractor, Fixpoint, InSequence, Relaxed, relaxed_intersection
from factorloc.intervals.convex_polygon import ConvexPolygon, Strips, lines_met, union
from factorloc.intervals.elementary import (
    acos,
    atan2,
    cos,
    cos_sin,
    hypot,
    maximum,
    minimum,
    move,
    pi,
    rotate,
    sector,
    sin,
    sqrt,
    square,
)
from factorloc.intervals.hough import HoughAccumulator, HoughPeak
from factorloc.intervals.interval import Interval, IntervalLike
from factorloc.intervals.paving import Paving, pave
from factorloc.intervals.regions import Ring, annulus, disk, half_plane, polygon, segment
from factorloc.intervals.separator import Separator, relaxed_separator

__all__ = [
    "AnyOf", "Box", "Contractor", "ConvexPolygon", "Cosine", "Distance", "Fixpoint", "Heading", "HoughAccumulator",
    "HoughPeak", "InSequence",
    "Interval", "IntervalLike", "Line", "Linear", "OnAxes", "Paving", "Polar", "Product", "Relaxed", "RigidMotion",
    "Ring", "SegmentHull", "Separator", "Sine", "Square", "Strips", "Sum", "acos", "annulus", "atan2", "cos",
    "cos_sin", "disk", "half_plane", "hypot", "lines_met", "maximum", "minimum", "move", "pave", "pi", "polygon",
    "relaxed_intersection", "relaxed_separator", "rotate", "sector", "segment", "sin", "sqrt", "square", "union",
]  # fmt: skip
