// Curves over one axis, with ticks, units, and a legend above them.

import { find, folded, html, numberText, svg, tell } from './elements.js';

const KINDS = 6; // of curves that can be told apart by their dashes
const BELOW = 44; // pixels for numbers and name of the x axis
const LINE = 20; // pixels between lines of the legend
const LETTER = 7; // pixels, about, of a letter
let made = 0;

export class Chart {
  constructor(name) {
    this.name = name;
    this.svg = svg('svg', { role: 'img', 'aria-label': `Chart of ${name}` });
    this.stage = html('div', { class: 'stage' }, this.svg);
    this.buttons = [];
    this.values = folded('Its values', () => this.listValues());
    this.below = [this.values.root];
    this.clip = `clip${made += 1}`;
    this.stage.addEventListener('pointermove', (event) => this.hover(event));
    this.stage.addEventListener('pointerleave', () => { find('tip').hidden = true; });
  }

  take(change) {
    for (const key of ['x_label', 'y_label', 'series', 'y_range']) {
      if (!(key in change)) continue;
      this[key] = change[key];
      this.isStale = true;
    }
    if (!('at' in change)) return;
    this.at = change.at;
    this.isMoved = true;
  }

  show() {
    if (this.isStale) this.build();
    else if (this.isMoved) this.mark();
  }

  build() {
    const { width, height } = this.size;
    if (!width) return;
    this.isStale = false;
    const legend = this.legend(width);
    const [xs, ys] = [1, 2].map((axis) => this.series.flatMap((one) => one[axis]).filter((one) => one !== null));
    const [left, right] = rangeOf(xs, 0);
    const [low, high] = this.y_range ?? rangeOf(ys, 0.05);
    const top = legend.height + 12;
    const rows = ticks(low, high, Math.max((height - top - BELOW) / 45, 2));
    const margin = 34 + LETTER * Math.max(...rows.map((one) => numberText(one).length));
    this.frame = { left, right, margin, width: width - margin - 14, bottom: height - BELOW };
    const x = (value) => margin + ((value - left) / (right - left)) * this.frame.width;
    const y = (value) => height - BELOW - ((value - low) / (high - low)) * (height - BELOW - top);
    const columns = ticks(left, right, Math.max(this.frame.width / 75, 2));
    const text = (content, attributes) => svg('text', attributes, content);
    const inside = svg('g', { 'clip-path': `url(#${this.clip})` });
    this.series.forEach(([, across, up], number) => {
      let pen = 'M';
      const d = across.map((one, index) => {
        if (one === null || up[index] === null) { pen = 'M'; return ''; }
        const point = `${pen}${x(one).toFixed(2)} ${y(up[index]).toFixed(2)}`;
        pen = 'L';
        return point;
      }).join('');
      inside.append(svg('path', { class: `curve s${number % KINDS}`, d }));
    });
    this.now = svg('g');
    inside.append(this.now);
    Object.assign(this.frame, { x, y, top });
    this.mark();
    const [middle, floor] = [margin + this.frame.width / 2, height - BELOW];
    this.svg.replaceChildren(
      svg('clipPath', { id: this.clip }, svg('rect', { x: margin - 3, y: top - 3, width: this.frame.width + 6, height: floor - top + 6 })),
      ...columns.flatMap((one) => [
        svg('path', { class: 'grid', d: `M${x(one)} ${top}V${floor}` }),
        text(tickText(one), { class: 'tick', x: x(one), y: floor + 17, 'text-anchor': 'middle' })]),
      ...rows.flatMap((one) => [
        svg('path', { class: 'grid', d: `M${margin} ${y(one)}h${this.frame.width}` }),
        text(tickText(one), { class: 'tick', x: margin - 7, y: y(one) + 4, 'text-anchor': 'end' })]),
      svg('path', { class: 'axis', d: `M${margin} ${top}V${floor}h${this.frame.width}` }),
      text(this.x_label, { x: middle, y: height - 6, 'text-anchor': 'middle' }),
      text(this.y_label, { transform: `translate(13 ${(top + floor) / 2}) rotate(-90)`, 'text-anchor': 'middle' }),
      inside, ...legend.elements);
  }

