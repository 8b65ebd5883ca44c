/** Live plots beside the picture: one for each quantity, a line for each person. */

import uPlot from "uplot";
import { QUANTITIES } from "./history.js";
import { fixed } from "./people.js";

const HEIGHT = 108;
const PLOT_PERIOD_MS = 120; // of each plot; they take turns, one in a drawn frame

export class Plots {
  /** @param {HTMLElement} place @param {import("./history.js").History} history */
  constructor(place, history) {
    this.place = place;
    this.history = history;
    this.axis = 0;
    this.plots = [];
    this.turn = 0;
    this.drawn_ms = 0;
    new ResizeObserver(() => this.resize()).observe(place);
  }

  /** @param {object} scene message */
  build(scene) {
    this.scene = scene;
    for (const { plot } of this.plots) plot.destroy();
    this.place.replaceChildren();
    const style = getComputedStyle(document.documentElement);
    const colour = (name) => style.getPropertyValue(name).trim();
    this.plots = QUANTITIES.map((quantity) => this.plot(quantity, colour("--text"), colour("--muted"), colour("--rule")));
    this.title();
    this.all();
  }

  plot(quantity, text, muted, rule) {
    const figure = document.createElement("figure");
    const title = document.createElement("figcaption");
    const drawing = document.createElement("div");
    figure.dataset.quantity = quantity.id;
    figure.append(title, drawing);
    this.place.append(figure);
    const line = (label, stroke, dashed) => ({ label, stroke, width: 1.5, dash: dashed ? [5, 3] : [], points: { show: false }, spanGaps: false });
    const series = [{ label: "time" }];
    if (quantity.object) series.push(line("object", text, true));
    for (const person of this.scene.people) {
      for (const [key, dashed] of quantity.lines) {
        const label = quantity.lines.length > 1 ? `${person.name} ${key}` : person.name;
        series.push(line(label, person.colour, dashed));
      }
    }
    const axis = { stroke: muted, grid: { stroke: rule, width: 1 }, ticks: { show: false }, font: "11px system-ui, sans-serif" };
    const plot = new uPlot(
      {
        width: this.width(), height: HEIGHT, series, legend: { show: false },
        cursor: { y: false, drag: { x: false, y: false }, points: { show: false } },
        scales: { x: { time: false, range: () => [this.history.end_s - this.history.window_s, this.history.end_s] }, y: { range: spread } },
        axes: [{ ...axis, size: 20, gap: 2, space: 60, values: (_, ticks) => ticks.map((each) => `${each} s`) }, { ...axis, size: 44, gap: 3, space: 18 }],
        hooks: { setCursor: [(self) => this.title(quantity, self)] },
      },
      [[], ...series.slice(1).map(() => [])],
      drawing,
    );
    return { quantity, plot, title };
  }

  /** Write what is plotted above each plot, or the values below the mouse. */
  title(only = null, hovered = null) {
    for (const { quantity, title } of this.plots) {
      if (only && only !== quantity) continue;
      const index = hovered?.cursor.idx ?? null;
      const along = quantity.along ? ` ${"xyz"[this.axis]}` : "";
      if (index === null) {
        title.textContent = `${quantity.title}${along} [${quantity.unit}]`;
        const note = document.createElement("small");
        note.textContent = quantity.note;
        title.append(note);
        continue;
      }
      const values = hovered.series.slice(1).map((each, at) => [each.label, hovered.data[at + 1][index]]);
      const text = values.filter(([, value]) => value !== null).map(([label, value]) => `${label} ${fixed(value, 2)}`);
      title.textContent = `${hovered.data[0][index].toFixed(2)} s: ${text.join(", ")} ${quantity.unit}`;
    }
  }

  width() {
    const columns = getComputedStyle(this.place).gridTemplateColumns.split(" ");
    return Math.max(120, Math.floor(Number.parseFloat(columns[0]) || this.place.clientWidth));
  }

  resize() {
    for (const { plot } of this.plots) plot.setSize({ width: this.width(), height: HEIGHT });
  }

  /** @param {number} axis 0 to 2 */
  showAxis(axis) {
    this.axis = axis;
    this.title();
    this.all();
  }

  all() {
    for (const { quantity, plot } of this.plots) plot.setData(this.history.columns(quantity, this.axis));
  }

  /** Draw the plot whose turn it is. @param {number} now_ms */
  next(now_ms) {
    if (this.plots.length === 0 || now_ms - this.drawn_ms < PLOT_PERIOD_MS / this.plots.length) return;
    this.drawn_ms = now_ms;
    this.turn = (this.turn + 1) % this.plots.length;
    const { quantity, plot } = this.plots[this.turn];
    plot.setData(this.history.columns(quantity, this.axis));
  }
}

/** Leave room around the values, also where all are one value; none below 0 where no value is. */
export function spread(_, least, most) {
  if (least === null || most === null) return [0, 1];
  const room = Math.max(0.08 * (most - least), 0.02 * Math.abs(most), 0.05);
  return [least >= 0 ? Math.max(0, least - room) : least - room, most + room];
}
