"""Regressions on whole logs take compiled kernels."""

import os

import pytest


@pytest.fixture(autouse=True)
def _compiled() -> None:
    if os.environ.get("NUMBA_DISABLE_JIT", "0") != "0":
        pytest.skip("a whole log takes hours on interpreted kernels")
