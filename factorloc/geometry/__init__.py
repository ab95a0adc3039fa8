"""SE(2) and SE(3) on plain arrays.

A pose ``T_a_b`` maps coordinates of frame ``b`` into frame ``a``; ``T_world_body`` is where the vehicle is. Planar
poses are rows ``[x, y, theta]`` (metres, radians); spatial poses are homogeneous 4 x 4 matrices. Every function takes
any number of leading batch dimensions, which broadcast. The tangent space is that of the *body*: a pose moves by
``T * exp(xi)``, with gtsam's order of coordinates: ``[x, y, theta]`` in the plane, ``[rotation, translation]`` in
space.
"""

from factorloc.geometry import se2, se3
from factorloc.geometry.angles import circular_mean, unwrap, wrap
from factorloc.geometry.group import PoseGroup, group_of, position_heading

__all__ = ["PoseGroup", "circular_mean", "group_of", "position_heading", "se2", "se3", "unwrap", "wrap"]
