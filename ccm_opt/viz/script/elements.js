// Elements of SVG and HTML. Texts become text nodes, so that a name is never markup.

const SVG_SPACE = "http://www.w3.org/2000/svg";

function dressed(node, attributes, children) {
  for (const [name, value] of Object.entries(attributes)) {
    if (value !== null && value !== undefined && value !== false) node.setAttribute(name, value === true ? "" : value);
  }
  node.append(...children.filter(child => child !== null && child !== undefined));
  return node;
}

function svg(name, attributes = {}, ...children) {
  return dressed(document.createElementNS(SVG_SPACE, name), attributes, children);
}

function html(name, attributes = {}, ...children) {
  return dressed(document.createElement(name), attributes, children);
}

function byId(id) {
  return document.getElementById(id);
}

// Calls back at once, and when an element gets another width; then in the next frame, as drawing may change its height.
function onWidth(node, act) {
  let known = node.clientWidth;
  act();
  new ResizeObserver(() => {
    if (node.clientWidth === known) return;
    known = node.clientWidth;
    requestAnimationFrame(act);
  }).observe(node);
}
