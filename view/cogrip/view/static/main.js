/** The page: joins the socket or an embedded recording to the picture, the plots, the numbers and the controls. */

import { Vector3 } from "three";
import { Hand } from "./hand.js";
import { History } from "./history.js";
import { listen } from "./keys.js";
import { Measures } from "./measures.js";
import { Panel } from "./panel.js";
import { fixed, People, write } from "./people.js";
import { Picture } from "./picture.js";
import { Player } from "./player.js";
import { clock, PlayerBar } from "./player_bar.js";
import { Plots } from "./plots.js";
import { Socket } from "./socket.js";
import { Sounds } from "./sounds.js";

const VERSION = 1; // of the scene message
const PLOT_WINDOW_S = 10;
const NUMBERS_PERIOD_MS = 100; // text that changes faster is not read
const MOST_EVENTS = 200;
const SILENT_MS = 1500;
const NO_NEWS = "no news";

const part = (id) => document.getElementById(id);

export class App {
  constructor() {
    this.scene = null;
    this.newest = null; // frame to draw
    this.shown = null; // frame that was drawn
    this.arrived_ms = 0;
    this.player = null;
    this.ghostSeat = undefined; // null: nobody's
    this.requested = false;
    this.numbers_ms = 0;
    this.resting = ""; // why the picture is not live, "" while it is
    this.measures = new Measures();
    this.history = new History(PLOT_WINDOW_S);
    const changed = () => this.request();
    try {
      this.picture = new Picture(part("stage"), part("canvas"), part("labels"), changed);
    } catch (error) {
      this.status("This browser gives the page no WebGL 2, with which the picture is drawn. Switch on hardware acceleration, or use another browser.");
      throw error;
    }
    this.plots = new Plots(part("plots"), this.history);
    this.people = new People(part("people"), (seat) => this.showGhost(seat === this.ghostSeat ? null : seat));
    this.hand = new Hand(part("canvas"), this.picture, (message) => this.socket?.send(message) ?? false, changed);
    this.panel = new Panel(part("panel"), (number, text) => this.socket?.send(JSON.stringify({ type: "reply", number, text })) ?? false);
    this.sounds = new Sounds(this.panel.part("sound"));
    this.followTheme();
    this.help = listen(this, part("help"));
    this.buttons();
    this.open();
  }

  /** Open the recording in this file, or the socket of the process that served it. */
  open() {
    const embedded = part("recording");
    if (embedded) {
      const { scene, chunks } = JSON.parse(embedded.textContent);
      this.embedded = chunks;
      this.takeScene(scene);
      return;
    }
    this.socket = new Socket(new URL(location.href), {
      opened: () => this.hand.restart(),
      scene: (scene) => this.takeScene(scene),
      frame: (frame, arrived_ms) => this.takeFrame(frame, arrived_ms),
      ownHand: (own) => {
        this.hand.show(own);
        this.request();
      },
      event: (event) => this.takeEvents([event]),
      chunk: (message) => this.takeChunk(message),
      panel: (message) => this.takePanel(message),
      status: (text) => this.status(text),
      over: () => this.panel.over,
      closed: () => {
        this.sounds.silence();
        this.rest(this.panel.over ? "over" : "not connected");
      },
      malformed: () => (this.measures.malformed += 1),
    });
    setInterval(() => this.watch(), 500);
  }

  /** @param {number} number of a chunk */
  askChunk(number) {
    if (this.socket) this.socket.askChunk(number);
    else {
      const message = Uint8Array.from(atob(this.embedded[number]), (each) => each.charCodeAt(0));
      queueMicrotask(() => this.takeChunk(message)); // as a socket would: the player is made by then
    }
  }

  /** @param {Uint8Array} message */
  takeChunk(message) {
    this.player?.take(message).catch((error) => {
      this.measures.malformed += 1;
      this.status(`A part of the recording cannot be read (${error.message}). Write the page again, or replay the run with cogrip replay.`);
    });
  }

