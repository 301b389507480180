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
# `rc.read` tells the format by the content. With NGSIM files only the list of files changes. Inside, everything is
# in metres and seconds; *x* grows downstream and *y* to the left.

# %%
from pathlib import Path

import numpy as np
import polars as pl

import rampcast as rc
from rampcast.paper import LstmSpec, PaperSpec, evaluate, fit_paper

pl.Config(tbl_hide_dataframe_shape=True, tbl_hide_column_data_types=True, tbl_rows=16, tbl_cols=12)
out = Path("out/tutorial")
out.mkdir(parents=True, exist_ok=True)

raw = rc.read(rc.shipped_sample())
print(f"{raw.site.title}: {raw.tracks.height:,} rows of the windows {', '.join(raw.names)}")
print(raw.tracks.select("recording", "vehicle", "frame", "x", "y", "lane", "length", "kind").head(3))

# %% [markdown]
# A recording is one polars table and the *site* it was made at. The site knows the lanes, where the ramp begins and
# ends, and the line that a merging vehicle crosses; a site of your own is [one text
# file](sites.md#a-site-of-your-own).

# %%
site = raw.site
print(f"ramp lane {site.ramp_lanes}, target lane {site.target_lane}, gore {site.gore} m, ramp end {site.ramp_end} m")

# %% [markdown]
# ## 2. Look
#
# `rc.inspect` counts what is in a recording, `rc.doctor` says [what is wrong with it](doctor.md), where, and what to
# do; `rc.plot` draws it.

# %%
print(rc.inspect(raw))
print(rc.doctor(raw).to_polars().select("severity", "title", "count", "share"))
rc.plot(raw).savefig(out / "recording.png", dpi=80)

# %% [markdown]
# ![Tracks of some simulated vehicles over their site](images/tutorial_recording.png)
#
# ## 3. Smooth
#
# `rc.clean` fills skipped frames, smooths the positions, derives velocities and accelerations from them, and keeps a
# row every 0.2 s. Its second result tells what that changed. (A real NGSIM recording changes far more than this
# simulated one.)

# %%
smoothed, changes = rc.clean(raw)
print(f"{changes.filled_rows} rows filled in, {changes.short_tracks} tracks too short to smooth")
print(f"x moved by {changes.mean_shift_x:.3f} m on average, by {changes.largest_shift_x:.2f} m at most")

# %% [markdown]
# ## 4. Fit
#
# *rampcast* learns how drivers follow and merge, and drives all vehicles around into the future together. With a
# training moment at every 20 s that takes a minute; leave `every` out for the full training.

# %%
training, test = smoothed.window("simulated-1"), smoothed.window("simulated-2")
forecaster = rc.fit(training, every=20.0)
print(f"trained on {', '.join(forecaster.trained_on)} of the site '{forecaster.site.name}'")

# %% [markdown]
# ## 5. Predict
#
# `predict` takes a recording and forecasts every vehicle on the ramp, here at every 15th second, from the past alone:
# the states come from the raw rows up to that moment `t0`, which the smoothed recording keeps. The result holds a
# position at every 0.2 s with quantiles, the probability of a lane change *within* and *at*
# each second, the gap that it merges into, and conflicts ([all columns](forecast_files.md)).

# %%
forecast = forecaster.predict(test, every=15.0)
print(forecast.position_table().select("vehicle", "t0", "horizon", "x", "x_q05", "x_q95").head(3))
print(forecast.lane_change_table().head(4))
print(forecast.gap_table().filter(pl.col("p") > 0).head(3))

# %% [markdown]
# ## 6. Look at one
#
# The first vehicle that is as likely as not to have merged within 8 s, and what it did.

# %%
likely = forecast.lane_change_table().filter(pl.col("t") == 8.0, pl.col("p_within").is_between(0.4, 0.6))
vehicle, t0 = likely.select("vehicle", "t0").row(0)
rc.plot(forecast, vehicle=vehicle, t0=t0, truth=test).savefig(out / "forecast.png", dpi=130)

# %% [markdown]
# ![One forecast of a simulated vehicle and what it did](images/tutorial_forecast.png)
#
# ## 7. Evaluate, beside the paper
#
# The paper's framework stands beside ours: two LSTMs that predict the neighbours (ramp lane, target lane),
# car-following laws fitted to each vehicle's own 4 s, and 32 random forests that classify lane changes. Its mode
# "paper" is the paper as printed, made computable; "corrected" repairs what is [wrong in it](methods.md#errata).
#
# `evaluate` refuses windows that were trained on. It gives tidy tables: one row for each model and second ahead,
# with `n`, the number of forecasts whose truth was seen. Always read the two baselines first: a model that does not
# beat *constant velocity* has learnt nothing that matters, and *constant_speed_leader* is IDM behind neighbours
# that simply keep their speed.

# %%
lstm = LstmSpec(units=32, epochs=6, batch=128, learning_rate=5e-3, decay=0.7)
quick = PaperSpec(lstm=lstm, window_stride=20, anchor_spacing=2.0, trees=20)  # PaperSpec() trains in full
paper = fit_paper(training, mode="corrected", spec=quick)
result = evaluate([forecaster, paper], test, every=15.0)
central = result.tables["longitudinal"].filter(pl.col("group") == "central")
at_5_s = central.filter(pl.col("horizon") == 5.0).select("model", "n", "within_5", "within_10", "mean_error", "bias")
print(at_5_s.with_columns(pl.col(pl.Float64).round(2)))
print(", ".join(result.tables))

# %% [markdown]
# ## 8. Save and load
#
# A model folder holds plain data (no pickled code), the training data's hash and the versions it was made with.
# Later releases read it too.

# %%
rc.save(forecaster, out / "model")
again = rc.load(out / "model").predict(test, every=15.0)
print("same forecast after loading:", np.array_equal(again.x["rampcast"], forecast.x["rampcast"]))

# %% [markdown]
# ## Your own data
#
# Replace the first step, and leave the training at its defaults:
#
# ```text
# raw = rc.read(["trajectories-0400-0415.txt", "trajectories-0500-0515.txt", "trajectories-0515-0530.txt"])
# training = concatenate([smoothed.window("i80-1"), smoothed.window("i80-3")])   # from rampcast.recording
# forecaster = rc.fit(training)
# result = evaluate([forecaster], smoothed.window("i80-2"))
# ```
#
# Next: [reproduce the paper with the original files](reproducing.md), or [choose a model](choosing_a_model.md).
