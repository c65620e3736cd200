/** The common time of all flights. */

export const SPEEDS = [1, 2, 5, 10, 20, 60];
const USUAL_SPEED = 10;

/**
 * Tells `change` whenever the time moves, and `state` when it begins or stops to play, or gets
 * another speed. While it plays the time lies between slots; else it is a whole slot.
 */
export class Player extends EventTarget {
  /**
   * @param {number} slots
   * @param {number} slotS
   * @param {() => boolean} isCalm whether people want no movement: then it goes slot by slot
   */
  constructor(slots, slotS, isCalm) {
    super();
    this.slots = slots;
    this.slotS = slotS;
    this.isPlaying = false;
    this.speed = USUAL_SPEED;
    this.time = 0;
    this.isCalm = isCalm;
    this.last = null;
  }

  /** The slot that numbers are shown of. */
  get slot() {
    return Math.floor(this.time);
  }

  /** The time that pictures are shown of. */
  get shownTime() {
    return this.isCalm() ? this.slot : this.time;
  }

  /** @param {number} slot where to go; it is brought into the flight */
  seek(slot) {
    this.time = Math.min(Math.max(Math.round(slot), 0), this.slots);
    this.last = null;
    this.dispatchEvent(new Event("change"));
  }

  /** @param {number} slots how far to go; it pauses */
  step(slots) {
    this.pause();
    this.seek(this.slot + slots);
  }

  play() {
    if (this.isPlaying) return;
    if (this.time >= this.slots) this.seek(0);
    this.isPlaying = true;
    this.last = null;
    this.dispatchEvent(new Event("state"));
    requestAnimationFrame((now) => this.advance(now));
  }

  pause() {
    if (!this.isPlaying) return;
    this.isPlaying = false;
    this.seek(this.slot);
    this.dispatchEvent(new Event("state"));
  }

  toggle() {
    if (this.isPlaying) this.pause();
    else this.play();
  }

  /** @param {number} speed seconds of the flight in a second */
  setSpeed(speed) {
    this.speed = speed;
    this.dispatchEvent(new Event("state"));
  }

  /** @param {number} direction 1 for faster, -1 for slower */
  changeSpeed(direction) {
    const place = SPEEDS.indexOf(this.speed) + direction;
    if (SPEEDS[place]) this.setSpeed(SPEEDS[place]);
  }

  advance(now) {
    if (!this.isPlaying) return;
    // A tab that was hidden goes on where it was.
    const seconds = this.last === null ? 0 : Math.min((now - this.last) / 1000, 0.25);
    this.last = now;
    this.time = Math.min(this.time + (seconds * this.speed) / this.slotS, this.slots);
    this.dispatchEvent(new Event("change"));
    if (this.time >= this.slots) this.pause();
    else requestAnimationFrame((next) => this.advance(next));
  }
}
