"""The house is in order: links, distributions, imports, version, and no trace of the machine it was built on."""

import ast
import fnmatch
import importlib.metadata
import json
import re
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import factorloc

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "factorloc"
LINKS = ("factors", "mapping", "intervals")
CONFIG: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))

HEAVY = ("gtsam", "h5py", "matplotlib", "numba", "open3d", "pydantic", "pyproj", "scipy", "shapely")
BANNED = {"cloudpickle", "codac", "dill", "evo", "joblib", "marshal", "pickle", "shelve", *LINKS}


def run(*command: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, *command], cwd=ROOT, capture_output=True, text=True, timeout=120)


@pytest.fixture(scope="module")
def tracked() -> list[Path]:
    """Files under version control; a source distribution has none."""
    command = ["git", "-c", "safe.directory=*", "ls-files", "-z"]
    if not (ROOT / ".git").exists():
        pytest.skip("not a clone: the root links and the list of tracked files are in git only")
    listed = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    return [ROOT / name for name in listed.split("\0") if name]


@pytest.fixture(scope="module")
def distributions(tmp_path_factory: pytest.TempPathFactory) -> tuple[list[str], list[str]]:
    """Names inside the wheel and the source distribution, built from this tree."""
    folder = tmp_path_factory.mktemp("dist")
    built = run("-m", "hatchling", "build", "-d", str(folder))
    assert built.returncode == 0, built.stderr
    with zipfile.ZipFile(next(folder.glob("*.whl"))) as wheel, tarfile.open(next(folder.glob("*.tar.gz"))) as sdist:
        # Everything in a source distribution lies in one folder, name-version.
        return wheel.namelist(), [name.split("/", 1)[1] for name in sdist.getnames()]


@pytest.mark.usefixtures("tracked")
@pytest.mark.parametrize("room", LINKS)
def test_a_link_at_the_root_names_the_room(room: str) -> None:
    link = ROOT / room
    assert link.is_symlink()
    assert link.readlink() == Path("factorloc") / room
    assert link.resolve() == PACKAGE / room
    assert (link / "__init__.py").is_file()


def test_distributions_ship_each_room_once(distributions: tuple[list[str], list[str]]) -> None:
    wheel, sdist = distributions
    assert {name.split("/")[0] for name in wheel if ".dist-info/" not in name} == {"factorloc"}
    for names in distributions:
        assert len(names) == len(set(names))
        assert "factorloc/py.typed" in names
        for room in LINKS:
            assert f"factorloc/{room}/__init__.py" in names
            assert not [name for name in names if name == room or name.startswith(f"{room}/")]
    assert {"LICENSE", "NOTICE", "README.md", "pyproject.toml", "tests/conftest.py"} <= set(sdist)


def test_every_module_is_shipped(distributions: tuple[list[str], list[str]]) -> None:
    modules = {path.relative_to(ROOT).as_posix() for path in PACKAGE.rglob("*.py")}
    for names in distributions:
        assert modules <= set(names)


def test_type_checker_and_linter_pass_by_the_links() -> None:
    excluded = CONFIG["tool"]["mypy"]["exclude"]
    for room in LINKS:
        assert any(re.search(pattern, f"{room}/pose.py") for pattern in excluded)
        assert not any(re.search(pattern, f"factorloc/{room}/pose.py") for pattern in excluded)
        # A bare name would pass by factorloc/mapping and tests/mapping too.
        assert f"{room}/*" in CONFIG["tool"]["ruff"]["extend-exclude"]
        assert room not in CONFIG["tool"]["ruff"]["extend-exclude"]
        assert room in CONFIG["tool"]["ruff"]["lint"]["flake8-tidy-imports"]["banned-api"]


@pytest.mark.usefixtures("tracked")
def test_no_test_is_collected_at_the_links() -> None:
    assert CONFIG["tool"]["pytest"]["ini_options"]["testpaths"] == ["tests"]
    collected = run("-m", "pytest", "--collect-only", "-q", "-p", "no:cacheprovider", *LINKS)
    assert collected.returncode == pytest.ExitCode.NO_TESTS_COLLECTED, collected.stdout + collected.stderr


def test_no_folder_of_tests_is_passed_over() -> None:
    # norecursedirs speaks of base names: "mapping" would silence tests/mapping too.
    patterns = CONFIG["tool"]["pytest"]["ini_options"].get("norecursedirs", [])
    folders = {path.name for path in [*PACKAGE.iterdir(), *(ROOT / "tests").rglob("*")] if path.is_dir()} - {
        "__pycache__"
    }
    assert not [folder for folder in folders for pattern in patterns if fnmatch.fnmatch(folder, pattern)]


def test_importing_the_package_loads_nothing_heavy() -> None:
    code = "import sys, json, factorloc; print(json.dumps(sorted(sys.modules)))"
    done = run("-c", code)
    assert done.returncode == 0, done.stderr
    loaded = {name.split(".")[0] for name in json.loads(done.stdout)}
    assert not loaded & set(HEAVY)


def test_every_public_name_is_there() -> None:
    assert len(factorloc.__all__) == len(set(factorloc.__all__))
    for name in factorloc.__all__:
        assert getattr(factorloc, name) is not None
    assert set(factorloc.__all__) <= set(dir(factorloc))


def imports(path: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield "." * node.level + (node.module or "")


def test_no_module_imports_what_is_banned() -> None:
    offences = []
    for path in PACKAGE.rglob("*.py"):
        where = path.relative_to(PACKAGE)
        tops = {module.split(".")[0] for module in imports(path)}
        banned = tops & BANNED
        banned |= {"a relative import"} if "" in tops else set()
        banned |= tops & {"numba"} if where.name != "_jit.py" else set()
        banned |= tops & {"gtsam"} if where.parts[0] not in ("factors", "localization") else set()
        offences += [f"{where}: {name}" for name in sorted(banned)]
    assert not offences


def test_arrays_are_never_unpickled() -> None:
    for path in PACKAGE.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.keyword) and node.arg == "allow_pickle":
                assert isinstance(node.value, ast.Constant), path
                assert node.value.value is False, path


def test_the_version_is_written_once() -> None:
    assert CONFIG["project"]["dynamic"] == ["version"]
    assert "version" not in CONFIG["project"]
    assert factorloc.__version__ == importlib.metadata.version("factorloc")
    assert f"## [{factorloc.__version__}]" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


def test_the_interpreters_promised_are_those_the_makefile_accepts() -> None:
    promised = {
        line.rsplit(" ", 1)[1]
        for line in CONFIG["project"]["classifiers"]
        if re.fullmatch(r"Programming Language :: Python :: 3\.\d+", line)
    }
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    assert promised == set(re.findall(r"\bpython(3\.\d+)\b", makefile))


def test_no_tracked_file_mentions_a_machine(tracked: list[Path]) -> None:
    machine = re.compile(rb"(?<![\w.~>)}/-])/(?:home|Users|root|work|tmp|mnt|scratch)/\w|\b[A-Z]:\\\\?Users")
    offences = []
    for path in tracked:
        if path.is_file() and not path.is_symlink():
            for number, line in enumerate(path.read_bytes().splitlines(), 1):
                if machine.search(line):
                    offences.append(f"{path.relative_to(ROOT)}:{number}: {line.decode(errors='replace').strip()[:120]}")
    assert not offences, "\n".join(offences)
