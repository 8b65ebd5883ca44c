// Follows a session by the view's socket: prints the object and the people; with --hand, leads a hand in a circle.
//
// node docs/examples/view_client.js 'http://127.0.0.1:PORT/#TOKEN' [--hand]    the address that `cogrip view` prints
//
// Written from docs/view.md alone, for the WebSocket of Node 22 (Node 20: node --experimental-websocket) and of browsers.
// Of a recording, every frame is printed. --hand needs `cogrip join LINK --device web`.

const STATES = ["free", "joining", "live", "degraded", "fault", "silent"];
const HEAD_BYTES = 96, PERSON_BYTES = 136;
const RADIUS_M = 0.03, TURN_S = 4, POINTER_PERIOD_MS = 20;

const vector = (view, at) => [0, 8, 16].map((offset) => view.getFloat64(at + offset, true));
const signed = (value) => (value < 0 ? "" : "+") + value.toFixed(3);
const millimetres = (position, anchor = [0, 0, 0]) => position.map((value, axis) => signed(1e3 * (value + anchor[axis]))).join(" ");

/** Return a frame as a line; a hand is where its person holds the object. @param {DataView} view @param {object} scene */
function line(view, scene) {
  const parts = [`${view.getFloat64(8, true).toFixed(3)} s  object ${millimetres(vector(view, 16))}`];
  for (let each = 0; each < view.getUint8(2); each += 1) {
    const at = HEAD_BYTES + each * PERSON_BYTES;
    const state = view.getUint8(at + 1);
    const told = scene.people.find((person) => person.seat === view.getUint8(at));
    if (state === 0 || !told) continue;
    const force_n = Math.hypot(...vector(view, at + 56));
    parts.push(`${told.name} ${STATES[state]} ${millimetres(vector(view, at + 8), told.anchor_m)} force ${force_n.toFixed(3)} N`);
  }
  return parts.join("  ");
}

/** Send a pointer message every 20 ms, in a circle that begins where the device is. @returns timer */
function circle(socket, [x, y, z]) {
  const begun_ms = performance.now();
  let number = 0;
  return setInterval(() => {
    const angle = (2 * Math.PI * (performance.now() - begun_ms)) / 1000 / TURN_S;
    const view = new DataView(new ArrayBuffer(32));
    view.setUint8(0, 2);
    view.setUint8(1, 1); // holds
    view.setUint32(4, (number += 1), true);
    const target = [x + RADIUS_M * (Math.cos(angle) - 1), y + RADIUS_M * Math.sin(angle), z];
    target.forEach((value, axis) => view.setFloat64(8 + 8 * axis, value, true));
    socket.send(view.buffer);
  }, POINTER_PERIOD_MS);
}

/** Return the frames of a chunk of a recording. @param {ArrayBuffer} message */
async function unpack(message) {
  const unzipped = new Blob([message.slice(12)]).stream().pipeThrough(new DecompressionStream("gzip"));
  const frames = await new Response(unzipped).arrayBuffer();
  const count = new DataView(message).getUint32(8, true);
  const size = frames.byteLength / count; // people and, of a scene, bodies are as many in all of them
  return Array.from({ length: count }, (_, each) => new DataView(frames, each * size, size));
}

/** Talk until the server closes the socket. @param {string} address @param {boolean} hand @param {(text: string) => void} say */
function follow(address, hand, say) {
  const url = new URL(address);
  const socket = new WebSocket(`ws://${url.host}/socket`, "cogrip.view.v1");
  let scene, timer;
  const ask = (number) => (number < scene.chunks ? socket.send(JSON.stringify({ type: "chunk", number })) : socket.close(1000));
  socket.binaryType = "arraybuffer";
  socket.onopen = () => socket.send(JSON.stringify({ type: "hello", token: url.hash.slice(1).replace(/&hand$/, ""), hand }));
  socket.onclose = ({ code }) => {
    clearInterval(timer);
    if (code !== 1000) say(`closed: ${code}`);
  };
  socket.onmessage = async ({ data }) => {
    if (typeof data === "string") {
      const told = JSON.parse(data);
      if (told.type === "scene") scene = told;
      if (told.type === "scene" && scene.chunks) ask(0);
      return;
    }
    const view = new DataView(data);
    const kind = view.getUint8(0);
    if (kind === 1) say(line(view, scene));
    else if (kind === 3) timer ??= circle(socket, vector(view, 8)); // own hand
    else if (kind === 4) {
      for (const frame of await unpack(data)) say(line(frame, scene));
      ask(view.getUint32(4, true) + 1);
    }
  };
}

if (globalThis.process?.argv[2]) follow(process.argv[2], process.argv.includes("--hand"), console.log);
