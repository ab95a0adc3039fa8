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
# # Localize among poles
#
# Posts, lamps, signs and trunks: a map of them takes some kilobytes and outlives parked cars, leaves and snow. A street
# is simulated and driven twice. Poles are mapped on the first drive; the second is localized among them, by the
# published particle filter and by smoothing.

# %%
# %matplotlib inline
import matplotlib.pyplot as plt
import numpy as np

import factorloc as fl
from factorloc.factors import PoleLandmarks
from factorloc.localization import filter_poles, smooth_poles
from factorloc.mapping import BY_EVIDENCE, PoleMapper, PoleMappingSettings, local_maps
from factorloc.simulation import hdl_32e
from factorloc.simulation.street import StreetSettings, street_route, street_scene

street = StreetSettings(length=120.0)
scene = street_scene(street, seed=3)
first, second = (
    fl.simulate_drive(scene.world, street_route(street, speed=6.0), hdl_32e(), seed=seed, period=0.25)
    for seed in (1, 2)
)
print(f"{len(first)} scans and {len(second)}, {first.truth.length:.0f} m each")

# %% [markdown]
# ## The map
#
# Every few metres of the way make a local map of occupied and free cells, in which what stands upright and free is a
# pole. `seen` and `in_view` count in how many local maps each was found, and in how many it could have been.

# %%
mapper = PoleMapper(PoleMappingSettings(poles=BY_EVIDENCE))
mapper.add("first", first.scans, first.truth)
pole_map = mapper.finish()
truth = np.array([[pole.x, pole.y] for pole in scene.poles])
true_map = np.linalg.norm(pole_map.positions[:, None] - truth, axis=2).min(1) < 0.25
print(f"{len(pole_map)} poles in the map, {true_map.sum()} of them true")

# %%
figure, axes = plt.subplots(figsize=(9, 3.5))
axes.plot(*truth.T, "o", mfc="none", color="0.5", label="poles of the street")
drawn = axes.scatter(*pole_map.positions.T, c=pole_map.detection_rates, s=12, zorder=3, label="map")
axes.plot(*first.truth.positions[:, :2].T, lw=1, label="first drive")
axes.set(aspect="equal", xlabel="x (m)", ylabel="y (m)")
axes.legend(loc="upper right", fontsize=8)
figure.colorbar(drawn, label="found / in view")
# %% [markdown]
# ## The second drive
#
# A vehicle knows its motions, not its place: local maps are laid along odometry.

# %%
poses = [second.truth.poses[0]]
for motion in second.odometry:
    poses.append(fl.se3.compose(poses[-1], motion))
driven = fl.Trajectory(second.truth.stamps, np.stack(poses), world="odometry")
found = list(local_maps(second.scans, driven, BY_EVIDENCE))
references = np.stack([each.T_world_reference for each in found])
motions = fl.se2.between(references[:-1], references[1:])
detections = [each.poles for each in found]
print(f"{len(found)} local maps with {np.mean([len(poles) for poles in detections]):.1f} poles each")

# %%
landmarks = PoleLandmarks(pole_map.poles)
at = [int(each.scans[-1]) for each in found]
truth_there = second.truth.to_2d()
start = fl.se2.compose(truth_there.poses[at[0]], [1.5, -1.0, 0.05])
stamps = truth_there.stamps[at]
smoothed = smooth_poles(landmarks, detections, motions, start, stamps=stamps)
filtered = filter_poles(landmarks, detections, motions, start, stamps=stamps)
for name, result in {"filter": filtered, "smoother": smoothed.result}.items():
    error = np.linalg.norm(result.trajectory.poses[:, :2] - truth_there.poses[at, :2], axis=1)
    print(f"{name}: mean {error.mean():.3f} m, largest {error.max():.3f} m")
print(smoothed.account() or "every landmark agrees with odometry")
