// The page: makes the client, and lets the link, the view and the interface work for it.

import start, { Client } from "./sightline_web.js";
import { listen, release } from "./input.js";
import { Interface } from "./interface.js";
import { Link, now } from "./link.js";
import { Plan } from "./plan.js";
import { colour, isFirstVisit, save, secret, settings } from "./settings.js";
import { View } from "./view.js";

/** How often words and plan are renewed, in milliseconds. */
const SHOW_MS = 200;
/** The smallest program that uses SIMD. */
const SIMD = new Uint8Array([
  0, 97, 115, 109, 1, 0, 0, 0, 1, 5, 1, 96, 0, 1, 123, 3, 2, 1, 0, 10, 10, 1, 8, 0, 65, 0, 253, 15, 253, 98, 11,
]);

let client = null;
let view = null;
let isNew = true;
let wasIn = false;
let returns = 0;
let hasFailed = false;
let place = "";
const link = new Link(() => showNotice());
const plan = new Plan(document.getElementById("plan"), goTo);
const page = new Interface({
  say: (text) => {
    const refused = client.say(text);
    link.flush();
    return refused;
  },
  goTo,
  goHome: () => {
    client.go_home();
    link.flush();
  },
  stop: () => client.stop(),
  toggleHidden: () => {
    const hasRooms = client.toggle_hidden();
    if (!hasRooms) page.add({ text: "the author of this building has declared no rooms" });
  },
  rejoin,
  again: () => link.tryAgain(),
});

begin().catch(fail);
addEventListener("error", ({ error }) => isTrap(error) && fail(error));
addEventListener("unhandledrejection", ({ reason }) => isTrap(reason) && fail(reason));

async function begin() {
  showNotice();
  if (!globalThis.WebAssembly?.validate(SIMD)) {
    throw new Error("This browser is too old: it needs WebAssembly with SIMD, as Chrome 91, Firefox 89 and Safari 16.4 have it");
  }
  // The building is fetched while the program is.
  const asked = link.ask().catch(() => null);
  const { memory } = await start({ module_or_path: "sightline_web_bg.wasm" });
  await asked;
  client = makeClient();
  if (isFirstVisit) save();
  const canvas = document.getElementById("view");
  view = new View(canvas, memory, settings);
  view.client = client;
  view.fault = fail;
  view.drawn = () => link.fetchPieces();
  listen(canvas, settings, (name) => page.act(name));
  canvas.focus({ preventScroll: true });
  addEventListener("visibilitychange", () => document.hidden && rest());
  addEventListener("pagehide", () => link.leave());
  addEventListener("pageshow", ({ persisted }) => persisted && location.reload());
  setInterval(() => show(), SHOW_MS);
  link.start(client);
  // For tests, and for the curious.
  globalThis.sightline = { client, view, link, memory, state: () => JSON.parse(client.state(now())) };
}

function makeClient() {
  const invitation = new URLSearchParams(location.hash.slice(1)).get("invitation") ?? "";
  return new Client(settings.name, colour(), secret(), invitation);
}

/** Comes in again under another name. Returns why not, if it cannot. */
function rejoin() {
  try {
    const before = client;
    client = makeClient();
    view.client = client;
    link.restart(client);
    before.free();
  } catch (error) {
    return error.message;
  }
  Object.assign(globalThis.sightline, { client });
  isNew = true;
  return null;
}

/** The body stands still while nobody looks. */
function rest() {
  release();
  client.step(now(), 0, 0, 0, false, false);
  link.flush();
}

function goTo(x, y, z) {
  if (!client.go_to(x, y, z)) page.add({ text: "no way leads there from here" });
  document.body.classList.remove("large-plan");
}

/** Renews words and plan. */
function show() {
  if (hasFailed) return;
  for (const said of JSON.parse(client.said())) page.add(said);
  const state = JSON.parse(client.state(now()));
  const isIn = state.stage === "in";
  // A short absence may lie between two looks.
  if (isIn && (!wasIn || state.returns > returns)) arrive(state);
  [wasIn, returns] = [isIn, state.returns];
  showNotice(state);
  if (document.hidden) return;
  page.show(state, now());
  plan.show(client, state, settings.map || document.body.classList.contains("large-plan"));
  if (page.panel === "help") {
    const kind = link.transport?.kind;
    const words = kind ? `You are connected by ${kind}. The picture is ${view.inWords()}.` : "";
    page.showConnection(words, link.join?.warnings ?? []);
  }
}

function arrive(state) {
  link.arrived();
  if (state.building !== place) {
    place = state.building;
    page.listRooms(JSON.parse(client.rooms()));
  }
  if (isNew) {
    isNew = false;
    const fingers = matchMedia("(pointer: coarse)").matches;
    const how = fingers ? "Left: walk. Right: look around." : "W A S D: walk. Click: look around. H: help.";
    page.add({ text: `You are ${settings.name}. ${how}` });
  } else {
    page.add({ text: "you are back" });
  }
}

/** What to tell while all is not well. */
function showNotice(state) {
  if (hasFailed) return;
  page.notice(client ? noticeOf(state ?? JSON.parse(client.state(now()))) : { title: "Opening Sightline", ...progress() });
}

function noticeOf({ stage, reason, returns, pose }) {
  const isBack = Boolean(pose) || returns > 0;
  if (stage === "in") return client.is_open() ? null : { title: "Fetching the building" };
  if (link.isOver) {
    const note = `${sentence(link.trouble)} ${link.join ? "" : "Is the address right?"}`;
    return { title: isBack ? "You have left the building" : "You cannot come in", note, canTryAgain: true };
  }
  if (stage === "closed" || stage === "over") {
    if (!link.trouble) return { title: "Connecting", ...progress() };
    const title = isBack ? "The connection is lost" : "You are not in yet";
    const seconds = Math.round((now() - link.lostAt) / 1000);
    return { title, note: `${sentence(link.trouble)} Trying again by itself, for ${seconds} s now.` };
  }
  if (stage === "waiting") return { title: "The server is getting ready", note: reason && `It says: ${reason}` };
  if (stage === "fetching" && link.reading) return { title: "Opening the building" };
  if (stage === "fetching") return { title: "Fetching the building", ...progress() };
  return isBack ? null : { title: stage === "greeted" ? "Connecting" : "Going in" };
}

function progress() {
  if (!link.progress) return {};
  const { done, all } = link.progress;
  const megabytes = (bytes) => (bytes / 1e6).toFixed(1);
  return { note: `${megabytes(done)} of ${megabytes(all)} MB`, share: done / all };
}

function sentence(text) {
  return text ? `${text[0].toUpperCase()}${text.slice(1)}.` : "";
}

/** Whether the program itself has stopped. */
function isTrap(error) {
  return error instanceof WebAssembly.RuntimeError;
}

/** The page cannot go on. */
function fail(error) {
  console.error(error);
  hasFailed = true;
  link.stop();
  if (view) view.client = null;
  const note = isTrap(error) ? "It has a fault. Loading the page again may help." : sentence(error.message);
  page.notice({ title: isTrap(error) ? "The program has stopped" : "This cannot be shown", note });
}
