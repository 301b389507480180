// A site as the page draws it: lanes with their edges, and where ramp vehicles drive.

import { clamp } from "./format.js";

const WIDEST = 5; // [m] of a lane in a drawing
const USUAL = 3.6; // [m] of a lane whose width no neighbour tells
const BIN = 10; // [m] of the ramp over which places are averaged
const ENOUGH = 3; // times that a vehicle was seen in a bin before it is believed
const TAPER = 0.75; // of the way from gore to end a ramp lane keeps its width, unless more is known

export class Geometry {
  constructor(site) {
    this.site = site;
    this.title = site.title || site.name;
    this.length = site.length;
    this.lanes = site.lanes;
    this.target = site.target_lane ?? 0;
    this.rampLanes = new Set(site.lanes.filter((lane) => lane.role === "ramp").map((lane) => lane.number));
    this.gore = Number.isFinite(site.gore) ? site.gore : null;
    this.end = Number.isFinite(site.ramp_end) ? Math.min(site.ramp_end, site.length) : site.length;
    this.goesOn = !Number.isFinite(site.ramp_end) || site.ramp_end > site.length;
    this.edges = edges(site.lanes);
    this.bins = new Map();
    this.seen = new Set();
    this.bottom = Math.min(...[...this.edges.values()].map((one) => one.low));
  }

  hasRamp() { return this.rampLanes.size > 0; }

  centre(number) { return this.lanes.find((lane) => lane.number === number)?.centre ?? null; }

  // The ramp lane beside the target lane.
  beside() {
    const ramps = this.lanes.filter((lane) => lane.role === "ramp");
    const target = this.centre(this.target);
    return ramps.sort((a, b) => Math.abs(a.centre - target) - Math.abs(b.centre - target))[0] ?? null;
  }

  // The lanes that are drawn: those that somebody was seen in, the ramp with its target, and one more beside them.
  shownLanes() {
    if (this.shown) return this.shown;
    const needed = this.lanes.filter((lane) => lane.role === "ramp" || lane.number === this.target || this.seen.has(lane.number));
    const all = [...this.lanes].sort((a, b) => b.centre - a.centre);
    const first = needed.length ? Math.min(...needed.map((lane) => all.indexOf(lane))) : 0;
    this.shown = all.slice(this.hasRamp() ? Math.max(0, first - 1) : 0);
    this.hidden = all.slice(0, all.indexOf(this.shown[0])).filter((lane) => lane.role === "main");
    return this.shown;
  }

  top() { return Math.max(...this.shownLanes().map((lane) => this.edges.get(lane.number).high)); }

  extent(lane) {
    if (!this.hasRamp()) return [0, this.length];
    const shared = this.lanes.some((one) => one.centre === lane.centre && one.number !== lane.number);
    if (lane.role === "ramp") return [0, lane === this.beside() ? this.end : this.gore];
    if (lane.role === "exit" || (lane.role === "shoulder" && shared)) return [this.end, this.length];
    return [0, this.length];
  }

  // Site files tell the lateral place of a ramp where it runs beside the road; before, vehicles show where it is.
  learn(vehicles) {
    for (const one of vehicles) {
      if (!this.seen.has(one.lane) && this.edges.has(one.lane)) {
        this.seen.add(one.lane);
        this.shown = null;
      }
      if (one.y === null || !this.rampLanes.has(one.lane) || one.x < 0 || one.x >= this.gore) continue;
      const bin = Math.floor(one.x / BIN);
      const seen = this.bins.get(bin) ?? { n: 0, y: 0 };
      seen.n += 1;
      seen.y += (one.y - seen.y) / Math.min(seen.n, 400);
      this.bins.set(bin, seen);
    }
  }

  // The lateral place of the ramp's centre [m] at x.
  rampCentre(x) {
    const own = this.beside()?.centre ?? 0;
    if (this.gore === null || x >= this.gore) return own;
    const known = this.knownRamp();
    if (!known.length) return own;
    const points = [...known, { x: this.gore, y: own }];
    if (x <= points[0].x) {
      if (points.length < 2) return points[0].y;
      const slope = (points[1].y - points[0].y) / (points[1].x - points[0].x);
      return points[0].y + clamp(slope, -0.1, 0.1) * (x - points[0].x);
    }
    const place = points.findIndex((one) => one.x >= x);
    const [before, after] = [points[place - 1], points[place]];
    return before.y + ((x - before.x) / (after.x - before.x)) * (after.y - before.y);
  }

  knownRamp() {
    return [...this.bins].filter(([, seen]) => seen.n >= ENOUGH).sort((a, b) => a[0] - b[0])
      .map(([bin, seen]) => ({ x: (bin + 0.5) * BIN, y: seen.y })).filter((one) => one.x < this.gore - BIN / 2);
  }

  lowest() {
    const known = this.knownRamp();
    return Math.min(this.bottom, ...known.map((one) => one.y - USUAL / 2 - 0.6));
  }

  // Where the ramp lane begins to narrow [m].
  taper() { return this.goesOn ? this.end : this.gore + TAPER * (this.end - this.gore); }
}

function edges(lanes) {
  const centres = [...new Set(lanes.map((lane) => lane.centre))].sort((a, b) => a - b);
  const widths = centres.slice(1).map((centre, place) => Math.min(centre - centres[place], WIDEST));
  const found = new Map();
  for (const lane of lanes) {
    const place = centres.indexOf(lane.centre);
    const below = widths[place - 1] ?? widths[place] ?? USUAL;
    const above = widths[place] ?? widths[place - 1] ?? USUAL;
    found.set(lane.number, { low: lane.centre - below / 2, high: lane.centre + above / 2, centre: lane.centre });
  }
  return found;
}

// Who makes the gap that a vehicle would merge into: told by the message, or counted along the target lane.
export function likeliestGap(vehicle, frame, target) {
  const told = vehicle.gaps?.[0];
  if (told) return { index: told.gap, p: told.p, ahead: frame.vehicles.get(told.ahead) ?? null, behind: frame.vehicles.get(told.behind) ?? null };
  const shares = Object.entries(vehicle.gap ?? {});
  if (!shares.length) return null;
  const [index, p] = shares.reduce((best, one) => (one[1] > best[1] ? one : best));
  const there = [...frame.vehicles.values()].filter((one) => one.lane === target).sort((a, b) => a.x - b.x);
  const place = there.filter((one) => one.x <= vehicle.x).length + Number(index);
  return { index: Number(index), p, ahead: there[place] ?? null, behind: there[place - 1] ?? null };
}
