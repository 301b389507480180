"""Algorithm 1 as plain Python, one scene and one step at a time: slow, and obviously what the method page says."""

import math
from dataclasses import dataclass

MINIMUM_GAP, MINIMUM_SPEED, MINIMUM_SPEED_DIFFERENCE = 1.0, 0.1, 0.1


@dataclass(frozen=True)
class Neighbour:
    """A neighbour's states at the start of each step."""

    x: list[float]
    v: list[float]
    length: float
    present: bool


def idm(p: list[float], v: float, v_m: float, s: float) -> float:
    """Returns the acceleration of the IDM [m/s^2]."""
    s_0, h_d, a_max, b, v_d, delta = p
    free = a_max * (1 - (max(v, MINIMUM_SPEED) / v_d) ** delta)
    if math.isinf(s):
        return free
    s_d = s_0 + h_d * v + v * (v - v_m) / (2 * math.sqrt(a_max * b))
    return free - a_max * (s_d / max(s, MINIMUM_GAP)) ** 2


def gipps_paper(p: list[float], v: float, v_m: float, s: float) -> float:
    """Returns the acceleration of the paper's "Gipps" [m/s^2]."""
    alpha, beta, gamma = p
    if math.isinf(s) or v == v_m:
        return 0.0
    size = max(abs(v_m - v), MINIMUM_SPEED_DIFFERENCE)
    return alpha * math.copysign(1, v_m - v) * size**beta / max(s, MINIMUM_GAP) ** gamma


def ghr(p: list[float], v: float, v_m: float, s: float) -> float:
    """Returns the acceleration of the GHR law [m/s^2]."""
    alpha, beta, gamma = p
    if math.isinf(s):
        return 0.0
    return alpha * max(v, MINIMUM_SPEED) ** beta * (v_m - v) / max(s, MINIMUM_GAP) ** gamma


def gipps(p: list[float], v: float, v_m: float, s: float) -> float:
    """Returns the acceleration of the model of Gipps 1981 [m/s^2]."""
    a_max, b, v_d, tau, b_hat, s_0 = p
    reached = v + 2.5 * a_max * tau * (1 - v / v_d) * math.sqrt(0.025 + v / v_d)
    if not math.isinf(s):
        radicand = (b * tau) ** 2 + b * (2 * (max(s, MINIMUM_GAP) - s_0) - v * tau + v_m**2 / b_hat)
        safe = max(math.sqrt(radicand) - b * tau, 0.0) if radicand > 0 else 0.0
        reached = min(reached, safe)
    return (reached - v) / tau


LAWS = {"idm": idm, "gipps_paper": gipps_paper, "ghr": ghr, "gipps": gipps}


def limits(law: str, p: list[float]) -> tuple[float, float]:
    """Returns the lowest and highest acceleration [m/s^2]."""
    return {"idm": lambda: (-p[3], p[2]), "gipps": lambda: (-p[1], p[0])}.get(law, lambda: (-3.41, 3.41))()


def gap_and_speed(
    x: float, ramp: list[Neighbour], target: list[Neighbour], k: int, ramp_end: float, mode: str
) -> tuple[float, float]:
    """Returns gap [m] and speed [m/s] of the actual leader at step k; an infinite gap without one."""
    paper = mode == "paper"
    ahead = [n for n in target if (paper or n.present) and n.x[k] >= x]
    p = min(ahead, key=lambda n: n.x[k]) if ahead else None
    before = [n for n in ramp if n.present and n.x[k] >= x]
    own = min(before, key=lambda n: n.x[k]) if before else None
    if own and own.x[k] >= ramp_end:
        own = None
    if p and own:
        x_m, v_m, length = (own.x[k] + p.x[k]) / 2, (own.v[k] + p.v[k]) / 2, (own.length + p.length) / 2
    elif p:
        x_m, v_m, length = p.x[k], p.v[k], p.length
    elif own and not paper:
        x_m, v_m, length = own.x[k], own.v[k], own.length
    else:
        return math.inf, 0.0
    return x_m - x - (0 if paper else length), v_m


def roll_out(
    law: str,
    p: list[float],
    x: float,
    v: float,
    ramp: list[Neighbour],
    target: list[Neighbour],
    *,
    ramp_end: float,
    v_max: float,
    mode: str,
    time_step: float,
) -> tuple[list[float], list[float]]:
    """Returns positions [m] and speeds [m/s] after each step."""
    lowest, highest = limits(law, p)
    xs, vs = [], []
    for k in range(len(ramp[0].x) - 1):
        s, v_m = gap_and_speed(x, ramp, target, k, ramp_end, mode)
        a = min(max(LAWS[law](p, v, v_m, s), lowest), highest)
        v = min(max(v + a * time_step, 0.0), v_max)
        x += v * time_step
        xs.append(x)
        vs.append(v)
    return xs, vs
