import subprocess
import sys

import matplotlib
import pytest

from factorloc.errors import ConfigError, FactorlocError
from factorloc.viewer import FIGURE_KINDS, plot_map_and_trajectories, save_figure

BEGINNINGS = {".png": b"\x89PNG\r\n\x1a\n", ".pdf": b"%PDF-", ".svg": b"<?xml"}


@pytest.mark.parametrize("kind", FIGURE_KINDS)
def test_equal_figures_are_equal_files(tmp_path, room, path, kind):
    def settings():
        # Only asking for the backend would choose one.
        return {name: matplotlib.rcParams[name] for name in matplotlib.rcParams if name != "backend"}

    before = settings()
    files = [tmp_path / "deep" / f"{name}{kind}" for name in ("one", "two")]
    for file in files:
        save_figure(plot_map_and_trajectories(*room, {"a": path()}), file)
    content = files[0].read_bytes()
    assert content.startswith(BEGINNINGS[kind])
    assert len(content) > 3000
    assert content == files[1].read_bytes()
    assert b"CreationDate" not in content and b"dc:date" not in content
    assert sorted(file.name for file in files[0].parent.iterdir()) == [f"one{kind}", f"two{kind}"]
    assert settings() == before


def test_fonts_of_a_pdf_are_outlines(tmp_path, path):
    save_figure(plot_map_and_trajectories(None, None, {"a": path()}), tmp_path / "a.pdf")
    content = (tmp_path / "a.pdf").read_bytes()
    assert b"/Type3" not in content and b"/Type42" not in content
    assert b"/CIDFontType2" in content


def test_resolution_counts(tmp_path, path):
    figure = plot_map_and_trajectories(None, None, {"a": path()})
    for dpi in (50, 100):
        save_figure(figure, tmp_path / f"{dpi}.png", dpi)
    widths = [int.from_bytes((tmp_path / f"{dpi}.png").read_bytes()[16:20]) for dpi in (50, 100)]
    assert widths[1] == pytest.approx(2 * widths[0], abs=6)


@pytest.mark.parametrize("name", ["a.jpeg", "a", "a.txt"])
def test_other_kinds_are_refused(tmp_path, path, name):
    with pytest.raises(ConfigError, match=r"end the name in \.png, \.pdf, \.svg"):
        save_figure(plot_map_and_trajectories(None, None, {"a": path()}), tmp_path / name)
    assert not list(tmp_path.iterdir())


def test_a_failure_leaves_the_old_file_and_nothing_else(tmp_path, path):
    file = tmp_path / "a.png"
    file.write_text("old")
    figure = plot_map_and_trajectories(None, None, {"a": path()})

    def fail(renderer):
        raise RuntimeError("half way")

    figure.axes[0].draw = fail
    with pytest.raises(RuntimeError, match="half way"):
        save_figure(figure, file)
    assert file.read_text() == "old"
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.png"]


def test_a_folder_that_is_a_file_is_one_clear_line(tmp_path, path):
    (tmp_path / "file").write_text("")
    with pytest.raises(FactorlocError, match="cannot be written"):
        save_figure(plot_map_and_trajectories(None, None, {"a": path()}), tmp_path / "file" / "a.png")


def test_matplotlib_waits_until_it_is_needed_and_pyplot_never_comes(tmp_path):
    program = f"""
import sys
import numpy as np
from factorloc.trajectory import Trajectory
from factorloc.viewer import NullViewer, Viewer, plot_map_and_trajectories
run = {{"a": Trajectory(np.arange(3), np.eye(3))}}
assert NullViewer().draw("map", plot_map_and_trajectories, None, None, run) is None
assert "matplotlib" not in sys.modules, "imported too early"
Viewer({str(tmp_path)!r}).draw("map", plot_map_and_trajectories, None, None, run)
assert "matplotlib.pyplot" not in sys.modules, "global state"
"""
    subprocess.run([sys.executable, "-c", program], check=True, timeout=60)
    assert (tmp_path / "map.png").stat().st_size > 3000
