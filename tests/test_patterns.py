"""No text of a user's makes a regular expression take more than a few looks at each character."""

import ast
import re
import subprocess
import sys
from itertools import product, takewhile

import pytest

from sources import MODULES, place_of, tree_of

pytestmark = pytest.mark.slow

FUNCTIONS = {"compile", "match", "fullmatch", "search", "sub", "subn", "split", "findall",
             "finditer"}  # fmt: skip
OURS = "matched against docstrings of the project alone"

# Where each stands, how it is used, and why that takes linear time: searching tries at each place.
REASONS = {
    ("checks/map_checks.py",
     r"(?<![0-9.])([0-9]{1,15}(?:\.[0-9]{0,15})?|\.[0-9]{1,15})\s{0,9}m(?:eters?)?/pix"):
        ("search", "every repeat is bounded, so a try is, too"),
    ("cli/completion.py", r"\n=\n?"): ("sub", "no more than three characters"),
    ("cli/options.py", r" +\[default: "): ("sub", OURS),
    ("cli/usage.py", r"(?:[^-=,][^=,]*=)?[-+0-9.eE]+(?:,[-+0-9.eE]+){1,2}"):
        ("fullmatch", "a name ends at its =, and no comma is in the class of numbers"),
    ("files/source.py", r"([0-9]{1,9}(?:\.[0-9]*)?)\s*([kmgt]?)(i?b)?"):
        ("fullmatch", "digits, white space and letters have nothing in common"),
    ("cli/usage.py", r"\(?-?\d+(\.\d*)?\)?"): ("fullmatch", "a point stands between the digits"),
    ("cli/usage.py", r"no such (option|command):? '?(?P<name>(?<=')[^']*|[^ ']*)'?"):
        ("match", "a repeat ends before the blank or quote that may follow"),
    ("cli/usage.py", r": '(?P<word>[^']*)' is not one of "):
        ("search", "a word of the command line; the repeat ends at the next quote"),
    ("cli/apps.py", r".*?\.(?=\s+[A-Z`]|$)"): ("match", OURS),
    ("bags/bag.py", r"([^/]+)/([^/]+)"): ("fullmatch", "a slash stands between the runs"),
    ("bags/bag.py", r"[A-Za-z_][A-Za-z0-9_]*"): ("fullmatch", "one run"),
    ("bags/bag.py", r"[A-Za-z0-9_. +-]+"): ("fullmatch", "one run"),
    ("bags/chunked.py", r"#ROSBAG V(\d+)\.(\d+)\n"):
        ("fullmatch", "a point stands between the runs; 64 bytes at most"),
    ("files/source.py", r"^MemAvailable:\s+(\d+) kB"):
        ("search", "tried at the beginnings of lines; the two runs have nothing in common"),
    ("files/source.py", r"^0::/(.*)$"): ("search", "tried at the beginnings of lines"),
    ("files/source.py", r"^inactive_file (\d+)"):
        ("search", "tried at the beginnings of lines"),
    ("inputs/kinds.py", r"(?m)^[ \t]*(FLASER|ROBOTLASER1|RAWLASER1)[ \t]"):
        ("search", "tried at the beginnings of lines, where one run precedes a letter"),
    ("inputs/kinds.py", r"(?m)^[ \t]*[\"']?ros__parameters[\"']?[ \t]*:"):
        ("search", "tried at the beginnings of lines, where two runs stand around what is fixed"),
    ("inputs/kinds.py", r"(?m)^size (\d{1,18})$"): ("search", "tried at the beginnings of lines"),
    ("inputs/listing.py", r"([0-9]+)"): ("split", "a try cannot fail behind its first digit"),
    ("files/source.py", r"""(?m)^(\xef\xbb\xbf)?["']?image["']?[ \t]*:"""):
        ("search", "tried at the beginnings of lines, where one run follows what is fixed"),
    ("maps/images.py", r"#[^\n\r]*|[^ \t\n\v\f\r#]+"):
        ("finditer", "either cannot fail behind its first character"),
    ("maps/images.py", r"[ \t\n\v\f\r]"): ("search", "one character"),
    ("maps/images.py", r"#[^\n\r]*"): ("sub", "it cannot fail behind its first sign"),
    ("maps/images.py", r"P[1-7fF](\s|#)"): ("match", "three characters"),
    ("maps/images.py", r"-?\d{1,12}"): ("fullmatch", "thirteen characters"),
    ("checks/findings.py", r"(?:^|(?<=\s))#[ \t]{0,9}mapdeal:[ \t]{0,9}ignore(?![\w-]):?"):
        ("search", "every repeat is bounded, so a try is, too"),
    ("checks/findings.py", r"[ \t]*([\w.-]+)[ \t]*"):
        ("match", "white space and names have nothing in common"),
    ("ros/robot.py",
     r"[ \t\n\v\f\r]*([-+]?(?:(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][-+]?[0-9]*)?|\.?))"):
        ("match", "it cannot fail: blanks, then runs of digits with a point or an e between"),
    ("ros/ros2_files.py",
     r"([-+]?)(?:0[xX]([0-9a-fA-F]+)|(0[0-7]*)|([1-9][0-9]*))"):
        ("fullmatch", "one run of digits at the end, after what tells the three apart"),
    ("ros/ros2_files.py",
     r"[-+]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][-+]?[0-9]+)?"):
        ("fullmatch", "a point or an e stands between runs of digits"),
    ("ros/ros2_files.py",
     r"[-+]?0[xX](?:[0-9a-fA-F]+(?:\.[0-9a-fA-F]*)?|\.[0-9a-fA-F]+)(?:[pP][-+]?[0-9]+)?"):
        ("fullmatch", "a point or a p stands between runs of digits"),
    ("ros/ros2_files.py",
     r"[-+]?(?:inf(?:inity)?|nan(?:\([0-9a-z_]*\))?)"):
        ("fullmatch", "one run, between fixed characters"),
    ("ros/ros2_files.py", r"[eE]"): ("split", "one character"),
    ("ros/ros2_files.py", r"[pP]"): ("split", "one character"),
    ("files/yaml_text.py", r"[-+]?(\d+(\.\d*)?|\.\d+)([eE][-+]?\d+)?"):
        ("fullmatch", "a point or an e stands between runs of digits"),
    ("files/yaml_text.py", r"[-+]?0\d"): ("match", "three characters"),
    ("files/yaml_text.py", r"P[1-7fF]\s"): ("match", "three characters"),
    ("files/yaml_text.py", r"[-+]?\d+,\d+"): ("fullmatch", "a comma stands between the digits"),
    ("files/yaml_text.py", r"[-+]?[\d.]+\s*[a-zA-Z]"):
        ("match", "the two runs have nothing in common, and it is tried at one place"),
    ("grid/footprint.py",
     r"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?|[-+]?\.?[nN]a[nN]|[-+]?\.?[iI]nf"):
        ("fullmatch", "a point or an e stands between runs of digits"),
    ("pipeline/batch.py", r"(?<![\w./-])/some/folder/"):
        ("split", "a look back at one character, then fixed text"),
    ("commands/report_entries.py", r"(?<![\w./\\-])(?=/|[A-Za-z]:[\\/]|\\\\)"):
        ("finditer match", "looks back at one character and ahead at three"),
    ("commands/report_entries.py", r"[\\/]"): ("finditer", "one character"),
    ("pipeline/recipe.py",
     r"(?:(?P<key>[^(]*) \()?line (?P<line>\d+)(?:, (?P<column>column \d+))?\)?"):
        ("fullmatch", "the first repeat ends at the bracket, the others are of digits"),
    ("pipeline/workers.py", r"(tcp|tls|ucx|ws|wss)://[^/\s]+:\d{1,5}"):
        ("fullmatch", "one run; behind each place where it may end five digits at most"),
    ("command.py", r"(?m)^ {4}(?P<names>[a-z_0-9, ]+) : "): ("finditer split", OURS),
    ("command.py", r"(?m)^ {4}(?P<name>\w+)\n {4}-+\n"): ("finditer split", OURS),
}  # fmt: skip
MADE = {"pipeline/batch.py": r"(?<![\w./-])/some/folder/"}
"""What a pattern that is put together looks like, by file."""

