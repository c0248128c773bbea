// The page of `designopt explore`, around Matplotlib's own script for a live canvas.
'use strict';

const socket = new WebSocket(`${location.protocol === 'https:' ? 'wss' : 'ws'}://${location.host}/ws`);
mpl.toolbar_items = [];
const figure = new mpl.figure('1', socket, () => {}, document.getElementById('figure'));
const message = document.getElementById('message');
const rows = document.querySelector('#readings tbody');

// A picture holds no more than the squares that have changed since the one before: none may be left
// out or drawn out of turn, and the server sends the next one when this one is drawn.
const takeMessage = socket.onmessage;
let squares = {};
let pictures = Promise.resolve();
figure.handle_squares = (_, news) => {
  squares = news;
};
socket.onmessage = (event) => {
  if (!(event.data instanceof Blob)) {
    takeMessage(event);
    return;
  }
  const { side, across, places, size } = squares;
  pictures = pictures.then(async () => {
    const bitmap = await createImageBitmap(event.data);
    const { canvas } = figure;
    if (canvas.width !== size[0] || canvas.height !== size[1]) {
      [canvas.width, canvas.height] = size; // what it fills of the page stays the same
    }
    places.forEach(([left, top], i) => {
      const from = [(i % across) * side, Math.floor(i / across) * side, side, side];
      figure.context.drawImage(bitmap, ...from, left, top, side, side);
    });
    bitmap.close();
    figure.waiting = false;
    figure.updated_canvas_event();
  });
};

socket.onclose = () => {
  message.textContent = 'The connection was lost: reload this page, or start designopt explore again.';
};

// A slider follows the mouse beyond the canvas, until the button is let go.
figure.canvas_div.addEventListener('pointerdown', (event) => {
  figure.canvas_div.setPointerCapture(event.pointerId);
});

const send = figure.send_message;
figure.send_message = (...content) => {
  if (socket.readyState === WebSocket.OPEN) {
    send.apply(figure, content);
  }
};

function cell(kind, name) {
  const element = document.createElement(kind);
  element.className = name;
  return element;
}

function setText(element, text) {
  if (element.textContent !== text) {
    element.textContent = text;
  }
}

figure.handle_readings = (_, news) => {
  while (rows.children.length > news.rows.length) {
    rows.lastElementChild.remove();
  }
  while (rows.children.length < news.rows.length) {
    const row = document.createElement('tr');
    const name = cell('th', 'name');
    name.scope = 'row';
    row.append(name, cell('td', 'number'), cell('td', 'unit'));
    rows.append(row);
  }
  news.rows.forEach((texts, i) => {
    texts.forEach((text, j) => setText(rows.children[i].children[j], text));
  });
  setText(message, news.message);
};
