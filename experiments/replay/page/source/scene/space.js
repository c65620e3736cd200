/** East, north and up in metres, as three.js has them: x, -z and y, around the area's middle. */
export class Space {
  /** @param {object} replay */
  constructor(replay) {
    [this.eastM, this.northM] = replay.areaM;
    this.sizeM = Math.max(this.eastM, this.northM);
    /** How many times as high as they are altitudes are drawn. */
    this.heights = 1;
  }

  /**
   * @param {import("three").Vector3} point is set, and given back
   * @param {number} eastM
   * @param {number} northM
   * @param {number} upM
   * @returns {import("three").Vector3}
   */
  put(point, eastM, northM, upM) {
    return point.set(eastM - this.eastM / 2, upM * this.heights, this.northM / 2 - northM);
  }

  /** The same into an array of coordinates, from a place on. */
  write(array, place, eastM, northM, upM) {
    array[place] = eastM - this.eastM / 2;
    array[place + 1] = upM * this.heights;
    array[place + 2] = this.northM / 2 - northM;
  }
}
