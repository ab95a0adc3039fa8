from pathlib import Path

import pytest
from localized_log import localized


@pytest.mark.data
def test_the_intel_log_is_localized_to_centimetres(data_dir: Path) -> None:
    figures, scans = localized(data_dir, "intel")
    assert scans == 455
    assert figures.rmse <= 0.04
    assert figures.median <= 0.025
    assert figures.percentile_95 <= 0.07
    assert figures.maximum <= 0.3
    assert figures.heading_rmse <= 0.7
