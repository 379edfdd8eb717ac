from pathlib import Path

import pytest

from mapdeal.errors import MalformedInputError
from mapdeal.files.json_values import JsonValue


def test_optional_values_may_be_missing_or_null_but_not_of_another_type():
    document = JsonValue(Path("plan.json"), {"steps": 7, "name": None})
    keys = ("steps", "name", "missing")
    assert [document.optional(key, JsonValue.integer) for key in keys] == [7, None, None]
    with pytest.raises(MalformedInputError, match=r"plan\.json: steps"):
        document.optional("steps", JsonValue.text)
