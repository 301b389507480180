# %% [markdown]
# # Tutorial
#
# From a recording to a scored forecast, in eight short steps. The code is one script, `docs/tutorial.py`: run it as
# it is (`python docs/tutorial.py`), or step through it in any editor that knows `# %%` cells. It uses the
# **simulated** recordings that ship with rampcast, so you need no data, and it trains for a minute only: the numbers
# show how to read the results, not how well real traffic can be forecast.
#
# ## 1. Read
#
# `read_any` tells the format by the content. With NGSIM files only the list of files changes. Inside, everything is
# in metres and seconds; *x* grows downstream and *y* to the left.

# %%
from pathlib import Path

import numpy as np
import polars as pl

from rampcast.forecast import ForecasterSpec, fit, load, save
from rampcast.formats import read_any
from rampcast.paper import LstmSpec, PaperSpec, evaluate, fit_paper
from rampcast.paper.examples import scene_tracks
from rampcast.paper.protocol import shown
from rampcast.paper.scenes import build_scenes
from rampcast.plots.tracks import plot_forecast
from rampcast.recording import clean
from rampcast.simulate import shipped_sample

pl.Config(tbl_hide_dataframe_shape=True, tbl_hide_column_data_types=True, tbl_rows=16, tbl_cols=12)
out = Path("out/tutorial")
out.mkdir(parents=True, exist_ok=True)

raw, report = read_any(shipped_sample())
print(f"{raw.site.title}: {report.rows:,} rows of the windows {', '.join(raw.names)}")
print(raw.tracks.select("recording", "vehicle", "frame", "x", "y", "lane", "length", "kind").head(3))

# %% [markdown]
# A recording is one polars table and the *site* it was made at. The site knows the lanes, where the ramp begins and
# ends, and the line that a merging vehicle crosses; a site of your own is [one text
# file](sites.md#a-site-of-your-own).

# %%
site = raw.site
print(f"ramp lane {site.ramp_lanes}, target lane {site.target_lane}, gore {site.gore} m, ramp end {site.ramp_end} m")

# %% [markdown]
# ## 2. Smooth
#
# `clean` fills skipped frames, smooths the positions, derives velocities and accelerations from them, and keeps a
# row every 0.2 s. Its second result tells what that changed. (A real NGSIM recording changes far more than this
# simulated one.)

# %%
smoothed, changes = clean(raw)
print(f"{changes.filled_rows} rows filled in, {changes.short_tracks} tracks too short to smooth")
print(f"x moved by {changes.mean_shift_x:.3f} m on average, by {changes.largest_shift_x:.2f} m at most")

# %% [markdown]
# ## 3. Scenes
#
# A *scene* is a question: a vehicle on the ramp at some moment `t0`, the last 4 s of it and of its six neighbours,
# and, for scoring, the next 15 s. Here a scene is made for every on-ramp vehicle at every 15th second. Where no
# vehicle fills a slot it is marked *virtual*; where the truth was not seen, `future_valid` is False.

# %%
training, test = smoothed.window("simulated-1"), smoothed.window("simulated-2")
scenes = build_scenes(test, every=15.0)
seen = scenes.future_valid[:, 0].all(axis=1)  # slot 0 is the central vehicle
print(f"{len(scenes)} scenes; the next 15 s were seen in {seen.sum()} of them")
print(f"past: {scenes.past.shape} (scene, slot, step, feature), future: {scenes.future.shape}")

# %% [markdown]
# ## 4. Fit
#
# *rampcast* learns how drivers follow and merge, and drives all vehicles around into the future together. The paper's
# framework stands beside it: two LSTMs that predict the neighbours (ramp lane, target lane), car-following laws fitted
# to each vehicle's own 4 s, and 32 random forests that classify lane changes. Its mode "paper" is the paper as printed,
# made computable; "corrected" repairs what is [wrong in it](methods.md#errata). The specs below train for a minute;
# without them the training is full.

