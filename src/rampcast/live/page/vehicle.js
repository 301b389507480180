// What is told of the vehicle that is followed, and of metering and advice where a message has them.

import { byId, element, km_h, percent, reaches } from "./format.js";
import { likeliestGap } from "./geometry.js";

const facts = (pairs) => pairs.filter(Boolean).map(([name, value, wide]) => element("div", { className: wide ? "wide-fact" : "" },
  element("dt", { textContent: name }), element("dd", { textContent: value, title: value })));

export class VehicleCard {
  constructor(store) { this.store = store; }

  draw() {
    const { frame, followed, geometry } = this.store;
    const one = followed === null ? null : frame?.vehicles.get(followed);
    byId("vehicle").hidden = !one;
    if (!one) return;
    const lane = geometry.lanes.find((each) => each.number === one.lane);
    const role = one.lane === geometry.target ? "target lane" : { ramp: "on the ramp", exit: "off-ramp", shoulder: "shoulder" }[lane?.role];
    byId("vehicle-title").textContent = `Vehicle ${one.id}`;
    const when = one.p_merged && this.store.onRamp(one) ? reaches(one.p_merged, 0.5) : null;
    const gap = this.store.onRamp(one) ? likeliestGap(one, frame, geometry.target) : null;
    const risk = one.conflicts;
    byId("vehicle-facts").replaceChildren(...facts([
      ["speed", km_h(one.v)],
      ["place", `${one.x.toFixed(0)} m`],
      ["lane", `${one.lane || "–"}${role ? `, ${role}` : ""}`],
      one.p_merged && this.store.onRamp(one) && ["merges in", when === null ? "not in 15 s" : `${when.toFixed(1)} s`],
      gap && ["behind, ahead", `${gap.behind?.id ?? "nobody"}, ${gap.ahead?.id ?? "nobody"}`],
      gap && ["probability", percent(gap.p)],
      risk && ["TTC < 3 s", percent(risk.ttc)],
      risk && ["DRAC > 3 m/s²", percent(risk.drac)],
      risk && ["PET < 2 s", percent(risk.pet)],
      one.advice && ["advice", words(one.advice), true],
    ]));
  }
}

// Metering and advice, and what it brings beside what happens without: shown only where a message has it.
export class ControlCard {
  constructor(store) { this.store = store; }

  draw() {
    const control = this.store.frame?.control ?? this.store.forecast?.control;
    byId("control").hidden = !control;
    if (!control) return;
    const { with: own, without: other, ...rest } = control;
    const compared = isTold(own) && isTold(other);
    const shown = Object.entries(compared ? rest : control);
    byId("control-facts").replaceChildren(...facts(shown.map(([name, value]) => [name.replaceAll("_", " "), words(value)])));
    byId("control-compared").hidden = !compared;
    if (compared) byId("control-rows").replaceChildren(...rows(own, other));
  }
}

const isTold = (value) => typeof value === "object" && value !== null && !Array.isArray(value);

// One row for each name: what happens with control, and without.
function rows(own, other) {
  const names = [...new Set([...Object.keys(own), ...Object.keys(other)])];
  return names.map((name) => element("tr", {}, element("th", { scope: "row", textContent: name.replaceAll("_", " ") }),
    element("td", { textContent: words(own[name] ?? "–") }), element("td", { textContent: words(other[name] ?? "–") })));
}

function words(value) {
  if (Array.isArray(value)) return value.map(words).join(", ");
  if (typeof value !== "object" || value === null) return `${value}`;
  return Object.entries(value).map(([name, one]) => `${name.replaceAll("_", " ")} ${words(one)}`).join(", ");
}
