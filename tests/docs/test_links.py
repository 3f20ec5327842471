"""Links of the documentation lead somewhere: pages, anchors, files; figures say how they were made; nothing is fetched."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from listings import DOCS, ROOT, pages

sys.path.insert(0, str(DOCS))

from python_api import PAGES

from itouch_tools.cli import COMMANDS
from itouch_tools.cli.completion import commands
from itouch_tools.cli.shells import Command

#: Pages that are written when the site is built: they need not be there yet.
MADE = set(PAGES)
_LINK = re.compile(r"(?<!!)\[[^\]]*\]\(([^)\s]+)\)")
_IMAGE = re.compile(r"!\[[^\]]*\]\(([^)\s]+)\)|```\{figure\} (\S+)")


def prose(page: Path) -> str:
    """Return a page without its listings."""
    return re.sub(r"^ *```(?!\{figure).*?^ *```\s*$", "", page.read_text(encoding="utf-8"), flags=re.S | re.M)


def slugs(text: str) -> set[str]:
    """Return the anchors of a page's headings."""
    found = re.findall(r"^#{1,3} (.*)$", text, flags=re.M)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).strip().replace(" ", "-") for heading in found}


def wrong(page: Path, target: str) -> str:
    """Return what is wrong with a link, or nothing."""
    if re.match(r"https?://", target):
        return ""
    file, _, anchor = target.partition("#")
    path = (page.parent / file).resolve() if file else page
    if path.name in MADE and path.parent == DOCS / "reference":
        return ""
    if path == DOCS / "explanation" / "paper.md" and not anchor:
        return ""
    if not (path.exists() or path.with_suffix(".md").exists()):
        return f"{target}: nothing is there"
    if anchor and anchor not in slugs(prose(path)):
        return f"{target}: the anchors are {sorted(slugs(prose(path)))}"
    return ""


@pytest.mark.parametrize("page", list(pages()), ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page: Path) -> None:
    assert [said for target in _LINK.findall(prose(page)) if (said := wrong(page, target))] == []


@pytest.mark.parametrize(
    ("target", "said"),
    [
        ("nowhere.md", "nothing is there"), ("#no-such-heading", "the anchors are"),
        ("../tutorials/nothing.md#a", "nothing is there"), ("https://example.org", ""), ("#links", ""),
    ],
)  # fmt: skip
def test_a_link_that_leads_nowhere_is_seen(tmp_path: Path, target: str, said: str) -> None:
    page = tmp_path / "page.md"
    page.write_text("# Links\n", encoding="utf-8")
    assert said in wrong(page, target) and bool(said) == bool(wrong(page, target))


def test_pictures_exist_or_are_made() -> None:
    source = (DOCS / "generated.py").read_text(encoding="utf-8")
    for page in pages():
        for plain, figure in _IMAGE.findall(page.read_text(encoding="utf-8")):
            path = page.parent / (plain or figure)
            made = path.parent.name == "_generated" and (f'"{path.stem}"' in source or f'"{path.name}"' in source)
            assert made or path.is_file(), f"{page.name}: {path}"


def test_files_that_are_named_exist() -> None:
    """Paths of the repository in running text."""
    missing = []
    for page in pages():
        for name in re.findall(r"`((?:scenes|tests|docs|framework|plugins)/[\w./-]+)`", prose(page)):
            if name != "scenes/blocks.xml" and not (ROOT / name).exists():  # what a tutorial writes
                missing.append(f"{page.relative_to(ROOT)}: {name}")
    assert not missing


def test_commands_that_are_named_exist() -> None:
    from itouch_tools.cli import _plugin_commands

    known = {*COMMANDS, *_plugin_commands()}
    for page in pages():
        for word in re.findall(r"`itouch-py ([a-z][\w-]*)[ `]", prose(page)):
            assert word in known, f"{page.name}: itouch-py {word}"


#: Pages that list what there is, whoever needs it.
LISTS = {"command-line.md", "sentences.md", "errors.md", "changes.md", "modules.md"}


def options_of(name: str, command: Command) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Yield the options of a command and of its sub-commands: for each the command's last word, and its spellings."""
    for option in command.options:
        if not {"-h", "-q", "-v", "--color"} & set(option.words):  # of every command
            yield name, option.words
    for word, inner in command.inner.items():
        yield from options_of(word, inner)


