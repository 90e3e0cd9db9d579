// An episode seen from above, on a canvas: ground, trails with speed as colour, footprints, predicted paths, contact.
"use strict";

const HORIZON = 10, QUARTER = Math.PI / 2, AHEAD = 3; // [s], [rad], [s] shown where no contact is predicted

// Colours are the style sheet's, so that they follow dark and light.
function colours() {
  const style = getComputedStyle(document.documentElement);
  const named = (name) => style.getPropertyValue(`--${name}`).trim();
  const names = ["ground", "town", "kerb", "road", "marking", "ink", "faint", "vehicle", "vehicle-slow", "pedestrian",
    "pedestrian-slow", "danger", "panel"];
  return Object.fromEntries(names.map((name) => [name, named(name)]));
}

function mixed(slow, fast, share) {
  const [a, b] = [slow, fast].map((hex) => [1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16)));
  const t = Math.min(Math.max(share, 0), 1);
  return `rgb(${a.map((from, i) => Math.round(from + t * (b[i] - from))).join(",")})`;
}

// Make the canvas as fine as the screen and return its context, scaled to CSS pixels, with width and height.
function prepared(canvas) {
  const ratio = window.devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  return { context, width, height };
}

// Where the vehicle is after `time` seconds at its speed and curvature: at most a quarter turn (CurvTTC).
function onArc(state, time) {
  const along = state.speed * time, turn = state.curvature * along;
  if (Math.abs(turn) < 1e-6) {
    return { x: state.x + along * Math.cos(state.heading), y: state.y + along * Math.sin(state.heading),
      heading: state.heading };
  }
  const heading = state.heading + turn;
  return { x: state.x + (Math.sin(heading) - Math.sin(state.heading)) / state.curvature,
    y: state.y - (Math.cos(heading) - Math.cos(state.heading)) / state.curvature, heading };
}

// How long the arc is followed [s].
function arcTime(state) {
  const rate = Math.abs(state.curvature) * state.speed;
  return rate > 0 ? Math.min(HORIZON, QUARTER / rate) : HORIZON;
}

// The point of the vehicle's rectangle nearest to a pedestrian: where they touch.
function contactPoint(car, ped, size) {
  const c = Math.cos(car.heading), s = Math.sin(car.heading), dx = ped.x - car.x, dy = ped.y - car.y;
  const clamp = (value, half) => Math.min(Math.max(value, -half), half);
  const along = clamp(c * dx + s * dy, size[0] / 2), left = clamp(c * dy - s * dx, size[1] / 2);
  return { x: car.x + c * along - s * left, y: car.y + s * along + c * left };
}

class Scene {
  constructor(canvas) {
    this.canvas = canvas;
    this.options = { predict: true, trails: true };
  }

  show(episode, ground) {
    this.episode = episode;
    this.ground = ground ?? null;
    const xs = [], ys = [], room = episode.size[0] * 0.6;
    for (let k = 0; k < episode.frames; k += 1) {
      xs.push(episode.x[k] - room, episode.x[k] + room, episode.ped_x[k] - 1, episode.ped_x[k] + 1);
      ys.push(episode.y[k] - room, episode.y[k] + room, episode.ped_y[k] - 1, episode.ped_y[k] + 1);
    }
    for (const one of episode.people) {
      xs.push(...one.x);
      ys.push(...one.y);
    }
    const [left, right, low, high] = [Math.min(...xs), Math.max(...xs), Math.min(...ys), Math.max(...ys)];
    this.view = { x: (left + right) / 2, y: (low + high) / 2, wide: Math.max(right - left, 8),
      tall: Math.max(high - low, 8) };
  }

  draw(time) {
    this.drawAt(stateAt(this.episode, time));
  }

  drawAt(state) {
    const { context, width, height } = prepared(this.canvas), colour = colours();
    const scale = Math.min(width / this.view.wide, height / this.view.tall) * 0.94;
    const shape = { context, colour, scale,
      px: (x) => width / 2 + (x - this.view.x) * scale, py: (y) => height / 2 - (y - this.view.y) * scale };
    context.fillStyle = colour.ground;
    context.fillRect(0, 0, width, height);
    context.lineJoin = context.lineCap = "round";
    if (this.ground) this.drawGround(shape);
    if (this.options.trails) this.drawTrails(shape, state);
    for (const one of state.people) this.drawPedestrian(shape, one, 1);
    this.drawPedestrian(shape, { x: state.ped_x, y: state.ped_y, vx: state.ped_vx, vy: state.ped_vy }, 1);
    this.drawVehicle(shape, state, 1);
    if (this.options.predict) this.drawPrediction(shape, state);
    this.drawScaleBar(shape, width, height);
  }

