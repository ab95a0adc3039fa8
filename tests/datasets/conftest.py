import functools
from collections.abc import Callable
from pathlib import Path

import pytest

from factorloc.datasets import Drive, open_drive


@pytest.fixture(scope="session")
def raw_log(data_dir: Path) -> Callable[[str], Drive]:
    """Raw logs by name, each read once."""
    return functools.cache(lambda name: open_drive(data_dir / f"carmen_raw/{name}.clf.bz2"))
