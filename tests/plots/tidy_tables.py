"""Tidy tables of the shape that rampcast.evaluate writes, with made-up numbers that look like results."""

import itertools

import numpy as np
import polars as pl

MODES = ("paper", "corrected")
LAWS = {
    "idm": (("s_0", "m"), ("h_d", "s"), ("A", "m/s^2"), ("B", "m/s^2"), ("v_d", "m/s"), ("delta", "")),
    "gipps_paper": (("alpha", ""), ("beta", ""), ("gamma", "")),
    "ghr": (("alpha", ""), ("beta", ""), ("gamma", "")),
    "gipps": (("a_n", "m/s^2"), ("b_n", "m/s^2"), ("V_n", "m/s"), ("tau", "s")),
}
ERROR_AT_15 = {
    "rampcast": 9.0,
    "idm": 18.0,
    "gipps_paper": 16.0,
    "ghr": 24.0,
    "gipps": 15.0,
    "lstm_alone": 28.0,
    "constant_velocity": 19.0,
    "constant_speed_leader": 17.0,
}
SLOTS = ("leader", "follower", "target_leader_1", "target_leader_2", "target_follower_1", "target_follower_2")


def longitudinal() -> pl.DataFrame:
    """Returns errors of every model and group that grow with the horizon."""
    cases = [("central", model, error) for model, error in ERROR_AT_15.items()]
    cases += [("ramp_neighbour", "lstm", 22.0), ("target_neighbour", "lstm", 26.0)]
    cases += [("ramp_neighbour", "constant_velocity", 19.0), ("target_neighbour", "constant_velocity", 20.0)]
    rows = []
    for mode, (group, model, last), horizon in itertools.product(MODES, cases, range(1, 16)):
        if (mode, model) == ("paper", "rampcast"):
            continue
        error = (last if mode == "paper" else 0.8 * last) * (horizon / 15.0) ** 1.4
        near = {k: float(1.0 - np.exp(-((k / (0.55 * error + 0.2)) ** 1.3))) for k in (5.0, 10.0)}
        rows.append(
            {
                "mode": mode,
                "group": group,
                "model": model,
                "horizon": float(horizon),
                "n": (258 if mode == "paper" else 4000 - 200 * horizon) * (3 if group == "target_neighbour" else 1),
                "within_5": near[5.0],
                "within_10": near[10.0],
                "mean_error": error,
                "bias": -0.3 * error,
            }
        )
    return pl.DataFrame(rows)


def parameters() -> pl.DataFrame:
    """Returns made-up distributions of fitted parameters and of the squared error."""
    rows = []
    for mode, (law, names) in itertools.product(MODES, LAWS.items()):
        squared = (("mse", "m^2/s^4"), ("mse_none_abreast", "m^2/s^4"))
        for i, (name, unit) in enumerate((*names, *squared)):
            is_error = name.startswith("mse")
            bounds = {"low": None, "high": None} if is_error else {"low": -5.0 + i, "high": 5.0 + i}
            middle = {"mean": 0.12, "median": 0.05} if is_error else {"mean": 1.5 + i, "median": 1.0 + i}
            key = {"mode": mode, "law": law, "parameter": name, "unit": unit}
            n = 258 if name != "mse_none_abreast" else 251
            rows.append(key | bounds | {"n": n} | middle | {"standard_deviation": 0.7})
    return pl.DataFrame(rows, infer_schema_length=None)


def outcomes() -> pl.DataFrame:
    """Returns how many fits ended in which way."""
    counts = {"converged": 180, "at_bound": 60, "no_leader": 12, "too_few_points": 6}
    rows = [
        {"mode": mode, "law": law, "outcome": outcome, "n": n}
        for mode, law, (outcome, n) in itertools.product(MODES, LAWS, counts.items())
    ]
    return pl.DataFrame(rows)


def lane_change() -> pl.DataFrame:
    """Returns classification metrics; at t = 0 nothing can change lane within t and the rates are undefined."""
    cases = [("paper", "forests", "label")]
    cases += [("corrected", model, reading) for model in ("rampcast", "forests") for reading in ("label", "crossing")]
    rows = []
    for (mode, model, reading), sampling, kind, t in itertools.product(
        cases, ("balanced", "natural"), ("within", "at"), range(16)
    ):
        accuracy = 0.92 + 0.05 * np.cos(t / 2.5) if kind == "within" else 0.95 - 0.014 * t
        n = 240 if sampling == "balanced" else 4000
        rate = 0.5 if sampling == "balanced" else (0.05 * t if kind == "within" else 0.01)
        positives = round(n * rate)
        rows.append(
            {
                "mode": mode,
                "model": model,
                "reading": reading,
                "sampling": sampling,
                "kind": kind,
                "t": float(t),
                "n": n,
                "positives": positives,
                "accuracy": accuracy,
                "tpr": accuracy - 0.04 if positives else None,
                "tnr": accuracy + 0.02,
                "ppv": (accuracy + 0.03 if sampling == "balanced" else 0.02 + 0.06 * t) if positives else float("nan"),
                "npv": accuracy - 0.03,
                "best_accuracy": accuracy + 0.01,
                "brier_skill": 0.5 - 0.02 * t,
            }
        )
    return pl.DataFrame(rows, infer_schema_length=None)


