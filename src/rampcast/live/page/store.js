// What the page knows: the newest state and forecast of a site, where vehicles were, what was lost.

import { clamp } from "./format.js";

const SPAN = 122; // [s] of the past that is kept
const APART = 0.4; // [s] between two kept places of a vehicle
const JUMP = 30; // [s] by which the clock may go on at once: a replay at 10 times that stood still for 3 s is no jump
const OLD = 3; // [s] after which a forecast is no longer drawn
const GONE = 2; // [s] after which a followed vehicle that was not seen again is let go
const BEATS = 10; // forecasts by which it is told how often they come
const [SOONEST, LATEST] = [900, 2600]; // [ms] without a forecast after which the page is stale

export class Store {
  constructor(geometry) {
    this.geometry = geometry;
    this.truth = null; // of a recording that is replayed: what will come
    this.followed = null;
    this.status = null;
    this.dropped = 0;
    this.heard = null; // [ms] on the page's clock, when the newest forecast came
    this.gaps = [];
    this.reset();
  }

  reset() {
    Object.assign(this, { frame: null, before: null, forecast: null, arrived: 0, period: 0, tracks: new Map(), merges: [] });
  }

  // Takes a message in that tells where vehicles are; returns whether the clock jumped.
  takeState(message, now) {
    const frame = { t: message.t_obs_ms / 1000, ms: message.t_obs_ms, epoch: message.epoch ?? 0, seq: message.seq, control: message.control ?? null, vehicles: new Map() };
    for (const one of message.vehicles) frame.vehicles.set(one.id, { ...one, length: one.length ?? 4.5, width: one.width ?? 1.8 });
    const last = this.frame;
    const jumped = last !== null && (frame.epoch !== last.epoch || frame.t < last.t - 1e-6 || frame.t > last.t + JUMP);
    const first = last === null || jumped;
    if (jumped) this.reset();
    else if (last !== null && frame.t === last.t) this.before = null;
    this.before = first ? null : last;
    this.period = first ? 0 : now - this.arrived;
    this.arrived = now;
    this.frame = frame;
    if (this.forecast && Math.abs(this.forecast.t - frame.t) < OLD) this.join();
    if (first && this.truth) this.fillFromTruth(frame.t);
    this.note(frame);
    this.geometry.learn(frame.vehicles.values());
    this.letGo(frame);
    return jumped;
  }

  takeForecast(message, now) {
    if (this.heard !== null) this.gaps = [...this.gaps.slice(1 - BEATS), now - this.heard];
    this.heard = now;
    if (this.frame && (message.epoch ?? 0) !== this.frame.epoch) return;
    this.forecast = {
      t: message.t_obs_ms / 1000, epoch: message.epoch ?? 0, model: message.model ?? "", samples: message.samples ?? null,
      degraded: message.degraded ?? null, took: message.took_ms ?? null, control: message.control ?? null,
      age: Number.isFinite(message.t_in_ms) ? message.t_pub_ms - message.t_in_ms : null,
      vehicles: new Map(message.vehicles.map((one) => [one.id, one])),
    };
    this.join();
  }

  // Gives the vehicles of the newest state what is forecast of them.
  join() {
    if (!this.frame) return;
    for (const one of this.frame.vehicles.values()) {
      const found = this.forecast.vehicles.get(one.id);
      if (!found) continue;
      Object.assign(one, {
        q: found.q, p_merged: found.p_merged ?? null, gap: found.gap ?? {}, gaps: found.gaps ?? null,
        conflicts: found.conflicts ?? null, advice: found.advice ?? one.advice ?? null, on_ramp: found.on_ramp,
      });
    }
  }

  // How much older the newest forecast is than what the picture shows [s].
  lag(now) { return this.forecast ? clamp(this.shownTime(now) - this.forecast.t, 0, OLD) : 0; }

  // Whether forecasts stay away [ms on the page's clock].
  isLate(now) {
    if (this.heard === null) return false;
    const usual = [...this.gaps].sort((a, b) => a - b)[this.gaps.length >> 1] ?? 0;
    return now - this.heard > clamp(3 * usual, SOONEST, LATEST);
  }

  note(frame) {
    for (const one of frame.vehicles.values()) {
      let track = this.tracks.get(one.id);
      if (!track) this.tracks.set(one.id, (track = { t: [], x: [], lane: [] }));
      const count = track.t.length;
      const before = count ? track.lane[count - 1] : null;
      if (before !== null && before !== one.lane && this.geometry.rampLanes.has(before) && one.lane === this.geometry.target) {
        this.merges.push({ id: one.id, t: frame.t, x: one.x });
      } else if (count && frame.t - track.t[count - 1] < APART) continue;
      track.t.push(frame.t);
      track.x.push(one.x);
      track.lane.push(one.lane);
    }
    this.forget(frame.t - SPAN);
  }

