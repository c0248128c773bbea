// A drawing to scale: shapes as SVG, or on a canvas where there are many; pan, zoom, hover, drag.

import { button, find, folded, html, keep, numberText, put, svg, tell } from './elements.js';

const MOST_ELEMENTS = 2000; // shapes; more are drawn on a canvas
const PAPER = 5.5; // pixels of the screen for a millimetre of line width on paper
const ROOM = 26; // pixels around what is fitted
const NEAR = 7; // pixels from a line at which it is hovered
const STEP = 1.25;
const [SMALLEST, LARGEST] = [1e-3, 1e6]; // pixels for a millimetre, unless what is fitted needs others
const FARTHEST = 1e9; // mm, the most that a message may hold
const WIDTH_OF_LETTER = 7.5; // pixels, of labels
const NO_ROOM = 2; // labels or pins that a label would cover
const AROUND = [
  [9, -9], [-9, -9], [9, 17], [-9, 17], [13, 4], [-13, 4], [0, -13], [0, 22], [9, -24], [-9, -24], [9, 32], [-9, 32],
];

const within = (least, value, most) => Math.min(Math.max(value, least), most);

export class View {
  constructor(name, link) {
    this.name = name;
    this.link = link;
    this.world = svg('g');
    this.texts = svg('g');
    this.grips = svg('g');
    this.svg = svg('svg', { role: 'img', 'aria-label': `Drawing of ${name}` }, this.world, this.texts, this.grips);
    this.stage = html('div', {
      class: 'stage', tabindex: 0, role: 'group',
      'aria-label': `${name}: plus and minus zoom, arrows move, 0 fits`,
    }, this.svg);
    this.buttons = [
      button('−', `Zoom out of ${name}`, () => this.zoom(1 / STEP)),
      button('+', `Zoom in on ${name}`, () => this.zoom(STEP)),
      button('Fit', `Fit ${name}`, () => this.fit()),
    ];
    this.parts = folded('Parts and their numbers', () => this.listParts());
    this.below = [this.parts.root];
    this.pointers = new Map();
    this.dirty = new Set();
    this.fitted = true;
    this.hit = document.createElement('canvas').getContext('2d');
    this.listen();
  }

  // Take what has changed of the drawing.
  take(change) {
    for (const [index, shape] of change.changed ?? []) {
      const [before, now] = [this.shapes[index], this.parsed(shape)];
      if (before.layer !== now.layer || !before.circle !== !now.circle) this.isNew = true;
      this.shapes[index] = now;
      this.dirty.add(index);
    }
    for (const key of ['box', 'layers', 'labels', 'handles', 'notes']) {
      if (key in change) this[key] = change[key];
    }
    if (change.shapes) this.shapes = change.shapes.map((shape) => this.parsed(shape));
    if (change.shapes || change.layers) this.isNew = true;
    if (Object.keys(change).some((key) => key !== 'name' && key !== 'notes')) this.isStale = true;
    this.parts.rest();
  }

  parsed([layer, name, ...rest]) {
    return rest.length === 1 ? { layer, name, d: rest[0] } : { layer, name, circle: rest };
  }

  show() {
    if (!this.isStale || !this.size.width) return;
    this.isStale = false;
    if (this.isNew) this.build();
    else if (!this.canvas) for (const index of this.dirty) this.place(index);
    this.dirty.clear();
    if (this.fitted && !this.grabbed) this.follow();
    this.draw();
  }

  // Make a group for every layer and an element for every shape.
  build() {
    this.isNew = false;
    if (this.shapes.length > MOST_ELEMENTS !== Boolean(this.canvas)) {
      this.canvas?.remove();
      this.canvas = this.canvas ? null : html('canvas');
      if (this.canvas) this.stage.prepend(this.canvas);
    }
    this.groups = this.layers.map(([, , color, , , fill]) => svg('g', {
      stroke: color, 'stroke-linejoin': 'round', fill: fill ? color : 'none', 'fill-opacity': fill || 1,
    }));
    this.world.replaceChildren(...this.groups);
    this.styled = null;
    if (!this.canvas) this.fill();
  }

