// The way to the server: joins, fetches worlds, and comes back by itself when the link breaks.

import { settings } from "./settings.js";
import { open } from "./transport.js";

/** The pauses before the first attempts to come back, in milliseconds. Later ones are as the last. */
const PAUSES_MS = [0, 250, 500, 1000, 1500, 3000];
/** Who is out for so long gives up, in milliseconds. */
const PATIENCE_MS = 600_000;
/** How long the server may take to answer, in milliseconds. */
const ANSWER_MS = 8000;
/** A clock that jumps by more than this has slept, in milliseconds. Timers of hidden pages run once a minute. */
const SLEPT_MS = 90_000;
/** How many requests for pieces of the building are under way at most, and how far apart they begin. */
const REQUESTS_MAX = 2;
const REQUEST_GAP_MS = 70;
/** Requests for pieces are as large as arrives in about this time, in milliseconds, in these bounds. */
const REQUEST_MS = 250;
const REQUEST_BYTES = [32 * 1024, 1024 * 1024];
/** Pieces that could not be had are asked for again after so long, in milliseconds. */
const PIECES_PAUSE_MS = 1000;
/** After the network has changed, a link on which nothing arrives for so long is given up, in milliseconds. */
const DEAD_MS = 4000;

/** The link of a client. `changed()` is called when there is something new to say of it. */
export class Link {
  constructor(changed) {
    this.changed = changed;
    this.client = null;
    this.join = null;
    this.transport = null;
    /** Why there is no link, in words. */
    this.trouble = "";
    /** Whether another attempt was given up, or makes no sense. */
    this.isOver = false;
    /** The downloads of worlds and heads, by path. */
    this.downloads = new Map();
    this.progress = null;
    this.attempts = 0;
    this.lostAt = 0;
    this.heardAt = 0;
    this.tickedAt = 0;
    this.isTrying = false;
    /** The requests for pieces that are under way, how large the next one is, and when it may begin. */
    this.requests = 0;
    this.requestBytes = 64 * 1024;
    this.requestAt = 0;
    addEventListener("online", () => this.hurry());
    addEventListener("visibilitychange", () => document.hidden || this.hurry());
    navigator.connection?.addEventListener?.("change", () => this.suspect());
  }

  /** Asks the server what it has, and begins to fetch its world. */
  async ask() {
    const answer = await fetch("join.json", { cache: "no-store", signal: AbortSignal.timeout(ANSWER_MS) });
    if (!answer.ok) throw new Error(`the server answers with error ${answer.status}`);
    this.join = await answer.json();
    const { head, world, world_bytes } = this.join;
    const path = head ? `pieces/${head}/head` : world && `world/${world}`;
    if (path && !this.downloads.has(path)) {
      this.download(path, head ? 0 : world_bytes).catch(() => {});
    }
    return this.join;
  }

  /** Gives the link the client that it speaks for, and connects. */
  start(client) {
    this.client = client;
    this.lostAt = now();
    this.timer();
    this.connect();
  }

  /** Ends the link, and begins anew with another client. */
  restart(client) {
    this.leave();
    this.attempts = 0;
    this.isOver = false;
    this.client = client;
    this.lostAt = now();
    this.connect();
  }

  /** Says goodbye. */
  leave() {
    this.client?.leave();
    this.flush();
    const { transport } = this;
    this.transport = null;
    transport?.close();
  }

  /** Ends the link for good: the client has a fault. */
  stop() {
    this.isOver = true;
    clearTimeout(this.due);
    clearTimeout(this.again);
    const { transport } = this;
    this.transport = null;
    transport?.close();
  }

  async connect() {
    if (this.isTrying || this.transport || this.isOver) return;
    this.isTrying = true;
    try {
      if (!this.join || this.attempts > 0) await this.ask();
      const { client } = this;
      const transport = await open(this.join, {
        control: (link, bytes) => this.hear(link, () => client.control(now(), bytes)),
        datagram: (link, bytes) => this.hear(link, () => client.datagram(now(), bytes)),
        closed: (link, reason) => this.lose(link, reason),
      });
      this.isTrying = false;
      if (client !== this.client) {
        transport.close();
        this.connect();
        return;
      }
      this.transport = transport;
      this.heardAt = now();
      client.opened(now());
      this.flush();
      this.changed();
    } catch (error) {
      this.isTrying = false;
      this.fail(inWords(error));
    }
  }

  hear(link, take) {
    if (link !== this.transport) return;
    this.heardAt = now();
    take();
    this.flush();
    this.fetchWanted();
    this.settle();
    if (!this.client.is_in()) this.changed();
  }

  /** Closes a connection that server or client have ended. */
  settle() {
    if (this.client.is_over()) this.drop("the connection was ended");
  }

  lose(link, reason) {
    if (link !== this.transport) return;
    this.transport = null;
    this.client.closed(now(), reason);
    this.fail(reason);
  }

  /** Tries again after a pause, unless that makes no sense. */
  fail(reason) {
    const { stage, mayPass, retryMs, isVersion, reason: said } = JSON.parse(this.client.state(now()));
    this.trouble = stage === "over" ? said : reason;
    if (isVersion) return this.reload();
    if (this.attempts === 0) this.lostAt = now();
    this.isOver = !mayPass || now() - this.lostAt > PATIENCE_MS;
    this.changed();
    if (this.isOver) return;
    const pause = PAUSES_MS[Math.min(this.attempts, PAUSES_MS.length - 1)];
    this.attempts += 1;
    // Those who were lost together come back apart.
    const spread = 1 + Math.random() * 0.25;
    clearTimeout(this.again);
    this.again = setTimeout(() => this.connect(), Math.max(pause, retryMs) * spread);
  }

