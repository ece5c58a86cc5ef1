"""Sentences of a Markdown page, and how long they are."""

import re

from markdown_it import MarkdownIt

END_OF_SENTENCE = re.compile(r"(?<=[.!?])[\"')\]]*\s+|(?<=[.!?][\"')\]])\s+")
WORD = re.compile(r"\w")


def plain(inline):
    """The text of a paragraph, list item, heading or cell; a name in back-ticks counts as one word."""
    parts = []
    for token in inline.children or []:
        if token.type == "text":
            parts.append(token.content)
        elif token.type in ("code_inline", "math_inline"):
            parts.append("code")
        elif token.type in ("softbreak", "hardbreak"):
            parts.append(" ")
    return "".join(parts)


def words(sentence):
    """Number of words: groups between spaces with at least one letter or digit."""
    return sum(1 for group in sentence.split() if WORD.search(group))


def sentences(text):
    """Every sentence of a Markdown text outside of code blocks, with its line. A cell of a table is text of its own."""
    line = 0
    for token in MarkdownIt("gfm-like", {"linkify": False}).parse(text):
        line = token.map[0] + 1 if token.map else line
        if token.type == "inline":
            for sentence in END_OF_SENTENCE.split(plain(token)):
                yield line, sentence.strip()


def too_long(text, most):
    """The sentences of more than `most` words: line, number of words, first words."""
    for line, sentence in sentences(text):
        count = words(sentence)
        if count > most:
            yield line, count, " ".join(sentence.split()[:8])
