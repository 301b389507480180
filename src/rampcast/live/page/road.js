// The road from above: lanes, vehicles to scale, bands and ghosts of the forecast, gaps, and what came true.

import { cleared, colours, segment, text } from "./canvas.js";
import { MEDIAN, at, bandsAt, clamp, percent, reaches } from "./format.js";
import { likeliestGap } from "./geometry.js";

const GHOSTS = [5, 10]; // [s]
const FIRST = 3; // ramp vehicles whose forecast is drawn when nobody is followed: those that merge next
const USUAL_SCALE = 5; // [pixels a metre] at which a car is easily seen
const NARROW = 2.6; // [pixels a metre] at least, on a phone
const CLOSEST = 24;
const STRETCH = 2.2; // by which lanes may be drawn wider than long
const BELOW = 17; // [pixels] for the scale of distances
const NEAR = 9; // [pixels] by which a click may miss
const APART = 34; // [pixels] between the names of two ghosts
const SHOWN_SHARE = 0.08; // of the futures, below which a ghost is not drawn
const MODES = ["ramp", "followed", "all"];

export class Road {
  constructor(canvas, overview, store) {
    Object.assign(this, { canvas, overview, store, mode: "ramp", truth: true, hovered: null, scale: null, left: 0, places: [] });
    this.listen();
  }

  nextMode() {
    this.mode = MODES[(MODES.indexOf(this.mode) + 1) % MODES.length];
    return this.mode;
  }

  // The whole road, or what fits of it where cars are still seen.
  home() {
    const { length, gore } = this.store.geometry;
    const width = this.canvas.clientWidth;
    this.scale = Math.max(width / length, Math.min(USUAL_SCALE, Math.max(NARROW, width / 250)));
    this.left = gore === null ? 0 : gore - 0.4 * (width / this.scale);
    this.clampView();
  }

  clampView() {
    const { length } = this.store.geometry;
    const width = this.canvas.clientWidth;
    this.scale = clamp(this.scale, width / length, CLOSEST);
    this.left = clamp(this.left, 0, Math.max(0, length - width / this.scale));
  }

  zoom(factor, at = this.canvas.clientWidth / 2) {
    const place = this.left + at / this.scale;
    this.scale *= factor;
    this.clampView();
    this.left = place - at / this.scale;
    this.clampView();
  }

  draw(now) {
    const { context, width, height } = cleared(this.canvas);
    if (!width || !this.store.frame) return;
    if (this.scale === null) this.home();
    const shown = this.store.shown(now);
    this.time = this.store.shownTime(now);
    this.lag = this.store.lag(now);
    this.labels = [];
    this.follow(shown, width);
    this.setLateral(height);
    this.drawGround(context, width, height);
    const drawn = this.forecasted(shown);
    if (drawn.length <= FIRST) for (const one of drawn) this.drawGap(context, one);
    for (const one of drawn) this.drawForecast(context, one, drawn.length === 1);
    this.drawVehicles(context, shown, width);
    for (const draw of this.labels) draw();
    this.drawOverview(shown);
  }

  follow(shown, width) {
    const followed = shown.find(({ one }) => one.id === this.store.followed);
    if (!followed || this.dragging) return;
    const aim = followed.x - 0.33 * (width / this.scale);
    this.left += 0.12 * (aim - this.left);
    this.clampView();
  }

  setLateral(height) {
    const { geometry } = this.store;
    const [top, bottom] = [geometry.top() + 0.3, geometry.lowest() - 0.3];
    const room = height - BELOW - 2;
    this.lateral = Math.min(room / (top - bottom), this.scale * STRETCH);
    this.topY = top + (room / this.lateral - (top - bottom)) / 2;
    this.room = room;
  }

  X(x) { return (x - this.left) * this.scale; }

  Y(y) { return 1 + (this.topY - y) * this.lateral; }

  // The lateral place of a vehicle; that of its lane where its own is not known.
  placeY(one, y) { return y ?? this.store.geometry.centre(one.lane) ?? this.store.geometry.top(); }

  drawGround(context, width, height) {
    const { geometry } = this.store;
    for (const lane of geometry.shownLanes()) {
      if (lane.role === "ramp" && lane === geometry.beside()) continue;
      const [from, to] = geometry.extent(lane);
      const { low, high } = geometry.edges.get(lane.number);
      context.fillStyle = colours.asphalt;
      context.fillRect(this.X(from), this.Y(high), (to - from) * this.scale, (high - low) * this.lateral + 0.5);
    }
    if (geometry.hasRamp()) this.drawRamp(context);
    this.drawLines(context);
    this.drawScale(context, width, height);
  }

