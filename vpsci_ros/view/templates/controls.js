// What people press: buttons, choices and keys; and the beginning.
"use strict";

const RATES = [0.1, 0.25, 0.5, 1, 2, 4];
const page = new Page();

function changeRate(by) {
  const next = RATES.indexOf(page.rate) + by;
  if (RATES[next]) page.setRate(RATES[next]);
}

function byFrame(frames) {
  page.play(false);
  page.goTo(page.clock + frames * page.panels[0].episode.period);
}

function toggle(box) {
  box.checked = !box.checked;
  box.dispatchEvent(new Event("change"));
}

const KEYS = {
  " ": () => page.play(!page.playing),
  ArrowRight: (event) => byFrame(event.shiftKey ? 1 / page.panels[0].episode.period : 1),
  ArrowLeft: (event) => byFrame(event.shiftKey ? -1 / page.panels[0].episode.period : -1),
  n: () => page.step(1),
  p: () => page.step(-1),
  Home: () => page.goTo(0),
  End: () => page.goTo(page.duration),
  "+": () => changeRate(1),
  "-": () => changeRate(-1),
  v: () => toggle($("predict")),
  t: () => toggle($("trails")),
  f: () => $("text").focus(),
  "?": () => $("help").showModal(),
};

function listen() {
  $("play").addEventListener("click", () => page.play(!page.playing));
  $("previous").addEventListener("click", () => page.step(-1));
  $("next").addEventListener("click", () => page.step(1));
  $("other-previous").addEventListener("click", () => page.stepOther(-1));
  $("other-next").addEventListener("click", () => page.stepOther(1));
  $("time").addEventListener("input", () => page.goTo(Number($("time").value)));
  $("rate").addEventListener("change", () => page.setRate(Number($("rate").value)));
  $("a").addEventListener("change", () => page.setSource($("a").value));
  $("b").addEventListener("change", () => page.setOther($("b").value));
  $("sort").addEventListener("change", () => {
    page.sort = $("sort").value;
    page.refilter();
  });
  for (const name of ["text", "group", "outcome", "yielded", "failure", "mark", "below"]) {
    $(name).addEventListener("input", () => {
      page.filter[name] = $(name).value.trim();
      page.refilter();
    });
  }
  $("all").addEventListener("click", () => {
    Object.assign(page.filter, NO_FILTER);
    page.refilter();
  });
  for (const name of ["predict", "trails"]) {
    $(name).addEventListener("change", () => {
      for (const panel of page.panels) panel.scene.options[name] = $(name).checked;
      page.draw();
    });
  }
  listenToChanges(page);
  $("keys").addEventListener("click", () => $("help").showModal());
  // What a pointer has pressed does not keep the focus, so that Space and the arrows play; what a key has reached does.
  let pointed = false;
  document.addEventListener("pointerdown", () => (pointed = true));
  for (const kind of ["click", "change"]) {
    document.addEventListener(kind, ({ target }) => {
      const kept = kind === "click" ? "button, summary, [type=checkbox], [type=range]" : "select";
      if (pointed) target.closest(kept)?.blur();
    });
  }
  document.addEventListener("keydown", (event) => {
    pointed = false;
    const busy = event.target.closest("input, select, textarea, dialog") || event.ctrlKey || event.metaKey || event.altKey;
    const pressing = event.key === " " && event.target.closest("button, summary");
    if (busy || pressing || !KEYS[event.key]) return;
    event.preventDefault();
    KEYS[event.key](event);
  });
  window.addEventListener("hashchange", () => page.readAddress());
  window.addEventListener("resize", () => page.draw());
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => page.draw());
  matchMedia("(max-width: 800px)").addEventListener("change", (event) => ($("choice").open = !event.matches));
}

fillSelect($("rate"), RATES.map((rate) => [String(rate), `${rate} ×`]), "1");
$("choice").open = !matchMedia("(max-width: 800px)").matches;
listen();
page.readAddress();
document.body.dataset.ready = "yes";
