"""Checksums of files and documents, against the system's own ``sha256sum`` and by hand."""

import hashlib
import json
import math
import subprocess

import pytest

from designopt.io.checksums import checksum_holds, file_checksum, with_checksum

DOCUMENT = {"b": [1, 2.5, None, "ü"], "a": {"z": True, "y": "x"}}


def test_the_checksum_of_a_file_is_that_of_sha256sum(tmp_path):
    path = tmp_path / "some file"
    path.write_bytes(bytes(range(256)) * 999)
    found = subprocess.run(["sha256sum", path], capture_output=True, text=True, check=True)
    assert file_checksum(path) == found.stdout.split()[0]


def test_the_checksum_of_a_document_is_over_sorted_json_without_blanks():
    text = '{"a":{"y":"x","z":true},"b":[1,2.5,null,"ü"]}'
    sealed = with_checksum(DOCUMENT)
    assert sealed["checksum"] == hashlib.sha256(text.encode()).hexdigest()
    assert list(sealed) == ["b", "a", "checksum"]
    # However it is laid out in a file, it holds.
    assert checksum_holds(json.loads(json.dumps(sealed, indent=3, sort_keys=True)))


@pytest.mark.parametrize("change", [{"b": []}, {"c": 1}, {"checksum": "0" * 64}, {"a": math.nan}])
def test_a_document_that_was_changed_has_not_its_checksum(change):
    assert not checksum_holds(with_checksum(DOCUMENT) | change)
    assert not checksum_holds(DOCUMENT)


def test_numbers_that_json_lacks_are_refused():
    with pytest.raises(ValueError, match="JSON compliant"):
        with_checksum({"a": math.inf})