  /** @param {object} scene message */
  takeScene(scene) {
    if (scene.version !== VERSION) {
      this.status(`This page reads version ${VERSION} of the scene and got ${scene.version}. Reload the page, so that it is the server's own.`);
      return;
    }
    const same = this.scene?.room === scene.room && this.scene.mode === scene.mode;
    const sameSpace = same && JSON.stringify(this.scene.workspace_m) === JSON.stringify(scene.workspace_m);
    if (!same) part("events").replaceChildren();
    this.scene = scene;
    document.title = `${scene.room} – cogrip`;
    write(part("room"), scene.room);
    this.rest("");
    write(part("note"), this.waitsForHand() ? "" : (scene.note ?? ""));
    document.body.dataset.mode = scene.mode;
    if (!same) this.history.clear();
    this.history.seats = scene.people.map((each) => each.seat);
    this.hand.build(scene);
    if (scene.mode === "recording") this.takeRecording(scene, same);
    const others = scene.people.filter((each) => each.seat !== scene.own_seat);
    if (this.ghostSeat === undefined && others.length > 0) this.ghostSeat = others[0].seat;
    this.rebuild(sameSpace);
    this.takeEvents(same ? [] : scene.events);
  }

  takeRecording(scene, same) {
    if (same && this.player) {
      this.player.askAgain();
      return;
    }
    this.player = new Player(scene, (number) => this.askChunk(number), () => this.request());
    this.bar = new PlayerBar(part("player"), this.player);
    this.status("");
  }

  /** Build all that has colours: of a new scene, or after the theme changed. */
  rebuild(keepCamera) {
    if (!this.scene) return;
    this.picture.build(this.scene, keepCamera);
    this.plots.build(this.scene);
    this.people.build(this.scene);
    for (const [axis, button] of [...document.querySelectorAll("[data-axis]")].entries()) button.hidden = axis >= this.scene.axes;
    this.showGhost(this.ghostSeat ?? null);
    this.numbers_ms = 0;
    this.request();
  }

  /** @param {object} message of a study's participant */
  takePanel(message) {
    this.panel.show(message);
    this.sounds.show(message);
    this.picture.aim(message.target);
    this.request();
  }

  takeFrame(frame, arrived_ms) {
    if (!this.scene) return;
    this.measures.arrived(frame.time_s, arrived_ms);
    this.newest = frame;
    this.arrived_ms = arrived_ms;
    this.history.push(frame);
    if (this.resting) this.rest("");
    this.request();
  }

  /** Show whether the picture is live. @param {string} why it is not, "" where it is */
  rest(why) {
    this.resting = why;
    document.body.classList.toggle("resting", why !== "");
    if (!this.scene) return;
    write(part("mode"), why || this.scene.mode);
    if (why) this.numbers(performance.now());
  }

  /** @returns {boolean} this page asked for a hand, and another tab has it */
  waitsForHand() {
    return Boolean(this.socket?.hello.hand && this.scene?.note && !this.scene.hand);
  }

  takeEvents(events) {
    for (const event of events) {
      const line = document.createElement("li");
      const button = document.createElement("button");
      button.type = "button";
      button.textContent = `${clock(event.time_s)}  ${event.text}`;
      button.className = event.kind;
      button.disabled = !this.player;
      button.onclick = () => this.player?.seek(event.time_s);
      line.append(button);
      part("events").prepend(line);
      write(part("news"), this.player ? "" : event.text);
    }
    while (part("events").children.length > MOST_EVENTS) part("events").lastChild.remove();
  }

  /** Ask for one picture. */
  request() {
    if (this.requested) return;
    this.requested = true;
    requestAnimationFrame((now_ms) => this.draw(now_ms));
  }

