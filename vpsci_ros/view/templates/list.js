// Which episodes are in the list, in what order, and the list itself.
"use strict";

const SYMBOLS = { collision: "✖", goal: "●", timeout: "◷", parked_collision: "▣", recorded: "○", none: "–" };
// What one must see first: who is hit by a moving vehicle, the fastest first, then who came nearest without a contact,
// and last who walked into a standing vehicle.
const MOVING = 0.5; // [m/s]
function severity(episode) {
  if (episode.impact > MOVING) return -episode.impact;
  return episode.outcome === "collision" ? 1000 : episode.least ?? 100;
}
// A telling, ordinary episode: the pedestrian goes first, the driver brakes, the least CurvTTC is near 2 s; collisions last.
const TELLING_TTC = 2; // [s]
function ordinariness(episode) {
  const away = Math.min(Math.abs((episode.least ?? 100) - TELLING_TTC), 50);
  return away + (episode.yielded === "vehicle" ? 0 : 100) + (["goal", "recorded"].includes(episode.outcome) ? 0 : 200);
}
const SORTS = {
  telling: { title: "typical first", order: (a, b) => ordinariness(a) - ordinariness(b) },
  worst: { title: "worst first", order: (a, b) => severity(a) - severity(b) },
  source: { title: "as in the source", order: () => 0 },
  least: { title: "least CurvTTC first", order: (a, b) => (a.least ?? Infinity) - (b.least ?? Infinity) || 0 },
  outcome: { title: "by outcome", order: (a, b) => a.outcome.localeCompare(b.outcome) },
  longest: { title: "longest first", order: (a, b) => b.frames - a.frames },
};
const NO_FILTER = { text: "", group: "", outcome: "", yielded: "", failure: "", mark: "", below: "", names: "" };

// Return the indices of a source's episodes that pass the filter, sorted; ties stay in the source's order.
function chosen(source, filter, sort) {
  const names = filter.names ? new Set(filter.names.split(",")) : null;
  const below = filter.below === "" ? Infinity : Number(filter.below), text = filter.text.toLowerCase();
  const passes = (episode) =>
    (!names || names.has(episode.name)) &&
    (!filter.group || source.groups[episode.group] === filter.group) &&
    (!filter.outcome || episode.outcome === filter.outcome) &&
    (!filter.yielded || episode.yielded === filter.yielded) &&
    (!filter.failure || episode.failure === filter.failure) &&
    (!filter.mark || episode.marks.some((mark) => source.marks[mark] === filter.mark)) &&
    (filter.below === "" || (episode.least ?? Infinity) < below) &&
    (!text || `${episode.name} ${source.groups[episode.group]} ${episode.failure ?? ""}`.toLowerCase().includes(text));
  const { order } = SORTS[sort];
  return [...source.episodes.keys()].filter((index) => passes(source.episodes[index]))
    .sort((a, b) => order(source.episodes[a], source.episodes[b]) || a - b);
}

function seconds(value) {
  return value === null || !Number.isFinite(value) ? "none" : `${value.toFixed(2)}\u00a0s`;
}

// Scenario names as people say them: "A, S-N"; the recording's name else.
function shortGroup(name) {
  return name.replace(/^Location(.*)_PedCross_/, "$1, ");
}

// Fill the list: a button an episode, of which the arrow keys and a screen reader see one after the other.
function fillList(list, source, indices, select) {
  const items = indices.map((index) => {
    const episode = source.episodes[index], item = document.createElement("li"), button = document.createElement("button");
    const part = (className, text) => {
      const span = document.createElement("span");
      span.className = className;
      span.textContent = text;
      button.append(span);
    };
    part("name", episode.name);
    part("where", shortGroup(source.groups[episode.group]));
    part(`outcome ${episode.outcome}`, `${SYMBOLS[episode.outcome] ?? "–"} ${episode.outcome}`);
    part("least", episode.impact > MOVING ? `at ${episode.impact.toFixed(1)} m/s` : seconds(episode.least));
    if (episode.failure) part("failure", episode.failure);
    button.type = "button";
    button.dataset.index = index;
    button.addEventListener("click", () => select(index));
    item.append(button);
    return item;
  });
  list.replaceChildren(...items);
}

function markCurrent(list, index) {
  list.querySelector("[aria-current]")?.removeAttribute("aria-current");
  const button = list.querySelector(`[data-index="${index}"]`);
  if (!button) return;
  button.setAttribute("aria-current", "true");
  const box = list.getBoundingClientRect(), at = button.getBoundingClientRect();
  if (at.top < box.top || at.bottom > box.bottom) list.scrollTop += at.top - box.top - box.height / 3;
}

function fillSelect(select, options, value) {
  select.replaceChildren(...options.map(([key, title]) => new Option(title, key, false, key === value)));
}
