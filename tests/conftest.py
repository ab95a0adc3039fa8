"""Fixtures shared by all tests: the real data, and hypothesis' temper."""

import os
from pathlib import Path

import hypothesis
import pytest

hypothesis.settings.register_profile("factorloc", deadline=None, derandomize=True, max_examples=60)
hypothesis.settings.load_profile("factorloc")

_DEFAULT_DATA = Path(__file__).resolve().parents[2] / "shared" / "data"


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """The folder of real logs; tests that need it are skipped, saying so, where it is missing."""
    folder = Path(os.environ.get("FACTORLOC_DATA", _DEFAULT_DATA))
    if not folder.is_dir():
        pytest.skip(f"no real data: FACTORLOC_DATA names no folder and {_DEFAULT_DATA} does not exist")
    return folder
