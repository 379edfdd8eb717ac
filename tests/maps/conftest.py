import pytest

from mapdeal import write_map


@pytest.fixture
def converted(tmp_path, command):
    """Return what converts a map, a grid or a file, into a file of some name."""

    def run(source, name, *words):
        if not hasattr(source, "suffix"):
            write_map(tmp_path / "map.yaml", source, force=True)
            source = tmp_path / "map.yaml"
        code, _, err = command("convert", source, "-o", tmp_path / name, *words, "--force")
        assert code == 0, err
        return tmp_path / name

    return run
