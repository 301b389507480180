// Alarms in words, the newest first; those that are still on stand above those that are over.

import { byId, element, moment, percent } from "./format.js";

const SHOWN = 40;
const LEVELS = { conflict: "alarm", no_merge: "warning", forecaster_gone: "alarm", source_silent: "alarm", degraded: "warning" };
const SIGNS = { alarm: "▲", warning: "◆", note: "●" };

const WORDS = {
  conflict: (one) => `${one.subject}: conflict within 5 s${one.p === undefined ? "" : `, ${percent(one.p)}`}`,
  no_merge: (one) => `${one.subject}: merge in 15 s unlikely${one.p_merged === undefined ? "" : `, ${percent(one.p_merged)}`}`,
  forecaster_gone: () => "The forecaster is gone; it is begun again",
  source_silent: () => "No frames come in",
  degraded: (one) => `Less is computed than usual${one.what ? `: ${one.what}` : ""}`,
};

export class AlarmList {
  constructor(store) {
    Object.assign(this, { store, last: 0, known: new Map() });
  }

  reset() {
    this.known.clear();
    this.draw();
  }

  // Takes alarms in that were raised or cleared, in their order.
  take(alarms) {
    for (const one of alarms) {
      if (one.number <= this.last) continue;
      this.last = one.number;
      const key = `${one.kind} ${one.subject}`;
      if (one.state === "cleared") {
        const raised = this.known.get(key);
        if (raised) raised.over = true;
      } else {
        this.known.delete(key);
        this.known.set(key, { ...one, over: false });
      }
    }
    if (alarms.length) this.draw();
  }

  draw() {
    const all = [...this.known.values()].reverse();
    const shown = [...all.filter((one) => !one.over), ...all.filter((one) => one.over)].slice(0, SHOWN);
    byId("alarms").replaceChildren(...shown.map((one) => this.line(one)));
    byId("alarms-none").hidden = shown.length > 0;
    const on = all.filter((one) => !one.over).length;
    byId("alarm-count").textContent = on ? `${on} on` : "";
  }

  line(one) {
    const level = LEVELS[one.kind] ?? "note";
    const words = (WORDS[one.kind] ?? (() => `${one.kind.replaceAll("_", " ")} ${one.subject ?? ""}`))(one);
    const button = element("button", { type: "button", className: one.over ? "alarm over" : "alarm" },
      element("span", { className: "sign", textContent: one.over ? "✓" : SIGNS[level], title: one.over ? "over" : level }),
      element("span", { textContent: words }),
      element("time", { textContent: moment(one.t_obs_ms ?? one.t_pub_ms) }));
    button.dataset.level = level;
    button.onclick = () => this.onFollow?.(one.subject);
    return element("li", {}, button);
  }
}