def importance() -> pl.DataFrame:
    """Returns importances that sum to 1 per t and grouping."""
    groups = {
        "feature": {"x": 0.22, "y": 0.36, "v": 0.16, "u": 0.1, "a": 0.09, "e": 0.07},
        "vehicle": {"target": 0.55, "central": 0.27, "ramp": 0.18},
    }
    rows = []
    for mode, kind, t, (grouping, shares) in itertools.product(MODES, ("within", "at"), range(16), groups.items()):
        raw = {group: share * (1.0 + 0.15 * np.sin(t + i)) for i, (group, share) in enumerate(shares.items())}
        key = {"mode": mode, "kind": kind, "t": float(t), "grouping": grouping}
        rows += [key | {"group": group, "importance": value / sum(raw.values())} for group, value in raw.items()]
    return pl.DataFrame(rows)


def examples() -> pl.DataFrame:
    """Returns the tracks of four scenes in both modes."""
    rows = []
    for mode, (number, name) in itertools.product(MODES, enumerate(("shock_1", "shock_2", "good_1", "good_2"))):
        key = {"mode": mode, "example": name, "title": f"vehicle {100 + number} of i80-2, t0 = {40 + number}.0 s"}
        rows += [
            key | row
            for row in _scene(slow_from=2.0 + number, slow=number < 2)
            if mode == "corrected" or not ("rampcast" in str(row["series"]) or row["kind"] == "band")
        ]
    return pl.DataFrame(rows)


def _scene(*, slow_from: float, slow: bool) -> list[dict[str, object]]:
    past, future = np.arange(-19, 1) * 0.2, np.arange(1, 76) * 0.2
    time = np.concatenate([past, future])
    speed = np.where((time > slow_from) & (time < slow_from + 5.0), 1.5, 8.0) if slow else np.full(95, 7.0)
    x = 120.0 + np.cumsum(speed) * 0.2
    rows = []

    def add(series: str, slot: str, kind: str, t: np.ndarray, x: np.ndarray) -> None:
        rows.extend(
            {"series": series, "slot": slot, "kind": kind, "t": float(a), "x": float(b)}
            for a, b in zip(t, x, strict=True)
        )

    add("central observed", "central", "observed", time, x)
    for model, v in (("rampcast", 6.9), ("GHR", 7.2), ("IDM", 6.4), ("LSTM alone", 8.3)):
        add(f"central forecast ({model})", "central", "forecast", future, x[19] + v * future)
    for name, v in (("5 %", 6.0), ("95 %", 7.8)):
        add(f"central {name} quantile", "central", "band", future, x[19] + v * future)
    for slot, offset in zip(SLOTS, (22.0, -18.0, 9.0, 30.0, -9.0, -30.0), strict=True):
        add(f"{slot} observed", slot, "observed", time, x + offset)
        if not slot.endswith(("follower_2",)):
            add(f"{slot} predicted", slot, "predicted", future, x[19] + offset + (7.0 + offset / 30.0) * future)
    return rows


def tracks() -> pl.DataFrame:
    """Returns a lane in which a slow band runs upstream at 5 m/s."""
    rows = []
    for vehicle in range(60):
        x, start = 0.0, 20 * vehicle
        for k in range(700):
            t = (start + k) * 0.1
            slow = abs((x - 500.0) + 5.0 * (t % 60.0 - 10.0)) < 40.0
            v = 2.5 if slow else 11.0
            x += v * 0.1
            if x > 500.0:
                break
            rows.append({"recording": "i80-1", "vehicle": vehicle, "frame": start + k, "lane": 6, "x": x, "v": v})
    return pl.DataFrame(rows)


def tables() -> dict[str, pl.DataFrame]:
    """Returns all tidy tables by name."""
    return {
        "longitudinal": longitudinal(),
        "parameters": parameters(),
        "outcomes": outcomes(),
        "lane_change": lane_change(),
        "importance": importance(),
        "examples": examples(),
    }


def run() -> dict[str, object]:
    """Returns a run record."""
    return {
        "date": "2025-01-02T03:04:05Z",
        "seed": 1,
        "data_hash": "0123456789abcdef" * 4,
        "versions": {"rampcast": "0.1.0", "python": "3.11.4", "jax": "0.10.0"},
        "trained_on": ["i80-1", "i80-3"],
        "tested_on": ["i80-2"],
        "counts": {"scenes": 4000, "ramp_vehicles": 713},
        "timings": {"train [s]": 61.2},
        "command": "rampcast reproduce --data <data> --out out",
    }
