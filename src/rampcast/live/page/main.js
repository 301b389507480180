// The page of one site: messages come in, panels are drawn. All that is shown comes from the service it was loaded from.

import { AlarmList } from "./alarms.js";
import { readColours } from "./canvas.js";
import { Diagram } from "./diagram.js";
import { byId, element, moment } from "./format.js";
import { Geometry } from "./geometry.js";
import { RampList } from "./ramp.js";
import { Replay } from "./replay.js";
import { Road } from "./road.js";
import { Store, Truth } from "./store.js";
import { Stream, fetched } from "./stream.js";
import { Trust } from "./trust.js";
import { ControlCard, VehicleCard } from "./vehicle.js";

const PANELS_EVERY = 95; // [ms] between two pictures of what changes with each message only
const ALARMS_EVERY = 1000; // [ms]
const TRUTH_EVERY = 500; // [ms] between two places of what came true

class Page {
  constructor(name, site, token) {
    this.name = name;
    this.geometry = new Geometry(site);
    this.store = new Store(this.geometry);
    this.trust = new Trust();
    this.road = new Road(byId("road"), byId("overview"), this.store);
    this.diagram = new Diagram(byId("diagram"), this.store);
    this.ramp = new RampList(this.store);
    this.alarms = new AlarmList(this.store);
    this.replay = new Replay(this.store, (action, value) => this.control(action, value));
    this.cards = [new VehicleCard(this.store), new ControlCard(this.store)];
    for (const part of [this.road, this.diagram, this.ramp, this.alarms]) part.onFollow = (id) => this.follow(id);
    byId("site-title").textContent = this.geometry.title;
    document.title = `${this.geometry.title} · rampcast`;
    this.line = "waiting";
    this.drawn = 0;
    this.fresh = true;
    this.stream = new Stream(name, {
      onMessage: (message) => this.take(message), onState: (state) => { this.line = state; }, askToken,
    }, token);
    this.askAlarms();
    requestAnimationFrame((now) => this.draw(now));
  }

  take(message) {
    const now = performance.now();
    if (message.type === "state") {
      if (this.store.takeState(message, now)) this.trust.reset();
      this.trust.takeState(this.store.frame);
    } else if (message.type === "forecast") {
      this.store.takeForecast(message, now);
      if (this.store.forecast) this.trust.takeForecast(this.store.forecast);
    } else if (message.type === "status") this.takeStatus(message);
    else if (message.type === "dropped") this.store.dropped += message.dropped;
    else if (message.type === "alarm") this.alarms.take([message]);
    this.fresh = true;
  }

  takeStatus(message) {
    this.store.status = message;
    if (!message.replay) return;
    const known = this.replay.state !== null;
    this.replay.take(message.replay);
    if (!known) this.askTruth();
  }

  get path() { return `/v1/sites/${encodeURIComponent(this.name)}`; }

  get replayed() { return `site=${encodeURIComponent(this.name)}`; }

  async askTruth() {
    const about = await fetched(`/v1/replay?${this.replayed}`, this.stream.token);
    const span = `from_ms=${about.first_ms}&to_ms=${about.last_ms}&every_ms=${TRUTH_EVERY}`;
    const { vehicles } = await fetched(`/v1/replay/truth?${this.replayed}&${span}`, this.stream.token);
    this.store.learnTruth(new Truth(vehicles, about.merges));
    this.replay.conflicts = about.conflicts ?? [];
    this.fresh = true;
  }

  async askAlarms() {
    try {
      const found = await fetched(`${this.path}/alarms?after=${this.alarms.last}`, this.stream.token);
      this.alarms.take(found.alarms);
    } catch { /* the banner tells that the service is away */ }
    setTimeout(() => this.askAlarms(), ALARMS_EVERY);
  }

  async control(action, value = null) {
    const body = JSON.stringify(value === null ? { action } : { action, value });
    const state = await fetched(`/v1/replay?${this.replayed}`, this.stream.token, { method: "POST", body, headers: { "Content-Type": "application/json" } });
    this.replay.take(state);
    this.fresh = true;
  }

  follow(id) {
    const there = id !== null && this.store.frame?.vehicles.has(id);
    this.store.followed = there && id !== this.store.followed ? id : null;
    this.store.seenFollowed = this.store.frame?.t;
    this.fresh = true;
    if (this.store.followed !== null) document.querySelector(`#ramp [data-vehicle="${CSS.escape(id)}"]`)?.scrollIntoView({ block: "nearest" });
  }

  followNext(by) {
    const order = this.ramp.order().map(({ one }) => one.id);
    if (!order.length) return;
    const place = order.indexOf(this.store.followed);
    const next = order[(place < 0 ? (by > 0 ? 0 : order.length - 1) : place + by + order.length) % order.length];
    if (next !== this.store.followed) this.follow(next);
  }

  isPaused() { return this.replay.state !== null && !this.replay.state.playing; }

  draw(now) {
    requestAnimationFrame((next) => this.draw(next));
    this.drawState(now);
    this.road.draw(now);
    if (!this.fresh || now - this.drawn < PANELS_EVERY) return;
    this.drawn = now;
    this.fresh = false;
    for (const part of [this.diagram, this.ramp, this.trust, this.replay, ...this.cards]) part.draw();
    this.drawFacts();
  }

