import json
from dataclasses import replace

import numpy as np
import pytest

from factorloc.errors import EvaluationError, FactorlocError
from factorloc.evaluation import ErrorStatistics, Report, absolute_errors, evaluate, relative_errors


@pytest.mark.parametrize("dimension", [2, 3])
def test_evaluate_gathers_every_metric(drive, dimension):
    estimate, truth = drive(dimension)
    d = 3 * (dimension - 1)
    estimate = replace(estimate, covariances=np.broadcast_to(0.05**2 * np.eye(d), (len(truth), d, d)))
    report = evaluate(estimate.select(slice(0, None, 2)), truth, delta=3)
    assert report.counts["poses"] == 60
    assert report.counts["unmatched poses of the truth"] == 60
    matched = truth.select(slice(0, None, 2))
    absolute = absolute_errors(estimate.select(slice(0, None, 2)), matched)
    assert report.metrics["absolute lateral"] == absolute.statistics("lateral")
    relative = relative_errors(estimate.select(slice(0, None, 2)), matched, 3)
    assert report.metrics["relative rotation"] == relative.statistics("rotation")
    assert report.metrics["NEES per degree of freedom"].mean == pytest.approx(1, abs=0.2)
    assert ("absolute vertical" in report.metrics) == (dimension == 3)


def test_json_is_in_si_units_and_complete(drive, tmp_path):
    report = evaluate(*drive(2), align=True)
    target = tmp_path / "deep" / "report.json"
    report.write_json(target)
    read = json.loads(target.read_text())
    assert read["counts"] == report.counts
    assert {name: ErrorStatistics(**s) for name, s in read["metrics"].items()} == report.metrics
    assert read["metrics"]["absolute heading"]["unit"] == "rad"
    assert [p.name for p in target.parent.iterdir()] == ["report.json"]


def test_a_file_that_cannot_be_written_is_one_clear_line(drive, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(FactorlocError, match="cannot be written"):
        evaluate(*drive(2)).write_json(tmp_path / "file" / "report.json")


def test_table_is_in_degrees_and_takes_names_as_they_are():
    report = Report({"heading": ErrorStatistics.of([np.pi / 2], "rad"), "[red]x": ErrorStatistics.of([2.0], "1")})
    text = report.to_text("run [bold]")
    assert "90.0000" in text and "deg" in text and "1.5708" not in text
    assert "[red]x" in text and "run [bold]" in text
    for header in ("RMSE", "median", "95 %", "max"):
        assert header in text


def test_no_overlap_is_refused(drive):
    estimate, truth = drive(2)
    with pytest.raises(EvaluationError, match="no overlap"):
        evaluate(replace(estimate, stamps=estimate.stamps + 1e6), truth)
