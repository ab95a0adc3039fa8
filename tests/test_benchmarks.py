"""The form all benchmarks share, what they compare, and a run of each on inputs so small that nobody minds the time."""

import ast
import gc
import importlib
import json
import math
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from benchmarks import __main__ as everything
from benchmarks import harness, raycast, solver
from benchmarks.bars import Bar, plot_bars
from benchmarks.harness import Arguments, Benchmark, Goal, arguments, one_line_errors
from benchmarks.machine import commit, machine
from benchmarks.reference import build_reference
from benchmarks.returns import OFFICE, load_returns
from benchmarks.timing import interleave, ratio, spread
from benchmarks.walks import all_walks
from factorloc.errors import DataError, FactorlocError, MapError

FOLDER = Path(harness.__file__).parent
KEYS = {"benchmark", "commit", "machine", "settings", "figures", "goals"}


def given(folder: Path) -> Arguments:
    return Arguments(None, True, folder / "run.json", folder / "run.png", 1, {})


def check_report(path: Path, benchmark: str) -> dict[str, Any]:
    report: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    assert set(report) == KEYS
    assert report["benchmark"] == benchmark
    assert report["machine"].keys() >= {"cpu", "cores", "python", "numpy", "numba", "gtsam", "factorloc"}
    assert report["figures"]
    for figure in report["figures"].values():
        assert figure.keys() - {"spread"} == {"value", "unit"}
    for goal in report["goals"]:
        assert goal.keys() == {"name", "value", "unit", "bound", "met"}
        assert isinstance(goal["met"], bool)
    return report


@pytest.mark.parametrize(
    ("goal", "met", "bound"),
    [
        (Goal("a", 1.6, "1", most=1.6), True, "<= 1.6"),
        (Goal("a", 1.6000001, "1", most=1.6), False, "<= 1.6"),
        (Goal("a", 0.5, "1", most=2.0, least=0.5), True, "0.5 to 2"),
        (Goal("a", 0.49, "1", most=2.0, least=0.5), False, "0.5 to 2"),
        (Goal("a", 96.0, "%", least=95.0), True, ">= 95"),
        (Goal("a", math.nan, "1", most=math.inf), False, "<= inf"),
    ],
)
def test_a_goal_is_met_within_its_bounds(goal: Goal, met: bool, bound: str) -> None:
    assert goal.met is met
    if math.isfinite(goal.value):
        assert goal.bound == bound


def test_a_run_is_one_json_object(tmp_path: Path) -> None:
    bench = Benchmark("mine", {"rounds": 3, "log": Path("a.log")})
    bench.figure("speed", 2.5, "ns/cell", (2.0, 3.0))
    bench.figure("nothing", math.nan, "m")
    bench.goal("speed", 2.5, "1", 3.0)
    assert bench.finish(given(tmp_path)) == 0
    report = check_report(tmp_path / "run.json", "mine")
    assert report["figures"]["speed"] == {"value": 2.5, "unit": "ns/cell", "spread": [2.0, 3.0]}
    assert report["figures"]["nothing"]["value"] is None
    assert report["goals"] == [{"name": "speed", "value": 2.5, "unit": "1", "bound": "<= 3", "met": True}]
    assert report["settings"] == {"rounds": 3, "log": "a.log"}


def test_the_exit_code_tells_of_a_missed_goal(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bench = Benchmark("mine", {})
    bench.figure("speed", 2.5, "1")
    assert bench.finish(given(tmp_path)) == 0  # no goal, none missed
    bench.goal("speed", 2.5, "1", 3.0)
    bench.goal("speed", 2.5, "1", 2.0)
    assert bench.finish(given(tmp_path)) == 1
    assert "no" in capsys.readouterr().out.split()


def test_files_are_written_whole_or_not_at_all(tmp_path: Path) -> None:
    bench = Benchmark("mine", {})
    bench.figure("speed", 2.5, "1")
    (tmp_path / "run.png").write_bytes(b"older")

    def refuse(target: Path, **_: object) -> None:
        Path(target).write_bytes(b"half")
        raise OSError(28, "No space left on device")

    with pytest.raises(FactorlocError, match="No space left"):
        bench.finish(given(tmp_path), SimpleNamespace(savefig=refuse))  # type: ignore[arg-type]
    assert (tmp_path / "run.png").read_bytes() == b"older"
    assert {path.name for path in tmp_path.iterdir()} == {"run.json", "run.png"}
    (tmp_path / "run.json").unlink()
    (tmp_path / "run.json").mkdir()
    with pytest.raises(FactorlocError, match="folder"):
        bench.finish(given(tmp_path))


def test_arguments_have_defaults_and_are_checked_before_the_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    chosen = arguments("mine", "Mine.", ["--data", str(tmp_path), "--sizes", "3", "4"], sizes=(1, 2), max_depth=5)
    assert chosen.options == {"sizes": [3, 4], "max_depth": 5}
    assert (chosen.data, chosen.quick) == (tmp_path, False)
    assert (chosen.json, chosen.plot) == (Path("out/mine.json"), Path("out/mine.png"))
    assert chosen.threads >= 1
    for wrong in (["--plot", "a.gif"], ["--data", str(tmp_path / "none")], ["--threads", "0"]):
        with pytest.raises(SystemExit) as stop:
            arguments("mine", "Mine.", wrong)
        assert stop.value.code == 2
        assert wrong[0] in capsys.readouterr().err


def test_data_is_optional_but_a_wrong_folder_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FACTORLOC_DATA", str(tmp_path))
    assert harness.default_data() == tmp_path
    monkeypatch.setenv("FACTORLOC_DATA", str(tmp_path / "none"))
    with pytest.raises(DataError, match="FACTORLOC_DATA"):
        harness.default_data()
    monkeypatch.delenv("FACTORLOC_DATA")
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "none"))
    monkeypatch.setenv("HOME", str(tmp_path / "none"))
    monkeypatch.setattr(harness, "_BESIDE_CHECKOUT", tmp_path)
    assert harness.default_data() == tmp_path
    monkeypatch.setattr(harness, "_BESIDE_CHECKOUT", tmp_path / "none")
    assert harness.default_data() is None