LENGTH = 100_000
LIMIT = 60  # seconds for all tries of a pattern, which take far less, or far more if quadratic


def text_of(pattern):
    """Return a pattern as the table has it: of bytes or text, \\x written out."""
    text = pattern.decode("latin-1") if isinstance(pattern, bytes) else pattern
    return "".join(c if c.isascii() else f"\\x{ord(c):02x}" for c in text)


def patterns_in_the_source():
    """Return the functions that each regular expression is used with, by file and pattern."""
    found = {}
    for path in MODULES:
        name, nodes = place_of(path), list(ast.walk(tree_of(path)))
        assert not any(
            isinstance(node, ast.ImportFrom) and node.module == "re" for node in nodes
        ), f"{name}: import re as a whole, so that uses are found"
        uses_of = {}
        for node in nodes:
            call = ast.unparse(node.func) if isinstance(node, ast.Call) else ""
            if not call.startswith("re.") or call[3:] not in FUNCTIONS:
                continue
            pattern = node.args[0]
            text = text_of(pattern.value) if isinstance(pattern, ast.Constant) else MADE[name]
            uses = found.setdefault((name, text), set())
            if call == "re.compile":
                uses_of[ast.unparse(node)] = uses
            else:
                uses.add(call[3:])
        for node in nodes:
            if isinstance(node, ast.Assign) and ast.unparse(node.value) in uses_of:
                uses_of[node.targets[0].id] = uses_of[ast.unparse(node.value)]
        for node in nodes:
            if isinstance(node, ast.Attribute) and ast.unparse(node.value) in uses_of:
                uses_of[ast.unparse(node.value)].add(node.attr)
    return found


