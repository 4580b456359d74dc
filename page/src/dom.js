// Helpers for the document: find elements by id, and make them from text, never from markup.

/** Element with this id in index.html. */
export const at = (id) => document.getElementById(id);

/** New element with attributes and children; strings become text nodes. */
export function make(name, attributes = {}, ...children) {
  const element = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (value === true) element.setAttribute(key, "");
    else if (value !== false && value !== undefined) element.setAttribute(key, value);
  }
  element.append(...children);
  return element;
}

/** Set a text, unless it is set already. */
export function say(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

// How the daemon names a section of its documents; the server serves that page.
const SECTION = /docs\/troubleshooting\.md#([\w-]+)/;

/** Set a text in which mentions of troubleshooting sections become links, which open in a new tab. */
export function sayLinked(element, text) {
  const parts = text.split(SECTION); // every second part is a section
  const words = parts.map((part, i) => (i % 2 ? part.replaceAll("-", " ") : part));
  if (element.textContent === words.join("")) return;
  element.replaceChildren(...words.map((word, i) =>
    i % 2 ? make("a", { href: `troubleshooting.html#${parts[i]}`, target: "_blank", rel: "noopener" }, word) : word));
}

/** Show or hide an element. */
export function show(element, shown) {
  if (element.hidden === shown) element.hidden = !shown;
}
