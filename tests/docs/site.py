"""Look at a built site as its readers do: `python tests/docs/site.py FOLDER` opens each page in a headless Chromium.

No page may be wider than a phone or a screen, ask a network for anything, or complain on its console; every link inside
the site must lead to a page and an anchor that are there; and the search must find what the pages are about.
"""

from __future__ import annotations

import sys
import urllib.parse
from html.parser import HTMLParser
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))
sys.path.insert(0, str(Path(__file__).parents[1] / "report"))

from browser import Browser, need_chromium

WIDTHS = (400, 1600)
#: Word -> a page that the search must name.
SOUGHT = {"effusivity": "exact-start", "loosened": "errors", "touch": "first-touch", "Stepper": "python-thermal"}
#: Elements that stick out of the window and stand in nothing that scrolls.
STICKING_OUT = """[...document.querySelectorAll('article *')].filter(e => {
  let q = e.parentElement;
  while (q) { if (['auto', 'scroll', 'hidden'].includes(getComputedStyle(q).overflowX)) return false; q = q.parentElement }
  return e.getBoundingClientRect().right > innerWidth + 1
}).slice(0, 3).map(e => e.tagName + ' ' + e.textContent.slice(0, 40)).join(' | ')"""


class Page(HTMLParser):
    """The anchors of a page, and where its links lead."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.anchors: set[str] = set()
        self.links: list[str] = []
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        found = dict(attributes)
        self.anchors.add(found.get("id") or "")
        self.links += [str(found[name]) for name in ("href", "src") if found.get(name)]


def broken(root: Path, paths: list[Path]) -> list[str]:
    """Return the links inside the site that lead nowhere."""
    parsed = {path.resolve(): Page(path) for path in paths}
    wrong = []
    for path, page in parsed.items():
        for link in page.links:
            parts = urllib.parse.urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            target = (path.parent / urllib.parse.unquote(parts.path)).resolve() if parts.path else path
            anchor = urllib.parse.unquote(parts.fragment)
            known = parsed[target].anchors if target in parsed else {anchor}
            if not target.exists() or (anchor and anchor not in known):
                wrong.append(f"{path.relative_to(root)}: {link}")
    return wrong


def looks(browser: Browser, paths: list[Path], width: int) -> list[str]:
    """Return the pages that are wider than the window."""
    wrong = []
    for path in paths:
        browser.open(path, width=width, height=900)
        wide, out = browser.run("document.documentElement.scrollWidth"), browser.run(STICKING_OUT)
        if wide > width or out:
            wrong.append(f"{path.name} at {width} px: {wide} px wide; {out}")
    return wrong


def unfound(browser: Browser, root: Path) -> list[str]:
    """Return what the search does not find."""
    wrong = []
    for word, page in SOUGHT.items():
        browser.open(root / "search.html", width=1600, height=900)
        browser.run(f"Search.performSearch({word!r})")
        found = browser.run(
            "new Promise(done => { let n = 0; const look = () => { const a = [...document.querySelectorAll"
            "('#search-results li a')].map(x => x.href).join(' '); if (a.includes("
            f"{page!r}) || n++ > 50) done(a); else setTimeout(look, 100) }}; look() }})"
        )
        if page not in found:
            wrong.append(f"the search for '{word}' does not name {page}")
    return wrong


def main(folder: str) -> int:
    """Look at a site; print what is wrong."""
    root = Path(folder).resolve()
    paths = sorted(path for path in root.rglob("*.html") if "_static" not in path.parts)
    wrong = broken(root, paths)
    browser = Browser(need_chromium())
    try:
        for width in WIDTHS:
            wrong += looks(browser, paths, width)
        wrong += [f"asked for {url}" for url in browser.asked] + [f"said {text}" for text in browser.said]
        wrong += unfound(browser, root)  # its excerpts need a server, which the console complains of
    finally:
        browser.close()
    print("\n".join(wrong) or f"{len(paths)} pages: links, widths, search and console are right")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
