import logging
import zipfile

import numpy as np
import pytest

from factorloc.errors import DataError, SimulationError
from factorloc.simulation import session_cache
from factorloc.simulation.session_cache import cache_key, cached, read_arrays, write_arrays
from factorloc.simulation.sessions import SessionSettings

ARRAYS = {"points": np.arange(12.0).reshape(4, 3), "ids": np.array([3, 1], np.int32), "name": np.array("town")}


def maker(calls):
    def make():
        calls.append(1)
        return ARRAYS

    return make


def assert_equal(arrays):
    assert sorted(arrays) == sorted(ARRAYS)
    for name, array in ARRAYS.items():
        assert arrays[name].dtype == array.dtype
        assert np.array_equal(arrays[name], array)


def test_what_is_kept_is_not_made_again(tmp_path):
    calls = []
    for _ in range(3):
        assert_equal(cached(tmp_path / "cache", SessionSettings(), maker(calls)))
    assert len(calls) == 1
    cached(tmp_path / "cache", SessionSettings(vanish_rate=0.5), maker(calls))
    assert len(calls) == 2
    assert len(list((tmp_path / "cache").iterdir())) == 2


def test_a_key_tells_all_that_goes_into_it(monkeypatch):
    keys = [cache_key("ab", "c"), cache_key("a", "bc"), cache_key(1), cache_key("1"), cache_key(SessionSettings(), 1)]
    assert len({*keys}) == len(keys)
    assert cache_key(SessionSettings(), 1) == keys[-1]
    monkeypatch.setattr(session_cache, "__version__", "0.0.0")
    assert cache_key(SessionSettings(), 1) != keys[-1]


@pytest.mark.parametrize("damage", [b"", b"PK", b"not a zip" * 99, "cut", "flip", "pickle", "bomb"])
def test_a_damaged_entry_is_refused_and_made_anew(tmp_path, damage, caplog, monkeypatch):
    calls = []
    cached(tmp_path, "key", maker(calls))
    (path,) = tmp_path.iterdir()
    whole = path.read_bytes()
    match damage:
        case bytes():
            path.write_bytes(damage)
        case "cut":
            path.write_bytes(whole[: len(whole) // 2])
        case "flip":
            middle = whole.index(b"points.npy") + 60
            path.write_bytes(
                whole[:middle] + bytes(255 - b for b in whole[middle : middle + 20]) + whole[middle + 20 :]
            )
        case "pickle":
            np.savez(path, points=np.array([{}], object))
        case "bomb":
            monkeypatch.setattr(session_cache, "MAX_CACHED_BYTES", 1000)
            with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as entry:
                entry.writestr("points.npy", bytes(3 << 20))
    with pytest.raises(DataError, match=path.name) as error:
        read_arrays(path)
    assert "\n" not in str(error.value)
    with caplog.at_level(logging.WARNING):
        assert_equal(cached(tmp_path, "key", maker(calls)))
    assert len(calls) == 2
    assert "made anew" in caplog.text
    assert_equal(read_arrays(path))


def test_nothing_half_made_is_kept(tmp_path):
    def fails():
        raise RuntimeError("no scan")

    with pytest.raises(RuntimeError, match="no scan"):
        cached(tmp_path, "key", fails)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("arrays", "message"),
    [({"a": np.array([{}], object)}, "plain"), ({"../a": np.zeros(2)}, "plain name"), ({"a": np.zeros(999)}, "exceed")],
)
def test_what_cannot_be_kept_is_refused(tmp_path, arrays, message, monkeypatch):
    monkeypatch.setattr(session_cache, "MAX_CACHED_BYTES", 1000)
    with pytest.raises(SimulationError, match=message):
        write_arrays(tmp_path / "a.npz", arrays)
    assert list(tmp_path.iterdir()) == []


def test_a_missing_entry_is_named(tmp_path):
    with pytest.raises(DataError, match="no such file"):
        read_arrays(tmp_path / "none.npz")
