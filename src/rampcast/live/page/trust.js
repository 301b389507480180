// How good the forecasts of the last minutes were, counted by the page itself from the messages that it got.

import { MEDIAN, byId, element, percent, quantile } from "./format.js";

const AHEAD = [5, 10, 15]; // [s]
const EVERY = 1; // [s] between two forecasts that are noted
const SPAN = 120; // [s] of truths that are looked back at
const SOON = 0.051; // [s] by which a truth may lie off its moment
const STATED = 0.9;
const SVG = "http://www.w3.org/2000/svg";

export class Trust {
  constructor() {
    this.rows = AHEAD.map((ahead) => new Row(ahead));
    byId("trust").replaceChildren(...this.rows.map((row) => row.line));
    this.reset();
  }

  reset() {
    this.noted = [];
    this.due = AHEAD.map(() => []);
    this.last = -Infinity;
    this.changed = true;
  }

  // Takes in where vehicles are now.
  takeState(frame) {
    for (const noted of this.noted) {
      AHEAD.forEach((ahead, place) => {
        const late = frame.t - noted.t - ahead;
        if (noted.done[place] || late < -SOON) return;
        noted.done[place] = true;
        if (late > SOON) return; // the frame of that moment was lost
        for (const [id, bands] of noted.bands) {
          const now = frame.vehicles.get(id);
          if (!now) continue;
          const [low, middle, high] = bands[place];
          this.due[place].push({ t: frame.t, error: Math.abs(now.x - middle), held: now.x >= low && now.x <= high });
        }
      });
    }
    this.noted = this.noted.filter((noted) => !noted.done.every(Boolean));
    for (const due of this.due) while (due.length && due[0].t < frame.t - SPAN) due.shift();
  }

  // Takes in a forecast, of which one a second is looked at again.
  takeForecast(forecast) {
    if (forecast.t - this.last < EVERY - 1e-6) return;
    this.last = forecast.t;
    this.changed = true;
    const bands = new Map();
    for (const one of forecast.vehicles.values()) {
      if (one.q) bands.set(one.id, AHEAD.map((ahead) => [one.q[ahead][0], one.q[ahead][MEDIAN], one.q[ahead][4]]));
    }
    this.noted.push({ t: forecast.t, bands, done: AHEAD.map(() => false) });
  }

  draw() {
    if (!this.changed) return;
    this.changed = false;
    this.rows.forEach((row, place) => row.show(this.due[place]));
  }
}

class Row {
  constructor(ahead) {
    this.error = element("td", { textContent: "–" });
    this.share = element("span", { textContent: "–" });
    this.count = element("td", { textContent: "0" });
    const svg = document.createElementNS(SVG, "svg");
    svg.setAttribute("viewBox", "0 0 68 9");
    svg.setAttribute("aria-hidden", "true");
    const shape = (name, values) => {
      const made = document.createElementNS(SVG, name);
      for (const [key, value] of Object.entries(values)) made.setAttribute(key, value);
      return made;
    };
    this.part = shape("rect", { class: "part", y: 1.5, height: 6, width: 0, rx: 1 });
    const aim = shape("line", { class: "aim", x1: 68 * STATED, x2: 68 * STATED, y1: 0, y2: 9 });
    svg.append(shape("rect", { class: "rail", y: 1.5, height: 6, width: 68, rx: 1 }), this.part, aim);
    const meter = element("span", { className: "meter", title: "The stroke is at 90 %: what the band promises." }, svg, this.share);
    this.line = element("tr", {}, element("td", { textContent: `${ahead} s` }), this.error, element("td", {}, meter), this.count);
  }

  show(due) {
    const held = due.filter((one) => one.held).length / due.length;
    this.error.textContent = due.length ? `${quantile(due.map((one) => one.error), 0.5).toFixed(1)} m` : "–";
    this.share.textContent = due.length ? percent(held) : "–";
    this.count.textContent = due.length.toLocaleString("en");
    this.part.setAttribute("width", due.length ? 68 * held : 0);
  }
}