def test_an_error_of_the_package_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    @one_line_errors
    def main(argv: list[str] | None = None) -> int:
        raise DataError(f"{argv}: no such file")

    assert main(["a"]) == 2
    assert capsys.readouterr().err == "error: ['a']: no such file\n"


def test_the_machine_and_the_commit_are_known() -> None:
    facts = machine()
    assert all(facts.values())
    assert facts["numpy"] == np.__version__
    assert commit()


def test_competitors_take_turns() -> None:
    calls: list[str] = []
    functions = {name: lambda name=name: calls.append(name) for name in "abc"}
    seconds = interleave(functions, 3, lambda name: calls.append(name.upper()))
    # Each is prepared before its turn; a round to warm up, and then every competitor begins once.
    assert "".join(calls) == "CcAaBb" + "AaBbCc" + "BbCcAa" + "CcAaBb"
    assert list(seconds) == ["a", "b", "c"]
    assert all(times.shape == (3,) and (times >= 0).all() for times in seconds.values())


def test_only_the_competitor_is_timed() -> None:
    seconds = interleave({"a": lambda: time.sleep(0.02)}, 2, lambda _: time.sleep(0.3))
    assert (seconds["a"] >= 0.02).all()
    assert (seconds["a"] < 0.3).all()


def test_garbage_is_collected_again_after_a_failure() -> None:
    assert gc.isenabled()
    with pytest.raises(ZeroDivisionError):
        interleave({"a": lambda: 1 // 0}, 1)
    assert gc.isenabled()


def test_a_ratio_survives_a_machine_that_slows_down() -> None:
    drift = np.geomspace(1.0, 30.0, 9)
    seconds = {"own": 0.5 * drift, "other": drift}
    seconds["own"][4] *= 100  # somebody else's moment
    assert ratio(seconds, "own", "other") == pytest.approx(0.5)
    assert spread(np.arange(5.0)) == (1.0, 3.0)


@pytest.fixture(scope="module")
def walks() -> dict[str, Any]:
    returns = load_returns(None, OFFICE, scans=2)
    return {walk.name: walk for walk in all_walks(returns, build_reference(), 2)}


def test_all_walks_agree(walks: dict[str, Any]) -> None:
    assert raycast.check_agreement(list(walks.values())) > 1_000
    path, hits = walks["accumulation: factorloc, 1 thread"].results()
    rival = walks["accumulation: plain numba"].results()
    np.testing.assert_allclose(path, rival[0], atol=1e-3)
    assert hits.sum() == rival[1].sum()


def test_walks_that_disagree_are_not_timed(walks: dict[str, Any]) -> None:
    plain = walks["forward: plain numba"]
    wrong = SimpleNamespace(
        kind=plain.kind,
        label="wrong",
        name="forward: wrong",
        run=lambda: None,
        results=lambda: tuple(values * 1.001 for values in plain.results()),
    )
    with pytest.raises(MapError, match="forward: wrong"):
        raycast.check_agreement([plain, wrong])  # type: ignore[list-item]


def test_the_reference_is_left_out_without_a_compiler() -> None:
    assert build_reference(("no-such-compiler",)) is None
    returns = load_returns(None, OFFICE, scans=1)
    names = [walk.name for walk in all_walks(returns, None, 1)]
    assert not [name for name in names if "C++" in name or "2 threads" in name]


def test_kernels_of_benchmarks_call_none_but_the_package_s() -> None:
    # numba notices an edit in a kernel's own file, and the package's digest one in its own kernels; nothing else.
    for path in FOLDER.glob("_*kernels.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom):
                name = (node.module or "").rsplit(".", 1)[-1]
                assert node.module in ("__future__", "factorloc._jit") or (
                    (node.module or "").startswith("factorloc.") and name.endswith("_kernels")
                ), f"{path.name}: {node.module}"
            elif isinstance(node, ast.Import):
                assert {alias.name for alias in node.names} <= {"math", "numpy", "numpy.typing"}


@pytest.mark.parametrize(
    ("module", "options"),
    [(raycast, ["--log", OFFICE, "--scans", "2", "--rounds", "1"]), (solver, ["--sizes", "40", "--rounds", "1"])],
)
def test_a_quick_run_writes_its_report_and_its_picture(module: Any, options: list[str], tmp_path: Path) -> None:
    name = module.__name__.rsplit(".", 1)[-1]
    files = ["--json", str(tmp_path / "a" / "b.json"), "--plot", str(tmp_path / "a" / "b.svg")]
    code = module.main(["--quick", *options, *files])
    report = check_report(tmp_path / "a" / "b.json", name)
    assert code == (0 if all(goal["met"] for goal in report["goals"]) else 1)
    assert "<svg" in (tmp_path / "a" / "b.svg").read_text(encoding="utf-8")
    assert report["settings"]["quick"] is True
    assert {path.name for path in (tmp_path / "a").iterdir()} == {"b.json", "b.svg"}


def test_both_solvers_find_the_same_optimum(tmp_path: Path) -> None:
    bench = Benchmark("solver", {})
    for name, space in solver.SPACES.items():
        graph, initial = solver.chain(space, 60)
        assert initial.size() == 60
        assert graph.size() == 59 + 6 + 3
        solver.compare(bench, name, graph, initial, 1)
    optimum = [goal for goal in bench.goals if "costs" in goal.name]
    assert len(optimum) == 2
    assert all(goal.met for goal in optimum)


def test_bars_keep_their_colours() -> None:
    groups = {"one": [Bar("a", 1.0, (0.9, 1.1), bound=2.0), Bar("b", 2.0, (1.0, 3.0))], "two": [Bar("b", 1.0, (1, 1))]}
    first, second = plot_bars(groups, "ms").axes
    assert first.patches[1].get_facecolor() == second.patches[0].get_facecolor()
    assert first.patches[0].get_facecolor() != first.patches[1].get_facecolor()
    assert first.get_xlim()[1] > 3.0  # the quartiles lie inside


def test_every_benchmark_is_run_by_the_one_command() -> None:
    with_main = {
        path.stem
        for path in FOLDER.glob("[a-z]*.py")
        if any(isinstance(n, ast.FunctionDef) and n.name == "main" for n in ast.parse(path.read_text("utf-8")).body)
    }
    assert {run.module for run in everything.RUNS.values()} == with_main
    for run in everything.RUNS.values():
        assert callable(importlib.import_module(f"benchmarks.{run.module}").main)
    listed = (FOLDER / "README.md").read_text(encoding="utf-8")
    assert all(f"python -m benchmarks.{module}" in listed for module in with_main)


@pytest.fixture
def run_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., tuple[int, list[list[str]]]]:
    """Run the one command with faked benchmarks, which write the goals given."""
    monkeypatch.setattr(everything, "OUT", tmp_path)

    def run(goals: list[dict[str, Any]] | None, data: Path | None) -> tuple[int, list[list[str]]]:
        commands: list[list[str]] = []

        def fake(command: list[str], **_: object) -> subprocess.CompletedProcess[str]:
            commands.append(command)
            if goals is not None:
                report = Path(command[command.index("--json") + 1])
                report.write_text(json.dumps({"goals": goals}), encoding="utf-8")
            return subprocess.CompletedProcess(command, 0)

        monkeypatch.setattr(everything.subprocess, "run", fake)
        monkeypatch.setattr(everything, "default_data", lambda: data)
        return everything.main(["--quick"]), commands

    return run


@pytest.mark.parametrize(("value", "met", "code"), [(1.0, True, 0), (2.0, False, 1), (None, False, 1)])
def test_one_missed_goal_is_the_exit_code_of_all(
    run_all: Callable[..., Any], value: float | None, met: bool, code: int, tmp_path: Path
) -> None:
    goal = {"name": "speed", "value": value, "unit": "1", "bound": "<= 1.6", "met": met}
    done, commands = run_all([goal], tmp_path)
    assert done == code
    assert len(commands) == len(everything.RUNS)
    assert all(command[:2] == [sys.executable, "-m"] and "--quick" in command for command in commands)


def test_a_benchmark_that_fails_is_no_success(run_all: Callable[..., Any], tmp_path: Path) -> None:
    for name in everything.RUNS:  # what an earlier run has left
        (tmp_path / f"{name}.json").write_text('{"goals": []}', encoding="utf-8")
    assert run_all(None, tmp_path)[0] == 1


def test_without_data_only_what_needs_it_is_left_out(run_all: Callable[..., Any]) -> None:
    done, commands = run_all([], None)
    assert done == 0
    assert {command[2] for command in commands} == {
        f"benchmarks.{run.module}" for run in everything.RUNS.values() if not run.needs_data
    }
