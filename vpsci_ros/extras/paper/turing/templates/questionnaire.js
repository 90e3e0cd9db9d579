// The questionnaire: clips in an order of the rater's own, answers kept in this browser until they are saved as a file.
"use strict";

const kit = JSON.parse(document.getElementById("kit").textContent);
const $ = (id) => document.getElementById(id);

// A random order that depends on the rater alone, so that a page opened again goes on with it (mulberry32).
function orderFor(text) {
  let seed = 2166136261;
  for (const letter of text) seed = Math.imul(seed ^ letter.codePointAt(0), 16777619);
  const random = () => {
    seed = (seed + 0x6d2b79f5) | 0;
    let t = Math.imul(seed ^ (seed >>> 15), 1 | seed);
    t = (t + Math.imul(t ^ (t >>> 7), 61 | t)) ^ t;
    return ((t ^ (t >>> 14)) >>> 0) / 4294967296;
  };
  const order = [...kit.clips.keys()];
  for (let i = order.length - 1; i > 0; i -= 1) {
    const j = Math.floor(random() * (i + 1));
    [order[i], order[j]] = [order[j], order[i]];
  }
  return order;
}

// A clip as `Scene` draws it; speeds and predictions are not shown.
function episodeOf(clip) {
  const columns = [0, 1, 2, 3, 4].map((column) => clip.values.map((row) => row[column]));
  const [x, y, heading, ped_x, ped_y] = columns, zero = x.map(() => 0);
  return { people: [], x, y, heading, ped_x, ped_y, speed: zero, curvature: zero, ped_vx: zero, ped_vy: zero, ped_speed: zero,
    acceleration: zero, ped_acceleration: zero, curvttc: x.map(() => Infinity), held: zero, frames: x.length,
    period: kit.period, duration: (x.length - 1) * kit.period, size: kit.size, middle: [0, 0] };
}

// Every clip is drawn at the same scale: as much ground as the widest of them needs.
const widest = Math.max(...kit.clips.map((clip) => {
  const span = (columns) => {
    const all = clip.values.flatMap((row) => columns.map((column) => row[column]));
    return Math.max(...all) - Math.min(...all);
  };
  return Math.max(span([0, 3]), span([1, 4]));
})) + 6;

class Questionnaire {
  begin(rater) {
    this.rater = rater;
    this.key = `vpsci-turing-${kit.kit}-${rater}`;
    this.order = orderFor(rater);
    this.answers = JSON.parse(localStorage.getItem(this.key) ?? "[]");
    this.scene = new Scene($("clip"));
    this.scene.options = { predict: false, trails: false };
    $("welcome").hidden = true;
    this.ask();
  }

  ask() {
    const done = this.answers.length;
    $("question").hidden = done >= this.order.length;
    $("end").hidden = done < this.order.length;
    if (done >= this.order.length) return;
    this.clip = kit.clips[this.order[done]];
    this.episode = episodeOf(this.clip);
    this.scene.show(this.episode);
    this.scene.view.wide = this.scene.view.tall = widest;
    $("progress").textContent = `clip ${done + 1} of ${this.order.length}`;
    $("answer").reset();
    $("answer").inert = true; // until it was seen once
    this.play();
  }

  play() {
    cancelAnimationFrame(this.request);
    let begun = null;
    const frame = (now) => {
      begun ??= now;
      const time = Math.min((now - begun) / 1000, this.episode.duration);
      this.scene.draw(time);
      if (time < this.episode.duration) this.request = requestAnimationFrame(frame);
      else $("answer").inert = false;
    };
    this.request = requestAnimationFrame(frame);
  }

  answer(form) {
    this.answers.push({ clip: this.clip.name, judgement: form.get("judgement"), realism: Number(form.get("realism")) });
    localStorage.setItem(this.key, JSON.stringify(this.answers));
    this.ask();
  }

  save() {
    const text = JSON.stringify({ kit: kit.kit, rater: this.rater, answers: this.answers }, null, 1);
    const link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob([text], { type: "application/json" }));
    link.download = `answers-${this.rater.replace(/[^\p{L}\p{N}_-]+/gu, "_")}.json`;
    link.click();
    $("saved").textContent = `Saved as ${link.download}, where your browser puts downloads.`;
  }
}

const questionnaire = new Questionnaire();
$("begin").addEventListener("submit", (event) => {
  event.preventDefault();
  questionnaire.begin($("rater").value.trim());
});
$("answer").addEventListener("submit", (event) => {
  event.preventDefault();
  questionnaire.answer(new FormData(event.target));
});
$("again").addEventListener("click", () => questionnaire.play());
$("save").addEventListener("click", () => questionnaire.save());
document.addEventListener("keydown", (event) => {
  if (event.target.closest("#rater") || event.ctrlKey || event.metaKey || event.altKey || $("question").hidden) return;
  if (event.key === "a") questionnaire.play();
  const choice = { r: "real", m: "made" }[event.key];
  if (choice && !$("answer").inert) document.querySelector(`[name=judgement][value=${choice}]`).click();
});
document.body.dataset.ready = "yes";