  // Where the design stands now on all curves.
  mark() {
    this.isMoved = false;
    this.values.rest();
    const { x, y, top, bottom } = this.frame;
    const dots = this.series.map((one) => valueAt(one, this.at)).filter((value) => value !== null);
    this.now.replaceChildren(...this.at === null ? [] : [
      svg('path', { class: 'now', d: `M${x(this.at)} ${top}V${bottom}` }),
      ...dots.map((value) => svg('circle', { class: 'dot', cx: x(this.at), cy: y(value), r: 4.5 }))]);
  }

  // What every curve is now, and between what it lies over all.
  listValues() {
    const here = this.at === null ? [] : [[this.x_label, `now ${short(this.at)}`]];
    return [...here, ...this.series.map((one) => {
      const now = this.at === null ? null : valueAt(one, this.at);
      const known = one[2].filter((value) => value !== null);
      const over = known.length ? `${short(Math.min(...known))} to ${short(Math.max(...known))}` : 'nowhere';
      return [one[0], now === null ? over : `now ${short(now)}, ${over}`];
    })];
  }

  // Names of the curves in lines above them.
  legend(width) {
    if (this.series.length < 2) return { height: 0, elements: [] };
    let [x, y] = [10, 14];
    const elements = this.series.flatMap(([name], number) => {
      const needed = 46 + LETTER * name.length;
      if (x > 10 && x + needed > width) [x, y] = [10, y + LINE];
      const line = svg('path', { class: `curve s${number % KINDS}`, d: `M${x} ${y - 4}h28` });
      const label = svg('text', { x: x + 34, y }, name);
      x += needed;
      return [line, label];
    });
    return { height: y + 6, elements };
  }

  // The curves' values under the pointer.
  hover(event) {
    if (!this.frame) return;
    const { left, right, margin, width } = this.frame;
    const box = this.stage.getBoundingClientRect();
    const at = left + ((event.clientX - box.left - margin) / width) * (right - left);
    const lines = this.series.map((one) => [one[0], valueAt(one, at)])
      .filter(([, value]) => value !== null).map(([name, value]) => `${name}: ${short(value)}`);
    const inside = lines.length && at >= left && at <= right;
    tell(event, inside ? [`${this.x_label}: ${short(at)}`, ...lines].join('\n') : '');
  }
}

const short = (value) => String(Number(value.toPrecision(4))).replace('-', '−');
const tickText = (value) => numberText(value).replace('-', '−');

function rangeOf(values, room) {
  if (!values.length) return [0, 1];
  const low = values.reduce((a, b) => Math.min(a, b));
  const high = values.reduce((a, b) => Math.max(a, b));
  const more = room * (high - low) || (high > low ? 0 : Math.max(Math.abs(low) * 0.1, 1e-9));
  return [low - more, high + more];
}

// Round numbers from low to high, about so many.
export function ticks(low, high, count) {
  const rough = (high - low) / count;
  const decade = 10 ** Math.floor(Math.log10(rough));
  const step = decade * [1, 2, 5, 10].find((one) => one * decade >= rough * (1 - 1e-9));
  const found = [];
  for (let n = Math.ceil(low / step - 1e-9); n * step <= high + 1e-9 * step; n += 1) {
    found.push(Number((n * step).toPrecision(12)));
  }
  return found;
}

// A curve's value at a place on the x axis, between its points; null where it has none.
function valueAt([, across, up], at) {
  for (let n = 1; n < across.length; n += 1) {
    const [a, b] = [across[n - 1], across[n]];
    if (a === null || b === null || up[n - 1] === null || up[n] === null || a === b) continue;
    const part = (at - a) / (b - a);
    if (part >= 0 && part <= 1) return up[n - 1] + part * (up[n] - up[n - 1]);
  }
  return null;
}
