// A row for every joint and dimension: number, slider, lock, bounds.

import { find, html, numberText, put, withUnit } from './elements.js';

const PAUSE = 800; // ms between keys after which another gesture begins

export class Inputs {
  constructor(link) {
    this.link = link;
    this.rows = [];
    this.lastKey = 0;
    find('show-bounds').addEventListener('click', ({ target }) => {
      const shown = target.getAttribute('aria-expanded') !== 'true';
      target.setAttribute('aria-expanded', shown);
      for (const { limits } of this.rows) limits.hidden = !shown;
    });
  }

  make() {
    for (const { root } of this.rows) root.remove();
    this.rows = this.link.model.parameters.map((one) => this.makeRow(one));
    for (const kind of ['joints', 'dimensions']) find(kind).hidden = !find(kind).querySelector('.row');
  }

  makeRow(one) {
    const { label, unit } = one;
    const named = withUnit(label, unit && `in ${unit}`);
    const field = (name) => html('input', { type: 'number', step: 'any', 'aria-label': name });
    const row = {
      one, held: false, sent: 0,
      slider: html('input', { type: 'range', step: 'any', 'aria-label': label }),
      number: field(named), low: field(`lowest ${named}`), high: field(`highest ${named}`),
      lock: html('input', { type: 'checkbox', 'aria-label': `Lock ${label}` }),
    };
    row.limits = html('div', { class: 'limits' }, 'between', row.low, 'and', row.high);
    row.limits.hidden = find('show-bounds').getAttribute('aria-expanded') !== 'true';
    row.root = html('div', { class: 'row', role: 'group', 'aria-label': label },
      html('span', { class: 'name' }, label), row.number, html('span', { class: 'unit' }, unit),
      html('label', { class: 'lock' }, row.lock, 'lock'), row.slider, row.limits);
    this.listen(row);
    find(one.joint ? 'joints' : 'dimensions').append(row.root);
    return row;
  }

  listen(row) {
    const { one, slider, number, low, high, lock } = row;
    const { send, sendChange, newGesture, model } = this.link;
    const set = (value, event) => {
      row.sent = sendChange({ type: 'set', values: { [one.name]: value } }, event);
      row.shown = null; // it holds what the server does not have yet
    };
    slider.addEventListener('pointerdown', () => { row.held = true; newGesture(); });
    for (const kind of ['pointerup', 'pointercancel', 'blur']) {
      slider.addEventListener(kind, () => { row.held = false; this.showRow(row); });
    }
    slider.addEventListener('keydown', ({ timeStamp }) => {
      if (timeStamp - this.lastKey > PAUSE || this.lastRow !== row) newGesture();
      [this.lastKey, this.lastRow] = [timeStamp, row];
    });
    slider.addEventListener('input', (event) => {
      const value = this.rounded(row, slider.valueAsNumber);
      if (document.activeElement !== number) number.value = numberText(value);
      set(value, event);
    });
    const entered = (field, action) => {
      field.addEventListener('input', () => { field.typed = true; });
      field.addEventListener('change', (event) => {
        field.typed = false;
        newGesture();
        if (Number.isFinite(field.valueAsNumber)) action(event);
        this.showRow(row);
      });
      // What was typed and taken back is no change.
      field.addEventListener('blur', () => { field.typed = false; this.showRow(row); });
    };
    entered(number, (event) => set(number.valueAsNumber, event));
    const bound = () => send({
      type: 'bounds', name: one.name, low: this.entry(low, 0, one), high: this.entry(high, 1, one),
    });
    entered(low, bound);
    entered(high, bound);
    lock.addEventListener('change', () => {
      row.shown = null;
      send({ type: 'lock', name: one.name, locked: lock.checked });
    });
  }

  // What stands in a bound's field, exactly what it was where it was not changed.
  entry(field, side, one) {
    const before = this.link.model.bounds[one.name][side];
    return field.value === numberText(before) ? before : field.valueAsNumber;
  }

  // A slider's value to a thousandth of its range or finer, at the ends exactly these.
  rounded({ slider }, value) {
    const [low, high] = [Number(slider.min), Number(slider.max)];
    if (value <= low || value >= high) return value;
    const step = 10 ** Math.floor(Math.log10((high - low) / 500));
    return Math.min(Math.max(Number((Math.round(value / step) * step).toPrecision(12)), low), high);
  }

  // Rows of which nothing has changed are left alone: most of them, at every move.
  show() {
    for (const row of this.rows) if (row.shown !== this.state(row)) this.showRow(row);
  }

  state({ one: { name } }) {
    const { values, locked, bounds } = this.link.model;
    return [values[name], locked.includes(name), ...bounds[name]].join(' ');
  }

  // A value that this tab has changed since is left alone until the server has it.
  showRow(row) {
    const { one, slider, number, lock, low, high } = row;
    const { model, seqs } = this.link;
    const value = model.values[one.name];
    const locked = model.locked.includes(one.name);
    const write = (field, text) => { if (!field.typed && field.value !== text) field.value = text; };
    const [least, most] = model.bounds[one.name];
    write(low, numberText(least));
    write(high, numberText(most));
    put(slider, 'min', least);
    put(slider, 'max', most);
    lock.checked = locked;
    slider.disabled = number.disabled = locked;
    row.shown = null;
    if (row.sent > seqs.seq) return;
    row.shown = this.state(row);
    write(number, numberText(value));
    if (!row.held) write(slider, String(value));
    put(slider, 'aria-valuetext', withUnit(numberText(value), one.unit));
  }
}
