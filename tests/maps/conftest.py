import pytest

from mapdeal import MapdealError, write_map
from mapdeal.maps.reading import read_source


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


@pytest.fixture(params=[4, pytest.param(1, marks=pytest.mark.thorough)])
def real_sources(request, real_maps, mapdeal_warnings):
    """Return paths of readable real maps, some or all of them, with their contents."""

    def read():
        count = 0
        maps = sorted(path for path in real_maps.rglob("*.yaml") if "params" not in path.parts)
        for path in maps[:: request.param]:
            try:
                source = read_source(path)
            except MapdealError:
                continue
            yield path, source
            count += 1
        assert count >= 37 // request.param

    return read()
