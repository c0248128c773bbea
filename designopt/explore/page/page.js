// The page: what the server sends is shown by the next frame, what a person changes is sent to it.

import { find, html, withUnit } from './elements.js';
import { Inputs } from './inputs.js';
import { Panels } from './panels.js';

const QUIET = 1000; // ms after which readouts are announced
const NEAREST = 8; // requirements that are shown at once; the others unfold

const model = {};
const changed = new Set();
const seqs = { sent: 0, seq: 0, shown: 0 };
const sentAt = new Map(); // when the events happened whose picture has not come yet
let gesture = 0;
let frame = 0;
let measuring = 0; // a picture has been drawn since the last frame
let announcing = 0;

const socket = new WebSocket(`ws://${location.host}/ws`);
const send = (message) => socket.readyState === WebSocket.OPEN && socket.send(JSON.stringify(message));

// Send a change whose picture is waited for; the event's time is what latency is measured from.
const sendChange = (message, event) => {
  seqs.sent += 1;
  sentAt.set(seqs.sent, event ? event.timeStamp : performance.now());
  send({ ...message, seq: seqs.sent, gesture });
  return seqs.sent;
};
const newGesture = () => { gesture += 1; };

const inputs = new Inputs({ send, sendChange, newGesture, seqs, model });
const panels = new Panels(find('panels'), { sendChange, newGesture, model });

const RENDERERS = {
  title: () => {
    document.title = `${model.title} – designopt explore`;
    find('title').textContent = model.title;
  },
  parameters: () => inputs.make(),
  values: () => inputs.show(),
  locked: () => { inputs.show(); panels.showLocks(); },
  panels: () => panels.show(),
  readouts: showReadouts,
  message: () => { find('message').textContent = model.message; },
  note: () => {
    find('note').textContent = model.note;
    find('note').classList.toggle('fault', model.note_is_fault);
  },
  undo: () => {
    find('undo').disabled = !model.undo;
    find('redo').disabled = !model.redo;
  },
  presets: () => showOptions(find('preset'), model.presets.map((name) => [name, name])),
  measures: showMeasures,
  measured: showMeasured,
  requirements: showRequirements,
  judging: () => {
    find('judging').textContent = model.judging ? '– computing' : '';
    showMeasured();
  },
  step: () => { find('step').textContent = model.step; },
  report: () => {
    find('report').replaceChildren(...model.report.map((line) => html('li', {}, line)));
  },
  optimising: () => { find('optimise').textContent = model.optimising ? 'Stop' : 'Optimise'; },
};
const ALSO = {
  bounds: 'values', redo: 'undo', note_is_fault: 'note',
};

socket.addEventListener('message', ({ data }) => {
  const { fields, seqs: received } = JSON.parse(data);
  send({ type: 'ack' });
  Object.assign(seqs, received);
  if (fields.panels) {
    panels.take(fields.panels);
    changed.add('panels');
  }
  delete fields.panels;
  Object.assign(model, fields);
  for (const name of Object.keys(fields)) changed.add(ALSO[name] ?? name);
  // A picture is drawn while the next frame is waited for, unless one was since the last frame.
  if ('shown' in received && !measuring && !document.hidden) render();
  else if (!frame) frame = requestAnimationFrame(render);
});

function render() {
  cancelAnimationFrame(frame);
  frame = 0;
  for (const [name, renderer] of Object.entries(RENDERERS)) {
    if (changed.delete(name)) renderer();
  }
  changed.clear();
  measure();
  clearTimeout(announcing);
  announcing = setTimeout(announce, QUIET);
}

// Note how long a change took from its event until after the frame that shows it.
function measure() {
  const shown = [...sentAt.keys()].filter((seq) => seq <= seqs.shown);
  if (!shown.length) return;
  const start = sentAt.get(shown.at(-1));
  shown.forEach((seq) => sentAt.delete(seq));
  measuring = requestAnimationFrame(() => {
    measuring = 0;
    const { port1, port2 } = new MessageChannel();
    port1.onmessage = () => {
      performance.measure('change to picture', { start, end: performance.now() });
      port1.close();
    };
    port2.postMessage(null);
  });
}

