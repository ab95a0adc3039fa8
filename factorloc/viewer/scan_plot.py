"""Scan plot: what a lidar saw, from above and at a slant, in the colours of its height."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt

from factorloc.errors import ConfigError, GeometryError
from factorloc.geometry import se2, se3
from factorloc.scan import Scan
from factorloc.viewer.map_canvas import Limits
from factorloc.viewer.slant import Slant
from factorloc.viewer.style import INK, OKABE_ITO, WIDTH, dress, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure

__all__ = ["View", "plot_scan"]

View = Literal["above", "oblique"]
"""From straight above, north up; or at a slant, without perspective."""

Array = npt.NDArray[np.float64]

_MARGIN = 0.02  # white space around the points, as a fraction of the longer side
_WIDE = 1.4  # views of areas longer than this times their width are stacked, others stand side by side
_MAX_HEIGHT = 9.0  # inch
_TAILS = (1.0, 99.0)  # percentiles of the heights at the ends of the colours
_RAY_COLOUR = "#56B4E9"


@dataclass(frozen=True)
class _Cloud:
    """Points (N, 3) and sensors (S, 3) in the world, m, and for planar scans their rays (R, 2, 2)."""

    points: Array
    sensors: Array
    rays: Array
    planar: bool


def plot_scan(
    scans: Scan | Sequence[Scan] | npt.ArrayLike,
    poses: npt.ArrayLike | None = None,
    *,
    views: Sequence[View] | None = None,
    limits: Limits | None = None,
    heights: tuple[float, float] | None = None,
    azimuth: float = np.deg2rad(-115.0),
    elevation: float = np.deg2rad(35.0),
    point_size: float = 0.3,
    colormap: str = "viridis",
) -> Figure:
    """Draw one or more scans, or a cloud of points.

    Points in front cover those behind. A white dot is the first sensor, a line its way from scan to scan. Planar scans
    have no height to tell: their points are drawn over their rays, whose blue is the free space that was seen.

    Parameters
    ----------
    scans : Scan, sequence of Scan, or array_like of shape (N, 2) or (N, 3)
        What to draw: the returns of scans, or points in the world, m. Scans that are cast when asked for are asked
        for once, one by one.
    poses : array_like, shape (3,) or (4, 4), or one a scan in front, optional
        Poses ``T_world_body`` of the scans, m and rad; one scan without a pose is drawn in the body frame.
    views : sequence of {"above", "oblique"}, optional
        From where to look; both by default, planar scans only from above.
    limits : (float, float, float, float), optional
        ``x_min, x_max, y_min, y_max`` of the area to draw, m; what is beyond is left out. All points by default.
    heights : (float, float), optional
        Heights at the ends of the colours, m; what is beyond is drawn in the last colour. By default the 1st and 99th
        percentile.
    azimuth, elevation : float
        Where the oblique view is taken from: counter-clockwise from the x axis, and above the horizon, rad.
    point_size : float
        Diameter of a point, pt.
    colormap : str
        Of the heights; ``"viridis"`` and ``"cividis"`` are told apart by everybody, and in grey.

    Returns
    -------
    Figure
        One view, or two with one scale of colours.

    Raises
    ------
    GeometryError
        If there is no point within the limits, a shape is wrong or a value not finite, planar scans are mixed with
        spatial ones, several scans have no poses, or limits or heights do not increase.
    ConfigError
        If a view or the colour map is unknown, the elevation not between 0 and pi/2, or the point size not positive.
    """
    from matplotlib import colormaps
    from matplotlib.colors import Normalize

    cloud = _cloud(scans, poses)
    chosen = tuple(views) if views is not None else ("above",) if cloud.planar else ("above", "oblique")
    if not chosen or len(set(chosen)) < len(chosen) or not set(chosen) <= {"above", "oblique"}:
        raise ConfigError(f"views: {chosen}; name 'above', 'oblique' or both, once each")
    if colormap not in colormaps:
        raise ConfigError(f"colormap: '{colormap}' is unknown to matplotlib; take 'viridis' or 'cividis'")
    if not 0 < point_size < np.inf:
        raise ConfigError(f"point_size: {point_size} pt; must be positive and finite")
    area = _area(cloud, limits)
    points = cloud.points[_within(area, cloud.points)]
    sensors = np.where(_within(area, cloud.sensors)[:, None], cloud.sensors, np.nan)  # the way is broken there
    if len(points) == 0:
        raise GeometryError(f"limits: no point lies within {tuple(area.tolist())}")
    z = points[:, 2]
    low, high = np.percentile(z, _TAILS) if heights is None else heights
    if heights is not None and not -np.inf < low < high < np.inf:
        raise GeometryError(f"heights: {heights} m; expected lowest < highest")
    colours = Normalize(low, high if high > low else low + 1.0, clip=True)
    slant = Slant(azimuth, elevation, (area[0], area[1], area[2], area[3]), float(low), float(z.max()))

    figure, axes = _canvas(chosen, area, slant)
    for view, canvas in zip(chosen, axes, strict=True):
        if view == "above":
            order = np.argsort(z, kind="stable")
            across, ways = points[:, :2], sensors[:, :2]
            canvas.set(aspect="equal", xlim=area[:2], ylim=area[2:])
            dress(canvas, "x (m)", "y (m)", frame=True)
            canvas.ticklabel_format(useOffset=False, style="plain")
            if cloud.planar:
                _draw_rays(canvas, cloud)
        else:
            order = np.argsort(-slant.depth(points), kind="stable")
            across, ways = slant.project(points), slant.project(sensors)
            slant.draw_floor(canvas)
        colour: dict[str, Any] = {"c": z[order], "cmap": colormap, "norm": colours}
        colour = {"color": OKABE_ITO[0]} if cloud.planar else colour
        right, up = across[order].T
        canvas.scatter(right, up, s=point_size**2, linewidths=0, rasterized=True, zorder=2, **colour)
        _draw_sensors(canvas, ways)
    if not cloud.planar:
        _colour_bar(figure, axes, colours, colormap, bool(z.min() < low), bool(z.max() > high))
    return figure


def _cloud(scans: Scan | Sequence[Scan] | npt.ArrayLike, poses: npt.ArrayLike | None) -> _Cloud:
    if isinstance(scans, Scan):
        return _placed([scans], 1, poses)
    if isinstance(scans, Sequence) and len(scans):
        each: Iterator[Any] = iter(scans)
        first = next(each)
        if isinstance(first, Scan):
            return _placed(itertools.chain([first], each), len(scans), poses)
    points = np.asarray(scans, np.float64)
    if points.ndim != 2 or points.shape[1] not in (2, 3) or not np.isfinite(points).all():
        raise GeometryError(f"scans: shape {points.shape}; expected scans, or finite points (N, 2) or (N, 3)")
    if poses is not None:
        raise GeometryError("poses: points have none; transform them into the world")
    return _Cloud(_raised(points), np.empty((0, 3)), np.empty((0, 2, 2)), points.shape[1] == 2)


def _placed(scans: Iterable[Scan], count: int, poses: npt.ArrayLike | None) -> _Cloud:
    """Scans in the world."""
    if poses is None and count > 1:
        raise GeometryError(f"poses: none given; {count} scans need one each")
    placed: list[tuple[Array, Array, Array]] = []
    planar, T_world_body = False, np.empty(0)
    for k, scan in enumerate(scans):
        if k == 0:
            planar = scan.dimension == 2
            group = se2 if planar else se3
            given = group.identity() if poses is None else group.as_poses(poses)
            T_world_body = given.reshape(-1, *group.identity().shape)
            if len(T_world_body) != count:
                raise GeometryError(f"poses: {len(T_world_body)} for {count} scans; give one a scan")
        if (scan.dimension == 2) != planar:
            raise GeometryError(f"scan {k}: has {scan.dimension} dimensions, scan 0 has not; draw them apart")
        group = se2 if planar else se3
        T_world_sensor = group.compose(T_world_body[k], scan.T_body_sensor)
        points = group.transform(T_world_sensor, scan.points())
        sensor = group.transform(T_world_sensor, np.zeros((1, scan.dimension)))
        rays = np.empty((0, 2, 2))
        if planar:
            ends = scan.origins + scan.directions * scan.ranges[:, None]
            rays = np.stack([group.transform(T_world_sensor, side) for side in (scan.origins, ends)], 1)
        placed.append((_raised(points), _raised(sensor), rays))
    points, sensors, rays = (np.concatenate(parts) for parts in zip(*placed, strict=True))
    return _Cloud(points, sensors, rays, planar)


def _raised(points: Array) -> Array:
    """Points of the plane in z = 0, those of space as they are."""
    return points if points.shape[1] == 3 else np.column_stack([points, np.zeros(len(points))])


def _area(cloud: _Cloud, limits: Limits | None) -> Array:
    if limits is not None:
        area = np.asarray(limits, np.float64)
        if area.shape != (4,) or not np.isfinite(area).all() or area[0] >= area[1] or area[2] >= area[3]:
            raise GeometryError(f"limits: {limits}; expected x_min < x_max, y_min < y_max in metres")
        return area
    if len(cloud.points) == 0:
        raise GeometryError("scans: without a return; nothing can be drawn")
    content = np.concatenate([cloud.points, cloud.sensors])[:, :2]
    low, high = content.min(0), content.max(0)
    margin = _MARGIN * max(float((high - low).max()), 1.0)
    return np.column_stack([low - margin, high + margin]).ravel()


def _within(area: Array, points: Array) -> npt.NDArray[np.bool_]:
    return np.asarray(((points[:, :2] >= area[::2]) & (points[:, :2] <= area[1::2])).all(1))


def _canvas(views: Sequence[str], area: Array, slant: Slant) -> tuple[Figure, list[Axes]]:
    """A figure as high as its views need, and their axes."""
    sizes = {"above": (area[1] - area[0], area[3] - area[2]), "oblique": slant.size}
    widths, tall = np.array([sizes[view] for view in views]).T
    if len(views) == 1 or sizes["above"][0] > _WIDE * sizes["above"][1]:
        height = float((WIDTH - 1.4) * (tall / widths).sum()) + 0.6 * len(views)
        figure = new_figure(WIDTH, min(_MAX_HEIGHT, height), equal_aspect=True)
        return figure, list(figure.subplots(len(views), 1, squeeze=False, height_ratios=tall / widths)[:, 0])
    height = float((WIDTH - 2.0) / (widths / tall).sum()) + 0.8
    figure = new_figure(WIDTH, min(_MAX_HEIGHT, height), equal_aspect=True)
    return figure, list(figure.subplots(1, len(views), squeeze=False, width_ratios=widths / tall)[0])


def _draw_rays(axes: Axes, cloud: _Cloud) -> None:
    from matplotlib.collections import LineCollection

    # The more scans overlap, the fainter each of them.
    alpha = max(0.02, 0.3 / np.sqrt(max(len(cloud.sensors), 1)))
    axes.add_collection(
        LineCollection(list(cloud.rays), colors=_RAY_COLOUR, linewidths=0.6, alpha=alpha, rasterized=True, zorder=1.5),
        autolim=False,
    )


def _draw_sensors(axes: Axes, ways: Array) -> None:
    if len(ways) > 1:
        axes.plot(*ways.T, color="white", linewidth=2.6, solid_capstyle="round", zorder=3, scalex=False, scaley=False)
        axes.plot(*ways.T, color=INK, linewidth=1.2, solid_capstyle="round", zorder=3, scalex=False, scaley=False)
    axes.scatter(ways[:1, 0], ways[:1, 1], s=26, facecolor="white", edgecolor=INK, linewidth=1.0, zorder=4)


def _colour_bar(figure: Figure, axes: list[Axes], colours: Normalize, colormap: str, below: bool, above: bool) -> None:
    from matplotlib.cm import ScalarMappable

    extend: Literal["both", "min", "max", "neither"] = (
        "both" if below and above else "min" if below else "max" if above else "neither"
    )
    mappable = ScalarMappable(colours, colormap)
    bar = figure.colorbar(mappable, ax=axes, shrink=0.6, aspect=30, pad=0.02, extend=extend, extendfrac=0.03)
    dress(bar.ax, ylabel="height (m)")
    bar.ax.grid(False)
    bar.outline.set_visible(False)
