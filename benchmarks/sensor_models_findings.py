"""What was found of the sensor models, and how it is shown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from rich.table import Table

from benchmarks.harness import Benchmark
from benchmarks.held_out import HeldOut
from benchmarks.sensor_model_choices import END_POINT, FIELD, FMP, MLM, NOISY, TYPES

__all__ = ["BEST", "COMPARED", "FIGURE_MODELS", "FILTERED", "Findings", "ModelsBenchmark", "new_table"]

Array = npt.NDArray[np.float64]

BEST = f"DEC {FMP}"
FILTERED = (BEST, f"DEC {MLM}", f"REF {FMP}", f"REF {MLM}", FIELD)
"""Models that weigh particles."""
FIGURE_MODELS = (f"DEC {MLM}", BEST)
COMPARED = (*(f"{kind} {form}" for kind in TYPES for form in (MLM, FMP)), END_POINT, NOISY)


class ModelsBenchmark(Benchmark):
    """Figures in tables of their own.

    Parameters
    ----------
    tables : list of Table
        To print.
    """

    tables: list[Table]

    def _figure_table(self) -> Table:
        page = Table.grid(pad_edge=False)
        for table in self.tables:
            page.add_row(table)
            page.add_row("")
        return page


class Findings:
    """Records, by scene.

    Parameters
    ----------
    values : mapping of str to object
        Records by ``scene/model``.
    scenes : sequence of str
    block : int
        Scans that count as one in tests.
    """

    def __init__(self, values: Mapping[str, Any], scenes: Sequence[str], block: int) -> None:
        self.values, self.scenes, self.block = values, scenes, block

    def part(self, scene: str, model: str, part: str) -> Any:
        """What was found of a model in a part; None if that was left out."""
        return self.values.get(f"{scene}/{model}", {}).get(part)

    def held_out(self, scene: str, model: str) -> HeldOut | None:
        """Log-likelihoods of held-out scans."""
        found = self.part(scene, model, "held-out")
        return None if found is None else HeldOut(**found)

    def errors(self, scene: str, model: str, study: str) -> Array | None:
        """Mean position error of each run, m."""
        found = self.part(scene, model, "filters")
        return None if found is None else np.asarray(found[study]).mean(1)

    def curve(self, scene: str, model: str) -> Array | None:
        """Position errors of figure 8.3, m, shape (runs, scans)."""
        found = self.part(scene, model, "figure")
        return None if found is None else np.asarray(found)


def new_table(title: str, *columns: str) -> Table:
    """A table of numbers, with names in its first column."""
    table = Table(columns[0], title=title, title_justify="left")
    for column in columns[1:]:
        table.add_column(column, justify="right")
    return table
