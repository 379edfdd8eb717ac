"""Examples of the documentation, checked by mypy as strictly as users may check their own code."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.thorough

ROOT = Path(__file__).parents[1]


def test_examples_pass_mypy_strict(tmp_path):
    pytest.importorskip("mypy")
    names = ["lists.py"]
    call = "m.graph(m.OccupancyGrid([[0]], 1), goals=[m.Goal(4, 0)], footprint=[[1, 1], [2, 1]])"
    (tmp_path / "lists.py").write_text(f"import mapdeal as m\n{call}\n", "utf-8")
    for page in [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]:
        blocks = re.findall(r"(?ms)^```python\n(.*?)^```", page.read_text("utf-8"))
        for number, block in enumerate(blocks):
            names.append(f"{page.stem.replace('.', '_')}_{number}.py")
            (tmp_path / names[-1]).write_text(block, "utf-8")
    assert len(names) > 10
    words = [sys.executable, "-m", "mypy", "--strict", "--no-error-summary", *names]
    checked = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (checked.stdout, checked.stderr, checked.returncode) == ("", "", 0)
