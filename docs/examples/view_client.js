// Follows a live session by the view's socket: prints the object and the people; with --hand, leads a hand in a circle.
//
// node docs/examples/view_client.js 'http://127.0.0.1:PORT/#TOKEN' [--hand]    the address that `cogrip view` prints
//
// Written from docs/view.md alone, for the WebSocket of Node 22 (Node 20: node --experimental-websocket) and of browsers.
// --hand needs `cogrip join LINK --device web`.

const STATES = ["free", "joining", "live", "degraded", "fault", "silent"];
const HEAD_BYTES = 96, PERSON_BYTES = 160;
const RADIUS_M = 0.03, TURN_MS = 4000;

const vector = (view, at) => [0, 8, 16].map((offset) => view.getFloat64(at + offset, true));
const signed = (value) => (value < 0 ? "" : "+") + value.toFixed(3);
const millimetres = (position, anchor = [0, 0, 0]) => position.map((value, axis) => signed(1e3 * (value + anchor[axis]))).join(" ");

/** Return a frame as a line; a hand is where its person holds the object. @param {DataView} view @param {object[]} people */
function line(view, people) {
  const parts = [`${view.getFloat64(8, true).toFixed(3)} s  object ${millimetres(vector(view, 16))}`];
  for (let each = 0; each < view.getUint8(2); each += 1) {
    const at = HEAD_BYTES + each * PERSON_BYTES;
    const [seat, state] = [view.getUint8(at), view.getUint8(at + 1)];
    const told = people.find((person) => person.seat === seat);
    if (state === 0 || !told) continue;
    const force_n = Math.hypot(...vector(view, at + 56));
    parts.push(`${told.name} ${STATES[state]} ${millimetres(vector(view, at + 8), told.anchor_m)} force ${force_n.toFixed(3)} N`);
  }
  return parts.join("  ");
}

/** Return the message that holds a hand at a target. @param {number} number from 1 up @param {number[]} target_m */
function pointer(number, target_m) {
  const view = new DataView(new ArrayBuffer(32));
  view.setUint8(0, 2);
  view.setUint8(1, 1); // holds
  view.setUint32(4, number, true);
  target_m.forEach((value, axis) => view.setFloat64(8 + 8 * axis, value, true));
  return view;
}

/** Talk until the server closes the socket. Each message about the own hand, 64 a second, is answered with its target. */
function follow(address, hand, say) {
  const url = new URL(address);
  const socket = new WebSocket(`ws://${url.host}/socket`, "cogrip.view.v1");
  let people = [], begin, sent = 0;
  socket.binaryType = "arraybuffer";
  socket.onopen = () => socket.send(JSON.stringify({ type: "hello", token: url.hash.slice(1).replace(/&hand$/, ""), hand }));
  socket.onclose = ({ code }) => say(`closed: ${code}`);
  socket.onmessage = ({ data }) => {
    if (typeof data === "string") {
      people = JSON.parse(data).people ?? people;
      return;
    }
    const view = new DataView(data);
    if (view.getUint8(0) === 1) say(line(view, people));
    if (view.getUint8(0) !== 3) return;
    begin ??= { time_ms: performance.now(), at_m: vector(view, 8) }; // the circle begins where the hand is
    const angle = (2 * Math.PI * (performance.now() - begin.time_ms)) / TURN_MS;
    const [x, y, z] = begin.at_m;
    socket.send(pointer((sent += 1), [x + RADIUS_M * (Math.cos(angle) - 1), y + RADIUS_M * Math.sin(angle), z]));
  };
}

if (globalThis.process?.argv[2]) follow(process.argv[2], process.argv.includes("--hand"), console.log);
