"""The benchmarks of intervals on inputs so small that nobody minds the time."""

import json
from pathlib import Path

import pytest

from benchmarks import interval_containment, interval_speed
from benchmarks.interval_samples import CONSTRAINTS, EXTENDED, OPERATIONS


def files(folder: Path) -> list[str]:
    return ["--quick", "--json", str(folder / "run.json"), "--plot", str(folder / "run.png")]


@pytest.mark.skipif(not EXTENDED, reason="longdouble is no wider than double here")
def test_no_number_is_lost(tmp_path: Path) -> None:
    assert interval_containment.main([*files(tmp_path), "--samples", "2000"]) == 0
    run = json.loads((tmp_path / "run.json").read_text())
    assert len(run["goals"]) == len(OPERATIONS) + len(CONSTRAINTS)
    assert all(figure["value"] >= 0.002 for name, figure in run["figures"].items() if name.endswith("samples"))
    assert (tmp_path / "run.png").stat().st_size > 0


def test_loops_are_timed_and_compared(tmp_path: Path) -> None:
    code = interval_speed.main(
        [*files(tmp_path), "--points", "20000", "--facades", "12", "--town-facades", "100", "--rounds", "2"]
    )
    run = json.loads((tmp_path / "run.json").read_text())
    assert code in (0, 1)  # times of so few points mean nothing
    assert run["goals"][0]["name"] == "rotation and translation: rounded / unrounded"
    assert {interval_speed.MOVE, interval_speed.SECTOR, interval_speed.HEADING, interval_speed.CLIP} <= set(
        run["figures"]
    )
    assert (tmp_path / "run.png").stat().st_size > 0
