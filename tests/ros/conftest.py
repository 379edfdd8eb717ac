import pytest


@pytest.fixture
def files(tmp_path):
    """Return a function that writes texts or bytes to ``0.yaml``, ``1.yaml``, ..."""

    def write(*texts):
        paths = [tmp_path / f"{number}.yaml" for number in range(len(texts))]
        for path, text in zip(paths, texts, strict=True):
            path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return paths

    return write
