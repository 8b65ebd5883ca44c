/** The socket to the process that serves this page (docs/view.md): says hello, comes back after a break, tells the user in one sentence. */

import { decodeFrame, decodeOwnHand, CHUNK, FRAME, OWN_HAND } from "./frames.js";

const SUBPROTOCOL = "cogrip.view.v1";
const FIRST_WAIT_MS = 500;
const LONGEST_WAIT_MS = 5000;

/** Codes after which another attempt would end in the same way. */
const FINAL = {
  4400: "This page and its server do not understand each other. Reload the page; if that does not help, update cogrip.",
  4401: "The server does not know this page's token. Open the link that the command printed, with all that follows the #.",
  4403: "This link has no right to that. Ask whoever sent it for another one.",
  4413: "The server refused a message of this page as too large. Reload the page.",
};

/** Codes whose reason is a sentence for the user. */
const TOLD = [4401, 4403];

/** The server will not be there again. */
const OVER = 4410;

/**
 * @typedef {object} Handlers
 * @property {() => void} opened
 * @property {(scene: object) => void} scene
 * @property {(frame: import("./frames.js").Frame, arrived_ms: number) => void} frame
 * @property {(hand: import("./frames.js").OwnHand) => void} ownHand
 * @property {(event: object) => void} event
 * @property {(message: Uint8Array) => void} chunk
 * @property {(panel: object) => void} panel of a study's participant
 * @property {(text: string) => void} status a sentence for the user, "" while all is well
 * @property {() => boolean} over nothing more comes: a break of the connection is the end
 * @property {() => void} closed the connection has ended
 * @property {(reason: string) => void} malformed
 */

export class Socket {
  /** @param {URL} page address of this page; its fragment is TOKEN or TOKEN&hand @param {Handlers} handlers */
  constructor(page, handlers) {
    const [token, ...wishes] = page.hash.replace(/^#/, "").split("&");
    this.hello = { type: "hello", token, hand: wishes.includes("hand") };
    this.address = new URL("socket", page);
    this.address.hash = "";
    this.address.search = "";
    this.address.protocol = page.protocol === "https:" ? "wss:" : "ws:";
    this.handlers = handlers;
    this.wait_ms = FIRST_WAIT_MS;
    this.connect();
  }

  connect() {
    this.handlers.status("Connecting ...");
    this.socket = new WebSocket(this.address, SUBPROTOCOL);
    this.socket.binaryType = "arraybuffer";
    this.socket.onopen = () => {
      this.handlers.opened();
      this.socket.send(JSON.stringify(this.hello));
    };
    this.socket.onmessage = (message) => this.take(message.data);
    this.socket.onclose = (ended) => this.ended(ended.code, ended.reason);
  }

  /** @param {string | ArrayBuffer} data */
  take(data) {
    try {
      if (typeof data === "string") this.takeText(JSON.parse(data));
      else this.takeBinary(data);
    } catch (error) {
      this.handlers.malformed(String(error));
    }
  }

  /** @param {{type: string}} message */
  takeText(message) {
    if (message.type === "scene") {
      this.wait_ms = FIRST_WAIT_MS;
      this.handlers.status("");
      this.handlers.scene(message);
    } else if (message.type === "event") {
      this.handlers.event(message);
    } else if (message.type === "panel") {
      this.handlers.panel(message);
    }
  }

  /** @param {ArrayBuffer} data */
  takeBinary(data) {
    const view = new DataView(data);
    const kind = view.getUint8(0);
    if (kind === FRAME) this.handlers.frame(decodeFrame(view), performance.now());
    else if (kind === OWN_HAND) this.handlers.ownHand(decodeOwnHand(view));
    else if (kind === CHUNK) this.handlers.chunk(new Uint8Array(data));
  }

  /** @param {number} code @param {string} reason the server's own sentence, "" where it gave none */
  ended(code, reason) {
    this.handlers.closed();
    if (code === OVER || this.handlers.over()) {
      this.handlers.status(this.handlers.over() ? "" : `${reason}. What you see is the last picture.`);
      return;
    }
    if (FINAL[code]) {
      this.handlers.status(TOLD.includes(code) && reason ? `Not admitted: ${reason}.` : FINAL[code]);
      return;
    }
    const wait_ms = this.wait_ms;
    this.wait_ms = Math.min(2 * wait_ms, LONGEST_WAIT_MS);
    this.handlers.status(`The connection to cogrip ended; trying again in ${(wait_ms / 1000).toFixed(1)} s.`);
    setTimeout(() => this.connect(), wait_ms);
  }

  /** @param {ArrayBuffer | string} message @returns {boolean} it was sent */
  send(message) {
    if (this.socket.readyState !== WebSocket.OPEN) return false;
    this.socket.send(message);
    return true;
  }

  /** @param {number} number */
  askChunk(number) {
    return this.send(JSON.stringify({ type: "chunk", number }));
  }
}