  forget(until) {
    for (const [id, track] of this.tracks) {
      let old = 0;
      while (old < track.t.length && track.t[old] < until) old += 1;
      if (old === track.t.length) this.tracks.delete(id);
      else if (old > 20) for (const values of Object.values(track)) values.splice(0, old);
    }
    while (this.merges.length && this.merges[0].t < until) this.merges.shift();
  }

  // What is known of a recording that is replayed.
  learnTruth(truth) {
    this.truth = truth;
    if (this.frame) this.fillFromTruth(this.frame.t);
    this.geometry.learn(truth.places());
  }

  fillFromTruth(t) {
    for (const [id, track] of this.truth.between(t - SPAN, t - 0.05)) {
      const later = this.tracks.get(id);
      const fresh = later ? later.t.findIndex((one) => one > track.t[track.t.length - 1]) : -1;
      if (fresh >= 0) for (const key of ["t", "x", "lane"]) track[key].push(...later[key].slice(fresh));
      this.tracks.set(id, track);
    }
    this.merges = this.truth.merges.filter((one) => one.t > t - SPAN && one.t <= t);
  }

  letGo(frame) {
    if (this.followed === null) return;
    if (frame.vehicles.has(this.followed)) this.seenFollowed = frame.t;
    else if (!(Math.abs(frame.t - this.seenFollowed) < GONE)) this.followed = null;
  }

  // The share of the way from the frame before to the newest one that the picture has gone.
  progress(now) {
    if (!this.before || !this.period) return 1;
    return clamp((now - this.arrived) / this.period, 0, 1);
  }

  // The moment that the picture shows [s].
  shownTime(now) {
    if (!this.before) return this.frame.t;
    return this.before.t + this.progress(now) * (this.frame.t - this.before.t);
  }

  // Where vehicles are in the picture: between two frames, so that they glide.
  shown(now) {
    const share = this.progress(now);
    const found = [];
    for (const one of this.frame.vehicles.values()) {
      const old = share < 1 ? this.before?.vehicles.get(one.id) : null;
      found.push({
        one,
        x: old ? old.x + share * (one.x - old.x) : one.x,
        y: old && old.y !== null && one.y !== null ? old.y + share * (one.y - old.y) : one.y,
      });
    }
    return found;
  }

  onRamp(vehicle) { return this.geometry.rampLanes.has(vehicle.lane); }
}

// What a recording holds, at moments some way apart: what came true, and the past after a jump.
export class Truth {
  // rows: of each id its rows of time [ms], x, y [m], lane; merges: t_obs_ms, id, x
  constructor(rows, merges) {
    this.merges = merges.map((one) => ({ id: one.id, t: one.t_obs_ms / 1000, x: one.x }));
    this.vehicles = new Map();
    for (const [id, own] of Object.entries(rows)) this.vehicles.set(id, own);
  }

  at(id, t) {
    const rows = this.vehicles.get(String(id));
    if (!rows || 1000 * t < rows[0][0] || 1000 * t > rows[rows.length - 1][0]) return null;
    const next = place(rows, 1000 * t);
    const [before, after] = [rows[Math.max(0, next - 1)], rows[next]];
    const share = after === before ? 0 : (1000 * t - before[0]) / (after[0] - before[0]);
    return { x: before[1] + share * (after[1] - before[1]), lane: share > 0.5 ? after[3] : before[3] };
  }

  *between(from, to) {
    for (const [id, rows] of this.vehicles) {
      if (rows[rows.length - 1][0] < 1000 * from || rows[0][0] > 1000 * to) continue;
      const some = rows.slice(place(rows, 1000 * from), place(rows, 1000 * to));
      if (!some.length) continue;
      const number = Number(id);
      yield [Number.isFinite(number) ? number : id, { t: some.map((row) => row[0] / 1000), x: some.map((row) => row[1]), lane: some.map((row) => row[3]) }];
    }
  }

  *places() {
    for (const [id, rows] of this.vehicles) for (const [, x, y, lane] of rows) yield { id, x, y, lane };
  }
}

// The first row at or after a time [ms], or the last.
function place(rows, ms) {
  let [low, high] = [0, rows.length - 1];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (rows[middle][0] < ms) low = middle + 1;
    else high = middle;
  }
  return low;
}
