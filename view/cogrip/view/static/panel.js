/** The panel of a study's participant: what to do, and one prompt at a time (docs/view.md). Texts are set as text, never as markup. */

import { write } from "./people.js";

const MOST_BUTTONS = 11; // of a scale; one with more steps is a slider
const MEANWHILE = { waiting: "Please wait ...", running: "", asking: "Please wait ...", paused: "Paused. Please wait ...", over: "" };

/** @param {Event} event @returns {boolean} it belongs to a field of the panel, not to the picture */
export const isAnswering = (event) => Boolean(event.target?.matches?.("#panel textarea, #panel input"));

const make = (name, properties = {}, ...children) => {
  const element = Object.assign(document.createElement(name), properties);
  element.append(...children);
  return element;
};

export class Panel {
  /** @param {HTMLElement} place @param {(number: number, text: string) => boolean} send a reply */
  constructor(place, send) {
    this.place = place;
    this.send = send;
    this.message = null;
    this.form = this.part("prompt");
    this.form.addEventListener("submit", (event) => event.preventDefault());
    document.addEventListener("keydown", (event) => {
      if (event.key !== "Enter" || event.repeat || this.message?.prompt?.kind !== "go") return;
      if (event.target instanceof HTMLButtonElement) return; // the browser presses that button
      event.preventDefault();
      this.reply("");
    });
  }

  part(name) {
    return this.place.querySelector(`[data-part=${name}]`);
  }

  /** @returns {boolean} there is no session to look at now */
  get pauses() {
    return this.message !== null && this.message.state !== "running";
  }

  /** @returns {boolean} nothing more comes */
  get over() {
    return this.message?.state === "over";
  }

  /** @param {object} message panel, as docs/view.md has it */
  show(message) {
    const same = this.message?.prompt && this.message.prompt.number === message.prompt?.number && !this.sent;
    this.message = message;
    this.place.hidden = false;
    this.place.dataset.state = message.state;
    write(this.part("title"), [message.person, message.title].filter(Boolean).join(" – "));
    write(this.part("text"), message.text);
    write(this.part("cue"), message.cue);
    if (!same) this.build(message.prompt);
  }

  /** Reply to the open prompt, once. @param {string} text */
  reply(text) {
    if (this.sent || !this.message?.prompt || !this.send(this.message.prompt.number, text)) return;
    this.sent = true;
    for (const each of this.form.querySelectorAll("button, input, textarea")) each.disabled = true;
  }

  /** @param {object | null} prompt */
  build(prompt) {
    this.sent = false;
    this.form.replaceChildren();
    if (!prompt) {
      this.form.append(make("p", { textContent: MEANWHILE[this.message.state] ?? "", className: "ends" }));
      return;
    }
    const field = make("fieldset", {}, ...(prompt.kind === "go" ? [] : [make("legend", { textContent: prompt.text })]));
    if (prompt.problem) field.append(make("p", { textContent: prompt.problem, className: "problem", role: "alert" }));
    field.append(...this.fields(prompt));
    this.form.append(field);
    if (prompt.kind === "text") this.form.querySelector("textarea").focus({ preventScroll: true });
  }

  fields(prompt) {
    if (prompt.kind === "text") return this.textFields(prompt);
    if (prompt.kind === "go") return [this.row([this.button(prompt.text, "")]), make("p", { textContent: prompt.low, className: "ends" })];
    if (prompt.kind === "choice") return [this.row(prompt.choices.map((each) => this.button(each, each)))];
    const steps = Math.floor((prompt.most - prompt.least) / prompt.step) + 1;
    const ends = make("p", { className: "ends" }, make("span", { textContent: prompt.low || prompt.least }), make("span", { textContent: prompt.high || prompt.most }));
    if (steps > MOST_BUTTONS) return this.sliderFields(prompt, ends);
    const values = Array.from({ length: steps }, (_, index) => String(prompt.least + index * prompt.step));
    return [this.row(values.map((each) => this.button(each, each))), ends];
  }

  textFields(prompt) {
    const text = make("textarea", { maxLength: prompt.most });
    text.setAttribute("aria-label", prompt.text);
    const send = make("button", { type: "button", textContent: "Send" });
    send.onclick = () => this.reply(text.value);
    return [text, this.row([send])];
  }

  /** A slider has no value before it was moved. */
  sliderFields(prompt, ends) {
    const middle = prompt.least + prompt.step * Math.round((prompt.most - prompt.least) / prompt.step / 2);
    const slider = make("input", { type: "range", min: prompt.least, max: prompt.most, step: prompt.step, value: middle });
    slider.setAttribute("aria-label", prompt.text);
    const send = make("button", { type: "button", textContent: "Send", disabled: true });
    const chosen = () => {
      send.disabled = false;
      send.textContent = `Send ${slider.value}`;
    };
    for (const name of ["input", "pointerup", "keyup"]) slider.addEventListener(name, (event) => event.key !== "Tab" && chosen());
    send.onclick = () => this.reply(slider.value);
    return [slider, ends, this.row([send])];
  }

  row(buttons) {
    return make("div", { className: "choices" }, ...buttons);
  }

  button(shown, text) {
    const button = make("button", { type: "button", textContent: shown });
    button.onclick = () => this.reply(text);
    return button;
  }
}
