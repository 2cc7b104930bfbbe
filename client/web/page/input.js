// Keys, mouse, fingers and gamepads become wishes: how to walk, and where to look.

/** Radians per pixel of mouse motion, and of a finger. */
const MOUSE_TURN = 0.0022;
const FINGER_TURN = 0.005;
/** Radians per second while an arrow key is held, or a stick of a gamepad. */
const KEY_TURN = 1.8;
const STICK_TURN = 2.6;
/** The share of the top speed of who walks. */
const WALK = 0.6;
/** How far the finger is from the middle of the stick at full speed, in pixels. */
const STICK_PX = 50;
/** What a stick of a gamepad gives at rest. */
const DEAD = 0.15;

const held = new Set();
const turned = { left: 0, up: 0 };
const stick = { id: null, x: 0, y: 0, right: 0, forward: 0 };
let looking = null;
let jumps = false;
let flies = false;
let settings;

/** Listens on a canvas. `act(name)` is called for keys that do something else than walk. */
export function listen(canvas, options, act) {
  settings = options;
  addEventListener("keydown", (event) => keyDown(event, act));
  // Who goes about the page by Tab sees what has the focus.
  addEventListener("keydown", ({ code }) => code === "Tab" && document.body.classList.add("tabbing"));
  addEventListener("pointerdown", () => document.body.classList.remove("tabbing"));
  addEventListener("keyup", ({ code }) => held.delete(code));
  addEventListener("blur", release);
  canvas.addEventListener("pointerdown", (event) => pointerDown(canvas, event));
  addEventListener("pointermove", (event) => pointerMove(canvas, event));
  addEventListener("pointerup", pointerUp);
  addEventListener("pointercancel", pointerUp);
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  const button = document.getElementById("jump");
  button.addEventListener("pointerdown", () => { jumps = true; });
  for (const end of ["pointerup", "pointercancel", "pointerleave"]) {
    button.addEventListener(end, () => { jumps = false; });
  }
}

/** Forgets what is held: the page has lost the focus. */
export function release() {
  held.clear();
  jumps = false;
  looking = null;
  moveStick(null);
}

/** The wish for the next `seconds`, and how far the view has turned. */
export function wish(seconds) {
  const pad = gamepad();
  const turn = KEY_TURN * settings.look * seconds;
  const left = turned.left + axis("ArrowLeft", "ArrowRight") * turn - pad.lookRight * STICK_TURN * seconds;
  const up = turned.up + axis("ArrowUp", "ArrowDown") * turn + pad.lookUp * STICK_TURN * seconds;
  turned.left = 0;
  turned.up = 0;
  const share = held.has("ShiftLeft") || held.has("ShiftRight") ? 1 : WALK;
  return {
    left,
    up: settings.invert ? -up : up,
    forward: clamp(axis("KeyW", "KeyS") * share + stick.forward + pad.forward),
    right: clamp(axis("KeyD", "KeyA") * share + stick.right + pad.right),
    climb: axis("Space", "KeyC") * share,
    jump: held.has("Space") || jumps || pad.jump,
    fly: flies,
  };
}

const ACTIONS = {
  KeyH: "help", F1: "help", KeyP: "people", KeyR: "rooms", KeyM: "plan", KeyV: "hidden",
  KeyO: "settings", Enter: "chat", KeyT: "chat", Home: "home", Escape: "close",
};

function keyDown(event, act) {
  const { target, code } = event;
  const isTyping = target.matches?.("input, select, textarea");
  if (code === "Escape") {
    act("close");
    return;
  }
  if (isTyping || event.ctrlKey || event.altKey || event.metaKey) return;
  const onButton = target.matches?.("button, a") && ["Enter", "Space"].includes(code);
  if (onButton) return;
  if (event.repeat) {
    if (held.has(code)) event.preventDefault();
    return;
  }
  if (code === "KeyF") flies = !flies;
  if (ACTIONS[code]) {
    event.preventDefault();
    release();
    act(ACTIONS[code]);
    return;
  }
  if (["Space", "ArrowUp", "ArrowDown", "ArrowLeft", "ArrowRight"].includes(code)) event.preventDefault();
  held.add(code);
}

function pointerDown(canvas, event) {
  canvas.focus({ preventScroll: true });
  if (event.pointerType === "mouse") {
    looking = event.pointerId;
    // Where the browser does not lock it, dragging looks around.
    Promise.resolve(canvas.requestPointerLock?.()).catch(() => {});
    return;
  }
  document.body.classList.add("fingers");
  if (event.clientX < innerWidth / 2 && event.clientY > innerHeight * 0.4 && stick.id === null) {
    Object.assign(stick, { id: event.pointerId, x: event.clientX, y: event.clientY });
    moveStick(event);
  } else {
    looking = event.pointerId;
  }
}

function pointerMove(canvas, event) {
  if (document.pointerLockElement === canvas) {
    turn(event.movementX, event.movementY, MOUSE_TURN);
  } else if (event.pointerId === stick.id) {
    moveStick(event);
  } else if (event.pointerId === looking) {
    turn(event.movementX, event.movementY, event.pointerType === "mouse" ? MOUSE_TURN * 2 : FINGER_TURN);
  }
}

function pointerUp({ pointerId }) {
  if (pointerId === stick.id) moveStick(null);
  if (pointerId === looking) looking = null;
}

function turn(right, down, radians) {
  turned.left -= right * radians * settings.look;
  turned.up -= down * radians * settings.look;
}

/** The finger on the stick is somewhere else, or nowhere. */
function moveStick(finger) {
  const knob = document.getElementById("knob");
  if (!finger) {
    Object.assign(stick, { id: null, right: 0, forward: 0 });
    knob.style.translate = "";
    return;
  }
  const [x, y] = [finger.clientX - stick.x, finger.clientY - stick.y];
  const far = Math.max(Math.hypot(x, y) / STICK_PX, 1);
  stick.right = x / STICK_PX / far;
  stick.forward = -y / STICK_PX / far;
  knob.style.translate = `${stick.right * 35}px ${-stick.forward * 35}px`;
}

function gamepad() {
  const pad = navigator.getGamepads?.().find((found) => found?.mapping === "standard");
  const value = (i) => (Math.abs(pad?.axes[i] ?? 0) > DEAD ? pad.axes[i] : 0);
  const sign = settings.look;
  return {
    right: value(0),
    forward: -value(1),
    lookRight: value(2) * sign,
    lookUp: -value(3) * sign,
    jump: pad?.buttons[0]?.pressed ?? false,
  };
}

function axis(more, less) {
  return Number(held.has(more)) - Number(held.has(less));
}

function clamp(value) {
  return Math.max(-1, Math.min(1, value));
}
