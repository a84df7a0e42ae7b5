/* Two sounds, made here: a photo was taken, the camera is good. A browser lets a page sound only after a click. */

const TAKEN = [[880, 0, 0.09], [1320, 0.08, 0.16]]; // Hz, from and for how long in s
const GOOD = [[523, 0, 0.2], [659, 0.15, 0.2], [784, 0.3, 0.2], [1047, 0.45, 0.5]];
const WRONG = [[220, 0, 0.25]];
const TUNES = { taken: TAKEN, good: GOOD, wrong: WRONG };

export class Sound {
  constructor() {
    this.isOn = false;
    this.context = null;
  }

  /** Called by a click or a key. */
  toggle() {
    this.isOn = !this.isOn;
    if (this.isOn) {
      this.context ??= new AudioContext();
      this.context.resume();
      this.play("taken");
    }
  }

  play(tune) {
    if (!this.isOn) return;
    const start = this.context.currentTime + 0.02;
    for (const [pitch, from, length] of TUNES[tune]) {
      const tone = this.context.createOscillator();
      const gain = this.context.createGain();
      tone.frequency.value = pitch;
      gain.gain.setValueAtTime(0.0001, start + from);
      gain.gain.exponentialRampToValueAtTime(0.3, start + from + 0.01);
      gain.gain.exponentialRampToValueAtTime(0.0001, start + from + length);
      tone.connect(gain).connect(this.context.destination);
      tone.start(start + from);
      tone.stop(start + from + length + 0.02);
    }
  }
}
