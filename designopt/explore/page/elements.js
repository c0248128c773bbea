// Making elements. Names reach the page as text alone, never as markup.

const SVG = 'http://www.w3.org/2000/svg';

export const find = (id) => document.getElementById(id);

const make = (element, attributes, content) => {
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  element.append(...content);
  return element;
};

// An HTML element; content is texts and elements.
export const html = (tag, attributes = {}, ...content) =>
  make(document.createElement(tag), attributes, content);

export const svg = (tag, attributes = {}, ...content) =>
  make(document.createElementNS(SVG, tag), attributes, content);

export const button = (text, label, action) => {
  const made = html('button', { type: 'button', 'aria-label': label, title: label }, text);
  made.addEventListener('click', action);
  return made;
};

// Let a group have an element for each item, made once and then only changed: text that is made anew
// is laid out anew.
export function keep(group, items, create, change) {
  while (group.childElementCount > items.length) group.lastChild.remove();
  while (group.childElementCount < items.length) group.append(create());
  items.forEach((item, number) => change(group.children[number], item));
}

// Set an attribute; one that is what it was is not laid out and painted again.
export function put(element, name, value) {
  if (element.getAttribute(name) !== String(value)) element.setAttribute(name, value);
}

// A list below a picture that unfolds; it is filled while it is open, once the picture rests.
export function folded(title, fill) {
  const list = html('dl');
  const root = html('details', { class: 'parts' }, html('summary', {}, title), list);
  const show = () => root.open && list.replaceChildren(
    ...fill().flatMap(([name, value]) => [html('dt', {}, ...[name].flat()), html('dd', {}, value)]));
  let resting = 0;
  const rest = () => { clearTimeout(resting); resting = setTimeout(show, 500); };
  root.addEventListener('toggle', show);
  return { root, rest };
}

// Six significant digits, as the server writes readouts.
export const numberText = (value) => String(Number(value.toPrecision(6)));

export const withUnit = (text, unit) => (unit ? `${text} ${unit}` : text);

// Show a text beside the pointer; an empty one hides what was there.
export function tell(event, text) {
  const tip = find('tip');
  tip.textContent = text;
  tip.hidden = !text;
  tip.style.left = `${Math.max(Math.min(event.clientX + 14, innerWidth - tip.offsetWidth - 8), 4)}px`;
  tip.style.top = `${Math.max(event.clientY - tip.offsetHeight - 10, 4)}px`;
}
