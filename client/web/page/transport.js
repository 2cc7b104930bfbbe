// The two kinds of connections to a server: WebTransport, and WebSocket where that does not work.
//
// Both are opened with a listener of { control(bytes), datagram(bytes), closed(reason) } and give
// { kind, sendControl(bytes), sendDatagram(bytes), close() }.

/** How long WebTransport has a head start, in milliseconds. */
const HEAD_START_MS = 800;
/** How long a connection may take to open, in milliseconds. */
const OPEN_MS = 8000;
/** A socket with more bytes than this waiting drops datagrams: newer ones follow. */
const WAITING_BYTES_MAX = 4096;

const CONTROL = 0;
const DATAGRAM = 1;

let webTransportFails = false;

/** Opens the better kind of connection that works. */
export async function open(join, listener) {
  const canTransport = join.webtransport && "WebTransport" in globalThis && !webTransportFails;
  if (!canTransport) return openWebSocket(join, listener);
  const better = openWebTransport(join, listener);
  better.catch(() => { webTransportFails = true; });
  const first = await Promise.race([better.catch(() => null), after(HEAD_START_MS)]);
  if (first) return first;
  const other = openWebSocket(join, listener);
  try {
    const found = await Promise.any([better, other]);
    // The one that comes second is not needed.
    for (const late of [better, other]) {
      late.then((link) => link !== found && link.close(), () => {});
    }
    return found;
  } catch (error) {
    throw error.errors?.at(-1) ?? error;
  }
}

function openWebSocket(join, listener) {
  return new Promise((resolve, reject) => {
    const url = new URL(join.websocket, location.href);
    url.protocol = url.protocol === "https:" ? "wss:" : "ws:";
    const socket = new WebSocket(url);
    socket.binaryType = "arraybuffer";
    const late = setTimeout(() => socket.close(), OPEN_MS);
    const send = (kind, bytes) => {
      if (socket.readyState !== WebSocket.OPEN) return;
      const message = new Uint8Array(bytes.length + 1);
      message[0] = kind;
      message.set(bytes, 1);
      socket.send(message);
    };
    const link = {
      kind: "WebSocket",
      sendControl: (bytes) => send(CONTROL, bytes),
      sendDatagram: (bytes) => socket.bufferedAmount < WAITING_BYTES_MAX && send(DATAGRAM, bytes),
      close: () => socket.close(),
    };
    let isOpen = false;
    socket.onopen = () => {
      clearTimeout(late);
      isOpen = true;
      resolve(link);
    };
    socket.onmessage = ({ data }) => {
      const bytes = new Uint8Array(data);
      if (bytes[0] === CONTROL) listener.control(link, bytes.subarray(1));
      if (bytes[0] === DATAGRAM) listener.datagram(link, bytes.subarray(1));
    };
    socket.onclose = ({ reason }) => {
      clearTimeout(late);
      const why = reason || (isOpen ? "the connection broke" : "no connection to the server can be made");
      if (isOpen) listener.closed(link, why);
      else reject(new Error(why));
    };
  });
}

async function openWebTransport(join, listener) {
  const { url, hashes } = join.webtransport;
  const value = (hash) => Uint8Array.from(atob(hash), (letter) => letter.charCodeAt(0));
  const options = hashes?.length
    ? { serverCertificateHashes: hashes.map((hash) => ({ algorithm: "sha-256", value: value(hash) })) }
    : {};
  const transport = new WebTransport(url, options);
  const late = setTimeout(() => transport.close(), OPEN_MS);
  transport.closed.catch(() => {});
  try {
    await transport.ready;
  } finally {
    clearTimeout(late);
  }
  const stream = await transport.createBidirectionalStream();
  const control = stream.writable.getWriter();
  const datagrams = (transport.datagrams.createWritable?.() ?? transport.datagrams.writable).getWriter();
  const ignore = () => {};
  const link = {
    kind: "WebTransport",
    sendControl: (bytes) => control.write(bytes).catch(ignore),
    sendDatagram: (bytes) => datagrams.write(bytes).catch(ignore),
    close: () => transport.close(),
  };
  let isOpen = true;
  const end = (reason) => {
    if (isOpen) {
      isOpen = false;
      listener.closed(link, reason || "the connection broke");
    }
  };
  const read = async (readable, take) => {
    const reader = readable.getReader();
    for (;;) {
      const { value, done } = await reader.read();
      if (done) return;
      take(value);
    }
  };
  // The last words arrive on the stream before its end.
  read(stream.readable, (bytes) => listener.control(link, bytes)).then(() => end(), () => end());
  read(transport.datagrams.readable, (bytes) => listener.datagram(link, bytes)).catch(ignore);
  transport.closed.then(({ reason }) => end(reason), () => end());
  return link;
}

function after(milliseconds) {
  return new Promise((resolve) => setTimeout(resolve, milliseconds, null));
}