  line(shape, points, style, thick, dash = []) {
    const { context } = shape;
    context.beginPath();
    points.forEach(([x, y], k) => context[k ? "lineTo" : "moveTo"](shape.px(x), shape.py(y)));
    context.strokeStyle = style;
    context.lineWidth = thick;
    context.setLineDash(dash);
    context.stroke();
    context.setLineDash([]);
  }

  drawGround(shape) {
    const { context, colour, scale } = shape, [ox, oy] = this.episode.middle;
    const local = (points) => points.map(([x, y]) => [x - ox, y - oy]);
    context.lineCap = "butt";
    this.drawTown(shape, this.ground.kerbs.map(local), this.ground.marks.map(local));
    this.line(shape, local(this.ground.lane), colour.road, this.ground.lane_width * scale);
    if (this.ground.crosswalk.length) this.drawCrosswalk(shape, local(this.ground.crosswalk));
    this.line(shape, local(this.ground.lane), colour.faint, 1, [8, 8]);
    this.line(shape, local(this.ground.route), colour.faint, 1, [2, 5]);
    for (const [x, y, heading, length, width] of this.ground.parked) {
      const [c, s] = [Math.cos(heading), Math.sin(heading)];
      const corners = [[1, 1], [1, -1], [-1, -1], [-1, 1]].map(([a, b]) => [a * length / 2, b * width / 2]);
      context.beginPath();
      local(corners.map(([u, v]) => [x + c * u - s * v, y + s * u + c * v])).forEach(
        ([px, py], k) => context[k ? "lineTo" : "moveTo"](shape.px(px), shape.py(py)));
      context.closePath();
      context.fillStyle = colour.faint;
      context.fill();
    }
    context.lineCap = "round";
  }

  // The roads around the lane; each kerb inside another one is that of a block or an island.
  drawTown(shape, kerbs, marks) {
    const { context, colour } = shape;
    context.beginPath();
    for (const kerb of kerbs) {
      kerb.forEach(([x, y], k) => context[k ? "lineTo" : "moveTo"](shape.px(x), shape.py(y)));
      context.closePath();
    }
    context.fillStyle = colour.town;
    context.fill("evenodd");
    context.strokeStyle = colour.kerb;
    context.lineWidth = 1;
    context.stroke();
    for (const mark of marks) this.line(shape, mark, colour.marking, 1);
  }

  // Stripes of half a metre, a metre apart, along the road: across the longer side of the crosswalk.
  drawCrosswalk(shape, corners) {
    const { context, colour, scale } = shape;
    const sides = corners.map(([x, y], k) => {
      const [nx, ny] = corners[(k + 1) % corners.length];
      return { length: Math.hypot(nx - x, ny - y), ux: nx - x, uy: ny - y };
    });
    const { length, ux, uy } = sides.reduce((a, b) => (b.length > a.length ? b : a)), [c, s] = [ux / length, uy / length];
    const places = corners.map(([x, y]) => c * x + s * y), aside = corners.map(([x, y]) => c * y - s * x);
    const [near, far] = [Math.min(...aside), Math.max(...aside)];
    context.save();
    context.beginPath();
    corners.forEach(([x, y], k) => context[k ? "lineTo" : "moveTo"](shape.px(x), shape.py(y)));
    context.closePath();
    context.fillStyle = colour.road;
    context.fill();
    context.clip();
    for (let at = Math.min(...places) + 0.5; at < Math.max(...places); at += 1) {
      this.line(shape, [near, far].map((side) => [c * at - s * side, s * at + c * side]), colour.marking, 0.5 * scale);
    }
    context.restore();
  }

  drawTrails(shape, state) {
    const { colour } = shape, { episode } = this;
    const agents = [["x", "y", "speed", "vehicle", 8, 5], ["ped_x", "ped_y", "ped_speed", "pedestrian", 3, 4]];
    for (const [x, y, speed, name, top, thick] of agents) {
      const rest = [];
      for (let k = state.frame; k < episode.frames; k += 1) rest.push([episode[x][k], episode[y][k]]);
      this.line(shape, rest, colour.faint, 1, [1, 4]);
      for (let k = 1; k <= state.frame; k += 1) {
        const style = mixed(colour[`${name}-slow`], colour[name], episode[speed][k] / top);
        this.line(shape, [[episode[x][k - 1], episode[y][k - 1]], [episode[x][k], episode[y][k]]], style, thick);
      }
    }
  }

