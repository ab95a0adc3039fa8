import numpy as np
import pytest

from factorloc.errors import GeometryError
from factorloc.viewer import plot_error_coloured_path, plot_map_and_trajectories
from factorloc.viewer.style import INK, OKABE_ITO, line_style


def lines_of(figure):
    return {line.get_label(): line for line in figure.axes[0].lines}


def test_every_trajectory_is_drawn_and_named(room, path):
    figure = plot_map_and_trajectories(*room, {"truth": path(), "a": path(1), "b": path(2)}, reference="truth")
    lines = lines_of(figure)
    for name, shift in {"truth": 0, "a": 1, "b": 2}.items():
        np.testing.assert_array_equal(lines[name].get_xydata(), path(shift).positions)
    assert [text.get_text() for text in figure.axes[0].get_legend().get_texts()] == ["truth", "a", "b", "start"]
    assert [lines[name].get_color() for name in lines] == [INK, *OKABE_ITO[:2]]
    assert lines["truth"].zorder < lines["b"].zorder < lines["a"].zorder
    assert lines["a"].get_linewidth() < lines["b"].get_linewidth() < lines["truth"].get_linewidth()
    assert (figure.axes[0].get_xlabel(), figure.axes[0].get_ylabel()) == ("x (m)", "y (m)")


def test_many_trajectories_stay_distinct(path):
    lines = lines_of(plot_map_and_trajectories(None, None, {str(k): path(k) for k in range(18)}))
    assert len({(line.get_color(), str(line_style(k)["linestyle"])) for k, line in enumerate(lines.values())}) == 18
    assert len({line.get_color() for line in lines.values()}) == len(OKABE_ITO)


def test_spatial_trajectories_are_seen_from_above(path):
    flat, spatial = (plot_map_and_trajectories(None, None, {"a": run}) for run in (path(), path().to_3d()))
    np.testing.assert_array_equal(lines_of(flat)["a"].get_xydata(), lines_of(spatial)["a"].get_xydata())


def test_a_map_alone_may_have_a_colour_bar(room):
    figure = plot_map_and_trajectories(*room, {}, image_label="reflection probability", colormap="viridis")
    assert figure.axes[1].get_ylabel() == "reflection probability"
    assert figure.axes[0].get_legend() is None


def test_what_cannot_be_drawn_says_why(room, path):
    image, extent = room
    with pytest.raises(GeometryError, match="image and extent"):
        plot_map_and_trajectories(image, None, {"a": path()})
    with pytest.raises(GeometryError, match="nothing can be drawn"):
        plot_map_and_trajectories(None, None, {})
    with pytest.raises(GeometryError, match="mixed world frames map, odom"):
        plot_map_and_trajectories(image, extent, {"a": path(), "b": path(world="odom")})
    with pytest.raises(GeometryError, match="a: the trajectory is empty"):
        plot_map_and_trajectories(image, extent, {"a": path().select([False] * 12)})
    with pytest.raises(GeometryError, match="no trajectory is called 'truth'; known: a"):
        plot_map_and_trajectories(image, extent, {"a": path()}, reference="truth")
    with pytest.raises(GeometryError, match="image: shape"):
        plot_map_and_trajectories(image[0], extent, {"a": path()})


def test_colours_are_the_errors(room, path):
    errors = np.linspace(0, 0.5, 12)
    figure = plot_error_coloured_path(path(), errors, *room)
    (segments,) = figure.axes[0].collections
    np.testing.assert_array_equal(segments.get_array(), errors[1:])
    np.testing.assert_array_equal(np.array(segments.get_segments())[:, 0], path().positions[:-1])
    assert segments.get_clim() == (0, pytest.approx(np.percentile(errors, 99)))
    assert figure.axes[1].get_ylabel() == "translation error (m)"
    fixed = plot_error_coloured_path(path(), errors, limit=2.0, label="heading error (°)")
    assert fixed.axes[0].collections[0].get_clim() == (0, 2)
    assert fixed.axes[1].get_ylabel() == "heading error (°)"


@pytest.mark.parametrize("poses", [1, 2])
def test_short_paths_without_error_are_drawn(path, poses):
    figure = plot_error_coloured_path(path(poses=poses), np.zeros(poses))
    assert figure.axes[0].collections[0].get_clim() == (0, 1)


@pytest.mark.parametrize(
    ("errors", "message"),
    [(np.zeros(11), "errors: shape"), (np.full(12, -1.0), "negative"), (np.full(12, np.nan), "finite")],
)
def test_bad_errors_are_refused(path, errors, message):
    with pytest.raises(GeometryError, match=message):
        plot_error_coloured_path(path(), errors)
