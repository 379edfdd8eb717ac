"""Parameter files as texts, with the results of their readers recorded in ``cases/*.yaml``.

A case contains files, as texts, and the result of their reader, line by line: problems, then the
robot or the parameters; or the findings of lint. ``<good>`` stands for valid first lines, which a
case may replace. The results were checked by hand against the sources of ROS. To add a case, write
its files and record the result, then check it: ``MAPDEAL_RECORD=1 python -m pytest -n0 TESTS``.
"""

import os

import yaml

from mapdeal.errors import MalformedInputError

LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


class Readable(yaml.SafeDumper):
    """Dumper that writes texts of several lines in block style."""


Readable.add_representer(str, lambda dumper, text: dumper.represent_scalar(
    "tag:yaml.org,2002:str", text, style="|" if "\n" in text else None))  # fmt: skip


class RecordedCases:
    """The cases in a folder, by kind and name."""

    def __init__(self, folder):
        self._folder = folder
        self._kinds = {path.stem: yaml.load(path.read_text("utf-8"), LOADER)  # noqa: S506 - safe
                       for path in sorted(folder.glob("*.yaml"))}  # fmt: skip
        self.names = [(kind, name) for kind in self._kinds for name in self._kinds[kind]["cases"]]

    def check(self, kind, name, files, read):
        """Compare the lines that `read` returns of the files of a case with the recorded ones."""
        case, good = self._kinds[kind]["cases"][name], self._kinds[kind]["good"]
        for before, after in case.get("replace", {}).items():
            assert before in good
            good = good.replace(before, after)
        texts = [text.replace("<good>\n", good) if isinstance(text, str) else text
                 for text in case["files"]]  # fmt: skip
        paths = files(*texts)
        try:
            lines = read(paths, **case.get("options", {}))
        except MalformedInputError as error:
            assert error.source == paths[0]
            line, hint = getattr(error, "line", None), error.hint
            lines = [f"refused in line {line}: {error.rule}" + (f"; hint: {hint}" if hint else "")]
        found = [line.encode("unicode_escape").decode() if not line.isprintable() else line
                 for line in lines]  # fmt: skip
        if "MAPDEAL_RECORD" in os.environ:
            case["found"] = found
            text = yaml.dump(self._kinds[kind], Dumper=Readable, sort_keys=False, width=1000)
            (self._folder / f"{kind}.yaml").write_text(text, "utf-8")
        else:
            assert found == case["found"]
