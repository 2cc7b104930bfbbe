// What is written over the picture: status, people, places, chat, settings, help and notices.

import { save, settings } from "./settings.js";

const KEYS = [
  ["W A S D", "walk"],
  ["click, arrows", "look around"],
  ["Shift", "run"],
  ["Space", "jump"],
  ["F", "fly, with Space and C up and down"],
  ["Enter, T", "say something"],
  ["P", "the people near you"],
  ["R", "places to go to"],
  ["M", "the plan, large or small"],
  ["V", "what rooms hide from you"],
  ["Home", "go back to the entrance"],
  ["O", "settings"],
  ["H, F1", "this help"],
  ["Escape", "close this, free the mouse"],
  ["fingers", "left: walk, right: look around"],
  ["gamepad", "left stick: walk, right stick: look around"],
];
const TITLES = { people: "People near you", rooms: "Places", settings: "Settings", help: "Help" };
/** How long a line of chat is shown, in milliseconds, and how many lines are kept. */
const SHOWN_MS = 20_000;
const LINES_MAX = 100;
/** What is around is told to screen readers no more often than this, in milliseconds. */
const AROUND_MS = 4000;

const $ = (id) => document.getElementById(id);

/** Writes a text where it differs, so that screen readers repeat nothing. */
function write(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

function element(name, text, className) {
  const made = document.createElement(name);
  made.textContent = text ?? "";
  if (className) made.className = className;
  return made;
}

/** The interface. `acts` has what it asks for: say, goTo, goHome, toggleHidden, rejoin, again. */
export class Interface {
  constructor(acts) {
    this.acts = acts;
    this.panel = null;
    this.aroundAt = 0;
    this.listed = "";
    for (const button of document.querySelectorAll("[data-panel]")) {
      button.addEventListener("click", () => this.toggle(button.dataset.panel));
    }
    $("panel-close").addEventListener("click", () => this.close());
    $("chat-button").addEventListener("click", () => this.chat(!document.body.classList.contains("chatting")));
    $("say").addEventListener("submit", (event) => this.submitLine(event));
    $("line").addEventListener("focus", () => document.body.classList.add("chatting"));
    $("line").addEventListener("blur", () => this.isNarrow() || document.body.classList.remove("chatting"));
    $("panel-settings").addEventListener("submit", (event) => this.submitSettings(event));
    $("home").addEventListener("click", () => acts.goHome());
    $("route-stop").addEventListener("click", () => acts.stop());
    $("notice-again").addEventListener("click", () => acts.again());
    $("full").addEventListener("click", () => this.toggleFull());
    $("full").hidden = !document.fullscreenEnabled;
    $("keys").append(...KEYS.map(([key, what]) => {
      const row = document.createElement("tr");
      const head = element("th", key);
      head.scope = "row";
      row.append(head, element("td", what));
      return row;
    }));
    addEventListener("resize", () => this.fit());
    addEventListener("pointerdown", () => this.fit());
    this.fit();
  }

  isNarrow() {
    return document.body.classList.contains("narrow");
  }

  /** Chooses the arrangement for the screen. */
  fit() {
    const fingers = matchMedia("(pointer: coarse)").matches || document.body.classList.contains("fingers");
    document.body.classList.toggle("narrow", fingers || innerWidth < 700);
    $("touch").hidden = !fingers;
  }

  /** Does what a key asks for. */
  act(name) {
    if (name === "chat") this.chat(true);
    else if (name === "plan") document.body.classList.toggle("large-plan");
    else if (name === "home") this.acts.goHome();
    else if (name === "hidden") this.acts.toggleHidden();
    else if (name === "close") this.escape();
    else this.toggle(name);
  }

  escape() {
    if (document.activeElement === $("line")) this.chat(false);
    else if (document.body.classList.contains("large-plan")) document.body.classList.remove("large-plan");
    else this.close();
  }

  toggle(name) {
    if (this.panel === name) {
      this.close();
      return;
    }
    this.panel = name;
    write($("panel-title"), TITLES[name]);
    for (const other of Object.keys(TITLES)) $(`panel-${other}`).hidden = other !== name;
    for (const button of document.querySelectorAll("[data-panel]")) {
      button.setAttribute("aria-expanded", String(button.dataset.panel === name));
    }
    if (name === "settings") this.fillSettings();
    $("panel").hidden = false;
    document.exitPointerLock?.();
    $("panel").focus();
  }

  close() {
    if (!this.panel) return;
    const opener = document.querySelector(`[data-panel="${this.panel}"]`);
    this.panel = null;
    $("panel").hidden = true;
    opener.setAttribute("aria-expanded", "false");
    $("view").focus({ preventScroll: true });
  }

  chat(opens) {
    document.body.classList.toggle("chatting", opens);
    $("chat-button").setAttribute("aria-expanded", String(opens));
    if (opens) {
      document.exitPointerLock?.();
      $("line").focus();
    } else {
      $("line").value = "";
      $("view").focus({ preventScroll: true });
    }
  }

  submitLine(event) {
    event.preventDefault();
    const text = $("line").value.trim();
    if (text) {
      const refused = this.acts.say(text);
      if (refused) {
        this.add({ text: `your line was not sent: ${refused}` });
        return;
      }
    }
    this.chat(false);
  }

  fillSettings() {
    for (const name of ["name", "colour", "look"]) $(name).value = settings[name];
    for (const name of ["invert", "map", "sharp"]) $(name).checked = settings[name];
    write($("settings-trouble"), "");
  }

  submitSettings(event) {
    event.preventDefault();
    const before = { ...settings };
    Object.assign(settings, { name: $("name").value.trim(), colour: $("colour").value, look: Number($("look").value) });
    for (const name of ["invert", "map", "sharp"]) settings[name] = $(name).checked;
    const refused = before.name !== settings.name || before.colour !== settings.colour ? this.acts.rejoin() : null;
    if (refused) {
      Object.assign(settings, { name: before.name, colour: before.colour });
      write($("settings-trouble"), refused);
      return;
    }
    save();
    this.close();
  }

  toggleFull() {
    const done = document.fullscreenElement
      ? document.exitFullscreen()
      : document.documentElement.requestFullscreen();
    done.catch(() => this.add({ text: "the browser does not allow full screen here" }));
  }

  /** Adds a line of chat, or a notice. */
  add({ name, text }) {
    const line = element("li", "", name === undefined ? "notice" : "");
    if (name !== undefined) line.append(element("b", `${name || "Somebody"}: `));
    line.append(text);
    $("log").append(line);
    setTimeout(() => line.classList.add("old"), SHOWN_MS);
    while ($("log").childElementCount > LINES_MAX) $("log").firstChild.remove();
  }

  /** Shows the state of a moment. */
  show(state, at) {
    const isIn = state.stage === "in";
    const place = [state.building, state.room].filter(Boolean).join(", ");
    write($("place"), place || "Sightline");
    write($("sight"), isIn ? state.sight : "");
    document.title = place ? `${place} – Sightline` : "Sightline";
    $("route").hidden = !state.onRoute;
    if (this.panel === "people") this.listPeople(state);
    if (at - this.aroundAt >= AROUND_MS) {
      this.aroundAt = at;
      write($("around"), isIn ? around(state, place) : "");
    }
  }

  listPeople({ people }) {
    const now = JSON.stringify(people.map(({ name, colour, metres, inSight }) => [name, colour, metres, inSight]));
    if (now === this.listed) return;
    this.listed = now;
    write($("nobody"), people.length ? "" : "Nobody is near you.");
    $("people").replaceChildren(...people.map(({ name, colour, metres, inSight }) => {
      const row = document.createElement("li");
      const patch = element("span", "", "patch");
      patch.style.background = colour;
      row.append(patch, element("span", name), element("small", `${metres} m, ${inSight ? "in sight" : "out of sight"}`));
      return row;
    }));
  }

  listRooms(rooms) {
    $("no-rooms").hidden = rooms.length > 0;
    $("rooms").replaceChildren(...rooms.map(({ title, at }) => {
      const row = document.createElement("li");
      const button = element("button", title);
      button.type = "button";
      button.addEventListener("click", () => this.acts.goTo(...at));
      row.append(button);
      return row;
    }));
  }

  showConnection(words, warnings) {
    write($("connection"), words);
    if ($("warnings").childElementCount !== warnings.length) {
      $("warnings").replaceChildren(...warnings.map((warning) => element("li", warning)));
    }
  }

  /** Says something across the middle, or nothing when all is well. */
  notice(notice) {
    $("notice").hidden = !notice;
    if (!notice) return;
    write($("notice-title"), notice.title);
    write($("notice-note"), notice.note ?? "");
    const bar = $("notice-progress");
    bar.hidden = notice.share === undefined;
    if (notice.share !== undefined) bar.value = notice.share;
    $("notice-again").hidden = !notice.canTryAgain;
  }
}

/** Who and what is around, in words. */
function around({ sight, people, pose }, place) {
  const seen = people.filter(({ inSight }) => inSight).slice(0, 4);
  const where = seen.map(({ name, metres, at }) => `${name}, ${metres} metres ${side(pose, at)}`);
  return [`You are in ${place}`, sight, ...where].join(". ");
}

/** On which side somebody is. */
function side([x, , z, yaw], [otherX, , otherZ]) {
  const turn = Math.atan2(x - otherX, z - otherZ) - yaw;
  const eighth = ((Math.round((turn / Math.PI) * 4) % 8) + 8) % 8;
  return [
    "ahead", "ahead to the left", "to the left", "behind to the left",
    "behind", "behind to the right", "to the right", "ahead to the right",
  ][eighth];
}
