// What the page remembers of its person, in this browser only.

const KEY = "sightline";
const COLOURS = ["#d9534f", "#e08e3c", "#d8b72b", "#5cab4a", "#2fa39a", "#3f7fd1", "#7d64c9", "#c95aa0"];

const stored = read();

/** The settings. `save` keeps them. */
export const settings = {
  name: `Visitor ${random(900) + 100}`,
  colour: COLOURS[random(COLOURS.length)],
  look: 1,
  invert: false,
  map: true,
  sharp: false,
  secret: base64(crypto.getRandomValues(new Uint8Array(32))),
  ...stored,
};

/** Whether this browser has been here before. */
export const isFirstVisit = !("name" in stored);

/** Keeps the settings. Where the browser keeps nothing, they last as long as the page. */
export function save() {
  try {
    localStorage.setItem(KEY, JSON.stringify(settings));
  } catch {
    // A private window may forbid it.
  }
}

/** The secret by which the server knows this browser again. */
export function secret() {
  return Uint8Array.from(atob(settings.secret), (letter) => letter.charCodeAt(0));
}

/** The colour as 0xRRGGBB. */
export function colour() {
  return Number.parseInt(settings.colour.slice(1), 16);
}

function read() {
  try {
    const found = JSON.parse(localStorage.getItem(KEY) ?? "{}");
    return found && typeof found === "object" ? found : {};
  } catch {
    return {};
  }
}

function random(below) {
  return crypto.getRandomValues(new Uint32Array(1))[0] % below;
}

function base64(bytes) {
  return btoa(String.fromCharCode(...bytes));
}
