"""Links between documents lead to files and headings that exist; sentences are short."""

import subprocess
from functools import cache
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest
from markdown_it import MarkdownIt
from mdit_py_plugins.anchors import anchors_plugin
from sentences import too_long

ROOT = Path(__file__).parents[2]
LISTED = ["git", "ls-files", "--cached", "--others", "--exclude-standard", "*.md"]
DOCUMENTS = subprocess.check_output(LISTED, cwd=ROOT, text=True).split()
MOST_WORDS = 40


def is_part(document):
    """Whether a bench makes a page of results from this text: its links are those of that page, and tested there."""
    return document.startswith("benches/") and "/src/" in document


@cache
def tokens(path):
    return MarkdownIt("gfm-like", {"linkify": False}).use(anchors_plugin, max_level=6).parse(path.read_text())


@cache
def headings(path):
    return {token.attrGet("id") for token in tokens(path) if token.type == "heading_open"}


def links(path):
    """Every link and picture of a document: its line, and where it leads."""
    for block in tokens(path):
        for token in block.children or []:
            target = token.attrGet("href") or token.attrGet("src")
            if target:
                yield block.map[0] + 1, target


def fault(path, target):
    """What is wrong with a link of a document, if anything."""
    url = urlsplit(target)
    if url.scheme:
        return None
    there = (path.parent / unquote(url.path)).resolve() if url.path else path
    if not there.exists():
        return "no such file"
    if url.fragment and there.suffix == ".md" and url.fragment not in headings(there):
        return "no such heading"
    return None


@pytest.mark.parametrize("document", [it for it in DOCUMENTS if not is_part(it)])
def test_links_lead_somewhere(document):
    path = ROOT / document
    wrong = [(line, it, fault(path, it)) for line, it in links(path) if fault(path, it)]
    assert not wrong


def test_wrong_links_are_found():
    path = ROOT / "docs" / "control.md"
    assert fault(path, "modes.md#passive-mode") is None
    assert fault(path, "modes.md#no-such-mode") == "no such heading"
    assert fault(path, "no-such-file.md") == "no such file"


@pytest.mark.parametrize("document", DOCUMENTS)
def test_sentences_are_short(document):
    assert not list(too_long((ROOT / document).read_text(), MOST_WORDS))


def test_long_sentences_are_found():
    long = " ".join(["word"] * 40)
    assert not list(too_long(f"# Title\n\n{long}. {long}!\n\n```\n{long} {long}\n```\n", 40))
    assert [line for line, *_ in too_long(f"Short.\n\n- {long} (a [link](x.md))\n", 40)] == [3]
    assert [count for _, count, _ in too_long(f"| a | b |\n| --- | --- |\n| {long} | `x` {long} |\n", 40)] == [41]
