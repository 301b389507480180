// The time-space diagram: on the left the last 2 minutes, on the right, on a scale of its own, the next 15 s.

import { cleared, colours, segment, text } from "./canvas.js";
import { MEDIAN, at, clamp, reaches } from "./format.js";

const PAST = 120; // [s]
const AHEAD = 15; // [s]
const SHARE = 0.4; // of the width, for what comes
const LEFT = 38;
const RIGHT = 8;
const BELOW = 32;
const ABOVE = 15;
const GUTTER = 10;
const NEAR = 14; // [pixels] by which a click may miss

export class Diagram {
  constructor(canvas, store) {
    Object.assign(this, { canvas, store, truth: true });
    canvas.addEventListener("click", (event) => this.onFollow?.(this.at(event.offsetX, event.offsetY)));
  }

  layout(width, height) {
    const room = width - LEFT - RIGHT - GUTTER;
    this.now = LEFT + (1 - SHARE) * room;
    this.begins = this.now + GUTTER;
    this.right = width - RIGHT;
    this.perPast = (this.now - LEFT) / PAST;
    this.perAhead = (this.right - this.begins) / AHEAD;
    this.base = height - BELOW;
    this.per = (this.base - ABOVE) / this.store.geometry.length;
  }

  past(t) { return this.now + (t - this.store.frame.t) * this.perPast; }

  ahead(s) { return this.begins + s * this.perAhead; }

  // So many seconds after the newest forecast was made.
  since(s) { return this.begins + (s - this.lag) * this.perAhead; }

  Y(x) { return this.base - x * this.per; }

  draw() {
    const { context, width, height } = cleared(this.canvas);
    if (!width || !this.store.frame) return;
    this.layout(width, height);
    this.drawAxes(context);
    this.clipped(context, LEFT, this.now, () => this.drawPast(context));
    this.clipped(context, this.begins, this.right, () => this.drawFuture(context));
  }

  clipped(context, from, to, draw) {
    context.save();
    context.beginPath();
    context.rect(from, ABOVE, to - from, this.base - ABOVE);
    context.clip();
    draw();
    context.restore();
  }

  drawAxes(context) {
    const { geometry } = this.store;
    context.fillStyle = colours.future;
    context.fillRect(this.begins, ABOVE, this.right - this.begins, this.base - ABOVE);
    context.lineWidth = 1;
    const step = [50, 100, 200, 500, 1000].find((one) => one * this.per > 34) ?? 2000;
    for (let x = 0; x <= geometry.length; x += step) {
      context.strokeStyle = colours.grid;
      segment(context, LEFT, this.Y(x), this.now, this.Y(x));
      segment(context, this.begins, this.Y(x), this.right, this.Y(x));
      text(context, x === 0 ? "0 m" : `${x}`, LEFT - 5, this.Y(x) + 3.5, { align: "right" });
    }
    for (let s = -PAST; s < 0; s += 30) this.tick(context, this.past(this.store.frame.t + s), `−${-s} s`);
    for (let s = 5; s <= AHEAD; s += 5) this.tick(context, this.ahead(s), `+${s} s`, s === AHEAD ? "right" : "center");
    context.strokeStyle = colours.ink;
    context.lineWidth = 1.4;
    segment(context, this.now, ABOVE, this.now, this.base);
    segment(context, this.begins, ABOVE, this.begins, this.base);
    text(context, "now", (this.now + this.begins) / 2, this.base + 13, { align: "center", colour: colours.ink, weight: 650 });
    text(context, "the last 2 min, seen", (LEFT + this.now) / 2, this.base + 26, { align: "center" });
    text(context, "the next 15 s, forecast", (this.begins + this.right) / 2, this.base + 26, { align: "center" });
    this.drawRampMarks(context);
  }

  tick(context, X, words, align = "center") {
    context.strokeStyle = colours.grid;
    segment(context, X, ABOVE, X, this.base);
    text(context, words, X, this.base + 13, { align });
  }

