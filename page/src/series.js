// The last seconds of one joint, in columns for curves; bounded; missing ticks are not filled in.

export const WINDOW_S = 20;
const MOST = 4096; // samples: 20 s at 200 Hz

/** Columns that grow at the end and drop the oldest rows. */
export class Series {
  #columns; #length = 0;

  constructor(columns) {
    this.#columns = Array.from({ length: columns }, () => new Float64Array(2 * MOST));
  }

  clear() {
    this.#length = 0;
  }

  /** Add a row. Its first number is the time [s]; if it does not increase, the earlier rows are cleared. */
  add(row) {
    const [times] = this.#columns;
    if (this.#length > 0 && row[0] <= times[this.#length - 1]) this.clear();
    if (this.#length === times.length) this.#shift(this.#length - MOST);
    this.#columns.forEach((column, i) => (column[this.#length] = row[i]));
    this.#length += 1;
  }

  /** Columns of the window that ends at `end_s`; views, valid until the next `add`. */
  window(end_s) {
    const [times] = this.#columns;
    let first = Math.max(this.#length - MOST, 0);
    while (first < this.#length && times[first] < end_s - WINDOW_S) first += 1;
    return this.#columns.map((column) => column.subarray(first, this.#length));
  }

  #shift(by) {
    for (const column of this.#columns) column.copyWithin(0, by, this.#length);
    this.#length -= by;
  }
}