  draw(now_ms) {
    this.requested = false;
    if (!this.scene) return;
    if (this.player) this.play(now_ms);
    const frame = this.newest;
    if (frame) {
      this.picture.show(frame, this.hand.own, this.hand.target);
      this.picture.draw();
      this.measures.drew(frame === this.shown ? null : frame, this.arrived_ms, performance.now());
      this.shown = frame;
      this.plots.next(now_ms);
    } else {
      this.picture.draw();
    }
    if (now_ms - this.numbers_ms >= NUMBERS_PERIOD_MS || this.player) this.numbers(now_ms);
    else this.numbersLater ??= setTimeout(() => this.numbers(performance.now()), NUMBERS_PERIOD_MS);
    if (this.player?.playing) this.request();
  }

  /** Let the recording's time pass and take the frame that it has come to. */
  play(now_ms) {
    const player = this.player;
    player.advance((now_ms - (this.played_ms ?? now_ms)) / 1000);
    this.played_ms = player.playing ? now_ms : undefined;
    const frame = player.frame();
    write(part("news"), frame ? "" : "Loading ...");
    this.bar.show();
    if (!frame) return;
    const before_s = this.history.end_s;
    const goesOn = frame.time_s >= before_s && frame.time_s - before_s < PLOT_WINDOW_S && this.arrivals === player.arrivals;
    if (!goesOn) this.history.clear();
    this.arrivals = player.arrivals;
    for (const each of player.between(goesOn ? before_s : frame.time_s - PLOT_WINDOW_S, frame.time_s)) this.history.push(each);
    if (!goesOn) this.plots.all();
    else if (frame !== this.newest && !player.playing) this.plots.all();
    this.arrived_ms = now_ms;
    this.newest = this.newest?.number === frame.number && this.newest?.time_s === frame.time_s ? this.newest : frame;
  }

  /** Write the numbers over the picture and beside it. */
  numbers(now_ms) {
    this.numbers_ms = now_ms;
    clearTimeout(this.numbersLater);
    this.numbersLater = null;
    const { force_n, pixels } = this.picture.arrowLegend();
    part("arrow-scale").style.width = `${pixels.toFixed(0)}px`;
    write(part("arrow-force"), `${Number(force_n.toPrecision(2))} N`);
    write(part("grid-step"), `grid ${Number((1000 * this.picture.gridStep_m).toPrecision(3))} mm`);
    write(part("own-force"), this.ownForce());
    const frame = this.newest;
    if (!frame) return;
    if (this.resting) {
      this.people.rest(this.resting);
      write(part("time"), `${this.resting}: the last picture, of ${frame.time_s.toFixed(2)} s`);
      return;
    }
    this.people.show(frame);
    const axes = this.scene.axes;
    const position = frame.position_m.slice(0, axes).map((value, axis) => `${"xyz"[axis]} ${fixed(1000 * value, 1)}`);
    write(part("time"), `${frame.time_s.toFixed(2)} s, step ${frame.number}`);
    write(part("object"), `object ${position.join("  ")} mm, ${Math.hypot(...frame.velocity_mps).toFixed(3)} m/s`);
    const names = new Map(this.scene.people.map((each) => [each.seat, each.name]));
    const pushing = frame.people.filter((each) => each.pushes).map((each) => names.get(each.seat) ?? `seat ${each.seat}`);
    write(part("contact"), frame.contact ? `contact${pushing.length > 0 ? `: ${pushing.join(", ")}` : ""}` : "no contact");
    part("contact").classList.toggle("on", frame.contact);
  }

  ownForce() {
    const { own, scene } = this.hand;
    if (!scene) return this.waitsForHand() ? this.scene.note : "";
    if (this.resting) return "";
    if (!own) return "Your device is being made ready ...";
    const limit = Number.isFinite(own.limit_n) ? ` of ${own.limit_n.toFixed(1)}` : "";
    const held = this.hand.holds ? "" : own.state === "live" ? "; press on your device or the object and drag" : `; ${own.state}`;
    return `force on your hand ${Math.hypot(...own.force_n).toFixed(2)}${limit} N${held}`;
  }

