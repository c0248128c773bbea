// The panels of a design: views and charts, each with its buttons.

import { Chart } from './chart.js';
import { button, html } from './elements.js';
import { savePng, saveSvg } from './saving.js';
import { View } from './view.js';

export class Panels {
  constructor(root, link) {
    this.root = root;
    this.link = link;
    this.panels = new Map();
  }

  // Take what has changed; nothing is drawn yet.
  take(changes) {
    const old = this.panels;
    this.panels = new Map(changes.map((change) => {
      let panel = old.get(change.name);
      if (change.kind && panel?.kind !== change.kind) panel = this.make(change);
      panel.take(change);
      return [change.name, panel];
    }));
    const roots = [...this.panels.values()].map(({ root }) => root);
    if (roots.some((one, number) => this.root.children[number] !== one) || roots.length !== this.root.children.length) {
      this.root.replaceChildren(...roots);
    }
  }

  make({ kind, name }) {
    const panel = kind === 'view' ? new View(name, this.link) : new Chart(name);
    panel.kind = kind;
    const file = () => `${this.link.model.title}-${name}`.replace(/[^\p{L}\p{N}.]+/gu, '-').replace(/^[-.]+|[-.]+$/g, '');
    const buttons = html('div', { class: 'buttons', role: 'group', 'aria-label': `Picture ${name}` },
      ...panel.buttons,
      button('SVG', `Download ${name} as SVG`, () => saveSvg(panel, file())),
      button('PNG', `Download ${name} as PNG`, () => savePng(panel, file())));
    panel.root = html('section', { class: `panel ${kind}`, 'aria-label': name },
      html('div', { class: 'head' }, html('h2', {}, name), buttons), panel.stage, ...panel.below);
    panel.size = { width: 0, height: 0 }; // to ask for it lays the page out at once
    new ResizeObserver(([{ contentRect }]) => {
      panel.size = contentRect;
      panel.isStale = true;
      panel.show();
    }).observe(panel.stage);
    return panel;
  }

  show() {
    for (const panel of this.panels.values()) panel.show();
  }

  showLocks() {
    for (const panel of this.panels.values()) panel.showLocks?.();
  }
}
