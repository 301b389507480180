// The list of ramp vehicles by time of merging: when, with which probability by then, and into which gap.

import { HORIZONS, byId, clock, element, percent, reaches } from "./format.js";

const SVG = "http://www.w3.org/2000/svg";
const [WIDE, HIGH] = [90, 26]; // of a curve, in its own units
const BARS = [-2, -1, 0, 1, 2]; // gaps that have a bar; those beyond count to the outermost
const NAMES = { "-2": "−2 or farther back", "-1": "−1", 0: "0", 1: "+1", 2: "+2 or farther on" };
const SHORT = { "-2": "", "-1": "−1", 0: "0", 1: "+1", 2: "" };
const OLD = 400; // [ms] beyond which an age is marked

const shape = (name, values) => {
  const made = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(values)) made.setAttribute(key, value);
  return made;
};

export class RampList {
  constructor(store) {
    this.store = store;
    this.list = byId("ramp");
    this.rows = new Map();
  }

  // Ramp vehicles, those first who will merge first; then those that will not within the forecast.
  order() {
    const { frame } = this.store;
    return [...frame.vehicles.values()].filter((one) => this.store.onRamp(one))
      .map((one) => ({ one, when: one.p_merged ? reaches(one.p_merged, 0.5) : null, last: one.p_merged?.[HORIZONS - 1] ?? 0 }))
      .sort((a, b) => (a.when ?? 99 - a.last) - (b.when ?? 99 - b.last) || b.one.x - a.one.x);
  }

  draw() {
    if (!this.store.frame) return;
    const found = this.order();
    const wanted = found.map(({ one, when, last }) => {
      let row = this.rows.get(one.id);
      if (!row) this.rows.set(one.id, (row = new Row(one.id, (id) => this.onFollow?.(id))));
      row.show(one, when, last, this.store.followed === one.id);
      return row.item;
    });
    const there = new Set(found.map(({ one }) => one.id));
    for (const [id, row] of this.rows) if (!there.has(id)) { row.item.remove(); this.rows.delete(id); }
    wanted.forEach((item, place) => { if (this.list.children[place] !== item) this.list.insertBefore(item, this.list.children[place] ?? null); });
    byId("ramp-none").hidden = found.length > 0;
  }
}

class Row {
  constructor(id, follow) {
    this.parts = {
      id: element("span", { className: "id", textContent: id }),
      when: element("b"), span: element("small"), age: element("span", { className: "age" }),
      area: shape("path", { class: "area" }), curve: shape("path", { class: "curve" }),
      bars: BARS.map((_, place) => shape("rect", { class: "bar", x: place * 17 + 2, width: 13, rx: 1.5 })),
      shares: BARS.map((_, place) => shape("text", { x: place * 17 + 8.5 })),
    };
    const { parts } = this;
    const curve = shape("svg", { viewBox: `0 0 ${WIDE} ${HIGH + 2}`, preserveAspectRatio: "none", "aria-hidden": "true" });
    curve.append(shape("line", { class: "half", x1: 0, x2: WIDE, y1: HIGH / 2 + 1, y2: HIGH / 2 + 1 }), parts.area, parts.curve,
      shape("line", { class: "axis", x1: 0, x2: WIDE, y1: HIGH + 1, y2: HIGH + 1 }));
    const gaps = shape("svg", { viewBox: "0 0 85 36", "aria-hidden": "true" });
    gaps.append(shape("line", { class: "axis", x1: 0, x2: 85, y1: 26, y2: 26 }), ...parts.bars, ...parts.shares,
      ...BARS.map((gap, place) => { const name = shape("text", { x: place * 17 + 8.5, y: 35 }); name.textContent = SHORT[gap]; return name; }));
    this.button = element("button", { type: "button", className: "row", onclick: () => follow(id) },
      parts.id, element("span", { className: "when" }, parts.when, parts.span), curve, gaps, parts.age);
    this.item = element("li", {}, this.button);
    this.item.dataset.vehicle = id;
  }

  show(one, when, last, followed) {
    const { parts } = this;
    parts.when.textContent = when === null ? "not in 15 s" : `${when.toFixed(1)} s`;
    const [early, late] = one.p_merged ? [reaches(one.p_merged, 0.05), reaches(one.p_merged, 0.95)] : [null, null];
    parts.span.textContent = when === null ? (last > 0 ? `with ${percent(1 - last)}` : "") : `${(early ?? 0).toFixed(1)} to ${late === null ? "> 15" : late.toFixed(1)} s`;
    this.button.classList.toggle("late", when === null);
    this.button.setAttribute("aria-pressed", followed);
    parts.age.textContent = one.age_ms < 1000 ? `${(one.age_ms / 1000).toFixed(1)} s` : `${Math.round(one.age_ms / 1000)} s`;
    parts.age.classList.toggle("old", one.age_ms > OLD);
    this.showCurve(one.p_merged ?? []);
    this.showGaps(one.gap ?? {}, when);
  }

  showCurve(p) {
    const points = p.map((share, t) => `${((t / (HORIZONS - 1)) * WIDE).toFixed(1)} ${(1 + HIGH * (1 - share)).toFixed(1)}`);
    this.parts.curve.setAttribute("d", points.length ? `M${points.join("L")}` : "");
    this.parts.area.setAttribute("d", points.length ? `M0 ${HIGH + 1}L${points.join("L")}L${WIDE} ${HIGH + 1}Z` : "");
  }

  showGaps(gap, when) {
    const shares = BARS.map(() => 0);
    for (const [index, p] of Object.entries(gap)) shares[Math.min(4, Math.max(0, Number(index) + 2))] += p;
    const most = Math.max(...shares);
    const first = shares.indexOf(most);
    shares.forEach((share, place) => {
      const [bar, words] = [this.parts.bars[place], this.parts.shares[place]];
      const tall = 16 * share;
      bar.setAttribute("y", 26 - tall);
      bar.setAttribute("height", tall);
      const top = place === first && share > 0;
      bar.setAttribute("class", top ? "bar top" : "bar");
      words.setAttribute("y", 24 - tall);
      words.setAttribute("class", "top");
      words.textContent = top ? percent(share).replace(" ", "") : "";
    });
    const likeliest = most > 0 ? `, gap ${NAMES[BARS[first]]} with ${percent(most)}` : "";
    this.button.setAttribute("aria-label", `Vehicle ${this.parts.id.textContent}: ${when === null ? "merges not within 15 s" : `merges in ${when.toFixed(1)} s`}${likeliest}`);
  }
}
