import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from factorloc.errors import ConfigError, GeometryError
from factorloc.viewer.map_canvas import MapImage, map_canvas


def drawn_value(axes, x, y):
    """The value that a drawn image shows at a position."""
    (image,) = axes.images
    assert image.origin == "lower"
    x_min, x_max, y_min, y_max = image.get_extent()
    rows = image.get_array()
    row = int((y - y_min) / (y_max - y_min) * rows.shape[0])
    column = int((x - x_min) / (x_max - x_min) * rows.shape[1])
    return rows[row, column]


def test_the_first_axis_of_the_image_is_x():
    values = np.zeros((3, 2))
    values[2, 0] = 1.0
    _, axes, _ = map_canvas(MapImage(values, (10, 13, 5, 7)), [], crop=False)
    assert drawn_value(axes, 12.5, 5.5) == 1
    assert drawn_value(axes, 10.5, 6.5) == 0
    assert (axes.get_xlim(), axes.get_ylim()) == ((10, 13), (5, 7))
    assert axes.get_aspect() == 1


@given(st.integers(0, 10**6), st.integers(1, 4))
def test_fine_walls_survive_where_they_are(seed, finer):
    rng = np.random.default_rng(seed)
    shape = (1000 * finer + int(rng.integers(1, 99)), int(rng.integers(2, 40)))
    cell = rng.integers(0, shape)
    values = np.full(shape, np.nan)
    values[:, 1:] = 0.0
    values[tuple(cell)] = 1.0
    _, axes, drawn = map_canvas(MapImage(values, (0, shape[0] * 0.1, 0, shape[1] * 0.1)), [], crop=False)
    assert drawn.get_array().shape[1] <= 1000
    assert drawn.get_array().sum() == 1
    assert drawn_value(axes, *((cell + 0.5) * 0.1)) == 1


def test_crop_frames_walls_and_paths_but_no_strays(room):
    image, extent = room
    assert MapImage(image, extent).content() == (0, 20, 5, 15)
    stray = np.kron(image, np.ones((5, 5)))
    stray[0, 0] = 0.9
    assert MapImage(stray, extent).content() == pytest.approx((0, 20, 5, 15), abs=0.11)
    _, axes, _ = map_canvas(MapImage(image, extent), [np.array([[4.0, 12.0], [22.0, 12.0]])])
    low, high = axes.get_xlim()
    assert -1.5 < low < 0 and 22 < high < 23.5
    assert 3.5 < axes.get_ylim()[0] < 5 and 15 < axes.get_ylim()[1] < 16.5


def test_an_even_map_is_shown_whole():
    assert MapImage(np.ones((4, 4)), (0, 1, 0, 1)).content() == (0, 1, 0, 1)
    half = np.full((4, 4), np.nan)
    half[:2] = 0.5
    assert MapImage(half, (0, 1, 0, 1)).content() == (0, 0.5, 0, 1)


@given(st.floats(0.01, 1e4), st.floats(0.01, 1e4))
def test_scale_bar_is_round_fits_and_says_its_length(width, height):
    _, axes, _ = map_canvas(None, [np.array([[0.0, 0.0], [width, height]])], scale_bar=True)
    x, _ = axes.lines[-1].get_data()
    length = float(x[1] - x[0])
    assert axes.texts[0].get_text() == f"{length:.12g} m"
    assert f"{length:.0e}"[0] in "125"
    low, high = axes.get_xlim()
    assert low < x[0] < x[1] < high
    assert len(axes.get_xticks()) == len(axes.get_yticks()) == 0


@given(st.floats(1e-3, 1e3))
def test_figures_of_any_proportion_keep_to_the_page(ratio):
    figure, _, _ = map_canvas(None, [np.array([[0.0, 0.0], [10.0, 10.0 * ratio]])])
    width, height = figure.get_size_inches()
    assert 3.4 < width < 7.3 and 1.9 < height < 8.1


@pytest.mark.parametrize(
    ("values", "extent", "message"),
    [
        (np.zeros(4), (0, 1, 0, 1), "image: shape"),
        (np.zeros((0, 4)), (0, 1, 0, 1), "image: shape"),
        (np.full((2, 2), np.nan), (0, 1, 0, 1), "finite"),
        (np.zeros((2, 2)), (1, 0, 0, 1), "extent"),
        (np.zeros((2, 2)), (0, 1, 0), "extent"),
        (np.zeros((2, 2)), (0, 1, 0, np.inf), "extent"),
    ],
)
def test_bad_images_are_refused(values, extent, message):
    with pytest.raises(GeometryError, match=message):
        MapImage(values, extent)


def test_unknown_colour_maps_are_refused(room):
    with pytest.raises(ConfigError, match="colormap: 'jett'"):
        map_canvas(MapImage(*room), [], colormap="jett")
