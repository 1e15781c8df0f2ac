"""Takes of both versions hold what is written beside them; a second reader finds the same in version 2."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import formats
from formats.archive import read_take, verify_take, write_take
from tests.formats.test_archive import a_take
from tests.formats.tiny_reader import read
from tests.formats.vectors.make import a_take_with_everything, plain

HERE = Path(__file__).parent / "vectors"


def nearly(found, wanted):
    """Equal to 1e-9, as JSON numbers; null stands for a number that is not finite, or a position that was not seen."""
    if isinstance(wanted, dict):
        return all(nearly(found[key], value) for key, value in wanted.items())
    if isinstance(wanted, list):
        return len(found) == len(wanted) and all(nearly(a, b) for a, b in zip(found, wanted, strict=True))
    if wanted is None:
        return found is None or not math.isfinite(found)
    return abs(found - wanted) < 1e-9 if isinstance(wanted, float) else found == wanted


@pytest.mark.parametrize("version", [1, 2])
def test_a_take_of_either_version_holds_what_is_written_beside_it(version):
    path = HERE / f"version-{version}.mcap"
    assert verify_take(path).is_sound
    assert nearly(plain(read_take(path)), json.loads((HERE / f"version-{version}.json").read_text()))


def test_the_take_of_version_1_is_what_its_writer_was_given():
    """Places to half of 0.1 mm: the same drawn take, sin(3 t) and 3 mm of noise, made anew."""
    from tests.formats.test_archive import a_take

    back, take = read_take(HERE / "version-1.mcap"), a_take(frames=70)
    assert np.nanmax(np.abs(back.points - take.points)) <= 0.5e-4 + 1e-12
    assert np.array_equal(back.points_valid, take.points_valid)
    np.testing.assert_allclose(back.points_sd[back.points_valid], 0.003)


def test_a_second_reader_finds_the_same():
    found = read((HERE / "version-2.mcap").read_bytes())
    wanted = json.loads((HERE / "version-2.json").read_text())
    assert nearly(found["frames"], wanted["frames"])
    assert nearly(found["scans"], wanted["scans"])
    assert found["header"]["take_id"] == "a"
    assert found["end"] == {"frames": 70, "blocks": 3, "scans": 2, "from": 250_000, "until": 9_550_000}


def test_the_writer_writes_what_it_wrote(tmp_path):
    path = write_take(tmp_path / "a.mcap", a_take_with_everything())
    assert nearly(plain(read_take(path)), json.loads((HERE / "version-2.json").read_text()))
    assert nearly(read(path.read_bytes())["frames"], json.loads((HERE / "version-2.json").read_text())["frames"])


def test_the_schema_of_the_messages_is_the_specification(tmp_path):
    """In the file that was kept, and in one that is written now."""
    from mcap.reader import make_reader

    written = write_take(tmp_path / "a.mcap", a_take_with_everything())
    for path in (HERE / "version-2.mcap", written):
        with path.open("rb") as file:
            reader = make_reader(file)
            met = [(schema, channel) for schema, channel, _ in reader.iter_messages()]
            assert (reader.get_header().profile, reader.get_header().library) == ("hangtime-take/2", "hangtime")
        assert {(channel.topic, channel.message_encoding) for _, channel in met} == {
            (topic, "msgpack") for topic in ("/header", "/block", "/surface", "/end")
        }
        (schema,) = {schema.id: schema for schema, _ in met}.values()
        assert (schema.name, schema.encoding) == ("hangtime-take", "text/markdown")
        assert schema.data.startswith(b"# Take archives, version 2\n")
    assert schema.data == (Path(formats.__file__).parent / "SPEC.md").read_bytes()


def test_other_programs_see_each_message_at_its_time(tmp_path):
    """MCAP's log time is in nanoseconds. Blocks of one second have the time of their first frame."""
    from mcap.reader import make_reader

    take = replace(a_take(75), time=2.5 + np.arange(75) / 30)
    with write_take(tmp_path / "a.mcap", take).open("rb") as file:
        met = [(channel.topic, message.log_time) for _, channel, message in make_reader(file).iter_messages()]
    first = [int(time) for topic, time in met if topic == "/block"]
    assert first[0] == 2_500_000_000
    assert np.diff(first) == pytest.approx([1e9 * 31 / 30, 1e9 * 31 / 30], abs=1e3)
    assert dict(met)["/end"] == pytest.approx(1e9 * take.time[-1], abs=1e3)
