// A picture as a file: what is seen, with its styles written into it.

const STYLES = [
  'fill', 'fill-opacity', 'stroke', 'stroke-width', 'stroke-dasharray', 'stroke-linejoin',
  'paint-order', 'font-family', 'font-size', 'text-anchor',
];

// The text of an SVG file of a panel, as wide as it is on the screen.
export function pictureText(panel) {
  const undo = panel.beginSaving?.();
  const seen = panel.svg;
  const copy = seen.cloneNode(true);
  const [width, height] = [seen.clientWidth, seen.clientHeight];
  const copies = copy.querySelectorAll('*');
  seen.querySelectorAll('*').forEach((one, number) => {
    const style = getComputedStyle(one);
    for (const name of STYLES) copies[number].setAttribute(name, style.getPropertyValue(name));
    copies[number].removeAttribute('class');
  });
  copy.querySelectorAll('[data-unseen]').forEach((one) => one.remove());
  for (const name of [...copy.attributes].map((one) => one.name)) copy.removeAttribute(name);
  const size = { width, height, viewBox: `0 0 ${width} ${height}` };
  for (const [name, value] of Object.entries(size)) copy.setAttribute(name, value);
  const ground = document.createElementNS(copy.namespaceURI, 'rect');
  const color = getComputedStyle(panel.root).backgroundColor;
  for (const [name, value] of Object.entries({ width, height, fill: color })) ground.setAttribute(name, value);
  copy.prepend(ground);
  undo?.();
  return new XMLSerializer().serializeToString(copy);
}

export function saveSvg(panel, name) {
  download(new Blob([pictureText(panel)], { type: 'image/svg+xml' }), `${name}.svg`);
}

export async function savePng(panel, name) {
  const scale = Math.max(devicePixelRatio, 2);
  const url = URL.createObjectURL(new Blob([pictureText(panel)], { type: 'image/svg+xml' }));
  const image = new Image();
  image.src = url;
  await image.decode();
  const canvas = document.createElement('canvas');
  [canvas.width, canvas.height] = [image.width * scale, image.height * scale];
  canvas.getContext('2d').drawImage(image, 0, 0, canvas.width, canvas.height);
  URL.revokeObjectURL(url);
  canvas.toBlob((blob) => download(blob, `${name}.png`), 'image/png');
}

function download(blob, name) {
  const link = document.createElement('a');
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}
