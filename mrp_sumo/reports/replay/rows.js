/* Lists. */
import { make } from "./elements.js";

/* A list of any length: only the rows in sight exist. Rows that stay in sight stay the same elements, or clicks would get lost. */
export class Rows {
  constructor(render, refresh = () => {}) {
    this.render = render; // (item, index) -> element
    this.refresh = refresh; // (element, item, index)
    this.inner = make("div");
    this.element = make("div", { className: "rows" }, this.inner);
    this.element.addEventListener("scroll", () => this.draw());
    this.items = [];
    this.shown = new Map();
  }

  set(items) {
    this.items = items;
    this.shown.clear();
    this.inner.replaceChildren();
    this.inner.style.height = `${items.length * 34}px`;
    this.draw();
  }

  draw() {
    const top = this.element.scrollTop, height = this.element.clientHeight || 600;
    const a = Math.max(0, Math.floor(top / 34) - 4), b = Math.min(this.items.length, Math.ceil((top + height) / 34) + 4);
    for (const [i, row] of this.shown) {
      if (i >= a && i < b) continue;
      row.remove();
      this.shown.delete(i);
    }
    for (let i = a; i < b; i++) {
      let row = this.shown.get(i);
      if (!row) {
        row = this.render(this.items[i], i);
        row.style.top = `${i * 34}px`;
        this.shown.set(i, row);
        this.inner.append(row);
      }
      this.refresh(row, this.items[i], i);
    }
  }

  reveal(index) {
    const top = index * 34, view = this.element;
    if (top < view.scrollTop + 34 || top > view.scrollTop + view.clientHeight - 68) view.scrollTop = top - view.clientHeight / 3;
  }
}