def test_each_regular_expression_has_the_reason_why_it_takes_linear_time():
    found = patterns_in_the_source()
    assert set(found) == set(REASONS)
    for key, uses in found.items():
        assert uses <= set(REASONS[key][0].split()), key


FROM_USERS = sorted(
    {(pattern, how) for (_, pattern), (how, reason) in REASONS.items() if reason != OURS}
)


def unbounded_repeats(items, *, inside=False):
    """Yield whether each repeat without an upper bound stands within another."""
    for code, value in items:
        name, parts, endless = str(code), [], False
        if name in ("MAX_REPEAT", "MIN_REPEAT"):
            endless = value[1] == re._parser.MAXREPEAT
            parts = [value[2]]
        elif name == "BRANCH":
            parts = value[1]
        elif name in ("SUBPATTERN", "ASSERT", "ASSERT_NOT"):
            parts = [value[-1]]
        if endless:
            yield inside
        for part in parts:
            yield from unbounded_repeats(part, inside=inside or endless)


def test_exponential_repeats_are_seen():
    assert any(unbounded_repeats(re._parser.parse(r"(?:\s|#[^\n]*)*x")))
    assert not any(unbounded_repeats(re._parser.parse(r"\d+(\.\d*)?")))


@pytest.mark.parametrize("pattern", [pattern for pattern, _ in FROM_USERS])
def test_no_repeat_without_a_bound_stands_within_another(pattern):
    assert not any(unbounded_repeats(re._parser.parse(pattern)))


CODE = """
import re, sys
pattern, uses = eval(sys.stdin.readline())
for line in sys.stdin:
    head, unit = eval(line)
    text = head + unit * (LENGTH // len(unit)) + "\x01"
    for use in uses.split():
        print(use, ascii((head, unit)), flush=True)
        if use == "sub":
            re.sub(pattern, "", text)
        else:
            getattr(re, use)(pattern, text)
""".replace("LENGTH", str(LENGTH))


@pytest.mark.thorough
@pytest.mark.parametrize(("pattern", "uses"), FROM_USERS)
def test_nothing_that_is_long_and_nearly_fits_takes_long(pattern, uses):
    signs = list(dict.fromkeys(["1", " ", "a", *pattern.replace("\\", "")]))
    heads = ["", "".join(takewhile(str.isalpha, pattern)), "-1", "tcp://a"]
    units = [*signs, *map("".join, product(signs[:5], repeat=2))]
    tries = [f"{(head, unit)!a}\n" for head in dict.fromkeys(heads) for unit in units]
    words = [sys.executable, "-c", CODE]
    text = "".join([f"{(pattern, uses)!a}\n", *tries])
    try:
        subprocess.run(words, input=text, capture_output=True, text=True, check=True, timeout=LIMIT)
    except subprocess.TimeoutExpired as stopped:
        pytest.fail(f"takes long: {(stopped.stdout or b'').decode().splitlines()[-1:]}")
