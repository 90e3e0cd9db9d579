// Speeds, accelerations and CurvTTC over time, with a cursor; a press on the chart goes to that time.
"use strict";

const STRIPS = [
  { title: "speed [m/s]", lines: [["speed", "vehicle", []], ["ped_speed", "pedestrian", [5, 3]]], low: 0 },
  { title: "acceleration [m/s²]", lines: [["acceleration", "vehicle", []], ["ped_acceleration", "pedestrian", [5, 3]]] },
  { title: "CurvTTC [s]", lines: [["curvttc", "ink", []]], low: 0, high: 10, marks: [[5, "critical"], [2, "conflict"]] },
];
const MARGIN = { left: 34, right: 8, top: 17, bottom: 18 };

class Charts {
  constructor(canvas, goTo) {
    this.canvas = canvas;
    const jump = (event) => {
      const box = canvas.getBoundingClientRect(), wide = box.width - MARGIN.left - MARGIN.right;
      goTo(((event.clientX - box.left - MARGIN.left) / wide) * this.episode.duration);
    };
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      jump(event);
    });
    canvas.addEventListener("pointermove", (event) => event.buttons && jump(event));
  }

  show(episode) {
    this.episode = episode;
    this.ranges = STRIPS.map((strip) => {
      const values = strip.lines.flatMap(([name]) => [...episode[name]]).filter(Number.isFinite);
      const low = strip.low ?? Math.min(-2, ...values), high = strip.high ?? Math.max(2, ...values) * 1.08;
      return [low, high];
    });
  }

  draw(time) {
    const { context, width, height } = prepared(this.canvas), colour = colours(), { episode } = this;
    const x = (at) => MARGIN.left + (at / Math.max(episode.duration, episode.period)) * (width - MARGIN.left - MARGIN.right);
    const tall = (height - MARGIN.bottom) / STRIPS.length;
    context.font = "11px system-ui, sans-serif";
    STRIPS.forEach((strip, n) => {
      const [low, high] = this.ranges[n], bottom = (n + 1) * tall, top = n * tall + MARGIN.top;
      const y = (value) => bottom - ((value - low) / (high - low)) * (bottom - top);
      this.drawHeld(context, colour, x, top, bottom);
      this.drawFrame(context, colour, strip, [low, high], { x, y, top, bottom, width });
      for (const [name, role, dash] of strip.lines) {
        this.drawLine(context, episode[name], x, (value) => y(Math.min(Math.max(value, low), high)), colour[role], dash);
      }
    });
    this.drawTimes(context, colour, x, height);
    context.strokeStyle = colour.ink;
    context.lineWidth = 1.5;
    context.beginPath();
    context.moveTo(x(time), MARGIN.top - 4);
    context.lineTo(x(time), height - MARGIN.bottom);
    context.stroke();
  }

  // Shade the time in which the policies hold the agents.
  drawHeld(context, colour, x, top, bottom) {
    const { held, period, frames } = this.episode;
    context.fillStyle = colour.road;
    for (let k = 0; k < frames; k += 1) {
      if (!held[k]) continue;
      const from = k;
      while (k + 1 < frames && held[k + 1]) k += 1;
      context.fillRect(x(from * period), top, x(Math.min(k + 1, frames - 1) * period) - x(from * period), bottom - top);
    }
  }

  drawFrame(context, colour, strip, [low, high], { x, y, top, bottom, width }) {
    context.strokeStyle = colour.faint;
    context.fillStyle = colour.ink;
    context.lineWidth = 1;
    context.setLineDash([]);
    const levels = strip.marks ?? (low < 0 ? [[0, ""]] : []);
    for (const [level, name] of levels) {
      context.setLineDash(level ? [3, 4] : []);
      context.beginPath();
      context.moveTo(x(0), y(level));
      context.lineTo(width - MARGIN.right, y(level));
      context.stroke();
      context.textAlign = "right";
      context.fillText(level, x(0) - 4, y(level) + 4);
      if (name) context.fillText(name, width - MARGIN.right - 2, y(level) - 3);
    }
    context.setLineDash([]);
    context.beginPath();
    context.moveTo(x(0), top);
    context.lineTo(x(0), bottom);
    context.stroke();
    context.textAlign = "left";
    context.fillText(strip.title, x(0), top - 5);
    context.textAlign = "right";
    const round = (value) => (Math.abs(value) < 10 ? value.toFixed(1) : value.toFixed(0));
    context.fillText(round(high), x(0) - 4, top + 8);
    if (!strip.marks) context.fillText(round(low), x(0) - 4, bottom);
  }

  drawLine(context, values, x, y, style, dash) {
    context.strokeStyle = style;
    context.lineWidth = 1.8;
    context.setLineDash(dash);
    context.beginPath();
    let down = false;
    values.forEach((value, k) => {
      const known = Number.isFinite(value);
      if (known) context[down ? "lineTo" : "moveTo"](x(k * this.episode.period), y(value));
      down = known;
    });
    context.stroke();
    context.setLineDash([]);
  }

  drawTimes(context, colour, x, height) {
    const { duration } = this.episode, step = [0.2, 0.5, 1, 2, 5, 10, 30].find((s) => duration / s <= 8) ?? 60;
    context.fillStyle = colour.ink;
    context.textAlign = "center";
    for (let at = 0; at <= duration + 1e-6; at += step) {
      context.fillText(`${Number(at.toFixed(1))}${at ? "" : " s"}`, x(at), height - 4);
    }
  }
}
