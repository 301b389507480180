// Numbers as text, and small sums that several panels need.

export const HORIZONS = 16; // quantiles and probabilities are told at 0, 1 ... 15 s
export const MEDIAN = 2; // of the five levels 5, 25, 50, 75, 95 %

export const km_h = (speed) => (Number.isFinite(speed) ? `${Math.round(3.6 * speed)} km/h` : "–");
export const percent = (share) => `${Math.round(100 * share)} %`;
export const metres = (x) => `${x.toFixed(x < 10 ? 1 : 0)} m`;

export function clock(seconds) {
  const sign = seconds < 0 ? "−" : "";
  const tenths = Math.round(Math.abs(seconds) * 10);
  const minutes = Math.floor(tenths / 600);
  return `${sign}${minutes}:${((tenths % 600) / 10).toFixed(1).padStart(4, "0")}`;
}

// A moment of a site: of a wall clock as such, of a recording since its beginning.
export function moment(ms) {
  return ms > 1e11 ? new Date(ms).toISOString().slice(11, 21) : clock(ms / 1000);
}

// When a probability, told at whole seconds, reaches a level; null where it does not within the forecast.
export function reaches(p, level) {
  for (let t = 1; t < p.length; t += 1) {
    if (p[t] >= level) return Math.max(0, t - 1 + (level - p[t - 1]) / Math.max(p[t] - p[t - 1], 1e-9));
  }
  return null;
}

// A list of values at whole seconds, at any time between.
export function at(values, time) {
  const low = Math.max(0, Math.min(values.length - 1, Math.floor(time)));
  const high = Math.min(values.length - 1, low + 1);
  return values[low] + (time - low) * (values[high] - values[low]);
}

// The five quantiles of a vehicle's front so many seconds after its forecast was made.
export const bandsAt = (q, time) => q[0].map((_, level) => at(q.map((levels) => levels[level]), time));

export function quantile(values, level) {
  if (!values.length) return NaN;
  const sorted = Float64Array.from(values).sort();
  return sorted[Math.min(sorted.length - 1, Math.floor(level * sorted.length))];
}

export const clamp = (value, low, high) => Math.min(high, Math.max(low, value));

export function element(name, properties = {}, ...children) {
  const made = Object.assign(document.createElement(name), properties);
  made.append(...children);
  return made;
}

export const byId = (id) => document.getElementById(id);
