"""Open3D is optional: its absence is one line, its presence gives the right points."""

import builtins
from typing import Any

import numpy as np
import pytest

from factorloc.errors import MissingLibraryError
from factorloc.scan import Scan
from factorloc.viewer.point_cloud import load_open3d, to_open3d

SCAN = Scan.from_polar([0.0, np.pi / 2, 1.0], [2.0, 3.0, np.inf], (0.1, 10.0), T_body_sensor=[1.0, 0.0, 0.0])


@pytest.mark.parametrize(
    ("failure", "mend"),
    [
        (ModuleNotFoundError("No module named 'open3d'"), "pip install 'factorloc\\[open3d\\]'"),
        (ImportError("libusb-1.0.so.0: cannot open shared object file"), "libusb-1.0.so.0.*apt install libusb-1.0-0"),
        (OSError("libGL.so.1: cannot open shared object file"), "libGL.so.1.*libgl1"),
    ],
)
def test_a_missing_library_is_one_line_with_its_mend(
    monkeypatch: pytest.MonkeyPatch, failure: Exception, mend: str
) -> None:
    real = builtins.__import__

    def broken(name: str, *rest: Any, **options: Any) -> Any:
        if name == "open3d":
            raise failure
        return real(name, *rest, **options)

    monkeypatch.setattr(builtins, "__import__", broken)
    with pytest.raises(MissingLibraryError, match=mend) as raised:
        load_open3d()
    assert "\n" not in str(raised.value)


def test_points_lie_where_the_body_says() -> None:
    try:
        load_open3d()
    except MissingLibraryError as error:
        pytest.skip(str(error))
    cloud = to_open3d(SCAN, [0.0, 0.0, np.pi / 2])
    assert np.allclose(np.asarray(cloud.points), [[0.0, 3.0, 0.0], [-3.0, 1.0, 0.0]])