  drawPrediction(shape, state) {
    const { context, colour } = shape, meets = Number.isFinite(state.curvttc);
    const time = meets ? state.curvttc : AHEAD, arc = Math.min(time, arcTime(state)), points = [];
    for (let k = 0; k <= 24; k += 1) {
      const at = onArc(state, (arc * k) / 24);
      points.push([at.x, at.y]);
    }
    const ped = { x: state.ped_x + time * state.ped_vx, y: state.ped_y + time * state.ped_vy, vx: state.ped_vx,
      vy: state.ped_vy };
    this.line(shape, points, meets ? colour.danger : colour.vehicle, 2, [6, 4]);
    this.line(shape, [[state.ped_x, state.ped_y], [ped.x, ped.y]], meets ? colour.danger : colour.pedestrian, 2, [6, 4]);
    if (!meets) return;
    const car = onArc(state, arc), touch = contactPoint(car, ped, this.episode.size);
    this.drawVehicle(shape, car, 0.35);
    this.drawPedestrian(shape, ped, 0.35);
    const [x, y] = [shape.px(touch.x), shape.py(touch.y)];
    context.strokeStyle = colour.danger;
    context.lineWidth = 2.5;
    context.beginPath();
    for (const [dx, dy] of [[1, 1], [1, -1]]) {
      context.moveTo(x - 6 * dx, y - 6 * dy);
      context.lineTo(x + 6 * dx, y + 6 * dy);
    }
    context.stroke();
  }

  drawVehicle(shape, at, solid) {
    const { context, colour, scale } = shape, [length, width] = this.episode.size;
    context.save();
    context.translate(shape.px(at.x), shape.py(at.y));
    context.rotate(-at.heading);
    context.globalAlpha = solid;
    context.beginPath();
    context.rect((-length / 2) * scale, (-width / 2) * scale, length * scale, width * scale);
    context.fillStyle = colour.vehicle;
    if (solid === 1) context.fill();
    context.strokeStyle = solid === 1 ? colour.panel : colour.vehicle;
    context.lineWidth = 1.5;
    context.stroke();
    context.beginPath(); // the windscreen says where the front is
    context.moveTo(length * 0.12 * scale, width * 0.4 * scale);
    context.lineTo(length * 0.28 * scale, 0);
    context.lineTo(length * 0.12 * scale, -width * 0.4 * scale);
    context.stroke();
    context.restore();
  }

  drawPedestrian(shape, at, solid) {
    const { context, colour, scale } = shape, radius = Math.max(this.episode.size[2] * scale, 4);
    const x = shape.px(at.x), y = shape.py(at.y), speed = Math.hypot(at.vx, at.vy);
    context.save();
    context.globalAlpha = solid;
    context.beginPath();
    context.arc(x, y, radius, 0, 2 * Math.PI);
    context.fillStyle = colour.pedestrian;
    if (solid === 1) context.fill();
    context.strokeStyle = solid === 1 ? colour.panel : colour.pedestrian;
    context.lineWidth = 1.5;
    context.stroke();
    if (solid === 1 && speed > 0.1) {
      context.beginPath();
      context.moveTo(x, y);
      context.lineTo(x + (at.vx / speed) * radius * 2.2, y - (at.vy / speed) * radius * 2.2);
      context.strokeStyle = colour.pedestrian;
      context.lineWidth = 2.5;
      context.stroke();
    }
    context.restore();
  }

  drawScaleBar(shape, width, height) {
    const { context, colour, scale } = shape, metres = [50, 20, 10, 5, 2, 1].find((m) => m * scale < width * 0.3) ?? 1;
    context.fillStyle = context.strokeStyle = colour.ink;
    context.lineWidth = 2;
    context.beginPath();
    context.moveTo(12, height - 12);
    context.lineTo(12 + metres * scale, height - 12);
    context.stroke();
    context.font = "12px system-ui, sans-serif";
    context.textAlign = "left";
    context.fillText(`${metres} m`, 12, height - 18);
  }
}