socket.addEventListener('close', ({ reason }) => {
  find('ended-text').textContent = reason
    ? `This page is no longer connected: ${reason}.`
    : 'This page is no longer connected: designopt explore has ended. Start it again to go on.';
  find('ended').showModal();
});

function announce() {
  const readouts = (model.readouts ?? []).map(([name, value, unit]) => `${name} ${withUnit(value, unit)}`);
  const missed = model.requirements.filter((row) => row[3] === false).map((row) => `not met: ${row[0]}`);
  const text = [model.message, ...readouts, ...missed, model.step].filter(Boolean).join('; ');
  if (find('announcer').textContent !== text) find('announcer').textContent = text;
}

function showReadouts() {
  const rows = model.readouts ?? [['numbers', 'computing', '']];
  const body = find('readouts');
  if (body.rows.length !== rows.length || model.readouts === null) {
    body.replaceChildren(...rows.map(() => html('tr', {},
      html('th', { scope: 'row' }), html('td', { class: 'number' }), html('td', { class: 'soft' }))));
  }
  rows.forEach((row, number) => row.forEach((text, column) => {
    const cell = body.rows[number].cells[column];
    if (cell.textContent !== text) cell.textContent = text;
  }));
}

function showRequirements() {
  find('required').hidden = !model.requirements.length;
  find('although').hidden = !model.requirements.some((row) => row[3] === false);
  if (find('although').hidden) find('although-failing').checked = false;
  const met = (one) => (one === null ? '' : one ? '✓ met' : '✗ not met');
  const rows = model.requirements.map(([asked, value, margin, is]) =>
    html('tr', {}, html('th', { scope: 'row' }, asked), html('td', { class: 'number' }, value ?? '–'),
      html('td', { class: 'number' }, margin ?? '–'), html('td', { class: is === false ? 'met fault' : 'met' }, met(is))));
  const missed = model.requirements.filter((row) => row[3] === false).length;
  const first = Math.max(NEAREST, missed);
  find('requirements').replaceChildren(...rows.slice(0, first));
  find('others').replaceChildren(...rows.slice(first));
  find('more').hidden = rows.length <= first;
  find('more-of-them').textContent = `${rows.length - first} more, all met with larger margins`;
}

function showOptions(select, options) {
  const chosen = select.value;
  select.replaceChildren(...options.map(([value, text]) => html('option', { value }, text)));
  if (options.some(([value]) => value === chosen)) select.value = chosen;
}

function showMeasures() {
  find('optimising').hidden = !model.measures.length;
  showOptions(find('measure'), model.measures.map(([name, description, unit, worst]) =>
    [name, `${worst === 'least' ? 'Increase' : 'Decrease'} ${description}${unit ? ` (${unit})` : ''}`]));
}

function showMeasured() {
  const value = model.measured[find('measure').value];
  find('measured').textContent = `Now: ${model.judging ? 'computing' : value ?? '–'}`;
}

find('measure').addEventListener('change', showMeasured);
find('undo').addEventListener('click', () => send({ type: 'undo' }));
find('redo').addEventListener('click', () => send({ type: 'redo' }));
find('apply').addEventListener('click', () => send({ type: 'preset', name: find('preset').value }));
find('presets').addEventListener('submit', (event) => {
  event.preventDefault();
  const name = find('preset-name').value;
  if (name.trim()) send({ type: 'store', name });
  find('preset-name').value = '';
});
find('optimising').addEventListener('submit', (event) => {
  event.preventDefault();
  send(model.optimising ? { type: 'stop' } : { type: 'optimise', measure: find('measure').value });
});
find('saving').addEventListener('submit', (event) => {
  event.preventDefault();
  send({ type: 'save', although_failing: find('although-failing').checked });
});
document.addEventListener('keydown', (event) => {
  if (event.key === 'Escape') find('tip').hidden = true;
  // In a text, these keys undo what was typed.
  if (!(event.ctrlKey || event.metaKey) || event.target.matches('[type=text], [type=number]')) return;
  const key = event.key.toLowerCase();
  const type = { z: event.shiftKey ? 'redo' : 'undo', y: 'redo' }[key];
  if (!type) return;
  event.preventDefault();
  send({ type });
});
