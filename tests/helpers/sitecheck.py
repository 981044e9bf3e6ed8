"""What a reader's browser says of a built page: one load, looked at in several widths, in light and
in dark.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import axe_core_python

from workbench.pages.browser import AT_ONCE

# axe-core, for the page and its frames: those of a page that is read from a file have no origin.
AXE = (Path(axe_core_python.__file__).parent / "axe.min.js").read_text(encoding="utf-8") + (
    "; axe.configure({allowedOrigins: ['<unsafe_all_origins>']});"
)
WIDTHS_PX = (1280, 1920, 400)  # the last is that of a telephone

# Of each formula: whether its box cuts it off, or cannot be scrolled to its end.
CLIPPED = """
[...document.querySelectorAll('article div.math')].filter(box => {
    if (!box.checkVisibility()) return false;
    const formula = box.querySelector('mjx-math').getBoundingClientRect();
    const edges = box.getBoundingClientRect();
    const scrolls = getComputedStyle(box).overflowX == 'auto';
    return formula.left < edges.left - 1 || (formula.right > edges.right + 1 && !scrolls);
}).map(box => box.textContent.slice(0, 60))
"""
# The lines of a chapter's code that its box does not show whole.
WIDE_CODE = """
[...document.querySelectorAll('article .cell_input div.highlight pre')]
    .filter(box => box.scrollWidth > box.clientWidth + 1)
    .map(box => box.textContent.slice(0, 60))
"""
# How far the page itself can be scrolled sideways.
WIDE_PAGE = "document.documentElement.scrollWidth - document.documentElement.clientWidth"
# The texts, pictures and films that reach over the window's edge, and that no box scrolls there.
OVER_THE_EDGE = """
(() => {
    const edge = document.documentElement.clientWidth + 1;
    const scrolled = one => {
        for (; one && one !== document.body; one = one.parentElement) {
            const scrolls = ['auto', 'scroll'].includes(getComputedStyle(one).overflowX);
            if (scrolls && one.getBoundingClientRect().right <= edge) return true;
        }
        return false;
    };
    // the second sidebar is a drawer, which waits beside the window
    const seen = one => one.checkVisibility() && !one.closest('.bd-sidebar-secondary');
    const found = [];
    const page = document.querySelector('main') || document.body;
    const texts = document.createTreeWalker(page, NodeFilter.SHOW_TEXT);
    const range = document.createRange();
    while (texts.nextNode()) {
        const text = texts.currentNode, parent = text.parentElement;
        if (!text.data.trim() || parent.closest('mjx-assistive-mml, script, style')) continue;
        if (!seen(parent)) continue;
        range.selectNodeContents(text);
        if (range.getBoundingClientRect().right > edge && !scrolled(parent))
            found.push(text.data.trim().slice(0, 60));
    }
    for (const one of page.querySelectorAll('img, video, iframe, canvas, mjx-container'))
        if (seen(one) && one.getBoundingClientRect().right > edge && !scrolled(one))
            found.push(one.outerHTML.slice(0, 60));
    return found;
})()
"""
# What should have become a formula, a link or a number, and stands there as it was typed.
RAW = r"""
(() => {
    const typed = /\\[a-zA-Z]{2,}|\$\$|\$[^$\s][^$]*\$|\{[a-z:-]+\}`|^:::|```|\]\(\S+\)/;
    const found = [];
    const texts = document.createTreeWalker(
        document.querySelector('article, .bd-article') || document.body, NodeFilter.SHOW_TEXT);
    while (texts.nextNode()) {
        const text = texts.currentNode;
        if (text.parentElement.closest('pre, code, mjx-container, script, style')) continue;
        if (typed.test(text.data)) found.push(text.data.trim().slice(0, 80));
    }
    return found;
})()
"""
# The pictures and films that are not there; those that wait to be scrolled to are fetched first.
MISSING = """
(async () => {
    const images = [...document.images];
    images.forEach(one => { one.loading = 'eager'; });
    await Promise.all(images.map(one => one.decode().catch(() => null)));
    const films = [...document.querySelectorAll('video, source')];
    return [...images.filter(one => !one.naturalWidth), ...films.filter(one => one.error)]
        .map(one => one.outerHTML.slice(0, 120));
})()
"""
# What axe-core calls serious or critical, by some rules or (null) all of them: rule, number of places,
# the first of them.
GRAVE = """
(async rules => {
    const only = rules ? {runOnly: {type: 'rule', values: rules}} : {};
    const result = await axe.run(document, {resultTypes: ['violations'], ...only});
    return result.violations
        .filter(one => ['serious', 'critical'].includes(one.impact))
        .map(one => `${one.id}: ${one.nodes.length} x ${one.nodes[0].html.slice(0, 140)} `
            + one.nodes[0].any.map(check => check.message).join('; ').slice(0, 200));
})
"""
# In the dark the colours are others, and nothing else is.
RULES = {"light": "null", "dark": "['color-contrast', 'link-in-text-block']"}


def faults(browser: Any, address: str, schemes: tuple[str, ...] = ("light", "dark")) -> list[str]:
    """Open a page, and say all that is wrong with it: a line for each kind of fault and place."""
    browser.open(address, width=WIDTHS_PX[0], before=AXE)
    browser.evaluate(AT_ONCE)
    found = [f"error: {one}" for one in browser.errors]
    found += [f"missing: {one}" for one in browser.evaluate(MISSING)]
    found += [f"raw: {one}" for one in browser.evaluate(RAW)]
    found += [f"wide code: {one}" for one in browser.evaluate(WIDE_CODE)]
    for scheme in schemes:
        browser.evaluate(f"document.documentElement.dataset.theme = '{scheme}'")
        found += [f"axe, {scheme}: {one}" for one in browser.evaluate(f"{GRAVE}({RULES[scheme]})")]
    for width in WIDTHS_PX:
        browser.resize(width)
        found += [f"clipped at {width}: {one}" for one in browser.evaluate(CLIPPED)]
        if over := browser.evaluate(WIDE_PAGE):
            found.append(f"{over} px wider than {width}")
    return found + [f"over the edge: {one}" for one in browser.evaluate(OVER_THE_EDGE)]
