"""Kernels are compiled once, cached apart from other programs, and import next to nothing."""

import ast
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import factorloc
from factorloc import _jit

PACKAGE = Path(factorloc.__file__).parent
KERNELS = sorted(PACKAGE.rglob("_*kernels.py"))
DECORATORS = {"kernel", "exact_kernel", "prange"}

PROBE = """
from factorloc._jit import exact_kernel, kernel, prange

@kernel(inline=True)
def halve(x):
    return x / 2

@kernel
def count_nan(values):
    count = 0
    for value in values:
        if value != value:
            count += 1
    return count

@exact_kernel(parallel=True)
def sum_of_halves(values):
    total = 0.0
    for i in prange(len(values)):
        total += halve(values[i])
    return total
"""

RUN = """
import logging, sys
logging.basicConfig(level=logging.INFO, stream=sys.stdout, format="%(name)s: %(message)s")
import numpy as np
from factorloc import _jit
from factorloc_probe._kernels import count_nan, sum_of_halves
assert count_nan(np.array([np.nan, np.inf, 1.0])) == 1
assert sum_of_halves(np.arange(5.0)) == 5.0
print("seconds", _jit.compile_seconds())
print("folder", _jit.cache_folder)
"""


def imports(path: Path) -> Iterator[tuple[str, str]]:
    """Every import of a file, at any depth: (module, name); the name is empty for ``import module``."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from ((alias.name, "") for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield from (("." * node.level + (node.module or ""), alias.name) for alias in node.names)


@pytest.fixture
def probe(tmp_path: Path) -> Path:
    package = tmp_path / "factorloc_probe"
    package.mkdir()
    (package / "__init__.py").touch()
    (package / "_kernels.py").write_text(PROBE)
    return tmp_path


def run(folder: Path, **environment: str) -> str:
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("NUMBA", "COVERAGE"))}
    kept |= {"PYTHONPATH": os.pathsep.join([str(folder), str(PACKAGE.parent)]), **environment}
    done = subprocess.run([sys.executable, "-c", RUN], env=kept, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return done.stdout


def seconds(output: str) -> float:
    found = re.search(r"^seconds (\S+)$", output, re.MULTILINE)
    assert found
    return float(found[1])


def test_the_first_process_says_once_that_it_compiles_and_the_second_compiles_nothing(probe: Path) -> None:
    cache = probe / "cache"
    first = run(probe, FACTORLOC_CACHE_DIR=str(cache))
    assert first.count("compiling kernels, once") == 1
    assert seconds(first) > 0
    assert str(cache) in first
    assert list(cache.rglob("*.nbc"))
    assert not list((probe / "factorloc_probe").rglob("*.nb[ci]"))
    second = run(probe, FACTORLOC_CACHE_DIR=str(cache))
    assert "compiling" not in second
    assert seconds(second) == 0


def test_an_unwritable_cache_is_replaced_and_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    blocker = tmp_path / "file"
    blocker.touch()
    monkeypatch.setenv("FACTORLOC_CACHE_DIR", str(blocker / "cache"))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    chosen = _jit._choose_cache_folder()
    assert chosen.is_dir()
    assert chosen.is_relative_to(tmp_path)
    assert str(blocker / "cache") in caplog.text
    assert "FACTORLOC_CACHE_DIR" in caplog.text


def test_an_edit_in_any_kernel_file_begins_a_new_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    room = tmp_path / "mapping"
    room.mkdir()
    for path in (tmp_path / "_jit.py", room / "_kernels.py", room / "_ray_kernels.py", room / "grid.py"):
        path.write_text("a = 1\n")
    monkeypatch.setattr(_jit, "__file__", str(tmp_path / "_jit.py"))
    seen = {_jit._digest()}
    (room / "grid.py").write_text("a = 2\n")
    assert _jit._digest() in seen
    for path in (tmp_path / "_jit.py", room / "_kernels.py", room / "_ray_kernels.py"):
        path.write_text("a = 2\n")
        assert _jit._digest() not in seen
        seen.add(_jit._digest())
    (room / "_ray_kernels.py").rename(room / "_beam_kernels.py")
    assert _jit._digest() not in seen


def test_threads_are_kept_within_what_the_process_may_use() -> None:
    most = _jit.set_threads(None)
    try:
        assert 1 <= most <= (os.cpu_count() or 1)
        assert _jit.threads() == most
        for asked, got in [(1, 1), (0, 1), (-3, 1), (most, most), (10_000, most)]:
            assert _jit.set_threads(asked) == got
            assert _jit.threads() == got
    finally:
        _jit.set_threads(None)


def test_there_are_kernels() -> None:
    assert KERNELS


@pytest.mark.parametrize("path", KERNELS, ids=lambda path: path.relative_to(PACKAGE).as_posix())
def test_kernel_files_import_nothing_that_the_cache_does_not_watch(path: Path) -> None:
    kernels = {".".join(kernel.relative_to(PACKAGE.parent).with_suffix("").parts) for kernel in KERNELS}
    allowed = {"numpy", "math", "__future__", "factorloc._jit"} | kernels
    strangers = {module for module, name in imports(path) if not {module, f"{module}.{name}"} & allowed}
    assert not strangers, f"{path.name} may import numpy, math, factorloc._jit and other kernel files only"


def test_no_other_file_compiles() -> None:
    offences = []
    for path in sorted(set(PACKAGE.rglob("*.py")) - {*KERNELS, PACKAGE / "_jit.py"}):
        names = {name for module, name in imports(path) if module == "factorloc._jit"}
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "_jit":
                names.add(node.attr)
        offences += [f"{path.relative_to(PACKAGE)}: {name}" for name in sorted(names & DECORATORS)]
    assert not offences, "kernels live in _kernels.py"