  drawFacts() {
    const { frame, forecast, status, dropped } = this.store;
    if (frame) {
      byId("clock").textContent = moment(frame.ms);
      byId("count").textContent = frame.vehicles.size;
    }
    if (forecast) byId("model").textContent = `${forecast.model}${forecast.samples ? `, ${forecast.samples} futures` : ""}`;
    byId("lost").textContent = (status?.frames?.lost ?? 0) + dropped;
    byId("tick").textContent = status?.tick_ms?.p99 != null ? `${Math.round(status.tick_ms.p99)} ms` : "–";
    byId("age").textContent = forecast?.age != null ? `${Math.round(forecast.age)} ms` : "–";
  }

  // What stands in the banner and in the chip: one of lost, stale, degraded, paused, replay, live.
  state(now) {
    const { forecast, status, heard } = this.store;
    if (this.line === "lost") return ["lost", "stale", "The line to the service is broken; trying again"];
    if (heard === null && status?.ready === false) return ["warming up", "note", "The forecaster warms up. The very first time it is compiled, which takes a minute"];
    if (heard === null && !status) return ["waiting", null, ""];
    if (this.isPaused()) return ["paused", null, ""];
    if (this.store.isLate(now)) {
      const what = status?.stale === "source" ? "No frames come in" : "No new forecasts";
      return ["stale", "stale", `${what} for ${((now - heard) / 1000).toFixed(1)} s: what is shown is old`];
    }
    if (status?.stale === "forecaster" && heard === null) return ["waiting", null, ""];
    const degraded = forecast?.degraded ?? status?.degraded;
    if (degraded) return ["degraded", "degraded", `Degraded: ${degraded}. There is more to compute than time`];
    return [this.replay.state ? "replay" : "live", null, ""];
  }

  drawState(now) {
    const [state, kind, words] = this.state(now);
    const chip = byId("state");
    if (chip.dataset.state !== state) Object.assign(chip, { textContent: state }).dataset.state = state;
    const banner = byId("banner");
    banner.hidden = kind === null;
    if (kind !== null && banner.textContent !== words) Object.assign(banner, { textContent: words }).dataset.kind = kind;
    document.body.classList.toggle("is-stale", kind === "stale");
  }
}

function askToken(wasWrong = true) {
  const dialog = byId("token");
  byId("token-wrong").hidden = !wasWrong;
  dialog.showModal();
  byId("token-value").focus();
  return new Promise((done) => {
    dialog.addEventListener("close", () => {
      const { value } = byId("token-value");
      byId("token-value").value = "";
      done(value);
    }, { once: true });
  });
}

function setTheme(theme) {
  document.documentElement.dataset.theme = theme;
  try { localStorage.setItem("rampcast-theme", theme); } catch { /* private windows keep nothing */ }
  readColours();
}

function firstTheme() {
  try {
    const kept = localStorage.getItem("rampcast-theme");
    if (kept) return kept;
  } catch { /* private windows keep nothing */ }
  return matchMedia("(prefers-color-scheme: light)").matches ? "light" : "dark";
}

function keys(page) {
  const otherTheme = () => {
    setTheme(document.documentElement.dataset.theme === "light" ? "dark" : "light");
    page.fresh = true;
  };
  const toggleTruth = () => {
    page.road.truth = page.diagram.truth = !page.road.truth;
  };
  const actions = {
    n: () => page.followNext(1), p: () => page.followNext(-1), Escape: () => page.follow(null), f: () => page.road.nextMode(), t: toggleTruth,
    l: otherTheme, "+": () => page.road.zoom(1.3), "=": () => page.road.zoom(1.3), "-": () => page.road.zoom(1 / 1.3), 0: () => page.road.zoom(0),
    "?": () => byId("help").showModal(), " ": () => page.replay.playOrPause(), "[": () => page.replay.faster(-1), "]": () => page.replay.faster(1),
    ArrowLeft: (event) => (event.shiftKey ? page.replay.seekBy(-5) : page.replay.step(-1)),
    ArrowRight: (event) => (event.shiftKey ? page.replay.seekBy(5) : page.replay.step(1)),
  };
  document.addEventListener("keydown", (event) => {
    const name = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    const action = actions[name];
    if (!action || event.ctrlKey || event.metaKey || event.altKey || document.querySelector("dialog[open]")) return;
    if (["SELECT", "INPUT"].includes(event.target.tagName) || (name === " " && event.target.tagName === "BUTTON")) return;
    event.preventDefault();
    action(event);
    page.fresh = true;
  });
  const legend = document.querySelector(".road .legend").cloneNode(true);
  legend.classList.add("help-legend");
  byId("help-legend").append(legend);
  byId("theme").onclick = otherTheme;
  byId("help-open").onclick = () => byId("help").showModal();
  byId("unfollow").onclick = () => page.follow(null);
  window.addEventListener("resize", () => { page.fresh = true; });
}

function offerSites(names, chosen) {
  const select = byId("sites");
  select.hidden = names.length < 2;
  select.append(...names.map((name) => element("option", { value: name, textContent: name, selected: name === chosen })));
  select.onchange = () => { location.search = `?site=${encodeURIComponent(select.value)}`; };
}

async function main() {
  setTheme(firstTheme());
  const asked = new URLSearchParams(location.search).get("site");
  let token = null;
  let sites;
  while (!sites) {
    try {
      sites = await fetched("/v1/sites", token);
    } catch (error) {
      if (error.status === 401) token = await askToken(token !== null);
      else await new Promise((done) => { setTimeout(done, 1000); });
    }
  }
  const names = sites.sites.map((one) => one.id);
  const chosen = names.includes(asked) ? asked : names[0];
  offerSites(names, chosen);
  const about = await fetched(`/v1/sites/${encodeURIComponent(chosen)}`, token);
  const page = new Page(chosen, about.rampcast, token);
  keys(page);
  window.rampcast = page; // for tests, and for who looks in the console
}

main();