  fill() {
    this.elements = this.shapes.map(({ layer, circle }, index) => {
      const element = svg(circle ? 'circle' : 'path');
      this.groups[layer].append(element);
      this.elements[index] = element;
      return element;
    });
    this.shapes.forEach((_, index) => this.place(index));
  }

  elements = [];

  place(index) {
    const { d, circle } = this.shapes[index];
    const element = this.elements[index];
    if (!circle) element.setAttribute('d', d);
    else ['cx', 'cy', 'r'].forEach((name, number) => element.setAttribute(name, circle[number]));
  }

  // Fit what has been seen so far when something leaves the stage: else the picture rests.
  follow() {
    if (!this.box) return;
    const [left, top, right, bottom] = this.box;
    const { width, height } = this.size;
    if (this.seen && this.fittedTo === width * 1e5 + height) {
      const [[x, y], [xEnd, yEnd]] = [this.onScreen(left, top), this.onScreen(right, bottom)];
      if (x >= 0 && y >= 0 && xEnd <= width && yEnd <= height) return;
    }
    this.fittedTo = width * 1e5 + height;
    const seen = this.seen ?? this.box;
    this.seen = [
      Math.min(seen[0], left), Math.min(seen[1], top), Math.max(seen[2], right), Math.max(seen[3], bottom),
    ];
    const [across, down] = [this.seen[2] - this.seen[0], this.seen[3] - this.seen[1]];
    this.scale = Math.min((width - 2 * ROOM) / (across || 1), (height - 2 * ROOM) / (down || 1));
    this.x = (width - this.scale * (this.seen[0] + this.seen[2])) / 2;
    this.y = (height - this.scale * (this.seen[1] + this.seen[3])) / 2;
  }

  fit() {
    this.fitted = true;
    this.seen = null;
    this.refresh();
  }

  zoom(factor, x = this.size.width / 2, y = this.size.height / 2) {
    if (this.scale === undefined) return;
    this.fitted = false;
    const scale = within(SMALLEST, this.scale * factor, LARGEST);
    this.x = x - (scale / this.scale) * (x - this.x);
    this.y = y - (scale / this.scale) * (y - this.y);
    this.scale = scale;
    this.refresh();
  }

  pan(x, y) {
    if (this.scale === undefined) return;
    this.fitted = false;
    this.x += x;
    this.y += y;
    this.refresh();
  }

  refresh() {
    this.isStale = true;
    this.show();
  }

  draw() {
    const { scale, x, y } = this;
    if (scale === undefined) return;
    this.world.setAttribute('transform', `matrix(${scale} 0 0 ${scale} ${x} ${y})`);
    if (this.styled !== scale) this.layers.forEach(([, , , width, dashed], number) => {
      const group = this.groups[number];
      group.setAttribute('stroke-width', (PAPER * width) / scale);
      if (dashed) group.setAttribute('stroke-dasharray', `${7 / scale} ${4 / scale}`);
    });
    this.styled = scale;
    if (this.canvas) this.paint();
    keep(this.texts, this.placedLabels(), () => svg('text', { class: 'label' }), (element, [text, across, down]) => {
      if (element.textContent !== text) element.textContent = text;
      put(element, 'transform', `translate(${across} ${down})`);
    });
    keep(this.grips, this.handles, makeHandle, (element, handle) => this.placeHandle(element, handle));
  }

  // The same on a canvas.
  paint() {
    const { scale, canvas, size: { width, height } } = this;
    [canvas.width, canvas.height] = [width * devicePixelRatio, height * devicePixelRatio];
    const context = canvas.getContext('2d');
    context.setTransform(
      scale * devicePixelRatio, 0, 0, scale * devicePixelRatio, this.x * devicePixelRatio, this.y * devicePixelRatio);
    context.lineJoin = 'round';
    this.layers.forEach(([, , color, lineWidth, dashed, fill], layer) => {
      context.strokeStyle = context.fillStyle = color;
      context.lineWidth = (PAPER * lineWidth) / scale;
      context.setLineDash(dashed ? [7 / scale, 4 / scale] : []);
      for (const shape of this.shapes) {
        if (shape.layer !== layer) continue;
        context.globalAlpha = fill;
        if (fill) context.fill(pathOf(shape));
        context.globalAlpha = 1;
        context.stroke(pathOf(shape));
      }
    });
  }

