// The page in which one drives: what comes over the socket is drawn, what is pressed is sent.
"use strict";

const $ = (id) => document.getElementById(id);
const KEYS = { ArrowUp: "throttle", w: "throttle", ArrowDown: "brake", s: "brake", ArrowLeft: "left", a: "left",
  ArrowRight: "right", d: "right" };
const OUTCOMES = { collision: "You touched the pedestrian.", goal: "Both are where they wanted to be.",
  timeout: "The time is over.", parked_collision: "You ran into a parked car." };
const scene = new Scene($("scene")), pressed = new Set();
scene.options = { predict: false, trails: false };
let last = null, waiting = false;

const socket = new WebSocket(`${location.protocol.replace("http", "ws")}//${location.host}${location.pathname}socket`);
const send = (message) => socket.readyState === WebSocket.OPEN && socket.send(JSON.stringify(message));

function card(headline, text, links = [], go = "") {
  $("headline").textContent = headline;
  $("text").textContent = text;
  $("links").replaceChildren(...links.flatMap(([name, address]) => {
    const link = document.createElement("a");
    Object.assign(link, { textContent: name, href: address, target: "_blank", rel: "noopener" });
    return [link, " "];
  }));
  $("go").hidden = !go;
  $("go").textContent = go;
  waiting = Boolean(go);
  $("card").hidden = false;
}

// Begin the episode that waits; or go on from a result to the next one, whose first frame is there already.
function go() {
  if (!waiting) return;
  waiting = false;
  $("card").hidden = true;
  send({ ready: true });
  sendPressed();
}

function sendPressed() {
  const on = (key) => Number(pressed.has(key));
  send({ pressed: [on("left") - on("right"), on("throttle"), on("brake")] });
}

function show(frame) {
  const [x, y, vx, vy] = frame.people[0] ?? [NaN, NaN, 0, 0];
  const people = frame.people.slice(1).map(([px, py, pvx, pvy]) => ({ x: px, y: py, vx: pvx, vy: pvy }));
  const { view } = scene;  // which follows the car to wherever it drives
  if (Math.abs(frame.x - view.x) > view.wide / 2 || Math.abs(frame.y - view.y) > view.tall / 2)
    scene.view = { ...view, x: frame.x, y: frame.y };
  last = { ...frame, ped_x: x, ped_y: y, ped_vx: vx, ped_vy: vy, people, curvttc: Infinity };
  scene.drawAt(last);
  $("readout").textContent = `${frame.time.toFixed(2)} s · ${(frame.speed * 3.6).toFixed(0)} km/h`;
  document.body.dataset.time = frame.time;
}

// Look at the lane with its crosswalk, all of it.
function lookAt(ground) {
  const points = [...ground.lane, ...ground.crosswalk, ...ground.route];
  const [xs, ys] = [0, 1].map((at) => points.map((point) => point[at]));
  const [left, right, low, high] = [Math.min(...xs), Math.max(...xs), Math.min(...ys), Math.max(...ys)];
  scene.view = { x: (left + right) / 2, y: (low + high) / 2, wide: right - left + 6, tall: high - low + 6 };
}

const HEAR = {
  episode(message) {
    scene.episode = { middle: [0, 0], size: message.size };
    scene.ground = message.ground;
    lookAt(message.ground);
    $("which").textContent = `${message.which} · ${message.scenario}`;
    last = null;
    if (!waiting) card(message.which, "Turn right along the broken line. Somebody may cross.", [], "drive (Enter)");
  },
  frame: show,
  result(message) {
    const least = message.least === null ? "no contact was ever ahead" : `least CurvTTC ${message.least.toFixed(2)} s`;
    const ways = { nobody: "nobody gave way", vehicle: "you gave way", pedestrian: "the pedestrian gave way",
      both: "both gave way" };
    const text = `${least}; ${ways[message.yielded]}. ${message.impact > 0.5 ? `You hit at ${(message.impact * 3.6).toFixed(0)} km/h.` : ""}`;
    card(OUTCOMES[message.outcome] ?? message.outcome, text, [["replay, beside the autopilot", message.replay]],
      message.more ? "next episode (Enter)" : "");
    document.body.dataset.outcome = message.outcome;
  },
  end(message) {
    const links = message.driven ? [["report", "report.html"], ["all episodes", "view.html"]] : [];
    card(message.driven ? `${message.driven} episode${message.driven > 1 ? "s" : ""} driven` : "Nothing was driven", message.text, links);
    $("finish").hidden = true;
    document.body.dataset.ended = "yes";
  },
};

function press(event, down) {
  const name = KEYS[event.key.length === 1 ? event.key.toLowerCase() : event.key];
  if (!name || event.ctrlKey || event.metaKey || event.altKey) return;
  event.preventDefault();
  if (down === pressed.has(name)) return;
  pressed[down ? "add" : "delete"](name);
  sendPressed();
}

socket.addEventListener("message", (event) => {
  const message = JSON.parse(event.data);
  HEAR[message.type](message);
});
socket.addEventListener("open", () => (document.body.dataset.ready = "yes"));
socket.addEventListener("close", (event) => {
  if (document.body.dataset.ended) return;
  card("Not connected", event.reason || "The command has ended; start it again, and load its address.");
});
document.addEventListener("keydown", (event) => {
  if (event.key === "Enter" && event.target === document.body) go();
  else if (event.key === "r" && $("card").hidden) send({ again: true });
  else press(event, true);
});
document.addEventListener("keyup", (event) => press(event, false));
window.addEventListener("blur", () => {
  if (!pressed.size) return;
  pressed.clear();
  sendPressed();
});
window.addEventListener("resize", () => last && scene.drawAt(last));
$("go").addEventListener("click", () => {
  $("go").blur();
  go();
});
$("finish").addEventListener("click", () => {
  $("finish").hidden = true;
  card("Finished", "The report is being made.");
  send({ finish: true });
});
