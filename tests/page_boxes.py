"""Boxes of a page in Chromium: what is clipped, what sticks out, which texts overlap."""

from __future__ import annotations

from typing import Any

# A text's line box is taller than its letters: so much of overlap is none, px.
_SLACK = 1.5

_MEASURE = """
(slack) => {
  const faults = [];
  const shown = (e) => {
    const box = e.getBoundingClientRect();
    return box.width > 0 && box.height > 0 && getComputedStyle(e).visibility !== 'hidden'
      && !e.closest('.skip, [hidden]');
  };
  const named = (e) => `${e.tagName.toLowerCase()}${e.id ? '#' + e.id : ''}` +
    `${e.className && e.className.baseVal === undefined ? '.' + e.className : ''} ` +
    `"${(e.textContent || '').trim().replace(/\\s+/g, ' ').slice(0, 50)}" in ` +
    `${(e.closest('section, header, nav, footer') || {}).id || 'page'}`;
  const wide = document.documentElement.clientWidth;
  if (document.documentElement.scrollWidth > wide)
    faults.push(`the page is ${document.documentElement.scrollWidth} px wide of ${wide}`);
  const main = 'h1, h2, h3, p, dt, dd, li, caption, th, td, figcaption, summary, figure, svg';
  for (const e of document.querySelectorAll(main)) {
    if (!shown(e) || e.closest('.interactive')) continue;
    const box = e.getBoundingClientRect();
    // A row of figures may be swiped.
    const scroll = e.closest('.scroll, .panels');
    if (!scroll && (box.left < -slack || box.right > wide + slack))
      faults.push(`outside the page (to ${box.right.toFixed()}): ${named(e)}`);
    if (!e.closest('svg') && e.scrollWidth > e.clientWidth + slack && e.clientWidth > 0
        && getComputedStyle(e).display !== 'inline')
      faults.push(`wider than its box (${e.scrollWidth} of ${e.clientWidth}): ${named(e)}`);
  }
  for (const e of document.querySelectorAll('.scroll')) {
    if (!shown(e)) continue;
    // A long table may be swiped next to its first column, which stays.
    const name = e.querySelector('.long tbody tr:not(.group) > th');
    if (name && getComputedStyle(name).position === 'sticky' && e.tabIndex === 0
        && name.getBoundingClientRect().width < 0.6 * e.clientWidth) continue;
    if (e.scrollWidth > e.clientWidth + slack)
      faults.push(`table cut by its frame (${e.scrollWidth} of ${e.clientWidth}): ${named(e)}`);
  }
  // Letters, not boxes: one line of text at a time, outside pictures and inside each picture.
  const lines = (root) => {
    const found = [], walker = document.createTreeWalker(root, NodeFilter.SHOW_TEXT);
    for (let node = walker.nextNode(); node; node = walker.nextNode()) {
      const parent = node.parentElement;
      if (!node.textContent.trim() || !shown(parent)) continue;
      if (parent.closest('.interactive, script, style, title, desc, .skip')) continue;
      if (root.tagName !== 'svg' && parent.closest('svg')) continue;
      const range = document.createRange();
      range.selectNodeContents(node);
      for (const r of range.getClientRects()) {
        if (r.width < 1) continue;
        const cut = 0.2 * r.height;
        found.push([r.left, r.top + cut, r.right, r.bottom - cut, node.textContent.trim()]);
      }
    }
    return found.sort((a, b) => a[1] - b[1]);
  };
  const overlaps = (found, where) => {
    for (let i = 0; i < found.length; i++) {
      for (let j = i + 1; j < found.length && found[j][1] < found[i][3]; j++) {
        const [a, b] = [found[i], found[j]];
        const across = Math.min(a[2], b[2]) - Math.max(a[0], b[0]);
        const down = Math.min(a[3], b[3]) - Math.max(a[1], b[1]);
        if (across > slack && down > slack)
          faults.push(`texts overlap in ${where}: "${a[4].slice(0, 40)}", "${b[4].slice(0, 40)}"`);
      }
    }
  };
  overlaps(lines(document.body), 'the page');
  for (const picture of document.querySelectorAll('svg')) {
    if (!shown(picture) || picture.closest('.interactive')) continue;
    const box = picture.getBoundingClientRect(), name = picture.getAttribute('aria-labelledby');
    const found = lines(picture);
    overlaps(found, name);
    for (const [left, top, right, bottom, text] of found)
      if (left < box.left - slack || right > box.right + slack || top < box.top - slack
          || bottom > box.bottom + slack)
        faults.push(`text cut by its picture ${name}: "${text}"`);
  }
  return [...new Set(faults)];
}
"""


def box_faults(page: Any) -> list[str]:
    """What is clipped or overlaps on a page as it is shown now, folds opened; one line each."""
    page.evaluate("document.querySelectorAll('details').forEach((d) => { d.open = true; })")
    found: list[str] = page.evaluate(_MEASURE, _SLACK)
    return found
