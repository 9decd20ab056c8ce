"""A batch's folder of this layout, and of the next one."""

import msgspec
import pytest

from vsalog.batch.records import Settings
from vsalog.batch.run import MANIFEST, Asked, _check_place
from vsalog.batch.storage import Store
from vsalog.core.errors import BatchError

ASKED = Asked(logs=(), out="", settings=Settings(), resume=True)


def place(folder, version):
    manifest = {"version": version, "do": "estimate", "asked": ASKED.settings.digest()}
    (folder / MANIFEST).write_bytes(msgspec.json.encode(manifest))
    return Store(str(folder))


def test_a_batch_of_the_first_layout_goes_on(tmp_path):
    assert _check_place(place(tmp_path, 1), ASKED).do == "estimate"


@pytest.mark.parametrize("version", [0, 2])
def test_a_batch_of_another_layout_is_left_alone(tmp_path, version):
    with pytest.raises(BatchError, match="another version"):
        _check_place(place(tmp_path, version), ASKED)