  /** Tell that nothing comes though the connection is there. */
  watch() {
    if (this.player || !this.newest) return;
    const still = performance.now() - this.arrived_ms > SILENT_MS;
    const silent = still && !this.panel.pauses && (!this.resting || this.resting === NO_NEWS);
    document.body.classList.toggle("silent", silent);
    if (still && this.resting !== "not connected") this.rest(this.panel.over ? "over" : this.panel.pauses ? "between trials" : NO_NEWS);
    if (silent) write(part("time"), `no news for ${((performance.now() - this.arrived_ms) / 1000).toFixed(0)} s`);
  }

  /** @param {string} text */
  status(text) {
    write(part("status"), text);
    part("status").hidden = text === "";
    if (text) this.hand?.letGo();
  }

  /** @param {number | null} seat */
  showGhost(seat) {
    this.ghostSeat = seat;
    this.picture.ghostSeat = seat;
    this.people.mark(seat);
    this.request();
  }

  nextGhost() {
    const seats = [...(this.scene?.people.map((each) => each.seat) ?? []), null];
    this.showGhost(seats[(seats.indexOf(this.ghostSeat) + 1) % seats.length]);
  }

  /** @param {number} axis 0 to 2 */
  showAxis(axis) {
    if (this.scene && axis >= this.scene.axes) return;
    for (const [each, button] of document.querySelectorAll("[data-axis]").entries()) button.setAttribute("aria-pressed", String(each === axis));
    this.plots.showAxis(axis);
  }

  followTheme() {
    const dark = matchMedia("(prefers-color-scheme: dark)");
    this.theme(dark.matches ? "dark" : "light");
    dark.addEventListener("change", () => this.theme(dark.matches ? "dark" : "light"));
  }

  /** @param {"dark" | "light"} name */
  theme(name) {
    document.documentElement.dataset.theme = name;
    this.rebuild(true);
  }

  switchTheme() {
    this.theme(document.documentElement.dataset.theme === "dark" ? "light" : "dark");
  }

  buttons() {
    for (const button of document.querySelectorAll("[data-view]")) button.onclick = () => this.picture.orbit.preset(button.dataset.view);
    for (const [axis, button] of document.querySelectorAll("[data-axis]").entries()) button.onclick = () => this.showAxis(axis);
    part("theme").onclick = () => this.switchTheme();
    part("help-button").onclick = () => this.help();
  }
}

const app = new App();

/** State for tests and benchmarks: to be read, but for `seek`. */
window.cogrip = Object.freeze({
  get scene() {
    return structuredClone(app.scene);
  },
  get frame() {
    return app.shown && { ...structuredClone(app.shown), drawn: app.picture.drawn() };
  },
  get stats() {
    return app.measures.read();
  },
  get player() {
    const { time_s, playing, speed, loop } = app.player ?? {};
    return app.player && { time_s, playing, speed, loop: { ...loop } };
  },
  get sounds() {
    const { context, noise, sounds, sound } = app.sounds;
    const samples = app.sounds.samples();
    return { made: context !== null, runs: sounds, noise: noise !== null, told: sound, most: Math.max(...samples.map(Math.abs)) };
  },
  get hand() {
    return { own: structuredClone(app.hand.own), target_m: app.hand.target, sent: app.hand.number };
  },
  /** Show a moment of a recording, exactly: the scrub bar's own value is rounded by the browser. */
  seek: (time_s) => app.player?.seek(time_s),
  /** The bodies alone, on one colour: to be compared with pictures of others. */
  portrait: (background) => app.picture.portrait(background),
  /** Pixel of the page at which a point of the world is drawn. */
  project: (point) => {
    const box = part("canvas").getBoundingClientRect();
    const [x, y] = app.picture.project(new Vector3(...point));
    return [box.left + x, box.top + y];
  },
});
