import hashlib
from pathlib import Path

import pytest

from factorloc.datasets import KNOWN_FILES, KnownFile, data_folder, known_max_range, log_name
from factorloc.errors import DataError

CARD = Path(__file__).resolve().parents[2] / "datasets" / "carmen.md"


@pytest.mark.parametrize(
    ("path", "name"),
    [
        ("a/intel-corrected.log.gz", "intel"),
        ("intel.clf.bz2", "intel"),
        ("freiburg-campus-corrected.log", "freiburg-campus"),
        ("freiburg-campus.LOG.xz", "freiburg-campus"),
        ("hall.v2.log", "hall.v2"),
        ("hall", "hall"),
    ],
)
def test_a_log_is_named_without_its_endings(path: str, name: str) -> None:
    assert log_name(path) == name


def test_known_reaches() -> None:
    assert known_max_range("intel") == 50
    assert known_max_range("edmonton") == 10
    assert known_max_range("belgioioso") == 80.99
    assert known_max_range("hall") is None
    logs = {log_name(known.path) for known in KNOWN_FILES if not known.path.endswith(".relations")}
    assert all(known_max_range(log) for log in logs)


def test_the_data_folder_is_the_one_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FACTORLOC_DATA", str(tmp_path))
    assert data_folder() == tmp_path
    monkeypatch.setenv("FACTORLOC_DATA", str(tmp_path / "nowhere"))
    with pytest.raises(DataError, match="nowhere: no such folder; set FACTORLOC_DATA"):
        data_folder()


def test_a_file_is_located_and_verified(tmp_path: Path) -> None:
    known = KnownFile("logs/hall.log", hashlib.sha256(b"hall").hexdigest(), "the janitor")
    with pytest.raises(DataError, match=r"hall.log: no such file; fetch it from the janitor"):
        known.locate(tmp_path)
    path = tmp_path / "logs" / "hall.log"
    path.parent.mkdir()
    path.write_bytes(b"hall")
    assert known.locate(tmp_path) == known.verify(tmp_path) == path
    path.write_bytes(b"hell")
    with pytest.raises(DataError, match=r"hall.log: sha256 .* fetch it again"):
        known.verify(tmp_path)


def test_the_card_names_every_known_file_and_its_digest() -> None:
    card = CARD.read_text()
    for known in KNOWN_FILES:
        assert f"`{known.path}`" in card
        assert known.sha256 in card


@pytest.mark.data
@pytest.mark.parametrize("known", KNOWN_FILES, ids=lambda known: known.path)
def test_real_files_are_those_known(data_dir: Path, known: KnownFile) -> None:
    assert known.verify(data_dir).is_file()
