# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # Localize a drive
#
# A building is simulated, driven twice, mapped on the first drive and localized in on the second. Every step is one
# call; with a log of your own, replace the simulation by `fl.open_drive(path)`.

# %%
# %matplotlib inline
import numpy as np

import factorloc as fl
from factorloc.evaluation import absolute_errors
from factorloc.factors import DecayRateTerm
from factorloc.localization import register_many
from factorloc.mapping import BlurPyramid
from factorloc.viewer import plot_error_coloured_path, plot_errors_over_time, plot_map_and_trajectories

plan, (first_route, second_route) = fl.office_plan(), fl.office_routes()
first = fl.simulate_drive(plan, first_route, seed=1)
second = fl.simulate_drive(plan, second_route, seed=2)

# %% [markdown]
# ## The map
#
# Rays leave hits, misses and path lengths in the cells they cross. Glass and plants show as grey: they stop some rays.

# %%
statistics = fl.RayStatistics.from_scans(first.scans, first.truth.poses, resolution=0.1)
rates = fl.DecayRateMap.from_statistics(statistics)
image = rates.reflection_probability()
image[statistics.path_fixed == 0] = np.nan
plot_map_and_trajectories(image, statistics.grid.extent, {"first drive": first.truth})

# %% [markdown]
# ## One scan
#
# From far away the fine map only confuses; on a blurred one the scan finds its way. These are the starts around one
# scan from which it comes home.

# %%
term = DecayRateTerm(BlurPyramid.from_statistics(statistics), second.scans[40:41])
truth = second.truth.poses[40]
angles = np.linspace(0, 2 * np.pi, 16, endpoint=False)
for radius, turn in [(0.5, 5), (1.0, 10), (2.0, 20)]:
    offsets = np.column_stack(
        [radius * np.cos(angles), radius * np.sin(angles), np.radians(turn) * (-1) ** np.arange(16)]
    )
    found = register_many(term, truth + offsets)
    home = np.hypot(*(found.poses - truth)[:, :2].T) < 0.1
    print(f"{radius} m, {turn} degrees: {home.mean():.0%} come home")

# %% [markdown]
# ## The drive
#
# Tracking knows the past; smoothing knows all of it.

# %%
start = fl.se2.compose(second.truth.poses[0], [0.7, -0.5, 0.15])
run = fl.localize(statistics, second.scans, second.odometry, start)
print(run.smoothed.summary())
print(fl.evaluate(run.smoothed.trajectory, second.truth).to_text())

# %%
errors = {
    name: absolute_errors(result.trajectory, second.truth)
    for name, result in {"tracked": run.tracked, "smoothed": run.smoothed}.items()
}
plot_errors_over_time(errors)

# %%
plot_error_coloured_path(run.smoothed.trajectory, errors["smoothed"].translation, image, statistics.grid.extent)

# %% [markdown]
# ## Which model?
#
# The same scans at the same true poses, judged by three models of one map: the mean log-likelihood a ray, in nats.
# Maximum likelihood excludes what it has not seen (minus infinity); the posterior does not.

# %%
posterior = fl.DecayRatePosterior.from_statistics(statistics)
for name, model in {"maximum likelihood": rates, "posterior": posterior}.items():
    rays = np.concatenate([model.log_likelihood(s, p) for s, p in zip(second.scans, second.truth.poses, strict=True)])
    print(f"{name}: {rays.mean():.3f} nats a ray, {np.isinf(rays).mean():.2%} of the rays excluded")
