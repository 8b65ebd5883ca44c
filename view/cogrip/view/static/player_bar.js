/** Bar below the picture: play, speed, scrub with event markers, loop. */

import { SPEEDS } from "./player.js";
import { write } from "./people.js";

/** @param {number} time_s @returns {string} as 1:02.50 */
export function clock(time_s) {
  const minutes = Math.floor(time_s / 60);
  return `${minutes}:${(time_s - 60 * minutes).toFixed(2).padStart(5, "0")}`;
}

export class PlayerBar {
  /** @param {HTMLElement} bar @param {import("./player.js").Player} player */
  constructor(bar, player) {
    this.bar = bar;
    this.player = player;
    const part = (name) => bar.querySelector(`[data-part="${name}"]`);
    this.play = part("play");
    this.time = part("time");
    this.scrub = part("scrub");
    this.speed = part("speed");
    this.loop = part("loop");
    this.band = part("band");
    this.markers = part("markers");
    this.scrub.max = String(player.duration_s);
    this.speed.replaceChildren(...SPEEDS.map((each) => new Option(`${each}x`, String(each))));
    const actions = {
      play: () => player.toggle(),
      "event-back": () => player.toEvent(-1),
      "event-on": () => player.toEvent(1),
      "frame-back": () => player.step(-1),
      "frame-on": () => player.step(1),
      "loop-from": () => player.markLoop("from_s"),
      "loop-to": () => player.markLoop("to_s"),
      loop: () => player.toggleLoop(),
    };
    for (const [name, action] of Object.entries(actions)) part(name).onclick = action;
    this.scrub.oninput = () => player.seek(Number(this.scrub.value));
    this.speed.onchange = () => {
      player.speed = Number(this.speed.value);
      player.changed();
    };
    this.markEvents();
    bar.hidden = false;
  }

  markEvents() {
    const { scene, duration_s } = this.player;
    const markers = scene.events.map((event) => {
      const marker = document.createElement("button");
      marker.type = "button";
      marker.className = `tick ${event.kind}`;
      marker.title = `${clock(event.time_s)} ${event.text}`;
      marker.setAttribute("aria-label", marker.title);
      marker.tabIndex = -1;
      marker.style.left = `${(100 * event.time_s) / Math.max(duration_s, 1e-9)}%`;
      marker.onclick = () => this.player.seek(event.time_s);
      return marker;
    });
    this.markers.replaceChildren(...markers);
  }

  show() {
    const { time_s, duration_s, playing, speed, loop } = this.player;
    write(this.play, playing ? "Pause" : "Play");
    write(this.time, `${clock(time_s)} / ${clock(duration_s)}`);
    this.scrub.value = String(time_s);
    this.scrub.setAttribute("aria-valuetext", `${time_s.toFixed(2)} s`);
    this.speed.value = String(speed);
    this.loop.setAttribute("aria-pressed", String(loop.on));
    this.band.hidden = !loop.on;
    this.band.style.left = `${(100 * loop.from_s) / Math.max(duration_s, 1e-9)}%`;
    this.band.style.width = `${(100 * (loop.to_s - loop.from_s)) / Math.max(duration_s, 1e-9)}%`;
  }
}