  /** The server has another page than this one. */
  reload() {
    const version = String(this.join?.version);
    this.isOver = true;
    if (sessionStorage.getItem("reloaded") !== version) {
      sessionStorage.setItem("reloaded", version);
      location.reload();
    }
    this.changed();
  }

  /** The client is in the world: the next pauses are short again. */
  arrived() {
    this.attempts = 0;
    this.trouble = "";
  }

  /** Tries again now. */
  tryAgain() {
    this.isOver = false;
    this.lostAt = now();
    this.hurry();
    this.changed();
  }

  /** Tries now what would be tried after a pause. */
  hurry() {
    if (!this.client || this.transport || this.isOver) return;
    clearTimeout(this.again);
    this.connect();
  }

  /** The network has changed: the link may be dead without anybody noticing. */
  suspect() {
    const since = now();
    setTimeout(() => {
      if (this.transport && this.heardAt < since) this.drop("the network changed");
    }, DEAD_MS);
  }

  drop(reason) {
    const { transport } = this;
    if (!transport) return;
    this.lose(transport, reason);
    transport.close();
  }

  /** Does what is due, at each of the server's ticks. */
  timer() {
    const at = now();
    if (this.tickedAt && at - this.tickedAt > SLEPT_MS && this.transport) {
      this.drop("the computer slept");
    }
    this.tickedAt = at;
    this.client.tick(at);
    this.flush();
    this.fetchWanted();
    this.due = setTimeout(() => this.timer(), this.client.tick_ms());
  }

  /** Sends what the client has to say. */
  flush() {
    if (!this.transport || !this.client) return;
    const control = this.client.take_control();
    if (control.length) this.transport.sendControl(control);
    for (;;) {
      const datagram = this.client.take_datagram();
      if (!datagram) return;
      this.transport.sendDatagram(datagram);
    }
  }

  /** Gets the world that the client needs. */
  async fetchWanted() {
    const path = this.client.wanted();
    if (!path || this.giving === path) return;
    this.giving = path;
    const { client } = this;
    try {
      const bytes = await (this.downloads.get(path) ?? this.download(path, 0));
      this.reading = true;
      this.changed();
      // The page shows what it does before it does it.
      await new Promise((resolve) => setTimeout(resolve, 0));
      if (client === this.client) client.give(bytes);
      this.reading = false;
      // The browser keeps the file; the page need not.
      this.downloads.delete(path);
      this.flush();
      this.settle();
    } catch (error) {
      this.downloads.delete(path);
      this.drop(`the building could not be fetched: ${inWords(error)}`);
    } finally {
      this.giving = null;
      this.changed();
    }
  }

  /** Gets pieces of the building that the client needs. To be called after each picture. */
  async fetchPieces() {
    const at = now();
    if (this.requests >= REQUESTS_MAX || at < this.requestAt) return;
    const { client } = this;
    const path = client.next_pieces((this.requests + 1) * this.requestBytes);
    if (!path) return;
    this.requests += 1;
    this.requestAt = at + REQUEST_GAP_MS;
    let bytes;
    let refused = "";
    try {
      // Where geometry is private, the server must know who asks.
      const headers = this.join?.private ? { "x-visitor": settings.secret } : {};
      const answer = await fetch(path, { headers, signal: AbortSignal.timeout(60_000) });
      if (answer.ok) bytes = new Uint8Array(await answer.arrayBuffer());
      refused = answer.headers.get("x-refused") ?? "";
    } catch {
      // The link breaks, or the server is started again: they are asked for again.
    }
    this.requests -= 1;
    if (bytes) {
      const share = Math.min(2, Math.max(0.5, REQUEST_MS / (now() - at)));
      const [least, most] = REQUEST_BYTES;
      this.requestBytes = Math.min(most, Math.max(least, this.requestBytes * share));
    } else {
      this.requestAt = now() + PIECES_PAUSE_MS;
    }
    if (client !== this.client) return;
    client.give_pieces(path, bytes, refused);
    this.settle();
  }

  /** Downloads a world or a head, and tells how far it has come. */
  download(path, all) {
    const bytes = (async () => {
      const answer = await fetch(path);
      if (!answer.ok) throw new Error(`the server answers with error ${answer.status}`);
      const length = Number(answer.headers.get("content-length")) || all;
      const pieces = [];
      let done = 0;
      const reader = answer.body.getReader();
      for (;;) {
        const { value, done: isDone } = await reader.read();
        if (isDone) break;
        pieces.push(value);
        done += value.length;
        this.progress = { done, all: Math.max(length, done) };
        this.changed();
      }
      this.progress = null;
      return joined(pieces, done);
    })();
    this.downloads.set(path, bytes);
    bytes.catch(() => { this.downloads.delete(path); });
    return bytes;
  }
}

function joined(pieces, length) {
  const bytes = new Uint8Array(length);
  let at = 0;
  for (const piece of pieces) {
    bytes.set(piece, at);
    at += piece.length;
  }
  return bytes;
}

function inWords(error) {
  if (error instanceof TypeError || error?.name === "TimeoutError") return "the server does not answer";
  return error?.message || String(error);
}

export function now() {
  return performance.now();
}
