// Episodes as `vpsci_ros.view.view_page` writes them: 16-bit whole numbers in base64, unpacked when an episode is shown.
"use strict";

const UNKNOWN = -32768, INFINITE = 32767;

class Source {
  constructor(packed) {
    Object.assign(this, packed);
    this.byName = new Map(this.episodes.map((episode, index) => [episode.name, index]));
    let first = 0, beside = 0;
    for (const episode of this.episodes) {
      episode.first = first;
      episode.beside = beside;
      first += episode.frames;
      beside += episode.frames * (episode.others ?? 0);
    }
    this.codes = this.otherCodes = null;
  }

  // Return the quantities of an episode over time: name -> Float32Array, and what is known of it as a whole.
  episode(index) {
    this.codes ??= decoded(this.frames);
    const about = this.episodes[index], width = this.fields.length, columns = {};
    this.fields.forEach((name, column) => {
      const values = new Float32Array(about.frames);
      for (let k = 0; k < about.frames; k += 1) {
        const code = this.codes[(about.first + k) * width + column];
        values[k] = code === UNKNOWN ? NaN : code === INFINITE ? Infinity : code * this.steps[column];
      }
      columns[name] = values;
    });
    const walk = columns.ped_vx.map((vx, k) => Math.hypot(vx, columns.ped_vy[k]));
    return {
      ...about, ...columns, index, source: this, period: this.period, groupName: this.groups[about.group],
      duration: (about.frames - 1) * this.period, ped_speed: walk, acceleration: slope(columns.speed, this.period),
      ped_acceleration: slope(walk, this.period), people: this.people(about),
    };
  }

  // Return the other pedestrians of an episode, each as name -> Float32Array over time.
  people(about) {
    if (!about.others) return [];
    this.otherCodes ??= decoded(this.others);
    return Array.from({ length: about.others }, (_, n) => {
      const begin = about.beside + n * about.frames;
      return Object.fromEntries(["x", "y", "vx", "vy"].map((name, column) => [name, Float32Array.from(
        { length: about.frames }, (_, k) => this.otherCodes[(begin + k) * 4 + column] * this.other_steps[column])]));
    });
  }
}

function decoded(text) {
  const bytes = atob(text), out = new Uint8Array(bytes.length);
  for (let i = 0; i < bytes.length; i += 1) out[i] = bytes.charCodeAt(i);
  return new Int16Array(out.buffer);
}

// Derivative over a fifth of a second about each frame, or what of it lies in the episode.
function slope(values, period) {
  const reach = Math.max(1, Math.round(0.1 / period)), last = values.length - 1;
  return values.map((_, k) => {
    const from = Math.max(0, k - reach), to = Math.min(last, k + reach);
    return to > from ? (values[to] - values[from]) / ((to - from) * period) : 0;
  });
}

// The state at a time [s], between two frames where need be; CurvTTC and who drives are those of the frame before.
function stateAt(episode, time) {
  const place = Math.min(Math.max(time / episode.period, 0), episode.frames - 1);
  const k = Math.floor(place + 1e-6), next = Math.min(k + 1, episode.frames - 1), part = Math.max(0, place - k);
  const between = (name) => episode[name][k] + part * (episode[name][next] - episode[name][k]);
  const state = { frame: k, curvttc: episode.curvttc[k], held: episode.held[k] > 0 };
  for (const name of ["x", "y", "heading", "speed", "curvature", "ped_x", "ped_y", "ped_vx", "ped_vy", "ped_speed",
    "acceleration", "ped_acceleration"]) state[name] = between(name);
  const mixed = (values) => values[k] + part * (values[next] - values[k]);
  state.people = episode.people.map((one) => ({ x: mixed(one.x), y: mixed(one.y), vx: mixed(one.vx), vy: mixed(one.vy) }));
  return state;
}
