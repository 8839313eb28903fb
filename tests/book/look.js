// What a reader would stumble over on the page that is open: a list of sentences, empty when all is well.
async ({ scheme, painted }) => {
  const wrong = [];
  const brief = element => {
    const tag = element.cloneNode(false).outerHTML.slice(0, 120);
    const section = element.closest("section[id]");
    return tag + (section ? " in #" + section.id : "");
  };
  if (window.MathJax?.startup?.promise) await window.MathJax.startup.promise;
  for (let wait = 0; wait < 100 && document.documentElement.dataset.theme !== scheme; wait++)
    await new Promise(done => setTimeout(done, 20));
  await new Promise(requestAnimationFrame);

  if (document.documentElement.dataset.theme !== scheme) wrong.push("the page does not follow the reader's colour scheme");

  const sources = document.querySelectorAll("span.math, div.math");
  const bare = [...sources].filter(element => !element.querySelector("mjx-container svg"));
  bare.forEach(element => wrong.push("mathematics not rendered: " + element.textContent.trim().slice(0, 80)));
  document.querySelectorAll("mjx-merror, [data-mjx-error]").forEach(element =>
    wrong.push("mathematics with an error: " + (element.dataset.mjxError || element.textContent)));

  for (const cell of document.querySelectorAll(".bd-article :is(p, li, td, th, figcaption)")) {
    const words = cell.cloneNode(true);
    words.querySelectorAll("code, pre, .math, mjx-container").forEach(part => part.remove());
    const dollars = words.textContent.match(/\$[^$]+\$/);
    if (dollars) wrong.push("mathematics that nobody typeset: " + dollars[0]);
  }

  for (const image of document.images) {
    if (!image.complete || !image.naturalWidth) wrong.push("image not loaded: " + image.src);
    if (!image.alt.trim()) wrong.push("image without alt text: " + image.src);
  }
  const figures = [...document.querySelectorAll(".bd-article img"), ...document.querySelectorAll(".bd-article canvas")];
  for (const figure of figures) {
    const alt = (figure.alt ?? figure.getAttribute("aria-label") ?? "").trim();
    const caption = figure.closest("figure")?.querySelector(".caption-text")?.textContent.trim();
    if (alt.length < 40) wrong.push(`alt text shorter than 40 characters ("${alt}"): ` + brief(figure));
    if (alt && alt === caption) wrong.push("alt text only repeats the caption: " + alt);
  }
  for (const svg of document.querySelectorAll("svg")) {
    if (svg.closest("mjx-container, [aria-hidden=true], [aria-label]")) continue;
    if (!svg.querySelector("title")) wrong.push("drawing without a name: " + brief(svg));
  }
  for (const control of document.querySelectorAll(".bd-article :is(button, input, select)")) {
    const name = control.getAttribute("aria-label") || control.textContent.trim() || control.labels?.[0]?.textContent
      || control.title || control.dataset.tooltip;
    if (!name && control.checkVisibility()) wrong.push("control without a name: " + brief(control));
  }

  const wide = innerWidth;
  if (document.documentElement.scrollWidth > wide || document.body.scrollWidth > wide) wrong.push("the page is wider than the window");
  const holds = element => {
    for (let box = element; box && box !== document.body; box = box.parentElement)
      if (getComputedStyle(box).overflowX !== "visible") return true;
    return false;
  };
  for (const element of document.querySelectorAll(".bd-article *")) {
    const box = element.getBoundingClientRect();
    if (box.width && box.right > wide + 1 && !holds(element)) { wrong.push("sticks out of the window: " + brief(element)); break; }
  }

  // Words against what lies behind them; 4.5 is WCAG's AA for text.
  const rgba = text => (text.match(/[\d.]+/g) || []).map(Number);
  const light = ([r, g, b]) => [r, g, b].map(c => (c /= 255) <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4)
    .reduce((sum, c, i) => sum + c * [0.2126, 0.7152, 0.0722][i], 0);
  const ground = element => {
    for (let box = element; box; box = box.parentElement) {
      const colour = rgba(getComputedStyle(box).backgroundColor);
      if (colour.length === 3 || colour[3] > 0.5) return colour;
    }
    return scheme === "dark" ? [0, 0, 0] : [255, 255, 255];
  };
  const seen = new Set();
  for (const element of document.querySelectorAll(painted)) {
    if (element.matches(".headerlink")) continue;  // the sign beside a heading, shown to a pointer only
    if (!element.checkVisibility() || ![...element.childNodes].some(n => n.nodeType === 3 && n.data.trim())) continue;
    const [ink, paper] = [light(rgba(getComputedStyle(element).color)), light(ground(element))];
    const contrast = (Math.max(ink, paper) + 0.05) / (Math.min(ink, paper) + 0.05);
    const kind = element.tagName + "." + element.className;
    if (contrast < 4.5 && !seen.has(kind)) {
      seen.add(kind);
      wrong.push(`contrast ${contrast.toFixed(2)} under 4.5: "${element.textContent.trim().slice(0, 40)}" ` + brief(element));
    }
  }
  return wrong;
}
