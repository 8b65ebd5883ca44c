/** The people beside the picture: a plain state line for each, and numbers with their units. */

/** Write a number; what is 0 when rounded has no sign. @returns {string} */
export function fixed(value, digits) {
  const text = value.toFixed(digits);
  return Number(text) === 0 ? text.replace("-", "") : text;
}

const number = (value, digits) => (Number.isFinite(value) ? fixed(value, digits) : "–");
const length = (values) => Math.hypot(...values);

/**
 * @param {string} name
 * @param {import("./frames.js").Person} person
 * @returns {string} as "ben: live, 48 ms, passive"
 */
export function stateLine(name, person) {
  if (person.state === "free") return `${name}: not here`;
  const delay = Number.isFinite(person.rtt_ms) ? `, ${person.rtt_ms.toFixed(0)} ms` : "";
  const passive = Number.isFinite(person.up_reserve_mj) || Number.isFinite(person.line_reserve_mj) || !person.passive;
  return `${name}: ${person.state}${delay}${passive ? (person.passive ? ", passive" : ", NOT PASSIVE") : ""}`;
}

const HANDLE = "buttons"; // a row that most devices have no use for
/** Numbers of a person: name, explanation, value, unit. */
const NUMBERS = [
  ["force", "force on the object", (each) => number(length(each.force_n), 2), "N"],
  ["delay", "delay up / down, jitter buffer included", (each) => `${number(each.up_ms, 0)} / ${number(each.down_ms, 0)}`, "ms"],
  ["energy", "energy reserve now: line up / whole line", (each) => `${number(each.up_reserve_mj, 1)} / ${number(each.line_reserve_mj, 1)}`, "mJ"],
  ["spring", "length of the coupling from device to proxy", (each) => number(1000 * stretch(each), 1), "mm"],
  ["buffer", "depth of the jitter buffer up / down", (each) => `${number(each.buffer_up_ms, 0)} / ${number(each.buffer_down_ms, 0)}`, "ms"],
  ["lost", "frames lost in the last second (since the beginning)", (each) => `${number(100 * each.loss, 1)} % (${each.lost})`, ""],
  [HANDLE, "buttons that are down; opening of the gripper", (each) => handle(each), ""],
];

/** @param {import("./frames.js").Person} person @returns {string} as "1 3, 12.5 mm" */
export function handle(person) {
  const down = Array.from({ length: 32 }, (_, bit) => bit + 1).filter((button) => (person.buttons >>> (button - 1)) & 1);
  const grip = Number.isFinite(person.grip_m) ? `${(1000 * person.grip_m).toFixed(1)} mm` : "";
  return [down.join(" "), grip].filter(Boolean).join(", ") || "–";
}

/** @param {import("./frames.js").Person} person @returns {number} length of the coupling [m] */
function stretch(person) {
  return person.hand_known ? length(person.hand_m.map((hand, axis) => hand - person.proxy_m[axis])) : NaN;
}

export class People {
  /** @param {HTMLElement} place @param {(seat: number) => void} ghost called when a person's picture is asked for */
  constructor(place, ghost) {
    this.place = place;
    this.ghost = ghost;
    this.cards = new Map();
  }

  build(scene) {
    this.place.replaceChildren();
    this.cards.clear();
    for (const person of scene.people) this.cards.set(person.seat, this.card(person));
  }

  card(person) {
    const card = document.createElement("article");
    card.dataset.seat = person.seat;
    const head = document.createElement("header");
    const swatch = document.createElement("span");
    swatch.className = "swatch";
    swatch.style.background = person.colour;
    const line = document.createElement("strong");
    line.textContent = person.name;
    const ghost = document.createElement("button");
    ghost.type = "button";
    ghost.textContent = "ghost";
    ghost.title = `Show the object as ${person.name} is shown it at this moment (g)`;
    ghost.addEventListener("click", () => this.ghost(person.seat));
    head.append(swatch, line, ghost);
    const list = document.createElement("dl");
    const values = NUMBERS.map(([title, explanation]) => {
      const row = document.createElement("div");
      row.title = explanation;
      row.hidden = title === HANDLE; // until there is something to tell
      const term = document.createElement("dt");
      const value = document.createElement("dd");
      term.textContent = title;
      row.append(term, value);
      list.append(row);
      return value;
    });
    card.append(head, list);
    this.place.append(card);
    return { person, card, line, ghost, values };
  }

  /** @param {import("./frames.js").Frame} frame */
  show(frame) {
    const bySeat = new Map(frame.people.map((each) => [each.seat, each]));
    for (const [seat, { person, card, line, values }] of this.cards) {
      const state = bySeat.get(seat);
      write(line, state ? stateLine(person.name, state) : `${person.name}: not here`);
      card.dataset.state = state?.state ?? "free";
      card.classList.toggle("alarm", Boolean(state && !state.passive));
      card.classList.toggle("pushes", Boolean(state?.pushes));
      NUMBERS.forEach(([, , value, unit], index) => {
        const text = state && state.state !== "free" ? `${value(state)} ${unit}`.trim() : "–";
        write(values[index], text);
        if (text !== "–") values[index].parentElement.hidden = false;
      });
    }
  }

  /** Show that nothing is known of anybody now. @param {string} why */
  rest(why) {
    for (const { person, card, line, values } of this.cards.values()) {
      write(line, `${person.name}: ${why}`);
      card.dataset.state = "free";
      card.classList.remove("alarm", "pushes");
      for (const value of values) write(value, "–");
    }
  }

  /** @param {number | null} seat whose ghost is shown */
  mark(seat) {
    for (const [each, { ghost }] of this.cards) ghost.setAttribute("aria-pressed", String(each === seat));
  }
}

/** Write a text where it is another one: the browser lays out less. */
export function write(element, text) {
  if (element.textContent !== text) element.textContent = text;
}