  // While a picture is saved its shapes are elements.
  beginSaving() {
    if (!this.canvas) return null;
    this.fill();
    return () => this.groups.forEach((group) => group.replaceChildren());
  }

  onScreen(x, y) {
    return [this.x + this.scale * x, this.y + this.scale * y];
  }

  inWorld(x, y) {
    return [(x - this.x) / this.scale, (y - this.y) / this.scale];
  }

  // Labels beside their places, each where it lies on no earlier one and on no pin. Where there is
  // no room for one it is left out until the picture is enlarged; hovering names every part.
  placedLabels() {
    const taken = this.labels.map(([, , x, y]) => {
      const [across, down] = this.onScreen(x, y);
      return [across - 5, down - 5, across + 5, down + 5];
    });
    return this.labels.flatMap(([text, , x, y]) => {
      const [across, down] = this.onScreen(x, y);
      const width = WIDTH_OF_LETTER * text.length;
      const boxes = AROUND.map(([right, low]) => {
        const left = across + right - (right < 0 ? width : right ? 0 : width / 2);
        return [left, down + low - 11, left + width, down + low + 2];
      });
      const faults = boxes.map((box) => (box[0] < 0 || box[2] > this.size.width ? 3 : 0) + taken.filter(
        (one) => box[0] < one[2] && one[0] < box[2] && box[1] < one[3] && one[1] < box[3]).length);
      const fewest = Math.min(...faults);
      if (fewest >= NO_ROOM) return [];
      const box = boxes[faults.indexOf(fewest)];
      taken.push(box);
      return [[text, box[0], box[3] - 2]];
    });
  }

  lockedOf(parameters) {
    return parameters.filter((name) => this.link.model.locked.includes(name));
  }

  placeHandle(element, [name, x, y, parameters]) {
    const [dot, grip] = element.children;
    grip.handle = { name, parameters };
    const lock = this.lockedOf(parameters).length ? ' locked' : '';
    put(dot, 'class', `handle${lock}`);
    put(grip, 'class', `grip${lock}`);
    put(element, 'transform', `translate(${this.onScreen(x, y).join(' ')})`);
  }

  showLocks() {
    if (this.handles.length) this.refresh();
  }

  listen() {
    const { stage } = this;
    const at = (event) => {
      const box = stage.getBoundingClientRect();
      return [event.clientX - box.left, event.clientY - box.top];
    };
    stage.addEventListener('wheel', (event) => {
      event.preventDefault();
      this.zoom(STEP ** (-event.deltaY / 100), ...at(event));
    }, { passive: false });
    stage.addEventListener('pointerdown', (event) => {
      stage.setPointerCapture(event.pointerId);
      this.pointers.set(event.pointerId, at(event));
      const grabbed = event.target.handle;
      if (this.pointers.size > 1) this.grabbed = null; // two fingers zoom, whatever the first is on
      else if (grabbed) {
        const locked = this.lockedOf(grabbed.parameters);
        if (locked.length) tell(event, `${grabbed.name} stays where it is: ${this.labelsOf(locked)} locked`);
        else this.grabbed = grabbed.name;
        this.held = true;
        this.link.newGesture();
      }
      stage.classList.toggle('panning', !grabbed);
    });
    stage.addEventListener('pointermove', (event) => {
      const before = this.pointers.get(event.pointerId);
      if (!before) { this.hover(event, ...at(event)); return; }
      const now = at(event);
      this.pointers.set(event.pointerId, now);
      if (this.grabbed) {
        const [x, y] = this.inWorld(...now).map((one) => within(-FARTHEST, one, FARTHEST));
        this.link.sendChange({ type: 'drag', handle: this.grabbed, x, y: -y }, event);
      } else if (this.pointers.size === 2) {
        this.pinch(event.pointerId, before, now);
      } else if (!this.held) this.pan(now[0] - before[0], now[1] - before[1]);
    });
    for (const kind of ['pointerup', 'pointercancel']) {
      stage.addEventListener(kind, (event) => {
        this.pointers.delete(event.pointerId);
        this.grabbed = null;
        this.held = false;
        stage.classList.remove('panning');
      });
    }
    stage.addEventListener('pointerleave', () => { find('tip').hidden = true; });
    stage.addEventListener('keydown', (event) => {
      const action = {
        '+': () => this.zoom(STEP), '=': () => this.zoom(STEP), '-': () => this.zoom(1 / STEP), 0: () => this.fit(),
        ArrowLeft: () => this.pan(40, 0), ArrowRight: () => this.pan(-40, 0),
        ArrowUp: () => this.pan(0, 40), ArrowDown: () => this.pan(0, -40),
      }[event.key];
      if (!action || event.ctrlKey || event.metaKey || event.altKey) return;
      event.preventDefault();
      action();
    });
  }

