/** Keyboard of the page, and the page of help that lists it. */

import { isAnswering } from "./panel.js";

/**
 * @typedef {object} Key
 * @property {string[]} keys as KeyboardEvent.key has them
 * @property {string} shown in the help
 * @property {string} text
 * @property {(event: KeyboardEvent) => void} run
 * @property {boolean} [recording] has a meaning in a recording only
 */

/** @param {import("./main.js").App} app @returns {Key[]} */
function table(app) {
  const preset = (name, key) => ({ keys: [key], shown: key, text: `view: ${name}`, run: () => app.picture.orbit.preset(name) });
  const axis = (name, number) => ({ keys: [name], shown: name, text: `plots along ${name}`, run: () => app.showAxis(number) });
  const recorded = (keys, shown, text, run) => ({ keys, shown, text, run: (event) => run(app.player, event), recording: true });
  return [
    preset("front", "1"), preset("side", "2"), preset("top", "3"), preset("iso", "4"),
    { keys: ["g"], shown: "g", text: "ghost: the object as the next person is shown it", run: () => app.nextGhost() },
    { keys: ["]"], shown: "]", text: "longer force arrows", run: () => app.picture.scaleArrows(2) },
    { keys: ["["], shown: "[", text: "shorter force arrows", run: () => app.picture.scaleArrows(0.5) },
    axis("x", 0), axis("y", 1), axis("z", 2),
    { keys: [], shown: "5 to 9", text: "buttons of the hand that this page holds", run: () => {} },
    { keys: ["t"], shown: "t", text: "dark or light", run: () => app.switchTheme() },
    { keys: ["?"], shown: "?", text: "this help", run: () => app.help() },
    recorded([" "], "space", "play or pause", (player) => player.toggle()),
    recorded(["ArrowRight"], "→", "1 s on (shift: 10 s)", (player, event) => player.seek(player.time_s + (event.shiftKey ? 10 : 1))),
    recorded(["ArrowLeft"], "←", "1 s back (shift: 10 s)", (player, event) => player.seek(player.time_s - (event.shiftKey ? 10 : 1))),
    recorded(["."], ".", "next frame", (player) => player.step(1)),
    recorded([","], ",", "frame before", (player) => player.step(-1)),
    recorded(["n"], "n", "next event", (player) => player.toEvent(1)),
    recorded(["p"], "p", "event before", (player) => player.toEvent(-1)),
    recorded(["+", "="], "+", "faster", (player) => player.changeSpeed(1)),
    recorded(["-"], "-", "slower", (player) => player.changeSpeed(-1)),
    recorded(["a"], "a", "loop from here", (player) => player.markLoop("from_s")),
    recorded(["b"], "b", "loop to here", (player) => player.markLoop("to_s")),
    recorded(["l"], "l", "loop on or off", (player) => player.toggleLoop()),
    recorded(["Home"], "Home", "to the beginning", (player) => player.seek(0)),
    recorded(["End"], "End", "to the end", (player) => player.seek(player.duration_s)),
  ];
}

/** Listen to the keyboard. @param {import("./main.js").App} app @param {HTMLDialogElement} dialog */
export function listen(app, dialog) {
  const keys = table(app);
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.target instanceof HTMLSelectElement || dialog.open || isAnswering(event)) return;
    if (event.key === " " && event.target instanceof HTMLButtonElement) return; // the browser presses that button
    const key = keys.find((each) => each.keys.includes(event.key) && (!each.recording || app.player));
    if (!key) return;
    event.preventDefault();
    key.run(event);
  });
  // A button that was clicked gives the keyboard back.
  document.addEventListener("click", (event) => event.detail > 0 && event.target instanceof HTMLButtonElement && event.target.blur());
  return () => {
    const rows = keys
      .filter((each) => !each.recording || app.player)
      .map((each) => {
        const row = document.createElement("div");
        const name = document.createElement("kbd");
        const text = document.createElement("span");
        name.textContent = each.shown;
        text.textContent = each.text;
        row.append(name, text);
        return row;
      });
    dialog.querySelector("[data-part=keys]").replaceChildren(...rows);
    dialog.showModal();
  };
}
