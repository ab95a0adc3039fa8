"""Figures, goals and tables of the sensor models, beside what was published of them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt
from rich.table import Table

from benchmarks.filter_study import FilterSettings
from benchmarks.harness import Benchmark
from benchmarks.held_out import ENDS, paired_p
from benchmarks.sensor_model_choices import (
    BARE,
    END_POINT,
    FILLED,
    FILLED_FMP,
    FMP,
    LEFT_OUT,
    MLM,
    NOISY,
    PUBLISHED,
    TYPES,
)
from benchmarks.sensor_models_findings import BEST, FIGURE_MODELS, Findings, new_table
from benchmarks.sensor_models_localization import filter_table, smoother_table

__all__ = ["report"]

Array = npt.NDArray[np.float64]

FORMS = (MLM, FMP, PUBLISHED, LEFT_OUT, FILLED, FILLED_FMP)

PUBLISHED_LIKELIHOOD = {"Campus": (1.21, 1.16), "Forest": (1.22, 1.31), "Park": (1.25, 1.27)}
PUBLISHED_DIVERGENCE = {"Campus": (1.24, 1.25), "Forest": (1.27, 1.82), "Park": (1.37, 1.59)}
PUBLISHED_TRUTH = {
    "Campus": (6.07e4, 6.99e4, 1.01e5),
    "Forest": (2.70e4, 3.33e4, 5.02e4),
    "Park": (1.11e8, 1.14e9, 1.16e9),
}
PUBLISHED_INVERSE = {"Campus": (1.87, 4.44, 2.09), "Forest": (0.96, 1.41, 1.14), "Park": (3.56, 4.64, 4.17)}


def report(bench: Benchmark, found: Findings, filters: FilterSettings, gain: float) -> Iterator[Table]:
    """Add all figures and goals, and return the tables."""
    if any(found.held_out(scene, BEST) for scene in found.scenes):
        for kind in TYPES:
            yield _likelihoods(bench, found, kind, gain)
        yield _ends(bench, found)
        yield _others(bench, found)
    if any(found.part(scene, BEST, "divergences") for scene in found.scenes):
        yield _ratios(bench, found)
        yield from _divergences(bench, found)
    if any(found.part(scene, BEST, "filters") for scene in found.scenes):
        for study in filters.studies:
            yield filter_table(bench, found, study.name)
    for scene in found.scenes:
        for model in FIGURE_MODELS:
            curve = found.curve(scene, model)
            if curve is not None:
                bench.figure(f"{scene}, figure 8.3, {model}: position error", curve.mean(), "m")
    smoothed = [scene for scene in found.scenes if f"{scene}/smoother" in found.values]
    if smoothed:
        yield smoother_table(bench, found, smoothed)


def _likelihoods(bench: Benchmark, found: Findings, kind: str, gain: float) -> Table:
    table = new_table(
        f"{kind}: nats per ray of held-out scans, MLM at its best floor (p: that FMP gains nothing; scans of a drive "
        f"are no independent samples, blocks of {found.block} are less dependent)",
        "scene", "floor", "MLM", "FMP", "gain", "p\nscans", "p\nblocks", "MLM, best\nunseen", "FMP, best\nunseen",
        "FMP,\npubl.", "FMP, leave-\none-out", "impossible by\nMLM bare, %",
    )  # fmt: skip
    for scene in found.scenes:
        worse, better = found.held_out(scene, f"{kind} {MLM}"), found.held_out(scene, f"{kind} {FMP}")
        bare = found.held_out(scene, f"{kind} {BARE}")
        if worse is None or better is None or bare is None:
            continue
        means = []
        for form in FORMS:
            one = found.held_out(scene, f"{kind} {form}")
            means.append(np.nan if one is None else one.mean)
            bench.figure(f"{scene}, {kind} {form}: nats per ray", means[-1], "nat")
        gained, share = better.mean - worse.mean, 100 * sum(bare.impossible) / sum(bare.rays)
        by_scan, by_block = (paired_p(better.nats, worse.nats, block) for block in (1, found.block))
        bench.figure(f"{scene}, {kind}: gain of FMP", gained, "nat")
        bench.figure(
            f"{scene}, {kind}: gain of FMP where both are the best in unseen space", means[5] - means[4], "nat"
        )
        bench.figure(f"{scene}, {kind}: p of the gain, scans", by_scan, "1")
        bench.figure(f"{scene}, {kind}: p of the gain, blocks", by_block, "1")
        bench.figure(f"{scene}, {kind} {BARE}: rays of likelihood zero", share, "%")
        bench.goal(f"{scene}, {kind}: gain of FMP per ray", gained, "nat", least=gain)
        floor = found.values[f"{scene}/choices"]["decay_floor" if kind == "DEC" else "reflection_floor"]
        table.add_row(
            scene, f"{floor:g}", f"{means[0]:.4f}", f"{means[1]:.4f}", f"{gained:+.4f}", f"{by_scan:.1e}",
            f"{by_block:.1e}", f"{means[4]:.4f}", f"{means[5]:.4f}", f"{means[2]:.4f}", f"{means[3]:.4f}",
            f"{share:.2f}",
        )  # fmt: skip
    return table


def _others(bench: Benchmark, found: Findings) -> Table:
    table = new_table(
        "nats per ray of held-out scans, other models, and what was chosen for them",
        "scene", "end point", "sigma, m", "noisy DEC", "sigma, m", "false, %",
        "returns from seen cells\nwithout hits, %",
    )  # fmt: skip
    for scene in found.scenes:
        end, noisy, best = (found.held_out(scene, model) for model in (END_POINT, NOISY, BEST))
        if end is None or noisy is None or best is None:
            continue
        made = found.values[f"{scene}/choices"]
        bench.figure(f"{scene}, {END_POINT}: nats per ray", end.mean, "nat")
        bench.figure(f"{scene}, {NOISY}: nats per ray", noisy.mean, "nat")
        share = 100 * best.counts[1] / sum(best.counts[:3])
        bench.figure(f"{scene}: returns from seen cells without hits", share, "%")
        table.add_row(
            scene, f"{end.mean:.4f}", f"{made['end_point_sigma']:g}", f"{noisy.mean:.4f}", f"{made['noise_sigma']:g}",
            f"{100 * made['false_rate']:g}", f"{share:.2f}",
        )  # fmt: skip
    return table


def _ends(bench: Benchmark, found: Findings) -> Table:
    """Where the gain comes from: what the rays of each kind add to the mean of all."""
    table = new_table(
        "where FMP gains over MLM: nats per ray of all rays, added by the rays of each kind (their share in %)",
        "scene", "model", *ENDS,
    )  # fmt: skip
    for scene in found.scenes:
        for kind in TYPES:
            worse, better = found.held_out(scene, f"{kind} {MLM}"), found.held_out(scene, f"{kind} {FMP}")
            if worse is None or better is None:
                continue
            cells, rays = [], sum(better.counts)
            for end, after, before, count in zip(ENDS, better.of_ends, worse.of_ends, better.counts, strict=True):
                added = (after - before) / rays
                bench.figure(f"{scene}, {kind}: gain of FMP, part of '{end}'", added, "nat")
                cells.append(f"{added:+.4f} ({100 * count / rays:.1f})")
            table.add_row(scene, kind, *cells)
    return table


def _ratios(bench: Benchmark, found: Findings) -> Table:
    table = new_table(
        "MLM to FMP, more than 1 is for FMP: ratios of log-likelihoods (table 8.2, where both are negative), and of "
        "divergences from the truth (8.24, table 8.3)",
        "scene", *(f"{kind}\n{what}" for kind in TYPES for what in ("log-lik.", "diverg.", "MLM, nat", "FMP, nat")),
    )  # fmt: skip
    for scene in found.scenes:
        cells = []
        for kind in TYPES:
            worse, better = (found.held_out(scene, f"{kind} {form}") for form in (MLM, FMP))
            ratio = np.nan
            if worse is not None and better is not None and max(worse.total, better.total) < 0:
                ratio = worse.total / better.total
                bench.figure(f"{scene}, {kind}: ratio of log-likelihoods", ratio, "1")
            sums = []
            for form in (MLM, FMP, BARE):
                values = np.asarray(found.part(scene, f"{kind} {form}", "divergences")["from_truth"])
                finite = np.isfinite(values)
                sums.append(float(values[finite].mean()) if finite.any() else np.nan)
                bench.figure(f"{scene}, {kind} {form}: divergence from the truth", sums[-1], "nat")
                bench.figure(f"{scene}, {kind} {form}: infinite divergences", 100 * (~finite).mean(), "%")
            bench.figure(f"{scene}, {kind}: ratio of divergences", sums[0] / sums[1], "1")
            shown = "-" if np.isnan(ratio) else f"{ratio:.2f}"
            cells += [shown, f"{sums[0] / sums[1]:.2f}", f"{sums[0]:.3g}", f"{sums[1]:.3g}"]
        table.add_row(scene, *cells)
    table.add_section()
    for name, likelihood in PUBLISHED_LIKELIHOOD.items():
        divergence = PUBLISHED_DIVERGENCE[name]
        cells = [text for k in (0, 1) for text in (f"{likelihood[k]}", f"{divergence[k]}", "", "")]
        table.add_row(f"published: {name}", *cells)
    return table


def _divergences(bench: Benchmark, found: Findings) -> Iterator[Table]:
    shown = (f"DEC {MLM}", f"REF {MLM}", END_POINT, f"DEC {FMP}", f"REF {FMP}", NOISY)
    heads = [model.split(",")[0] for model in shown]
    direct = new_table("D'(g||h) over all held-out scans (table 7.3a), nats", "scene", *heads)
    inverse = new_table("D(h||g), mean over scans (table 7.3b), nats", "scene", *heads)
    for scene in found.scenes:
        sums, means = [], []
        for model in (*shown, *(f"{kind} {BARE}" for kind in TYPES)):
            one = found.held_out(scene, model)
            total = np.nan if one is None else np.inf if any(one.impossible) else -one.total
            values = np.asarray(found.part(scene, model, "divergences")["to_truth"])
            known = np.isfinite(values)
            sums.append(total)
            means.append(float(values[known].mean()) if known.any() else np.nan)
            bench.figure(f"{scene}, {model}: D'(g||h)", total, "nat")
            bench.figure(f"{scene}, {model}: D(h||g)", means[-1], "nat")
            bench.figure(f"{scene}, {model}: scans no sample explains", 100 * (~known).mean(), "%")
        direct.add_row(scene, *(f"{value:.3g}" for value in sums[: len(shown)]))
        inverse.add_row(scene, *(f"{value:.2f}" for value in means[: len(shown)]))
    for table, published in ((direct, PUBLISHED_TRUTH), (inverse, PUBLISHED_INVERSE)):
        table.add_section()
        for name, figures in published.items():
            table.add_row(f"published: {name}", *(f"{value:.3g}" for value in figures), "", "", "")
        yield table
