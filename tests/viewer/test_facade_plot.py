"""Pictures of facade maps: what is in them, and whom they name."""

from __future__ import annotations

import numpy as np
import shapely
from matplotlib.backends.backend_agg import FigureCanvasAgg

from factorloc.mapping import BuildingOutlines, FacadeMap, Outline
from factorloc.viewer import plot_facade_map, save_figure


def town(attribution: str) -> FacadeMap:
    court = shapely.box(0, 0, 40, 30).difference(shapely.box(10, 10, 30, 20))
    return FacadeMap.from_outlines(BuildingOutlines((Outline(court),), attribution=attribution))


def texts(figure) -> list[str]:
    return [text.get_text() for text in figure.axes[0].texts]


def test_the_attribution_is_in_the_picture(tmp_path) -> None:
    figure = plot_facade_map(town("© somebody"), {"drive": np.array([[45.0, 0], [45, 60]])})
    assert "© somebody" in texts(figure)
    assert figure.axes[0].get_ylim()[1] >= 60
    save_figure(figure, tmp_path / "facades.png")
    assert (tmp_path / "facades.png").stat().st_size > 5000


def test_courtyards_are_empty_and_nobody_is_named_in_vain() -> None:
    figure = plot_facade_map(town(""), limits=(0, 40, 0, 30))
    assert "" not in texts(figure)
    assert not any("©" in text for text in texts(figure))
    walls = figure.axes[0].collections[1]
    assert len(walls.get_segments()) == 8
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    pixels = np.asarray(canvas.buffer_rgba())

    def colour(x: float, y: float) -> list[int]:
        column, row = figure.axes[0].transData.transform((x, y))
        return pixels[pixels.shape[0] - 1 - round(row), round(column), :3].tolist()

    assert colour(20, 15) == [255, 255, 255]
    assert colour(20, 25) == colour(35, 15) != [255, 255, 255]
