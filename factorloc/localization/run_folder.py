"""Run folder: everything one localization leaves on disk, in standard formats."""

from __future__ import annotations

import json
import os
import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from factorloc._version import __version__
from factorloc.config import Block, write_config
from factorloc.errors import FactorlocError
from factorloc.evaluation import Report, absolute_errors, evaluate
from factorloc.files import atomic_path, write_text
from factorloc.mapping.brick_statistics import BrickStatistics
from factorloc.mapping.facade_map import FacadeMap
from factorloc.mapping.ray_statistics import RayStatistics
from factorloc.mapping.top_view import top_view
from factorloc.result import Bounds, Result
from factorloc.trajectory import Trajectory
from factorloc.viewer import (
    NullViewer,
    Viewer,
    plot_cost_history,
    plot_error_coloured_path,
    plot_errors_over_time,
    plot_map_and_trajectories,
    save_figure,
)
from factorloc.viewer.bounds_plot import plot_feasible_sets

__all__ = ["RunFolder", "new_run_folder"]

Array = npt.NDArray[np.float64]


def new_run_folder(root: Path | str) -> Path:
    """Make ``root/<UTC stamp>`` and let ``root/latest`` name it.

    Parameters
    ----------
    root : Path or str
        Folder of all runs; created.

    Raises
    ------
    FactorlocError
        If it cannot be written.
    """
    root = Path(root)
    stamp = datetime.now(UTC).strftime("%Y-%m-%d_%H-%M-%S")
    try:
        root.mkdir(parents=True, exist_ok=True)
        folder, number = root / stamp, 1
        while True:
            try:
                folder.mkdir()
                break
            except FileExistsError:
                number += 1
                folder = root / f"{stamp}_{number}"
        link = root / f".latest-{os.getpid()}"
        link.unlink(missing_ok=True)
        link.symlink_to(folder.name, target_is_directory=True)
        link.replace(root / "latest")
    except OSError as error:
        raise FactorlocError(f"{root}: cannot be written ({error.strerror}); choose another output") from error
    return folder


@dataclass(frozen=True)
class RunFolder:
    """Writes the files of one run.

    Parameters
    ----------
    folder : Path
        Where they go.
    plots : bool
        Whether figures are drawn.
    files : dict of str to Path
        What was written so far, by role.
    """

    folder: Path
    plots: bool = True
    files: dict[str, Path] = field(default_factory=dict)

    def write_settings(self, settings: Block) -> None:
        """Write the resolved settings, ``settings.json``."""
        self._wrote("settings", "settings.json")
        write_config(self.files["settings"], settings)

    def write_result(self, name: str, result: Result) -> None:
        """Write a trajectory as ``<name>.tum`` and ``<name>.kitti``, covariances as ``<name>_covariances.npy``."""
        self._wrote(f"{name} trajectory", f"{name}.tum")
        result.trajectory.write_tum(self.folder / f"{name}.tum")
        result.trajectory.write_kitti(self.folder / f"{name}.kitti")
        if result.trajectory.covariances is not None:
            with (
                atomic_path(self.folder / f"{name}_covariances.npy") as temporary,
                temporary.open("wb") as stream,
            ):
                np.save(stream, result.trajectory.covariances, allow_pickle=False)

    def write_bounds(self, name: str, bounds: Sequence[Bounds], violated: npt.ArrayLike) -> None:
        """Write feasible sets as ``<name>_bounds.json``: headings (rad), polygons (m), and what was violated."""
        self._wrote(f"{name} bounds", f"{name}_bounds.json")
        sets = [
            {"orientation": one.orientation, "polygons": [np.asarray(p).tolist() for p in one.polygons],
             "assumptions violated": bool(flag)}
            for one, flag in zip(bounds, np.asarray(violated), strict=True)
        ]  # fmt: skip
        write_text(self.files[f"{name} bounds"], json.dumps(sets) + "\n")

    def draw_bounds(self, facade_map: FacadeMap, name: str, result: Result) -> None:
        """Draw feasible sets and the trajectory over a facade map, ``bounds.png``."""
        if self.plots and result.bounds is not None:
            self._wrote("bounds figure", "bounds.png")
            figure = plot_feasible_sets(
                facade_map.facades.segments, result.bounds, {name: result.trajectory.positions[:, :2]},
                every=max(len(result.bounds) // 20, 1), attribution=facade_map.attribution,
            )  # fmt: skip
            save_figure(figure, self.files["bounds figure"])

    def write_account(self, results: Mapping[str, Result], **facts: Any) -> None:
        """Write ``run.json``: what ran, on what, how long, why it stopped and what was left out."""
        account = {
            "factorloc": __version__,
            "python": platform.python_version(),
            "written": datetime.now(UTC).isoformat(timespec="seconds"),
            **facts,
            "results": {
                name: {
                    "poses": len(result.trajectory),
                    "length_m": result.trajectory.length,
                    "cost": result.cost,
                    "iterations": result.iterations,
                    "stop": result.stop.value,
                    "seconds": result.seconds,
                    "rejected": result.rejected,
                    "residuals": {kind: float(values.sum()) for kind, values in result.residuals.items()},
                }
                for name, result in results.items()
            },
        }
        self._wrote("account", "run.json")
        write_text(self.files["account"], json.dumps(account, indent=2, default=str) + "\n")

    def write_evaluation(self, trajectories: Mapping[str, Trajectory], truth: Trajectory) -> dict[str, Report]:
        """Write ``metrics.json``, the errors of each trajectory against the truth, and return the reports."""
        reports = {name: evaluate(trajectory, truth) for name, trajectory in trajectories.items()}
        self._wrote("metrics", "metrics.json")
        metrics = {name: json.loads(report.to_json()) for name, report in reports.items()}
        write_text(self.files["metrics"], json.dumps(metrics, indent=2) + "\n")
        return reports

    def draw(
        self,
        statistics: RayStatistics | BrickStatistics,
        trajectories: Mapping[str, Trajectory],
        results: Mapping[str, Result],
        truth: Trajectory | None = None,
    ) -> None:
        """Draw the map with all paths, the costs, and with a truth the errors over time and along the last path."""
        viewer = Viewer(self.folder) if self.plots else NullViewer()
        grid = statistics.grid
        image = top_view(statistics)
        # Tracked and smoothed paths lie on each other at the scale of a map: the last result stands for all.
        shown = [name for name in trajectories if name not in results or name == list(results)[-1]]
        paths = {name: trajectories[name] for name in shown} | ({} if truth is None else {"truth": truth})
        self._drew(
            "map and paths",
            viewer.draw(
                "map",
                plot_map_and_trajectories,
                image,
                grid.extent,
                paths,
                reference=None if truth is None else "truth",
            ),
        )
        for name, result in results.items():
            if result.history:
                self._drew(f"cost of {name}", viewer.draw(f"cost_{name}", plot_cost_history, result))
        if truth is not None:
            errors = {name: absolute_errors(path, truth) for name, path in trajectories.items() if name in results}
            self._drew("errors over time", viewer.draw("errors", plot_errors_over_time, errors))
            last = list(errors)[-1]
            self._drew(
                f"errors along {last}",
                viewer.draw(
                    "error_path",
                    plot_error_coloured_path,
                    trajectories[last],
                    errors[last].translation,
                    image,
                    grid.extent,
                ),
            )

    def _wrote(self, role: str, name: str) -> None:
        self.files[role] = self.folder / name

    def _drew(self, role: str, path: Path | None) -> None:
        if path is not None:
            self.files[role] = path
