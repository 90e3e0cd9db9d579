// A failure and what was changed in it: a slider through the amounts that were driven, from the failure to what avoids it.
"use strict";

// What was changed in the episode of the first panel, if the second one shows a source that has it driven again.
function changesOf(page) {
  return (page.other?.changes ?? {})[page.panels[0].episode.name] ?? [];
}

// The episode beside a failure at first: the nearest that avoids it.
function nearestSuccess(page) {
  const [first] = changesOf(page);
  return first && page.other.byName.get(first.steps[first.nearest].name);
}

function showChanges(page) {
  const changes = changesOf(page);
  $("changes").hidden = changes.length === 0;
  if (!changes.length) return;
  const name = page.panels[1].episode.name;
  const at = Math.max(0, changes.findIndex((one) => one.steps.some((step) => step.name === name)));
  const { unit, steps } = changes[at], now = steps.findIndex((step) => step.name === name);
  fillSelect($("factor"), changes.map((one, index) => [String(index), one.title]), String(at));
  [$("amount").max, $("amount").value] = [steps.length - 1, Math.max(0, now)];
  const { amount, fails } = steps[Math.max(0, now)];
  const said = amount ? `by ${amount} ${unit}: ${fails ? "still fails" : "avoids it"}` : "as it was: fails";
  $("changed").textContent = said;
  $("amount").setAttribute("aria-valuetext", said);
}

function listenToChanges(page) {
  const show = (change, step) => page.show(page.panels[0].index, page.clock, page.other.byName.get(change.steps[step].name));
  $("factor").addEventListener("change", () => {
    const change = changesOf(page)[Number($("factor").value)];
    show(change, change.nearest);
  });
  $("amount").addEventListener("input", () => show(changesOf(page)[Number($("factor").value)], Number($("amount").value)));
}