def test_every_option_is_on_a_page_besides_the_reference() -> None:
    """One that no page needs is one that nobody would miss; a page must name the command, too."""
    texts = [
        page.read_text(encoding="utf-8") for page in (*pages(), ROOT / "README.md")
        if page.name not in LISTS and page.parent.name != "decisions"
    ]  # fmt: skip
    untold = []
    for name, command in commands().items():
        for last, words in options_of(name, command):
            spelt = re.compile("|".join(rf"(?<![\w-]){re.escape(word)}(?![\w-])" for word in words))
            told = any(spelt.search(text) and (last == "run" or re.search(rf"\b{last}\b", text)) for text in texts)
            untold += [] if told else [f"{last} {words[-1]}"]
    assert untold == []


def test_every_measured_table_says_how_it_was_made() -> None:
    """The pages of measured figures name commands, dates and commits; pages that explain what was measured link there."""
    for name in ("campaigns", "safety-case", "long-form"):
        text = (DOCS / "explanation" / f"{name}.md").read_text(encoding="utf-8")
        assert re.search(r"2026-\d\d-\d\d|\d\d? November 2026", text), name
        assert re.search(r"(?<![\w/])[0-9a-f]{7,8}(?![\w/])", text), name
        assert "`itouch-py bench" in text or "`python -m pytest" in text, name
    explained = ("explanation/real-time.md", "explanation/thermal-display.md", "explanation/session-evidence.md",
                 "explanation/ten-thousand-fingers.md", "reference/thermal-display.md", "reference/thermal-solver.md")  # fmt: skip
    for name in explained:
        text = (DOCS / name).read_text(encoding="utf-8")
        assert re.search(r"[(/]campaigns\.md#[\w-]+\)", text) and "`itouch-py " in text, name


def test_the_index_leads_to_every_page() -> None:
    index = (DOCS / "index.md").read_text(encoding="utf-8")
    for folder in ("how-to", "reference", "explanation"):
        assert f"\n{folder}/*\n" in index
    for page in (DOCS / "tutorials").glob("*.md"):
        assert f"tutorials/{page.stem}" in index


def test_the_four_kinds_of_page_are_complete() -> None:
    wanted = {
        "tutorials": ("first-touch", "four-materials", "plugin-in-a-day", "record-save-restore"),
        "how-to": ("calibrate", "add-a-material", "measure-a-flux-curve", "real-time-kernel", "slow-device",
                   "read-data-in-pandas", "make-a-figure", "port-a-scene"),
        "explanation": ("one-tick", "scene-model-state", "proxies", "exact-start", "kinds-of-display", "safety-case",
                        "real-time", "decisions"),
        "reference": ("session-format", "recording-format", "safety-limits", "report"),
    }  # fmt: skip
    for folder, names in wanted.items():
        for name in names:
            assert (DOCS / folder / f"{name}.md").is_file(), f"{folder}/{name}"


def test_every_scene_has_a_small_film_in_the_gallery() -> None:
    from gallery import FILMS, PARTS
    from PIL import Image

    text = (DOCS / "reference" / "gallery.md").read_text(encoding="utf-8")
    shipped = {path.stem for path in (ROOT / "scenes").glob("*.xml")}
    assert shipped - set(PARTS) == {"materials", "handbook", "real_touch"}  # two libraries, and touches of a sample
    assert {path.stem for path in FILMS.iterdir()} == set(PARTS)
    for name in PARTS:
        path = FILMS / f"{name}.webp"
        assert f"](../pictures/gallery/{name}.webp)" in text and f"`scenes/{name}.xml`" in text
        assert path.stat().st_size < 250_000, name
        with Image.open(path) as film:
            assert film.n_frames > 3, name


def test_the_gallery_pictures_eight_scenes_that_run() -> None:
    from generated import PICTURES

    text = (DOCS / "reference" / "gallery.md").read_text(encoding="utf-8")
    figures = re.findall(r"```\{figure\} \.\./_generated/([\w-]+)\.png\n`scenes/(\w+\.xml)`", text)
    assert len(figures) >= 8
    for picture, scene in figures:
        assert PICTURES[picture][0] == scene
        assert (ROOT / "scenes" / scene).is_file()
    sys.path.insert(0, str(ROOT / "tests" / "session"))
    from running import RUNNABLE  # what the tests run, save, restore and replay

    assert {Path(scene).stem for _, scene in figures} <= set(RUNNABLE)