  rampEdges() {
    const { geometry } = this.store;
    const own = geometry.edges.get(geometry.beside().number);
    const half = (own.high - own.low) / 2;
    const points = [];
    for (let x = 0; x < geometry.gore; x += 10) points.push([x, geometry.rampCentre(x)]);
    points.push([geometry.gore, own.centre]);
    return { own, upper: points.map(([x, y]) => [x, Math.min(y + half, own.high)]), lower: points.map(([x, y]) => [x, y - half]) };
  }

  drawRamp(context) {
    const { geometry } = this.store;
    const { own, upper, lower } = this.rampEdges();
    context.fillStyle = colours["asphalt-ramp"];
    context.beginPath();
    for (const [x, y] of upper) context.lineTo(this.X(x), this.Y(y));
    context.lineTo(this.X(geometry.end), this.Y(own.high));
    if (geometry.goesOn) context.lineTo(this.X(geometry.end), this.Y(own.low));
    context.lineTo(this.X(geometry.taper()), this.Y(own.low));
    for (const [x, y] of lower.reverse()) context.lineTo(this.X(x), this.Y(y));
    context.fill();
    context.strokeStyle = colours.barrier;
    context.lineWidth = 1.4;
    context.beginPath();
    for (const [x, y] of lower.reverse()) context.lineTo(this.X(x), this.Y(y));
    context.lineTo(this.X(geometry.taper()), this.Y(own.low));
    if (!geometry.goesOn) context.lineTo(this.X(geometry.end), this.Y(own.high));
    context.stroke();
    context.beginPath();
    for (const [x, y] of upper) context.lineTo(this.X(x), this.Y(y));
    context.stroke();
  }

  drawLines(context) {
    const { geometry } = this.store;
    const bounds = new Set();
    for (const lane of geometry.shownLanes()) if (lane.role !== "ramp") for (const key of ["low", "high"]) bounds.add(geometry.edges.get(lane.number)[key]);
    const ys = [...bounds].sort((a, b) => b - a);
    context.strokeStyle = colours.line;
    context.lineWidth = 1;
    const ramp = geometry.hasRamp() ? geometry.edges.get(geometry.beside().number) : null;
    for (const y of ys) {
      const outer = (y === ys[0] && !geometry.hidden.length) || y === ys[ys.length - 1];
      const atRamp = ramp && Math.abs(y - ramp.high) < 0.3;
      context.setLineDash(outer ? [] : [3 * this.scale, 9 * this.scale]);
      context.lineDashOffset = this.left * this.scale;
      context.strokeStyle = outer ? colours.barrier : colours.line;
      if (!atRamp) segment(context, this.X(0), this.Y(y), this.X(geometry.length), this.Y(y));
      else {
        segment(context, this.X(0), this.Y(y), this.X(geometry.gore), this.Y(y));
        segment(context, this.X(geometry.end), this.Y(y), this.X(geometry.length), this.Y(y));
        context.setLineDash([1.5 * this.scale, 2.5 * this.scale]);
        context.strokeStyle = colours.barrier;
        segment(context, this.X(geometry.gore), this.Y(y), this.X(geometry.end), this.Y(y));
      }
    }
    context.setLineDash([]);
    context.lineDashOffset = 0;
    if (geometry.hidden.length) {
      const names = geometry.hidden.map((lane) => lane.number).sort((a, b) => a - b);
      const which = names.length > 1 ? `lanes ${names[0]} to ${names[names.length - 1]}` : `lane ${names[0]}`;
      text(context, `↑ ${which}: nobody seen`, 8, this.Y(ys[0]) + 13, { colour: colours.faint });
    }
  }

  drawScale(context, width, height) {
    const { geometry } = this.store;
    const step = [10, 20, 50, 100, 200, 500, 1000].find((one) => one * this.scale > 70) ?? 2000;
    const marks = geometry.hasRamp() ? [[geometry.gore, `gore ${Math.round(geometry.gore)} m`]] : [];
    if (geometry.hasRamp() && !geometry.goesOn) marks.push([geometry.end, `ramp ends ${Math.round(geometry.end)} m`]);
    const base = height - 5;
    context.strokeStyle = colours.faint;
    context.lineWidth = 1;
    for (let x = Math.ceil(this.left / step) * step; x <= geometry.length && this.X(x) <= width; x += step) {
      segment(context, this.X(x), height - BELOW + 1, this.X(x), height - BELOW + 5);
      if (marks.some(([mark]) => Math.abs(this.X(mark) - this.X(x)) < 76)) continue;
      const edge = this.X(x) < 12 ? "left" : this.X(x) > width - 18 ? "right" : "center";
      text(context, `${x} m`, clamp(this.X(x), 3, width - 3), base, { align: edge });
    }
    for (const [x, words] of marks) {
      context.strokeStyle = colours.barrier;
      segment(context, this.X(x), height - BELOW - 3, this.X(x), height - BELOW + 5);
      if (this.X(x) > -20 && this.X(x) < width + 20) text(context, words, clamp(this.X(x), 34, width - 48), base, { align: "center", colour: colours.ink });
    }
  }

