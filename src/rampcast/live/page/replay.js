// The bar of a replay: play, pause, step, speed, and a timeline with merges and conflicts marked.

import { cleared, colours, segment, text } from "./canvas.js";
import { byId, clamp, clock, element } from "./format.js";

const SPEEDS = [0.25, 0.5, 1, 2, 5, 10];
const BASE = 20; // [pixels] of the line of time
const DRAG = 120; // [ms] between two places that a drag asks for

export class Replay {
  constructor(store, control) {
    Object.assign(this, { store, control, state: null, conflicts: [], asked: 0 });
    byId("speed").append(...SPEEDS.map((speed) => element("option", { value: speed, textContent: `${speed} ×` })));
    byId("play").onclick = () => this.playOrPause();
    byId("back").onclick = () => this.step(-1);
    byId("step").onclick = () => this.step(1);
    byId("speed").onchange = () => this.control("speed", Number(byId("speed").value));
    this.listen(byId("timeline"));
  }

  take(state) {
    this.state = state;
    byId("replay").hidden = false;
    document.body.classList.add("has-replay");
    byId("play").classList.toggle("is-playing", state.playing);
    byId("play").setAttribute("aria-label", state.playing ? "Pause" : "Play");
    const speed = byId("speed");
    if (![...speed.options].some((one) => Number(one.value) === state.speed)) speed.append(element("option", { value: state.speed, textContent: `${state.speed} ×` }));
    if (document.activeElement !== speed) speed.value = state.speed;
  }

  playOrPause() {
    if (this.state) this.control(this.state.playing ? "pause" : "play");
  }

  step(count) { if (this.state) this.control("step", count); }

  seek(ms) { if (this.state) this.control("seek", clamp(ms, this.state.first_ms, this.state.last_ms)); }

  seekBy(seconds) { this.seek(this.time() + 1000 * seconds); }

  faster(by) {
    if (!this.state) return;
    const place = SPEEDS.findIndex((speed) => speed >= this.state.speed - 1e-9);
    this.control("speed", SPEEDS[clamp((place < 0 ? SPEEDS.length - 1 : place) + by, 0, SPEEDS.length - 1)]);
  }

  time() { return this.store.frame?.ms ?? this.state?.t_obs_ms ?? 0; }

  draw() {
    if (!this.state) return;
    const { first_ms: first, last_ms: last } = this.state;
    byId("replay-time").textContent = `${clock((this.time() - first) / 1000)} / ${clock((last - first) / 1000).replace(/\.\d$/, "")}`;
    const canvas = byId("timeline");
    const { context, width, height } = cleared(canvas);
    if (!width) return;
    const X = (ms) => 1 + ((ms - first) / (last - first)) * (width - 2);
    context.lineWidth = 1;
    context.strokeStyle = colours.ramp;
    context.globalAlpha = 0.85;
    context.beginPath();
    for (const one of this.store.truth?.merges ?? []) {
      context.moveTo(X(1000 * one.t), BASE - 3);
      context.lineTo(X(1000 * one.t), BASE - 10);
    }
    context.stroke();
    context.globalAlpha = 1;
    context.fillStyle = colours.alarm;
    for (const one of this.conflicts) {
      const place = X(one.t_obs_ms);
      context.beginPath();
      context.moveTo(place - 4, BASE - 11);
      context.lineTo(place, BASE - 18);
      context.lineTo(place + 4, BASE - 11);
      context.fill();
    }
    context.fillStyle = colours.edge;
    context.fillRect(1, BASE - 2, width - 2, 4);
    context.fillStyle = colours.target;
    context.fillRect(1, BASE - 2, X(this.time()) - 1, 4);
    context.beginPath();
    context.arc(X(this.time()), BASE, 6, 0, 2 * Math.PI);
    context.fillStyle = colours.ink;
    context.fill();
    if (height > 30) this.drawMinutes(context, X, width);
    canvas.setAttribute("aria-valuemin", 0);
    canvas.setAttribute("aria-valuemax", Math.round((last - first) / 1000));
    canvas.setAttribute("aria-valuenow", Math.round((this.time() - first) / 1000));
    canvas.setAttribute("aria-valuetext", clock((this.time() - first) / 1000));
  }

  drawMinutes(context, X, width) {
    const { first_ms: first, last_ms: last } = this.state;
    const step = [10, 30, 60, 120, 300, 600].find((one) => (one * 1000 * width) / (last - first) > 44) ?? 1800;
    for (let s = 0; first + 1000 * s <= last; s += step) {
      const place = X(first + 1000 * s);
      if (place > width - 14) break;
      context.strokeStyle = colours.faint;
      segment(context, place, BASE + 3, place, BASE + 5);
      text(context, clock(s).replace(/\.0$/, ""), place, BASE + 14, { size: 9.5, align: s === 0 ? "left" : "center" });
    }
  }

  listen(canvas) {
    const at = (event) => {
      if (!this.state || !(event.buttons & 1)) return;
      const now = performance.now();
      if (event.type === "pointermove" && now - this.asked < DRAG) return;
      this.asked = now;
      const { first_ms: first, last_ms: last } = this.state;
      this.seek(first + clamp(event.offsetX / canvas.clientWidth, 0, 1) * (last - first));
    };
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      at(event);
    });
    canvas.addEventListener("pointermove", at);
  }
}
