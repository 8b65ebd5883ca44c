/** Sounds of a study: a tone at each phase, and noise while a trial goes on, which masks what motors are heard doing. */

import { write } from "./people.js";

const MOST_LEVEL = 0.5; // of full scale, of each: both together stay within it
const RAMP_S = 0.02; // in which anything begins and ends: a step would be heard as a click
const NOISE_S = 5; // after which noise repeats
const LOOK_BINS = 2048;

const bounded = (level) => Math.min(Math.max(Number(level) || 0, 0), MOST_LEVEL);

/** Filter of Paul Kellet for noise of -3 dB an octave. @param {Float32Array} samples */
const makePink = (samples) => {
  const poles = [0.99886, 0.99332, 0.969, 0.8665, 0.55, -0.7616];
  const gains = [0.0555179, 0.0750759, 0.153852, 0.3104856, 0.5329522, -0.016898];
  const states = poles.map(() => 0);
  let last = 0;
  for (let at = 0; at < samples.length; at += 1) {
    const white = samples[at];
    let sum = white * 0.5362 + last;
    poles.forEach((pole, each) => {
      states[each] = pole * states[each] + gains[each] * white;
      sum += states[each];
    });
    last = white * 0.115926;
    samples[at] = sum;
  }
};

export class Sounds {
  /** @param {HTMLElement} note says that sound waits for a click; a browser lets no page sound before one */
  constructor(note) {
    this.note = note;
    this.sound = null;
    this.running = false;
    this.tones = null; // phases that had begun when the page was told last; null: it was not told yet
    this.context = null;
    this.noise = null; // {source, gain} while it sounds
    for (const name of ["pointerdown", "keydown"]) document.addEventListener(name, () => this.wake());
  }

  /** @param {{sound: object | null, state: string}} message panel, as docs/view.md has it */
  show(message) {
    this.sound = message.sound;
    this.running = message.state === "running";
    const before = this.tones;
    this.tones = this.sound?.tones ?? null;
    if (this.sound && this.context === null) this.wake();
    if (this.running && before !== null && this.tones > before) this.tone();
    this.follow();
  }

  /** End every sound: the session is over, or nothing is known of it. */
  silence() {
    this.running = false;
    this.tones = null;
    this.follow();
  }

  wake() {
    if (!this.sound) return;
    if (this.context === null) {
      this.context = new AudioContext();
      this.look = this.context.createAnalyser();
      this.look.fftSize = LOOK_BINS;
      this.look.connect(this.context.destination);
      this.context.onstatechange = () => this.follow();
    }
    if (this.context.state === "suspended") this.context.resume().catch(() => {});
    this.follow();
  }

  get sounds() {
    return this.context?.state === "running";
  }

  /** @returns {number[]} what went to the speaker just now, of full scale */
  samples() {
    const samples = new Float32Array(this.look ? LOOK_BINS : 1);
    this.look?.getFloatTimeDomainData(samples);
    return [...samples];
  }

  /** Let noise sound while a trial goes on, and only then. */
  follow() {
    write(this.note, this.sound && !this.sounds ? "Click, or press a key, for sound." : "");
    const wanted = this.running && this.sound && this.sound.noise !== "none" && bounded(this.sound.noise_level) > 0;
    if (wanted && this.sounds && !this.noise) this.noise = this.begin();
    if (!wanted && this.noise) {
      this.fade(this.noise.gain, 0);
      this.noise.source.stop(this.context.currentTime + RAMP_S);
      this.noise = null;
    }
  }

  begin() {
    const buffer = this.context.createBuffer(1, Math.round(NOISE_S * this.context.sampleRate), this.context.sampleRate);
    const samples = buffer.getChannelData(0);
    for (let at = 0; at < samples.length; at += 1) samples[at] = 2 * Math.random() - 1;
    if (this.sound.noise === "pink") makePink(samples);
    const most = samples.reduce((found, each) => Math.max(found, Math.abs(each)), 0);
    for (let at = 0; at < samples.length; at += 1) samples[at] /= most;
    const source = new AudioBufferSourceNode(this.context, { buffer, loop: true });
    const gain = this.gain(source);
    source.start();
    this.fade(gain, bounded(this.sound.noise_level));
    return { source, gain };
  }

  /** Sound the cue of a phase, once. */
  tone() {
    const { tone_hz, tone_s, tone_level } = this.sound;
    if (!this.sounds || !(tone_hz > 0)) return;
    const source = new OscillatorNode(this.context, { frequency: tone_hz });
    const gain = this.gain(source);
    const now = this.context.currentTime;
    const end = now + Math.max(tone_s, 2 * RAMP_S);
    gain.gain.linearRampToValueAtTime(bounded(tone_level), now + RAMP_S);
    gain.gain.setValueAtTime(bounded(tone_level), end - RAMP_S);
    gain.gain.linearRampToValueAtTime(0, end);
    source.start(now);
    source.stop(end);
  }

  /** @param {AudioNode} source @returns {GainNode} silent, on its way to the speaker */
  gain(source) {
    const gain = new GainNode(this.context, { gain: 0 });
    gain.gain.setValueAtTime(0, this.context.currentTime);
    source.connect(gain).connect(this.look);
    source.onended = () => gain.disconnect();
    return gain;
  }

  fade(gain, level) {
    const now = this.context.currentTime;
    gain.gain.cancelScheduledValues(now);
    gain.gain.setValueAtTime(gain.gain.value, now);
    gain.gain.linearRampToValueAtTime(level, now + RAMP_S);
  }
}
