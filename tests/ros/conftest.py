import pytest


@pytest.fixture
def files(tmp_path):
    """Return what writes texts, or bytes, as files ``0.yaml`` and so on, and returns the paths."""

    def written(*texts):
        paths = [tmp_path / f"{number}.yaml" for number in range(len(texts))]
        for path, text in zip(paths, texts, strict=True):
            path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return paths

    return written
