// The page: two panels that play together, the list beside them, and the address that names an episode.
"use strict";

const packed = JSON.parse(document.getElementById("episodes").textContent);
const sources = packed.sources.map((one) => new Source(one));
const $ = (id) => document.getElementById(id);
const FILTERS = Object.keys(NO_FILTER);
const FIRST_SORT = sources.some((one) => one.episodes.some((e) => e.failure)) ? "worst" : "telling"; // worst: of an exam

class Panel {
  constructor(key) {
    this.element = $(`panel-${key}`);
    const find = (name) => this.element.querySelector(`.${name}`);
    [this.whose, this.title, this.readout] = [find("whose"), find("title"), find("readout")];
    this.scene = new Scene(find("scene"));
    this.charts = new Charts(find("charts"), (time) => page.goTo(time + this.delay));
    this.delay = 0; // [s] after the page's clock at which this episode begins
    this.source = null;
  }

  show(source, index) {
    this.source = source;
    this.index = index;
    this.episode = source.episode(index);
    this.scene.show(this.episode, source.grounds[this.episode.scenario] ?? packed.grounds[this.episode.scenario]);
    this.charts.show(this.episode);
    const { name, groupName, outcome, yielded, least } = this.episode;
    const ways = { nobody: "nobody yields", vehicle: "the vehicle yields", pedestrian: "the pedestrian yields",
      both: "both yield" };
    this.whose.textContent = source.title;
    this.title.textContent = `${name} · ${groupName} · ${SYMBOLS[outcome] ?? "–"} ${outcome} · ${ways[yielded]} · ` +
      `least CurvTTC ${seconds(least)}`;
  }

  draw(clock) {
    const time = Math.min(Math.max(clock - this.delay, 0), this.episode.duration), state = stateAt(this.episode, time);
    this.scene.draw(time);
    this.charts.draw(time);
    const speed = (v, a) => `${v.toFixed(1)} m/s, ${a >= 0 ? "+" : "−"}${Math.abs(a).toFixed(1)} m/s²`;
    this.readout.textContent = `${time.toFixed(2)} s · vehicle ${speed(state.speed, state.acceleration)} · ` +
      `pedestrian ${speed(state.ped_speed, state.ped_acceleration)} · CurvTTC ${seconds(state.curvttc)}` +
      (state.held ? " · the policies act" : "");
  }
}

class Page {
  constructor() {
    Object.assign(this, { clock: 0, rate: 1, playing: false, sort: FIRST_SORT, filter: { ...NO_FILTER }, other: null });
    this.source = sources[0];
    this.panels = [new Panel("a"), new Panel("b")];
  }

  get duration() {
    return Math.max(...this.shown.map((panel) => panel.delay + panel.episode.duration));
  }

  get shown() {
    return this.other ? this.panels : this.panels.slice(0, 1);
  }

  // Read the address: what it does not name stays as it begins.
  readAddress() {
    const address = new URLSearchParams(location.hash.slice(1));
    const byKey = (key) => sources.find((source) => source.key === key);
    this.source = byKey(address.get("a")) ?? sources[0];
    const beside = address.has("b") ? byKey(address.get("b")) : address.has("a") ? null : sources[1];
    this.other = beside === this.source ? null : beside ?? null;
    this.sort = SORTS[address.get("sort")] ? address.get("sort") : FIRST_SORT;
    for (const name of FILTERS) this.filter[name] = address.get(name) ?? "";
    this.playing = !address.has("t") && !matchMedia("(prefers-reduced-motion: reduce)").matches;
    this.refill();
    this.showMissing(address, byKey);
    const index = this.source.byName.get(address.get("episode")) ?? this.indices[0] ?? 0;
    this.show(index, address.has("t") ? Number(address.get("t")) : 0, this.other?.byName.get(address.get("beside")));
  }

  // Say what the address names and this page does not hold; the first source and episode are shown in its place.
  showMissing(address, byKey) {
    const missing = ["a", "b"].filter((k) => address.get(k) && !byKey(address.get(k))).map((k) => `source ${address.get(k)}`);
    const episode = address.get("episode");
    if (episode && !this.source.byName.has(episode)) missing.push(`episode ${episode} of ${this.source.title}`);
    $("notice").hidden = missing.length === 0;
    $("notice").textContent = `Not on this page: ${missing.join(", ")}.`;
  }

  writeAddress() {
    const address = new URLSearchParams({ a: this.source.key, episode: this.panels[0].episode.name });
    address.set("b", this.other ? this.other.key : "");
    if (this.other) address.set("beside", this.panels[1].episode.name);
    if (this.sort !== FIRST_SORT) address.set("sort", this.sort);
    for (const name of FILTERS) if (this.filter[name] !== "") address.set(name, this.filter[name]);
    if (!this.playing) address.set("t", this.clock.toFixed(2)); // without a time it plays when it is opened
    history.replaceState(null, "", `#${address}`);
  }