  drawRampMarks(context) {
    const { geometry } = this.store;
    if (!geometry.hasRamp()) return;
    const marks = [[geometry.gore, "gore"]];
    if (!geometry.goesOn) marks.push([geometry.end, "ramp ends"]);
    context.strokeStyle = colours.faint;
    context.setLineDash([4, 3]);
    for (const [x] of marks) {
      segment(context, LEFT, this.Y(x), this.now, this.Y(x));
      segment(context, this.begins, this.Y(x), this.right, this.Y(x));
    }
    context.setLineDash([]);
    this.marks = marks;
  }

  drawPast(context) {
    const { geometry, tracks, frame } = this.store;
    const lines = { ramp: new Path2D(), target: new Path2D() };
    for (const [id, track] of tracks) {
      let drawing = null;
      for (let place = 0; place < track.t.length; place += 1) {
        const lane = track.lane[place];
        const kind = geometry.rampLanes.has(lane) ? "ramp" : lane === geometry.target ? "target" : null;
        const [X, Y] = [this.past(track.t[place]), this.Y(track.x[place])];
        if (drawing) lines[drawing].lineTo(X, Y);
        if (kind && kind !== drawing) lines[kind].moveTo(X, Y);
        drawing = kind;
      }
      const newest = frame.vehicles.get(id);
      if (drawing && newest) lines[drawing].lineTo(this.now, this.Y(newest.x));
    }
    context.lineWidth = 1;
    context.globalAlpha = 0.7;
    for (const kind of ["target", "ramp"]) {
      context.strokeStyle = colours[kind];
      context.stroke(lines[kind]);
    }
    context.globalAlpha = 1;
    this.drawFollowedPast(context);
    for (const merge of this.store.merges) this.dot(context, this.past(merge.t), this.Y(merge.x), colours.ramp);
    for (const [x, words] of this.marks ?? []) text(context, words, LEFT + 4, this.Y(x) - 3, { size: 10, halo: colours.panel });
  }

  drawFollowedPast(context) {
    const track = this.store.tracks.get(this.store.followed);
    if (!track) return;
    context.strokeStyle = colours.follow;
    context.lineWidth = 2.4;
    context.beginPath();
    track.t.forEach((t, place) => context.lineTo(this.past(t), this.Y(track.x[place])));
    const newest = this.store.frame.vehicles.get(this.store.followed);
    if (newest) context.lineTo(this.now, this.Y(newest.x));
    context.stroke();
  }

  dot(context, X, Y, colour, hollow = false) {
    context.beginPath();
    context.arc(X, Y, 3, 0, 2 * Math.PI);
    context.fillStyle = hollow ? colours.future : colour;
    context.fill();
    context.lineWidth = 1.2;
    context.strokeStyle = hollow ? colour : colours.ink;
    context.stroke();
  }

  // Whose bands are drawn: who is followed, else who merges next.
  chosen() {
    const { frame, followed } = this.store;
    const own = frame.vehicles.get(followed);
    if (own?.q) return own;
    let [best, soonest] = [null, Infinity];
    for (const one of frame.vehicles.values()) {
      if (!one.q || !one.p_merged || !this.store.onRamp(one)) continue;
      const when = reaches(one.p_merged, 0.5);
      if (when !== null && when < soonest) [best, soonest] = [one, when];
    }
    return best;
  }

