"""Files are written whole or not at all, and read with a limit on what they unfold to."""

import bz2
import gzip
import lzma
import os
import stat
from pathlib import Path

import pytest

from factorloc import files
from factorloc.errors import DataError, FactorlocError
from factorloc.files import atomic_path, open_text, write_text

COMPRESS = {"gz": gzip.compress, "bz2": bz2.compress, "xz": lzma.compress}
LINES = b"".join(b"line %d\n" % i for i in range(20_000))


def one_line(error: BaseException, path: Path) -> None:
    assert str(error).startswith(f"{path}: ")
    assert "\n" not in str(error)


def test_a_new_file_appears_with_its_folder_and_usual_mode(tmp_path: Path) -> None:
    target = tmp_path / "new" / "folder" / "t.txt"
    write_text(target, "Grüße\n")
    assert target.read_bytes() == "Grüße\n".encode()
    plain = tmp_path / "plain"
    plain.touch()
    assert stat.S_IMODE(target.stat().st_mode) == stat.S_IMODE(plain.stat().st_mode)


def test_nothing_shows_before_the_block_ends(tmp_path: Path) -> None:
    target = tmp_path / "t.txt"
    write_text(target, "old")
    with atomic_path(target) as temporary:
        temporary.write_text("new")
        assert target.read_text() == "old"
        assert temporary.suffix == ".txt"
        assert temporary.parent == target.parent
    assert target.read_text() == "new"
    assert list(tmp_path.iterdir()) == [target]


@pytest.mark.parametrize("failure", [ValueError, KeyboardInterrupt, FactorlocError])
def test_a_failure_keeps_the_old_file_and_leaves_no_other(tmp_path: Path, failure: type[BaseException]) -> None:
    target = tmp_path / "t.txt"
    write_text(target, "old")
    with pytest.raises(failure), atomic_path(target) as temporary:
        temporary.write_text("half")
        raise failure
    assert target.read_text() == "old"
    assert list(tmp_path.iterdir()) == [target]


def test_a_full_disk_is_one_clear_line(tmp_path: Path) -> None:
    target = tmp_path / "t.txt"
    write_text(target, "old")
    with pytest.raises(FactorlocError, match="No space left on device") as caught, atomic_path(target):
        raise OSError(28, os.strerror(28))
    one_line(caught.value, target)
    assert target.read_text() == "old"
    assert list(tmp_path.iterdir()) == [target]


def test_a_failed_rename_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(self: Path, target: Path) -> Path:
        raise PermissionError(1, os.strerror(1))

    monkeypatch.setattr(Path, "replace", refuse)
    with pytest.raises(FactorlocError, match="cannot be written"):
        write_text(tmp_path / "t.txt", "new")
    assert list(tmp_path.iterdir()) == []


def test_a_folder_is_no_target(tmp_path: Path) -> None:
    folder = tmp_path / "results"
    folder.mkdir()
    with pytest.raises(FactorlocError, match="is a folder; name a file") as caught:
        write_text(folder, "text")
    one_line(caught.value, folder)
    assert list(tmp_path.iterdir()) == [folder]


def test_a_device_is_not_replaced_by_a_file(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with pytest.raises(FactorlocError, match="is a device; name a file"):
        write_text(pipe, "text")
    assert stat.S_ISFIFO(pipe.stat().st_mode)


def test_a_file_is_no_folder_to_write_into(tmp_path: Path) -> None:
    blocker = tmp_path / "file"
    blocker.write_text("")
    with pytest.raises(FactorlocError, match=r"cannot be written .*; choose another output") as caught:
        write_text(blocker / "t.txt", "text")
    one_line(caught.value, blocker / "t.txt")


@pytest.mark.skipif(not hasattr(os, "getuid") or os.getuid() == 0, reason="root may write anywhere")
def test_a_read_only_folder_is_refused(tmp_path: Path) -> None:
    folder = tmp_path / "locked"
    folder.mkdir(mode=0o500)
    with pytest.raises(FactorlocError, match="cannot be written"):
        write_text(folder / "t.txt", "text")


@pytest.mark.parametrize("ending", ["", *COMPRESS])
def test_lines_are_numbered_and_whole(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"log.{ending or 'txt'}"
    content = "one\r\nzwei ü\n\nfour".encode()
    path.write_bytes(COMPRESS[ending](content) if ending else content)
    assert list(open_text(path)) == [(1, "one"), (2, "zwei ü"), (3, ""), (4, "four")]


def test_bytes_that_are_no_text_are_replaced(tmp_path: Path) -> None:
    path = tmp_path / "log.txt"
    path.write_bytes(b"FLASER 2 \xff\xfe 1\nnext\n")
    assert list(open_text(path)) == [(1, "FLASER 2 \N{REPLACEMENT CHARACTER}\N{REPLACEMENT CHARACTER} 1"), (2, "next")]


@pytest.mark.parametrize("ending", COMPRESS)
@pytest.mark.parametrize("damage", ["cut", "flipped", "nonsense after the header", "not compressed", "header only"])
def test_damaged_archives_are_named(tmp_path: Path, ending: str, damage: str) -> None:
    whole = COMPRESS[ending](LINES)
    middle = len(whole) // 2
    content = {
        "cut": whole[:middle],
        "flipped": whole[:middle] + bytes(byte ^ 0xFF for byte in whole[middle : middle + 64]) + whole[middle + 64 :],
        "nonsense after the header": whole[:10] + b"\xff" * 200,
        "not compressed": LINES,
        "header only": whole[:4],
    }[damage]
    path = tmp_path / f"log.{ending}"
    path.write_bytes(content)
    with pytest.raises(DataError, match=f"damaged or cut short, or not {ending}") as caught:
        list(open_text(path))
    one_line(caught.value, path)


@pytest.mark.parametrize("ending", COMPRESS)
def test_bombs_are_not_unfolded(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"bomb.{ending}"
    path.write_bytes(COMPRESS[ending](b"0 0 0 0 0 0 0 1\n" * 200_000))
    assert path.stat().st_size < 40_000
    with pytest.raises(DataError, match="unfolds beyond 1 MiB at line 65537") as caught:
        list(open_text(path, max_bytes=2**20))
    one_line(caught.value, path)


def test_one_endless_line_is_not_kept_in_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(files, "_MAX_LINE_BYTES", 2**20)
    path = tmp_path / "zeros.gz"
    path.write_bytes(gzip.compress(bytes(2**22)))
    with pytest.raises(DataError, match="1 MiB a line at line 1"):
        list(open_text(path))


def test_missing_files_and_folders_are_named(tmp_path: Path) -> None:
    for path, complaint in [(tmp_path / "none.log", "no such file"), (tmp_path, "is a folder; name a file")]:
        with pytest.raises(DataError, match=complaint) as caught:
            list(open_text(path))
        one_line(caught.value, path)
    blocker = tmp_path / "file"
    blocker.touch()
    with pytest.raises(DataError, match="cannot be read"):
        list(open_text(blocker / "log.txt"))