  // Those whose forecast is drawn.
  forecasted(shown) {
    const { followed } = this.store;
    const own = shown.filter(({ one }) => one.id === followed && one.q);
    if (this.mode === "followed" || (own.length && this.mode === "ramp")) return own;
    if (this.mode === "all") return shown.filter(({ one }) => one.q);
    const onRamp = shown.filter(({ one }) => one.q && one.p_merged && this.store.onRamp(one))
      .map((each) => ({ ...each, when: reaches(each.one.p_merged, 0.5) ?? Infinity })).sort((a, b) => a.when - b.when || b.x - a.x);
    const sure = onRamp.filter(({ when }) => when < Infinity).slice(0, FIRST);
    return sure.length ? sure : onRamp.slice(0, 1);
  }

  // The places across the road where it may be after so many seconds, each with its share of the futures.
  branches(one, y, ahead) {
    const { geometry } = this.store;
    if (!one.p_merged || !this.store.onRamp(one)) return [{ y: geometry.centre(one.lane) ?? this.placeY(one, y), share: 1 }];
    const p = at(one.p_merged, ahead);
    const x = at(one.q.map((levels) => levels[MEDIAN]), ahead);
    const found = [{ y: geometry.centre(geometry.target), share: p }];
    if (x < geometry.end) found.push({ y: geometry.rampCentre(x), share: 1 - p, until: geometry.end });
    return found.filter(({ share }) => share > SHOWN_SHARE);
  }

  colour(one) {
    if (this.store.onRamp(one)) return colours.ramp;
    return one.lane === this.store.geometry.target ? colours.target : colours.other;
  }

  drawForecast(context, { one, x, y }, alone) {
    const colour = this.colour(one);
    this.drawPath(context, one, x, y, colour);
    for (const ahead of [...GHOSTS].reverse()) {
      const [low, lower, middle, upper, high] = bandsAt(one.q, ahead + this.lag);
      for (const { y: across, share, until = Infinity } of this.branches(one, y, ahead + this.lag)) {
        const [Y, last] = [this.Y(across), Math.min(high, until)];
        context.globalAlpha = 0.25 + 0.75 * share;
        context.fillStyle = colour;
        context.strokeStyle = colour;
        context.lineWidth = 1.4;
        segment(context, this.X(low), Y, this.X(last), Y);
        segment(context, this.X(low), Y - 4, this.X(low), Y + 4);
        if (high <= until) segment(context, this.X(high), Y - 4, this.X(high), Y + 4);
        context.globalAlpha *= 0.55;
        context.fillRect(this.X(lower), Y - 4, (Math.min(upper, until) - lower) * this.scale, 8);
        context.globalAlpha = 0.25 + 0.75 * share;
        this.drawGhost(context, one, middle, Y, ahead, colour);
        if (alone && share >= 0.5 && (ahead === GHOSTS[0] || this.X(middle) - this.X(at(one.q.map((levels) => levels[MEDIAN]), GHOSTS[0] + this.lag)) > APART)) this.labels.push(() => text(context, `+${ahead} s`, this.X(middle - one.length / 2), Y - this.high(one) / 2 - 7, { colour: colours.ink, size: 10.5, weight: 650, align: "center", halo: colours.asphalt }));
      }
      context.globalAlpha = 1;
      this.drawTruth(context, one, ahead);
    }
  }

  drawPath(context, one, x, y, colour) {
    context.strokeStyle = colour;
    context.globalAlpha = 0.5;
    context.lineWidth = 1.2;
    context.setLineDash([1, 4]);
    context.lineCap = "round";
    context.beginPath();
    context.moveTo(this.X(x), this.Y(this.placeY(one, y)));
    for (let ahead = 1; ahead <= GHOSTS[1]; ahead += 1) {
      const [most] = this.branches(one, y, ahead + this.lag).sort((a, b) => b.share - a.share);
      if (most) context.lineTo(this.X(at(one.q.map((levels) => levels[MEDIAN]), ahead + this.lag)), this.Y(most.y));
    }
    context.stroke();
    context.setLineDash([]);
    context.lineCap = "butt";
    context.globalAlpha = 1;
  }

