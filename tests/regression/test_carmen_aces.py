from pathlib import Path

import pytest
from localized_log import localized


@pytest.mark.data
def test_the_aces_log_is_localized_to_centimetres(data_dir: Path) -> None:
    figures, scans = localized(data_dir, "aces")
    assert scans == 220
    assert figures.rmse <= 0.05
    assert figures.median <= 0.03
    assert figures.percentile_95 <= 0.10
    assert figures.maximum <= 0.2
    assert figures.heading_rmse <= 0.4
