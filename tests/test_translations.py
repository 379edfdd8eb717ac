"""The Chinese pages have the commands, code, pictures, links and tables of the English ones."""

import itertools
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
GLOSSARY = "术语对照"

CJK = "[一-鿿]"
HEADING = re.compile(r"^(#+) (.*)$")
SPAN = re.compile(r"`([^`\n]+)`")
LINK = re.compile(r"(!?)\[((?:[^][]|\[[^]]*\])*)\]\(([^)\s]+)\)")
LANGUAGE_LINK = re.compile(r"^\[(?:中文|English)\]\([^)]+\)$")
ENGLISH_WORDS = re.compile(r"(?i)\b(?:a|an|and|are|by|for|in|is|it|of|that|the|to|with)\b")


def chinese_of(page):
    is_readme = page == ROOT / "README.md"
    return DOCS / "README.zh.md" if is_readme else page.with_name(f"{page.stem}.zh.md")


def parts(text):
    """A page as its prose, line by line, and its blocks of code with their languages."""
    block = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
    lines = block.sub("\n", text).splitlines()
    return [line for line in lines if not LANGUAGE_LINK.match(line)], block.findall(text)


def read(page):
    """The parts of a page, without the glossary and lint's checks, which have one language."""
    text = page.read_text("utf-8").split(f"## {GLOSSARY}\n")[0]
    return parts(re.sub(r"<!-- checks -->.*?<!-- end -->", "", text, flags=re.DOTALL))


def commands(block):
    """A block of shell commands without comments, save those that state an exit code."""
    lines = (re.sub(r"(?:^|\s+)#(?! exit code \d).*", "", line) for line in block.splitlines())
    return [line for line in lines if line]


def levels(lines):
    return [len(match[1]) for line in lines if (match := HEADING.match(line))]


def tables(lines):
    grouped = itertools.groupby(lines, lambda line: line.startswith("|"))
    return [list(rows) for is_table, rows in grouped if is_table]


def spans(row):
    """The code in the first column of a row, and all of its code, whatever their order."""
    return sorted(SPAN.findall(re.split(r"(?<!\\)\|", row)[1])), sorted(SPAN.findall(row))


def resolved(page, target):
    address, _, fragment = target.partition("#")
    if address.startswith("http"):
        return address, fragment
    return (page.parent / address).resolve() if address else page, fragment


def targets(page, lines, pictures):
    return [
        resolved(page, target)
        for picture, _, target in LINK.findall("\n".join(lines))
        if bool(picture) == pictures
    ]


def untranslated(line):
    text = LINK.sub(r"\2", SPAN.sub("", re.sub(r"<!-- .+? -->", "", line)))
    if re.search(r"<a id=", text):
        return ""
    match = ENGLISH_WORDS.search(text)
    is_names = text.startswith("|") or re.fullmatch(r"# \w+|## \d+\uff1a\w+", text)
    if match is None and (re.search(CJK, text) or is_names):
        return ""
    return text if re.search(r"[A-Za-z]", text) else ""


@pytest.fixture(params=sorted(DOCS.rglob("*.zh.md")), ids=lambda page: page.name)
def pair(request):
    """The English page of a Chinese one, and that page."""
    page = request.param
    english = page.with_name(page.name.replace(".zh.md", ".md"))
    return ROOT / "README.md" if page == DOCS / "README.zh.md" else english, page


SAME = {
    "levels of headings": lambda page: levels(read(page)[0]),
    "blocks of code": lambda page: [
        (kind, commands(code) if kind == "sh" else code) for kind, code in read(page)[1]
    ],
    "pictures": lambda page: targets(page, read(page)[0], pictures=True),
    "rows of tables": lambda page: [len(rows) for rows in tables(read(page)[0])],
    "code in tables": lambda page: [spans(row) for row in itertools.chain(*tables(read(page)[0]))],
}


@pytest.mark.parametrize("trait", SAME)
def test_both_languages_have_the_same(pair, trait):
    english, chinese = map(SAME[trait], pair)
    assert chinese == english


def test_links_lead_to_the_same_pages_in_chinese_where_there_are_such(pair):
    def in_chinese(target):
        address, fragment = target
        if isinstance(address, Path) and chinese_of(address).exists():
            return chinese_of(address), fragment
        return target

    english, chinese = (targets(page, read(page)[0], pictures=False) for page in pair)
    assert sorted(chinese, key=str) == sorted(map(in_chinese, english), key=str)


def test_no_english_sentence_is_left_and_a_paragraph_is_one_line(pair):
    lines, _ = read(pair[1])
    assert [line for line in lines if untranslated(line)] == []
    # a line break between Chinese characters would be shown as a space
    lines, _ = parts(pair[1].read_text("utf-8"))
    assert re.findall(r"(?m)^[^#|\s!<].*\n(?!- |\d+\. )[^#|\s!<].*", "\n".join(lines)) == []


def test_each_page_links_to_its_other_language_at_its_top(pair):
    english, chinese = pair
    for page, counterpart, label in ((chinese, english, "English"), (english, chinese, "中文")):
        if page == ROOT / "README.md":
            continue
        label_and_target = re.match(r"# .*\n\n\[(.*?)\]\((.*?)\)\n\n", page.read_text("utf-8"))
        assert label_and_target is not None, page.name
        assert label_and_target[1] == label
        assert resolved(page, label_and_target[2]) == (counterpart, "")