  high(one) { return Math.max(3.5, one.width * Math.min(this.scale, this.lateral)); }

  drawGhost(context, one, front, Y, ahead, colour) {
    const [long, high] = [Math.max(6, one.length * this.scale), this.high(one)];
    context.beginPath();
    context.roundRect(this.X(front) - long, Y - high / 2, long, high, 2.5);
    const before = context.globalAlpha;
    context.globalAlpha = 0.85 * before;
    context.fillStyle = colours.asphalt;
    context.fill();
    context.globalAlpha = before;
    context.strokeStyle = colour;
    context.lineWidth = 1.6;
    context.setLineDash(ahead === GHOSTS[0] ? [] : [3, 2]);
    context.stroke();
    context.setLineDash([]);
  }

  drawTruth(context, one, ahead) {
    if (!this.truth || !this.store.truth) return;
    const came = this.store.truth.at(one.id, this.time + ahead);
    if (!came) return;
    const { geometry } = this.store;
    const across = geometry.rampLanes.has(came.lane) ? geometry.rampCentre(came.x) : geometry.centre(came.lane) ?? one.y;
    const [X, Y] = [this.X(came.x), this.Y(across)];
    context.beginPath();
    context.moveTo(X - 5, Y);
    context.lineTo(X, Y - 5);
    context.lineTo(X + 5, Y);
    context.lineTo(X, Y + 5);
    context.closePath();
    context.lineWidth = 3.4;
    context.strokeStyle = colours.asphalt;
    context.stroke();
    context.lineWidth = 1.8;
    context.strokeStyle = colours.truth;
    context.stroke();
  }

  // Shades, in the target lane, what lies now between those between whom it would merge.
  drawGap(context, { one, x, y }) {
    const { geometry, frame } = this.store;
    if (!this.store.onRamp(one)) return;
    const gap = likeliestGap(one, frame, geometry.target);
    if (!gap) return;
    const from = gap.behind ? gap.behind.x : this.left - 1;
    const to = gap.ahead ? gap.ahead.x - gap.ahead.length : geometry.length + 1;
    const { low, high } = geometry.edges.get(geometry.target);
    const [X, Y, wide, tall] = [this.X(from), this.Y(high) + 2, (to - from) * this.scale, (high - low) * this.lateral - 4];
    if (wide <= 0) return;
    context.save();
    context.beginPath();
    context.rect(X, Y, wide, tall);
    context.globalAlpha = 0.1 + 0.14 * gap.p;
    context.fillStyle = colours.ramp;
    context.fill();
    context.clip();
    context.globalAlpha = 0.25 + 0.4 * gap.p;
    context.strokeStyle = colours.ramp;
    context.lineWidth = 1;
    context.beginPath();
    const [begin, end] = [Math.max(X, -tall), Math.min(X + wide, this.canvas.clientWidth)];
    for (let at = begin - ((begin - X) % 7) - tall; at < end; at += 7) {
      context.moveTo(at, Y + tall);
      context.lineTo(at + tall, Y);
    }
    context.stroke();
    context.restore();
    const middle = clamp(X + wide / 2, Math.max(X, 0) + 2, Math.min(X + wide, this.canvas.clientWidth) - 2);
    context.globalAlpha = 0.75;
    context.strokeStyle = colours.ramp;
    context.lineWidth = 1.1;
    const nose = this.Y(this.placeY(one, y));
    context.beginPath();
    context.moveTo(this.X(x - one.length / 2), nose - this.high(one) / 2);
    context.bezierCurveTo(this.X(x - one.length / 2), nose - 16, middle, Y + tall + 12, middle, Y + tall);
    context.stroke();
    context.globalAlpha = 1;
    if (wide > 34) text(context, percent(gap.p), middle, Y + tall / 2 + 0.5, { colour: colours.ink, size: 10, weight: 650, align: "center", base: "middle", halo: colours.asphalt });
  }

  drawVehicles(context, shown, width) {
    this.places = [];
    let labelled = -Infinity;
    for (const { one, x, y } of [...shown].sort((a, b) => a.x - b.x)) {
      const [front, Y] = [this.X(x), this.Y(this.placeY(one, y))];
      const [long, high] = [Math.max(6, one.length * this.scale), this.high(one)];
      if (front < -4 || front - long > width + 4) continue;
      this.places.push({ id: one.id, left: front - long, right: front, Y, high });
      this.drawBody(context, one, front, Y, long, high);
      const named = one.id === this.store.followed || one.id === this.hovered;
      const middle = front - long / 2;
      if (named) this.drawName(context, `${one.id}`, middle, Y, high);
      else if (this.store.onRamp(one) && middle - labelled > 26) {
        text(context, `${one.id}`, middle, Y + high / 2 + 9, { size: 9, align: "center", colour: colours.dim });
        labelled = middle;
      }
    }
  }

