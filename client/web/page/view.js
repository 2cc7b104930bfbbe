// The picture: draws what the client sees, as often and as large as the machine can.

import { now } from "./link.js";
import { wish } from "./input.js";

/** While nothing but others moves, pictures follow each other no faster than this, in milliseconds. */
const CALM_MS = 30;
/** The longest step of the body, in seconds. */
const STEP_S_MAX = 0.25;

/** Draws a client on a canvas, until the page is closed. */
export class View {
  constructor(canvas, memory, settings) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d", { alpha: false });
    this.memory = memory;
    this.settings = settings;
    this.client = null;
    this.before = 0;
    this.drawnAt = 0;
    /** Pictures in the current second, and in the last one. */
    this.count = 0;
    this.rate = 0;
    this.rateAt = 0;
    this.tookMs = 0;
    this.drawMs = 0;
    /** Whether there has been a picture. */
    this.hasDrawn = false;
    this.fault = null;
    /** Called after each picture. */
    this.drawn = null;
    const next = () => {
      try {
        this.frame();
        requestAnimationFrame(next);
      } catch (error) {
        this.fault?.(error);
      }
    };
    requestAnimationFrame(next);
  }

  frame() {
    const { client, canvas } = this;
    if (!client) return;
    const at = now();
    const seconds = Math.min((at - this.before) / 1000, STEP_S_MAX);
    this.before = at;
    const { left, up, forward, right, climb, jump, fly } = wish(seconds);
    client.turn(left, up);
    client.step(at, forward, right, climb, jump, fly);
    const moves = left || up || forward || right || climb || jump;
    if (!moves && at - this.drawnAt < CALM_MS) return;
    this.drawnAt = at;
    const scale = devicePixelRatio;
    const [wide, high] = [canvas.clientWidth * scale, canvas.clientHeight * scale].map(Math.round);
    if (wide < 1 || high < 1) return;
    const quick = client.size(at, wide, high);
    const [columns, rows] = this.settings.sharp ? [wide, high] : quick;
    const start = now();
    const isNew = client.draw(at, columns, rows);
    this.drawn?.();
    this.drawMs = now() - start;
    if (!isNew) return;
    this.show(columns, rows);
    this.tookMs = now() - start;
    client.drew(this.tookMs);
    this.hasDrawn ||= client.is_open();
    this.countPicture(at);
  }

  show(columns, rows) {
    const { canvas, client, memory } = this;
    if (canvas.width !== columns || canvas.height !== rows) {
      canvas.width = columns;
      canvas.height = rows;
    }
    const bytes = new Uint8ClampedArray(memory.buffer, client.pixels(), columns * rows * 4);
    this.context.putImageData(new ImageData(bytes, columns, rows), 0, 0);
  }

  countPicture(at) {
    this.count += 1;
    if (at - this.rateAt >= 1000) {
      this.rate = Math.round((this.count * 1000) / (at - this.rateAt));
      this.count = 0;
      this.rateAt = at;
    }
  }

  /** How large pictures are, and how often they come, in words. */
  inWords() {
    const { width, height } = this.canvas;
    const times = this.rate > 0 ? `, ${this.rate} times a second while something moves` : "";
    return `drawn in ${width} × ${height} pixels${times}, ${this.tookMs.toFixed(0)} ms each`;
  }
}
