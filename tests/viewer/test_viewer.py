import inspect

import pytest

from factorloc.errors import ConfigError, GeometryError
from factorloc.viewer import NullViewer, Viewer, plot_map_and_trajectories


@pytest.mark.parametrize("kind", [".png", ".svg"])
def test_figures_land_in_the_folder(tmp_path, room, path, kind):
    viewer = Viewer(tmp_path / "figures", kind)
    assert not viewer.folder.exists()
    file = viewer.draw("blur 0.5", plot_map_and_trajectories, *room, {"a": path()}, crop=False)
    assert file == tmp_path / "figures" / f"blur 0.5{kind}"
    assert file.stat().st_size > 3000


def test_the_null_viewer_takes_everything_and_does_nothing(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def never():
        raise AssertionError("a null viewer draws nothing")

    viewer: Viewer = NullViewer()
    assert viewer.draw("map", never) is None
    assert not list(tmp_path.iterdir())


def test_both_have_the_same_methods():
    for name, method in inspect.getmembers(Viewer, inspect.isfunction):
        if not name.startswith("_"):
            null = getattr(NullViewer, name)
            assert null is not method, f"{name} is not silenced"
            assert list(inspect.signature(null).parameters) == list(inspect.signature(method).parameters)


def test_errors_of_the_plot_come_through_and_leave_nothing(tmp_path):
    with pytest.raises(GeometryError, match="nothing can be drawn"):
        Viewer(tmp_path).draw("map", plot_map_and_trajectories, None, None, {})
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["", "a/b", "../a", "/a"])
def test_names_with_folders_are_refused(tmp_path, path, name):
    with pytest.raises(ConfigError, match="leave out folders"):
        Viewer(tmp_path).draw(name, plot_map_and_trajectories, None, None, {"a": path()})


def test_other_kinds_of_files_are_refused(tmp_path):
    with pytest.raises(ConfigError, match="kind: 'png'"):
        Viewer(tmp_path, "png")