  drawBody(context, one, front, Y, long, high) {
    const followed = one.id === this.store.followed;
    const old = one.age_ms > 400;
    context.globalAlpha = old ? 0.5 : 1;
    context.fillStyle = this.colour(one);
    context.beginPath();
    context.roundRect(front - long, Y - high / 2, long, high, Math.min(3, high / 3));
    context.fill();
    context.fillStyle = colours.asphalt;
    context.globalAlpha *= 0.55;
    const glass = Math.max(1.5, 0.16 * Math.min(long, 5 * this.scale));
    context.fillRect(front - Math.min(0.34 * long, 1.9 * this.scale), Y - high / 2 + 1, glass, high - 2);
    context.globalAlpha = 1;
    if (!followed && one.id !== this.hovered) return;
    context.strokeStyle = colours.follow;
    context.lineWidth = followed ? 2 : 1.2;
    context.beginPath();
    context.roundRect(front - long - 2.5, Y - high / 2 - 2.5, long + 5, high + 5, 5);
    context.stroke();
  }

  drawName(context, words, middle, Y, high) {
    text(context, words, middle, Y + high / 2 + 12, { size: 11, weight: 650, align: "center", colour: colours.ink, halo: colours.ground });
  }

  drawOverview(shown) {
    const { context, width, height } = cleared(this.overview);
    const { geometry } = this.store;
    const scale = width / geometry.length;
    const lateral = (height - 6) / (geometry.top() - geometry.lowest());
    const Y = (y) => 3 + (geometry.top() - y) * lateral;
    context.fillStyle = colours.raised;
    context.fillRect(0, 0, width, height);
    const [from, to] = [this.left * scale, (this.left + this.canvas.clientWidth / this.scale) * scale];
    context.fillStyle = colours.asphalt;
    context.fillRect(from, 0, to - from, height);
    for (const { one, x, y } of shown) {
      context.fillStyle = one.id === this.store.followed ? colours.follow : this.colour(one);
      context.fillRect((x - one.length) * scale, Y(this.placeY(one, y)) - 1, Math.max(2.5, one.length * scale), 2);
    }
    context.strokeStyle = colours.faint;
    context.lineWidth = 1;
    context.strokeRect(from + 0.5, 0.5, Math.max(1, to - from - 1), height - 1);
  }

  // The vehicle at a place of the canvas.
  at(X, Y) {
    let [best, nearest] = [null, NEAR];
    for (const one of this.places) {
      const distance = Math.hypot(Math.max(one.left - X, 0, X - one.right), Math.max(Math.abs(Y - one.Y) - one.high / 2, 0));
      if (distance < nearest) [best, nearest] = [one.id, distance];
    }
    return best;
  }

  listen() {
    const { canvas, overview } = this;
    let from = null;
    canvas.addEventListener("pointerdown", (event) => {
      from = { X: event.offsetX, left: this.left };
    });
    canvas.addEventListener("pointermove", (event) => {
      this.hovered = this.at(event.offsetX, event.offsetY);
      canvas.classList.toggle("at-vehicle", this.hovered !== null);
      if (!from || Math.abs(event.offsetX - from.X) < 4) return;
      if (!this.dragging) canvas.setPointerCapture(event.pointerId);
      this.dragging = true;
      this.left = from.left - (event.offsetX - from.X) / this.scale;
      this.clampView();
    });
    const ends = () => {
      from = null;
      setTimeout(() => { this.dragging = false; });
    };
    canvas.addEventListener("pointerup", ends);
    canvas.addEventListener("pointercancel", ends);
    canvas.addEventListener("pointerleave", () => { this.hovered = null; });
    canvas.addEventListener("click", (event) => {
      if (!this.dragging) this.onFollow?.(this.at(event.offsetX, event.offsetY));
    });
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.zoom(Math.exp(-0.0015 * event.deltaY), event.offsetX);
    }, { passive: false });
    const jump = (event) => {
      if (!(event.buttons & 1) || this.scale === null) return;
      const width = canvas.clientWidth / this.scale;
      this.left = (event.offsetX / overview.clientWidth) * this.store.geometry.length - width / 2;
      this.clampView();
    };
    overview.addEventListener("pointerdown", jump);
    overview.addEventListener("pointermove", jump);
    new ResizeObserver(() => { this.scale = null; }).observe(canvas);
  }
}
