import gzip
from pathlib import Path

import pytest
from carmen_corridor import Corridor, flaser

from factorloc.datasets import open_drive, read_carmen
from factorloc.errors import DataError, FactorlocWarning

LINES = Corridor.drive(12).raw().splitlines()
SCANS = [k for k, line in enumerate(LINES) if line.startswith("FLASER")]


def write(folder: Path, lines: list[str], name: str = "hall.log") -> Path:
    path = folder / name
    path.write_text("\n".join(lines) + "\n")
    return path


def spoil(line: str, field: int, value: str) -> str:
    words = line.split()
    words[field] = value
    return " ".join(words)


@pytest.mark.parametrize(
    ("damage", "reason"),
    [
        (lambda line: line[: len(line) // 2], "number of fields"),
        (lambda line: spoil(line, 20, "1.2.3"), "not a number"),
        (lambda line: spoil(line, 20, "nan"), "range is NaN"),
        (lambda line: spoil(line, 20, "-1"), "range is negative"),
        (lambda line: spoil(line, -5, "nan"), "not finite"),
        (lambda line: flaser([1.0] * 361, (0, 0, 0), (0, 0, 0), 0, 0), "beam count changes from 180 to 361"),
        (lambda line: flaser([1.0] * 77, (0, 0, 0), (0, 0, 0), 0, 0), "77 beams, of unknown angles"),
        (lambda line: "\ufffd" + line, "not a CARMEN message"),
    ],
)
def test_damaged_scans_are_counted_by_reason_and_reported(tmp_path: Path, damage, reason: str) -> None:
    lines = list(LINES)
    for k in SCANS[3:6]:
        lines[k] = damage(lines[k])
    with pytest.warns(FactorlocWarning, match=f"hall.log: 3 damaged lines left out: 3 x .*{reason}") as caught:
        drive = read_carmen(write(tmp_path, lines))
    assert len(caught) == 1 and "\n" not in str(caught[0].message)
    assert len(drive) == len(SCANS) - 3
    (found,) = drive.reports[0].damaged
    assert (found.count, found.first_line) == (3, SCANS[3] + 1)
    assert drive.reports[0].lines == len(lines)


def test_odometry_spans_the_scans_lost_from_a_raw_log(tmp_path: Path) -> None:
    lines = list(LINES)
    lines[SCANS[4]] = "FLASER 180 oops"
    whole = read_carmen(write(tmp_path, LINES))
    with pytest.warns(FactorlocWarning):
        part = read_carmen(write(tmp_path, lines))
    expected = whole.select([k for k in range(len(whole)) if k != 4])
    assert abs(part.odometry - expected.odometry).max() < 1e-12


def test_other_damaged_messages_are_counted_too(tmp_path: Path) -> None:
    lines = [*LINES, "ODOM 1 2", "PARAM lonely", "%$!", "TRUEPOS 0 0 0", ""]
    with pytest.warns(FactorlocWarning, match="3 damaged lines"):
        report = read_carmen(write(tmp_path, lines)).reports[0]
    assert report.ignored == {"TRUEPOS": 1}
    assert {damage.reason for damage in report.damaged} == {
        "ODOM: fields are missing or too many",
        "PARAM: without a value",
        "not a CARMEN message",
    }


def test_every_line_is_accounted_for(tmp_path: Path) -> None:
    lines = ["# comment", "", *LINES[2:], "NOTE x", "FLASER 1"]
    with pytest.warns(FactorlocWarning):
        report = read_carmen(write(tmp_path, lines)).reports[0]
    assert sum(report.used.values()) + sum(report.ignored.values()) + report.damaged_lines == report.lines - 2
    assert str(report).count("\n") == 0


def test_a_log_cut_short_in_its_last_line_is_reported(tmp_path: Path) -> None:
    text = "\n".join(LINES[: SCANS[-1] + 1])
    path = tmp_path / "hall.log"
    path.write_text(text[:-200])
    with pytest.warns(FactorlocWarning, match="number of fields"):
        assert len(read_carmen(path)) == len(SCANS) - 1


def test_too_much_damage_is_an_error(tmp_path: Path) -> None:
    lines = list(LINES)
    for k in SCANS[:7]:
        lines[k] = spoil(lines[k], 9, "nan")
    path = write(tmp_path, lines)
    with pytest.raises(
        DataError, match=r"hall.log: 7 of 13 scans are damaged \(7 .*range is NaN \(first at line 4\)\)"
    ):
        read_carmen(path)
    with pytest.warns(FactorlocWarning):
        assert len(read_carmen(path, max_damaged_fraction=0.6)) == 6
    with pytest.raises(DataError, match="13 of 13 scans"):
        read_carmen(write(tmp_path, [spoil(line, 9, "x") if "FLASER" in line else line for line in LINES]))


def test_an_empty_file_is_an_error(tmp_path: Path) -> None:
    path = tmp_path / "hall.log"
    path.touch()
    with pytest.raises(DataError, match=r"hall.log: is empty"):
        read_carmen(path)
    path = tmp_path / "hall.log.gz"
    path.write_bytes(gzip.compress(b""))
    with pytest.raises(DataError, match=r"hall.log.gz: is empty"):
        read_carmen(path)


PNG = b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR" + bytes(range(256)) * 4


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("picture.log", PNG, "holds no FLASER or ROBOTLASER1 message .*is it a CARMEN log"),
        ("poses.log", b"1.0 2.0 3.0\n", "holds no FLASER or ROBOTLASER1 message .*is it a CARMEN log"),
        ("text.log", b"# only a comment\n", "holds no FLASER or ROBOTLASER1 message; is it a CARMEN log"),
        ("picture.log.gz", PNG, "not gz"),
        ("picture.log.bz2", PNG, "not bz2"),
        ("picture.log.xz", PNG, "not xz"),
    ],
)
def test_a_file_of_another_type_is_an_error(tmp_path: Path, name: str, content: bytes, message: str) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(DataError, match=message) as caught:
        open_drive(path)
    assert name in str(caught.value) and "\n" not in str(caught.value)


def test_a_truncated_archive_is_an_error(tmp_path: Path) -> None:
    path = tmp_path / "hall.log.gz"
    path.write_bytes(gzip.compress("\n".join(LINES).encode())[:-100])
    with pytest.raises(DataError, match=r"hall.log.gz: damaged or cut short"):
        read_carmen(path)


def test_a_damaged_archive_is_an_error(tmp_path: Path) -> None:
    content = bytearray(gzip.compress("\n".join(LINES).encode()))
    content[len(content) // 2 : len(content) // 2 + 40] = bytes(40)
    path = tmp_path / "hall.log.gz"
    path.write_bytes(content)
    with pytest.raises(DataError, match=r"hall.log.gz: damaged or cut short"):
        read_carmen(path)


def test_a_bomb_is_an_error(tmp_path: Path) -> None:
    path = tmp_path / "hall.log.gz"
    path.write_bytes(gzip.compress(b"ODOM 0 0 0 0 0 0 0 robot 0\n" * 80_000))
    with pytest.raises(DataError, match=r"hall.log.gz: unfolds beyond 1 MiB"):
        read_carmen(path, max_bytes=2**20)


def test_a_missing_file_or_a_folder_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"nowhere.log: no such file"):
        open_drive(tmp_path / "nowhere.log")
    (tmp_path / "folder.log").mkdir()
    with pytest.raises(DataError, match=r"folder.log: is a folder"):
        open_drive(tmp_path / "folder.log")
