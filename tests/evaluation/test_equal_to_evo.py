"""Absolute and relative errors equal those of evo's command line, which is only ever called as a program."""

import io
import itertools
import os
import shutil
import subprocess
import sys
import zipfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from factorloc.evaluation import absolute_errors, relative_errors
from factorloc.trajectory import Trajectory

METRICS = {"translation": "trans_part", "rotation": "angle_rad"}
ABSOLUTE = list(itertools.product([2, 3], METRICS, [False, True]))
RELATIVE = [
    *((dimension, metric, 1, "frames", False) for dimension in (2, 3) for metric in METRICS),
    *((dimension, metric, 10, "frames", dimension == 3) for dimension in (2, 3) for metric in METRICS),
    (2, "translation", 4.0, "m", False),
    (3, "rotation", 4.0, "m", True),
]


def program(name: str) -> str:
    found = shutil.which(name, path=os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")]))
    if found is None:
        pytest.skip(f"{name} is not installed: the errors are not compared with evo's")
    return found


def absolute_command(folder: Path, dimension: int, metric: str, align: bool) -> list[str]:
    files = [str(folder / f"truth{dimension}.tum"), str(folder / f"estimate{dimension}.tum")]
    return [program("evo_ape"), "tum", *files, "-r", METRICS[metric], *(["--align"] if align else [])]


def relative_command(folder: Path, dimension: int, metric: str, delta: float, unit: str, all_pairs: bool) -> list[str]:
    files = [str(folder / f"truth{dimension}.tum"), str(folder / f"estimate{dimension}.tum")]
    step = ["--delta", str(delta), "--delta_unit", unit[0], "--pairs_from_reference"]
    return [program("evo_rpe"), "tum", *files, "-r", METRICS[metric], *step, *(["--all_pairs"] if all_pairs else [])]


def evo_errors(command: list[str], folder: Path, number: int) -> np.ndarray:
    """Errors of each pose or pair as evo saves them."""
    saved = folder / f"{number}.zip"
    subprocess.run(
        [*command, "--save_results", str(saved), "--no_warnings"],
        check=True,
        capture_output=True,
        timeout=60,
        env={**os.environ, "HOME": str(folder), "OPENBLAS_NUM_THREADS": "1"},
    )
    with zipfile.ZipFile(saved) as archive:
        return np.load(io.BytesIO(archive.read("error_array.npy")))


@pytest.fixture(scope="module")
def runs(drive, tmp_path_factory):
    """The folder of the files, the trajectories read back from them, and evo's errors of every case."""
    folder = tmp_path_factory.mktemp("evo")
    pairs = {}
    for dimension in (2, 3):
        names = [folder / f"{name}{dimension}.tum" for name in ("estimate", "truth")]
        for trajectory, name in zip(drive(dimension, noise=0.2, seed=7), names, strict=True):
            trajectory.write_tum(name)
        pairs[dimension] = tuple(Trajectory.read_tum(name, planar=dimension == 2) for name in names)
    commands = {case: absolute_command(folder, *case) for case in ABSOLUTE}
    commands |= {case: relative_command(folder, *case) for case in RELATIVE}
    # The first call writes evo's settings into the folder that is its home; the others may then run side by side.
    first, *others = commands.values()
    errors = [evo_errors(first, folder, 0)]
    with ThreadPoolExecutor(2) as pool:
        errors += pool.map(evo_errors, others, itertools.repeat(folder), range(1, len(commands)))
    return pairs, dict(zip(commands, errors, strict=True))


@pytest.mark.parametrize(("dimension", "metric", "align"), ABSOLUTE)
def test_absolute_errors(runs, dimension, metric, align):
    pairs, evo = runs
    errors = absolute_errors(*pairs[dimension], align=align)
    expected = evo[dimension, metric, align]
    assert expected.mean() > 0.01
    np.testing.assert_allclose(getattr(errors, metric), expected, atol=1e-6, rtol=0)
    assert errors.statistics(metric).rmse == pytest.approx(np.sqrt(np.mean(expected**2)), abs=1e-6)


@pytest.mark.parametrize(("dimension", "metric", "delta", "unit", "all_pairs"), RELATIVE)
def test_relative_errors(runs, dimension, metric, delta, unit, all_pairs):
    pairs, evo = runs
    errors = relative_errors(*pairs[dimension], delta, unit, all_pairs=all_pairs)
    expected = evo[dimension, metric, delta, unit, all_pairs]
    assert expected.mean() > 0.01
    np.testing.assert_allclose(getattr(errors, metric), expected, atol=1e-6, rtol=0)