  // Fill choices and list again, after the source or the filter has changed.
  refill() {
    const { source, filter } = this, every = (values, all) => [["", all], ...[...new Set(values)].sort().map((v) => [v, v])];
    const titled = (some) => some.map((one) => [one.key, one.title]);
    fillSelect($("a"), titled(sources), source.key);
    fillSelect($("b"), [["", "nothing"], ...titled(sources.filter((one) => one !== source))], this.other?.key ?? "");
    fillSelect($("group"), every(source.groups, "all places"), filter.group);
    fillSelect($("outcome"), every(source.episodes.map((e) => e.outcome), "all outcomes"), filter.outcome);
    fillSelect($("yielded"), every(source.episodes.map((e) => e.yielded), "any yielding"), filter.yielded);
    const failures = source.episodes.map((e) => e.failure).filter(Boolean);
    fillSelect($("failure"), every(failures, "all failure groups"), filter.failure);
    $("failure").hidden = failures.length === 0;
    fillSelect($("mark"), every(source.marks, "all kinds").map(([k, t]) => [k, t.replaceAll("_", " ")]), filter.mark);
    fillSelect($("sort"), Object.entries(SORTS).map(([key, { title }]) => [key, title]), this.sort);
    [$("below").value, $("text").value, $("names").hidden] = [filter.below, filter.text, !filter.names];
    this.indices = chosen(source, filter, this.sort);
    this.besides = this.other ? chosen(this.other, filter, this.sort) : [];
    fillList($("list"), source, this.indices, (index) => this.show(index, 0));
    const part = source.total > source.episodes.length ? ` of ${source.total.toLocaleString("en")}, evenly spread` : "";
    $("shown").textContent = `${this.indices.length} of ${source.episodes.length}${part}`;
    $("nothing").hidden = this.indices.length > 0;
  }

  // Show an episode; what stands beside it is the same one of the other source, or else one of like rank.
  show(index, clock = 0, beside = undefined) {
    const [main, second] = this.panels;
    main.show(this.source, index);
    second.element.hidden = !this.other;
    document.body.classList.toggle("two", Boolean(this.other));
    main.delay = second.delay = 0;
    if (this.other) {
      const same = main.episode.scenario ? this.other.byName.get(main.episode.name) : undefined;
      second.show(this.other, beside ?? nearestSuccess(this) ?? same ?? this.alike(index));
      const [a, b] = [main, second].map((panel) => (panel.episode.onset ?? 0) * panel.episode.period);
      const together = second.episode.name === main.episode.name || changesOf(this).length;
      if (!together) [main.delay, second.delay] = [Math.max(0, b - a), Math.max(0, a - b)];
    }
    showChanges(this);
    markCurrent($("list"), index);
    $("time").max = this.duration;
    this.goTo(clock);
    this.play(this.playing);
    this.writeAddress();
  }

  alike(index) {
    const place = Math.max(0, this.indices.indexOf(index)), last = Math.max(1, this.indices.length - 1);
    const others = this.besides.length ? this.besides : [...this.other.episodes.keys()];
    return others[Math.round((place / last) * (others.length - 1))];
  }

  step(by) {
    const place = this.indices.indexOf(this.panels[0].index);
    const next = place < 0 ? 0 : Math.min(Math.max(place + by, 0), this.indices.length - 1);
    if (this.indices.length && this.indices[next] !== this.panels[0].index) this.show(this.indices[next]);
  }

  goTo(clock) {
    this.clock = Number.isFinite(clock) ? Math.min(Math.max(clock, 0), this.duration) : 0;
    this.draw();
    if (!this.playing) this.writeAddress();
  }

  draw() {
    for (const panel of this.shown) panel.draw(this.clock);
    $("time").value = this.clock;
    $("clock").textContent = `${this.clock.toFixed(2)} of ${this.duration.toFixed(1)} s`;
  }

  play(on) {
    this.playing = on;
    $("play").textContent = on ? "❚❚ pause" : "▶ play";
    if (on && this.clock >= this.duration) this.clock = 0;
    cancelAnimationFrame(this.request);
    this.before = null;
    if (on) this.request = requestAnimationFrame((now) => this.advance(now));
    else this.writeAddress();
  }

  advance(now) {
    this.clock += this.before === null ? 0 : ((now - this.before) / 1000) * this.rate;
    this.before = now;
    if (this.clock >= this.duration) {
      this.clock = this.duration;
      this.draw();
      const place = this.indices.indexOf(this.panels[0].index);
      if ($("on").checked && place >= 0 && place < this.indices.length - 1) this.step(1);
      else this.play(false);
      return;
    }
    this.draw();
    this.request = requestAnimationFrame((later) => this.advance(later));
  }

  setRate(rate) {
    this.rate = rate;
    $("rate").value = String(rate);
  }

  // Take a change of the filter over; stay with the episode if it is still in the list.
  refilter() {
    this.refill();
    if (this.indices.length && !this.indices.includes(this.panels[0].index)) this.show(this.indices[0]);
    else this.show(this.panels[0].index, this.clock);
  }

  setSource(key) {
    this.source = sources.find((source) => source.key === key);
    if (this.other === this.source) this.other = null;
    if (!this.source.groups.includes(this.filter.group)) this.filter.group = "";
    if (!this.source.marks.includes(this.filter.mark)) this.filter.mark = "";
    this.filter.names = "";
    this.refill();
    this.show(this.indices[0] ?? 0);
  }

  setOther(key) {
    this.other = sources.find((source) => source.key === key) ?? null;
    this.refill();
    this.show(this.panels[0].index);
  }

  // Another episode beside the one that is shown.
  stepOther(by) {
    const others = this.besides.length ? this.besides : [...this.other.episodes.keys()];
    const place = others.indexOf(this.panels[1].index);
    this.show(this.panels[0].index, 0, others[(place + by + others.length) % others.length]);
  }
}