  // Two fingers: what lies between them stays there.
  pinch(moved, before, now) {
    const [other] = [...this.pointers].filter(([id]) => id !== moved).map(([, place]) => place);
    const length = (place) => Math.max(Math.hypot(place[0] - other[0], place[1] - other[1]), 1);
    this.zoom(length(now) / length(before), ...other);
  }

  labelsOf(names) {
    const found = this.link.model.parameters.filter((one) => names.includes(one.name));
    return `${found.map(({ label }) => label).join(' and ')} ${found.length > 1 ? 'are' : 'is'}`;
  }

  // Name the part under the pointer, with its numbers.
  hover(event, x, y) {
    if (this.scale === undefined || event.target.closest('details')) return;
    const grip = event.target.handle;
    if (grip) {
      const locked = this.lockedOf(grip.parameters);
      tell(event, locked.length ? `${grip.name} stays where it is: ${this.labelsOf(locked)} locked` : `drag ${grip.name}`);
      return;
    }
    const place = this.inWorld(x, y);
    this.hit.lineWidth = (2 * NEAR) / this.scale;
    const backwards = [...this.shapes].reverse();
    const shape = backwards.find((one) => one.circle && this.hit.isPointInPath(pathOf(one), ...place))
      ?? backwards.find((one) => this.hit.isPointInStroke(pathOf(one), ...place))
      ?? backwards.find((one) => one.d?.endsWith('Z') && this.hit.isPointInPath(pathOf(one), ...place));
    tell(event, shape ? this.words(shape) : '');
  }

  // A part's name, its numbers and, of a line, its length.
  words({ layer, name, d }) {
    const [title] = this.layers[layer];
    const note = this.notes[name] ?? this.notes[title];
    const length = d && !d.endsWith('Z') ? `${numberText(svg('path', { d }).getTotalLength())} mm long` : '';
    return [name || title, note, length].filter(Boolean).join('\n');
  }

  listParts() {
    const names = new Map(this.layers.map(([name]) => [name, this.notes[name] ?? '']));
    for (const [name, note] of Object.entries(this.notes)) names.set(name, note);
    return [...names].map(([name, note]) => {
      const layer = this.layers.find(([title]) => title === name);
      const sample = svg('svg', { width: 26, height: 12, 'aria-hidden': true });
      if (layer) {
        const [, , stroke, width, dashed] = layer;
        sample.append(svg('path', {
          d: 'M1 6H25', stroke, 'stroke-width': PAPER * width, ...(dashed ? { 'stroke-dasharray': '7 4' } : {}),
        }));
      }
      return [[...(layer ? [sample, ' '] : []), name], note || '–'];
    });
  }
}

// A dot, and around it what is easily hit.
function makeHandle() {
  return svg('g', {}, svg('circle', { r: 6 }), svg('circle', { r: 14, 'data-unseen': '' }));
}

function pathOf(shape) {
  if (!shape.path) {
    shape.path = new Path2D(shape.d);
    if (shape.circle) shape.path.arc(...shape.circle, 0, 2 * Math.PI);
  }
  return shape.path;
}
