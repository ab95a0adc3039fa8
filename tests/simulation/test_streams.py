import numpy as np
import pytest

from factorloc.errors import SimulationError
from factorloc.simulation.streams import stream


def first(*path, seed=3):
    return stream(seed, *path).random(4).tolist()


def test_a_stream_is_its_seed_and_path():
    assert first("poles", 2) == first("poles", 2)
    others = [first("poles"), first("poles", 3), first("trees", 2), first(2, "poles"), first("poles", 2, seed=4)]
    assert all(first("poles", 2) != other for other in others)


def test_a_name_is_not_the_number_of_its_checksum():
    import zlib

    assert first("poles") != first(zlib.crc32(b"poles"))


def test_streams_are_independent():
    draws = np.array([stream(0, "car", k).standard_normal(2000) for k in range(4)])
    assert abs(np.corrcoef(draws) - np.eye(4)).max() < 0.1


@pytest.mark.parametrize(("seed", "path"), [(-1, ()), (0, ("car", -2))])
def test_negative_numbers_are_refused(seed, path):
    with pytest.raises(SimulationError, match="negative"):
        stream(seed, *path)