# %%
forecaster = fit(training, spec=ForecasterSpec(spacing=20.0))
lstm = LstmSpec(units=32, epochs=6, batch=128, learning_rate=5e-3, decay=0.7)
quick = PaperSpec(lstm=lstm, window_stride=20, anchor_spacing=2.0, trees=20)
paper = fit_paper(training, mode="corrected", spec=quick)
print(f"trained on {forecaster.trained_on}; last loss of the target lane's LSTM: {paper.target.losses[-1]:.4f}")

# %% [markdown]
# ## 5. Predict
#
# `predict` takes a recording, and no model sees what comes after t0. (The smoothing has looked 1 s ahead; the methods
# page, section 2, says how much that helps.) The result holds a position at every 0.2 s with quantiles, the probability
# of a lane change *within* and *at* each second, the gap that it merges into, and conflicts ([all
# columns](forecast_files.md)); of the paper's framework positions by every model, and lane changes.

# %%
forecast = forecaster.predict(test, every=15.0)
print(forecast.position_table().select("vehicle", "t0", "horizon", "x", "x_q05", "x_q95").head(3))
print(forecast.lane_change_table().head(4))
print(forecast.gap_table().filter(pl.col("p") > 0).head(3))

# %% [markdown]
# ## 6. Look at one
#
# The first scene whose next 15 s were seen and whose vehicle crosses the lane line later than 3 s from now. Grey is
# the past, black is what the vehicle did, and the coloured lines are what was forecast at t = 0.

# %%
number = int(np.flatnonzero(seen & (scenes.change_crossing > 3.0))[0])
vehicle, t0 = int(forecast.vehicle[number]), float(forecast.t0[number])
probability = forecast.lane_change_table().filter(pl.col("vehicle") == vehicle, (pl.col("t0") - t0).abs() < 0.1)
picture = plot_forecast(
    scene_tracks(number, scenes, shown([forecast, paper.predict(test, every=15.0)])),
    lane_change=probability,
    ramp_end=site.ramp_end,
    title=f"simulated vehicle {vehicle}, t0 = {t0:.1f} s",
)
picture.savefig(out / "forecast.png", dpi=130)

# %% [markdown]
# ![One forecast of a simulated vehicle and what it did](images/tutorial_forecast.png)
#
# ## 7. Evaluate
#
# `evaluate` refuses windows that were trained on. It gives tidy tables: one row for each model and second ahead,
# with `n`, the number of forecasts whose truth was seen. Always read the two baselines first: a model that does not
# beat *constant velocity* has learnt nothing that matters, and *constant_speed_leader* is IDM behind neighbours
# that simply keep their speed.

# %%
result = evaluate([forecaster, paper], test, every=15.0)
central = result.tables["longitudinal"].filter(pl.col("group") == "central")
at_5_s = central.filter(pl.col("horizon") == 5.0).select("model", "n", "within_5", "within_10", "mean_error", "bias")
print(at_5_s.with_columns(pl.col(pl.Float64).round(2)))
print(", ".join(result.tables))

# %% [markdown]
# ## 8. Save and load
#
# A model folder holds plain data (no pickled code), the training data's hash and the versions it was made with.
# `load` refuses a folder of another version of rampcast.

# %%
save(forecaster, out / "model")
again = load(out / "model").predict(test, every=15.0)
print("same forecast after loading:", np.array_equal(again.x["rampcast"], forecast.x["rampcast"]))

# %% [markdown]
# ## Your own data
#
# Replace the first step, and leave the training at its defaults:
#
# ```text
# raw, report = read_any(["trajectories-0400-0415.txt", "trajectories-0500-0515.txt", "trajectories-0515-0530.txt"])
# training = concatenate([smoothed.window("i80-1"), smoothed.window("i80-3")])   # from rampcast.recording
# forecaster = fit(training)
# result = evaluate([forecaster], smoothed.window("i80-2"))
# ```
#
# Next: [reproduce the paper with the original files](reproducing.md), or [choose a model](choosing_a_model.md).