  drawFuture(context) {
    const { geometry, frame } = this.store;
    this.lag = this.store.forecast ? Math.max(0, frame.t - this.store.forecast.t) : 0;
    const chosen = this.chosen();
    if (chosen) this.drawBands(context, chosen);
    context.lineWidth = 1.1;
    for (const kind of ["target", "ramp"]) {
      context.strokeStyle = colours[kind];
      context.globalAlpha = 0.75;
      context.beginPath();
      for (const one of frame.vehicles.values()) {
        if (!one.q || one === chosen) continue;
        const onRamp = this.store.onRamp(one);
        if (kind === "ramp" ? !onRamp : onRamp || one.lane !== geometry.target) continue;
        one.q.forEach((levels, s) => (s ? context.lineTo(this.since(s), this.Y(levels[MEDIAN])) : context.moveTo(this.since(0), this.Y(levels[MEDIAN]))));
      }
      context.stroke();
    }
    context.globalAlpha = 1;
    if (chosen) this.drawMedian(context, chosen);
    this.drawTruths(context, chosen);
    for (const one of frame.vehicles.values()) {
      const when = one.q && one.p_merged && this.store.onRamp(one) ? reaches(one.p_merged, 0.5) : null;
      if (when !== null) this.dot(context, this.since(when), this.Y(at(one.q.map((levels) => levels[MEDIAN]), when)), colours.ramp, one !== chosen);
    }
  }

  drawBands(context, one) {
    context.fillStyle = this.store.onRamp(one) ? colours.ramp : one.lane === this.store.geometry.target ? colours.target : colours.other;
    for (const [low, high, alpha] of [[0, 4, 0.18], [1, 3, 0.34]]) {
      context.globalAlpha = alpha;
      context.beginPath();
      one.q.forEach((levels, s) => context.lineTo(this.since(s), this.Y(levels[high])));
      [...one.q.keys()].reverse().forEach((s) => context.lineTo(this.since(s), this.Y(one.q[s][low])));
      context.fill();
    }
    context.globalAlpha = 1;
  }

  drawMedian(context, one) {
    context.strokeStyle = this.store.followed === one.id ? colours.follow : colours.ramp;
    context.lineWidth = 2.4;
    context.beginPath();
    one.q.forEach((levels, s) => context.lineTo(this.since(s), this.Y(levels[MEDIAN])));
    context.stroke();
    const end = Math.min(one.q[AHEAD][MEDIAN], this.store.geometry.length);
    const s = one.q.findIndex((levels) => levels[MEDIAN] >= end);
    const words = `${one.id}`;
    text(context, words, this.ahead(clamp(s, 0, AHEAD)) - 6, clamp(this.Y(end) + 16, ABOVE + 12, this.base - 4), { align: "right", weight: 650, colour: colours.ink, halo: colours.future });
  }

  drawTruths(context, chosen) {
    const { truth, frame } = this.store;
    if (!this.truth || !truth) return;
    context.setLineDash([4, 3]);
    context.strokeStyle = colours.truth;
    for (const one of frame.vehicles.values()) {
      if (!this.store.onRamp(one) && one !== chosen) continue;
      context.lineWidth = one === chosen ? 2.4 : 1.1;
      context.globalAlpha = one === chosen ? 1 : 0.7;
      context.beginPath();
      for (let s = 0; s <= AHEAD; s += 0.5) {
        const came = truth.at(one.id, frame.t + s);
        if (!came) break;
        context.lineTo(this.ahead(s), this.Y(came.x));
      }
      context.stroke();
    }
    context.setLineDash([]);
    context.globalAlpha = 1;
  }

  // The vehicle of the ramp or the target lane whose line is nearest.
  at(X, Y) {
    if (!this.store.frame) return null;
    let [best, nearest] = [null, NEAR];
    const look = (id, x) => {
      const distance = Math.abs(this.Y(x) - Y);
      if (distance < nearest) [best, nearest] = [id, distance];
    };
    if (X >= this.begins) {
      const s = clamp((X - this.begins) / this.perAhead, 0, AHEAD);
      for (const one of this.store.frame.vehicles.values()) {
        if (one.q && (this.store.onRamp(one) || one.lane === this.store.geometry.target)) look(one.id, at(one.q.map((levels) => levels[MEDIAN]), s));
      }
      return best;
    }
    const t = this.store.frame.t + (X - this.now) / this.perPast;
    for (const [id, track] of this.store.tracks) {
      const place = track.t.findIndex((one) => one >= t);
      if (place >= 0 && this.store.frame.vehicles.has(id)) look(id, track.x[place]);
    }
    return best;
  }
}
