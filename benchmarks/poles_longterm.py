"""Long-term localization among poles: 27 sessions of a town that changes over 15 months.

Poles vanish and appear, cars park elsewhere, leaves fall; and late, a row of construction barrels along a street
without any other pole is moved sideways, all barrels alike. The map is made of the first session; each session is
localized in it by the filter as published, from ten starts, and by the smoother, which learns from session to session
which landmarks still stand. Errors are taken each metre of the true path and averaged over runs, in the form of the
thesis (table 12.1). The filter is the control: if the barrels did not drag it along, the world would test nothing.

Scans are cast once and kept, as are the poles found in them: a second run takes minutes.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np
import numpy.typing as npt
from pydantic import Field
from rich.progress import track as progress_of

from benchmarks.harness import Benchmark, arguments, new_console, one_line_errors
from benchmarks.longterm_outcomes import COLUMNS, METHODS, LongtermBenchmark, Outcome
from benchmarks.longterm_picture import longterm_picture
from benchmarks.longterm_poles import detect, make_map
from benchmarks.longterm_preparation import prepare
from benchmarks.longterm_sessions import LongtermWorld, Recording, record
from factorloc.config import Block, read_config
from factorloc.factors import PoleDetections, PoleLandmarks
from factorloc.geometry import se3
from factorloc.localization import AroundPose
from factorloc.localization.moved_poles import visibility
from factorloc.localization.pole_filter import PoleFilterSettings, filter_poles
from factorloc.localization.pole_localization import PoleLocalization
from factorloc.localization.pole_persistence import PersistenceSettings, persistence
from factorloc.localization.pole_smoother import PoleSmootherSettings, smooth_poles
from factorloc.mapping.pole_likelihood import PoleLikelihood
from factorloc.mapping.pole_map import PoleMap
from factorloc.mapping.pole_mapping import PoleMappingSettings
from factorloc.simulation.poles import PoleKind

SETTINGS = Path(__file__).with_name("poles_longterm.json")

Array = npt.NDArray[np.float64]

_BESIDE = 12.0  # m; poses nearer to a moved barrel are beside the row
_HEADINGS = np.array([3, 4, 2])  # x, y and heading in the tangent space of SE(3)


class LongtermGoals(Block):
    """Bounds: m, deg, m, m of way, and how far off the control must be, m."""

    position: float
    angle: float
    limit: float
    way: float
    control: float


class LongtermSettings(LongtermWorld):
    """What ``poles_longterm.json`` holds: the world, and what is done in it.

    Parameters
    ----------
    mapping : PoleMappingSettings
        Local maps and the map.
    start : (float, float)
        Radius around the first true pose, m, and largest turn, deg.
    runs, smoother_runs : int
        Of each session, by the filter and by the smoother.
    filter : PoleFilterSettings
    smoother : PoleSmootherSettings
    persistence : PersistenceSettings
    goals : LongtermGoals
    """

    mapping: PoleMappingSettings
    start: tuple[float, float]
    runs: int = Field(gt=0)
    smoother_runs: int = Field(gt=0)
    filter: PoleFilterSettings
    smoother: PoleSmootherSettings
    persistence: PersistenceSettings
    goals: LongtermGoals

    @property
    def world(self) -> LongtermWorld:
        """The world alone: recordings do not follow from the rest."""
        return LongtermWorld(**{name: getattr(self, name) for name in LongtermWorld.model_fields})


@one_line_errors
def main(argv: list[str] | None = None) -> int:
    """Run the benchmark; the exit code is 1 if a goal is missed."""
    given = arguments(
        "poles_longterm", __doc__ or "", argv, settings=str(SETTINGS), cache="out/longterm", only=(-1,), runs=0
    )
    settings = read_config(given.options["settings"], LongtermSettings)
    numbers = _numbers(settings, given.options["only"], given.quick)
    runs = given.options["runs"] or (2 if given.quick else settings.runs)
    cache = Path(given.options["cache"])
    bench = LongtermBenchmark(
        "poles_longterm",
        {"quick": given.quick, "sessions run": numbers, "filter runs": runs, **settings.model_dump(mode="json")},
    )
    console, began = new_console(), time.perf_counter()
    wanted = sorted({0, *numbers})
    ready = prepare(wanted, settings.world, settings.mapping.poles, cache, given.threads)
    list(progress_of(ready, "scans and poles", total=len(wanted), console=console))
    town = settings.world.all_sessions
    recordings = {number: record(settings.world, number, cache, town.session) for number in wanted}
    others = [recordings[number] for number in numbers if number]
    pole_map, fractions = make_map(recordings[0], others, settings.world, settings.mapping, cache)
    found = {number: detect(recordings[number], settings.world, settings.mapping.poles, cache) for number in numbers}
    bench.figure("poles in the map", len(pole_map), "1")
    bench.figure("scans and poles", time.perf_counter() - began, "s")
    chronicle = Chronicle(pole_map, settings)
    outcomes: dict[int, dict[str, Outcome]] = {}
    for number in progress_of(numbers, "localization", console=console):
        outcomes[number] = chronicle.localize(recordings[number], found[number], runs)
    for number in numbers:
        bench.session(number, fractions.get(number, 0.0), outcomes[number])
    barrels = _moved_barrels(settings, numbers)
    summarize(bench, settings, recordings, outcomes, chronicle, barrels)
    bench.figure("whole experiment", (time.perf_counter() - began) / 60, "min")
    shown = max(barrels, default=numbers[-1])
    picture = longterm_picture(
        {n: {who: o.row()[0] for who, o in by.items()} for n, by in outcomes.items()},
        pole_map.positions, chronicle.distrusted.get(shown, np.zeros(0, np.int64)), recordings[shown].planar_truth,
        {who: (chronicle.paths[shown][who], o.position[0]) for who, o in outcomes[shown].items()}, shown,
    )  # fmt: skip
    return bench.finish(given, picture)


class Chronicle:
    """The map, and what is learned of its landmarks from session to session."""

    def __init__(self, pole_map: PoleMap, settings: LongtermSettings) -> None:
        self.settings, self.poles = settings, pole_map.poles
        f = settings.filter
        self.model = PoleLikelihood(pole_map.positions, f.sigma, f.epsilon, f.gate, f.resolution)
        self.sessions = ["survey"]
        # All that is known of the survey is that it found each of them.
        self.seen = [np.ones(len(self.poles), np.int64)]
        self.in_view = [np.ones(len(self.poles), np.int64)]
        self.distrusted: dict[int, npt.NDArray[np.int64]] = {}
        self.accounts: dict[int, PoleLocalization] = {}
        self.paths: dict[int, dict[str, Array]] = {}

    @property
    def trust(self) -> Array:
        """How likely each landmark still stands, (L,)."""
        counts = np.stack(self.seen, 1), np.stack(self.in_view, 1)
        return persistence(PoleMap(self.poles, *counts, tuple(self.sessions)), self.settings.persistence)

    def localize(self, recording: Recording, detections: PoleDetections, runs: int) -> dict[str, Outcome]:
        """Localize a session by both methods, and learn from the smoother."""
        s, truth = self.settings, recording.planar_truth
        start = AroundPose(truth[0], s.start[0], float(np.radians(s.start[1])))
        motions = se3.to_se2(recording.odometry)
        covariances = recording.covariances[:, _HEADINGS[:, None], _HEADINGS]
        landmarks = PoleLandmarks(self.poles, self.trust)
        outcomes = {who: Outcome() for who in METHODS}
        self.paths[recording.number] = {}
        for run in range(runs):
            filtered = filter_poles(
                landmarks, detections, motions, start, covariances=covariances, settings=s.filter, model=self.model,
                seed=1000 * recording.number + run,
            )  # fmt: skip
            outcomes["filter"].add(filtered.trajectory.poses, truth, filtered.seconds)
            self.paths[recording.number].setdefault("filter", filtered.trajectory.poses)
        for run in range(min(s.smoother_runs, runs)):
            # A start that is off by as much as those of the particles are, and known no better.
            rng = np.random.default_rng([s.seed, recording.number, run])
            off = AroundPose(start.sample(1, rng)[0], start.reach, start.heading)
            smoothed = smooth_poles(
                landmarks, detections, motions, off, covariances=covariances, settings=s.smoother, seed=run
            )
            path = smoothed.result.trajectory.poses
            outcomes["smoother"].add(path, truth, smoothed.result.seconds)
            if run == 0:
                self._learn(recording.number, smoothed, path, detections)
        return outcomes

    def _learn(self, number: int, done: PoleLocalization, path: Array, detections: PoleDetections) -> None:
        seen, in_view = visibility(
            path, detections, done.matches, self.poles.positions, self.settings.smoother.moved.reach
        )
        self.sessions.append(str(number))
        self.seen.append(seen)
        self.in_view.append(in_view)
        moved = [group.landmarks for group in done.moved]
        self.distrusted[number] = np.unique(np.concatenate([done.distrusted, *moved])).astype(np.int64)
        self.accounts[number] = done
        self.paths[number]["smoother"] = path


def summarize(
    bench: Benchmark,
    settings: LongtermSettings,
    recordings: dict[int, Recording],
    outcomes: dict[int, dict[str, Outcome]],
    chronicle: Chronicle,
    barrels: dict[int, tuple[Array, Array]],
) -> None:
    """Add means over sessions, what happened beside the barrels, and goals."""
    goals, spacing = settings.goals, settings.lidar.spacing
    rows = {who: np.array([by[who].row() for by in outcomes.values()]).mean(0) for who in METHODS}
    for who, row in rows.items():
        for name, value, unit in zip(COLUMNS, row, ("m", "m", "deg", "deg"), strict=True):
            bench.figure(f"{who}: {name}, all sessions", value, unit)
        longest = max(by[who].longest_above(goals.limit, spacing) for by in outcomes.values())
        bench.figure(f"{who}: longest way above {goals.limit:g} m", longest, "m")
        times = [
            len(recordings[n]) * spacing / settings.changes.speed / seconds
            for n, by in outcomes.items()
            for seconds in by[who].seconds
        ]
        bench.figure(f"{who}: speed", float(np.median(times)), "x real time")
    controls = []
    for number, (before, after) in barrels.items():
        truth = recordings[number].planar_truth
        beside = np.hypot(*(truth[:, None, :2] - after[None]).transpose(2, 0, 1)).min(1) < _BESIDE
        for who, outcome in outcomes[number].items():
            most = [float(errors[beside].max()) for errors in outcome.position]
            bench.figure(
                f"session {number}, beside the moved barrels: {who}, largest error", float(np.median(most)), "m"
            )
            if who == "filter":
                controls.append(min(most))
        near = np.hypot(*(chronicle.poles.positions[:, None] - before[None]).transpose(2, 0, 1)).min(1) < 0.5
        named = np.isin(np.flatnonzero(near), chronicle.distrusted[number])
        bench.figure(f"session {number}: moved barrels in the map", near.sum(), "1")
        bench.figure(f"session {number}: of those, named as moved or distrusted", named.sum(), "1")
        others = len(chronicle.distrusted[number]) - named.sum()
        bench.figure(f"session {number}: other landmarks named", others, "1")
    smoother = rows["smoother"]
    bench.goal("smoother: mean position error, all sessions", smoother[0], "m", goals.position)
    bench.goal("smoother: mean heading error, all sessions", smoother[2], "deg", goals.angle)
    longest = bench.figures[f"smoother: longest way above {goals.limit:g} m"][0]
    bench.goal(f"smoother: longest way above {goals.limit:g} m", longest, "m", goals.way)
    if controls:
        bench.goal(
            "control: filter beside the barrels, least of the largest errors", min(controls), "m", least=goals.control
        )


def _numbers(settings: LongtermSettings, only: tuple[int, ...], quick: bool) -> list[int]:
    if tuple(only) != (-1,):
        return sorted(number for number in set(only) if 0 <= number < settings.sessions)
    if quick:  # the first, one in the middle and those with the moved barrels
        moved = settings.changes.barrels_moved
        return sorted({1, settings.sessions // 2, *range(moved, settings.sessions)} & set(range(settings.sessions)))
    return list(range(settings.sessions))


def _moved_barrels(settings: LongtermSettings, numbers: list[int]) -> dict[int, tuple[Array, Array]]:
    """Barrels of each session in which they were moved: where they were before, and where they are, (B, 2)."""
    late = [number for number in numbers if number >= settings.changes.barrels_moved]
    if not late:
        return {}
    town = settings.world.all_sessions
    shift = np.array(town.barrel_vector[:2])
    stands = [(pole.x, pole.y) for pole in town.session(late[0]).poles if pole.kind is PoleKind.BARREL]
    after = np.array(stands)
    return dict.fromkeys(late, (after - shift, after))


if __name__ == "__main__":
    sys.exit(main())
