"""MATLAB v7.3 files, laid out as MATLAB lays them out: HDF5 with dimensions in reverse and references for what is nested."""

from __future__ import annotations

import re
import sys
import time
from itertools import pairwise

import h5py
import numpy as np
import pytest
from finding_codes import codes, found, values_of
from scipy.io import savemat

from vsalog.core.errors import ReadError
from vsalog.readers import open_reader, read

pytestmark = pytest.mark.share(2)

T = np.arange(50) / 1000
HEAD = b"MATLAB 7.3 MAT-file, Platform: GLNXA64, Created on: Mon Jan  5 10:00:00 2026 HDF5 schema 1.00 ."


class Matlab:
    """Writes values as MATLAB does: dictionaries are structures, lists cell arrays or arrays of structures."""

    def __init__(self, path, **options):
        self.path = path
        self.file = h5py.File(path, "w", userblock_size=512, **options)
        self.count = 0

    def save(self, content):
        for name, value in content.items():
            self.put(self.file, name, value)
        self.file.close()
        with self.path.open("r+b") as file:
            file.write(HEAD.ljust(124) + b"\0\x02IM")
        return self.path

    def put(self, group, name, value):
        if isinstance(value, dict):
            made = group.create_group(name)
            made.attrs["MATLAB_class"] = np.bytes_("struct")
            for key, member in value.items():
                self.put(made, key, member)
        elif isinstance(value, list) and all(isinstance(v, dict) for v in value):
            made = group.create_group(name)
            made.attrs["MATLAB_class"] = np.bytes_("struct")
            for key in value[0]:
                made.create_dataset(key, data=self.references([v[key] for v in value]), dtype=h5py.ref_dtype)
        elif isinstance(value, list):
            made = group.create_dataset(name, data=self.references(value), dtype=h5py.ref_dtype)
            made.attrs["MATLAB_class"] = np.bytes_("cell")
        elif isinstance(value, str):
            made = group.create_dataset(name, data=np.array([[ord(c)] for c in value], np.uint16))
            made.attrs["MATLAB_class"] = np.bytes_("char")
        else:
            array = np.atleast_2d(value)
            made = group.create_dataset(name, data=array.T, chunks=True, compression="gzip", fletcher32=True)
            made.attrs["MATLAB_class"] = np.bytes_("double")

    def references(self, values):
        refs = self.file.require_group("#refs#")
        out = np.empty((len(values), 1), dtype=h5py.ref_dtype)
        for i, value in enumerate(values):
            self.count += 1
            self.put(refs, f"r{self.count}", value)
            out[i, 0] = refs[f"r{self.count}"].ref
        return out


CONTENT = {
    "DEVICE": {
        "x00": {"timeJIM": T[:, None], "angle": np.sin(T)[None, :], "torque": T[:, None] * 2, "label": "soft"},
        "x10": {"time": T * 2, "torque": T * 3, "setting": 10.0},
    },
    "curve": np.arange(7.0),
    "table": np.arange(40.0).reshape(2, 20),
    "image": np.zeros((100, 200)),
    "out": {"time": T, "signals": [{"values": T + 1, "label": "a"}, {"values": T + 2, "label": "b"}]},
    "cells": [np.arange(30.0), "text", np.arange(30.0) * 2],
}


def content(recording):
    return {
        name: (channel.values.tolist(), channel.stamps.tolist(), channel.stream)
        for name, channel in recording.channels.items()
    }


def test_it_reads_as_the_same_file_of_version_5(tmp_path):
    new = Matlab(tmp_path / "log").save(CONTENT)
    (tmp_path / "old").mkdir()
    as_arrays = dict(CONTENT)
    as_arrays["out"] = {"time": T, "signals": np.array(CONTENT["out"]["signals"], dtype=object)}
    as_arrays["cells"] = np.array(CONTENT["cells"], dtype=object)
    old = tmp_path / "old" / "log"
    savemat(old, as_arrays, appendmat=False)
    mine, theirs = read(new), read(old)
    assert content(mine) == content(theirs)
    assert mine.unread.keys() == theirs.unread.keys()
    assert mine.format == "matlab"
    np.testing.assert_array_equal(mine.channel("out.b").values, T + 2)
    np.testing.assert_array_equal(mine.channel("DEVICE.x10.torque").stamps, np.arange(50) * 2_000_000)
    assert mine.channels.keys() == open_reader(new).catalogue().channels.keys()


def test_links_to_other_places_are_not_followed(tmp_path):
    with h5py.File(tmp_path / "secret", "w") as file:
        file["x"] = np.arange(5.0)
    log = Matlab(tmp_path / "log")
    log.file["linked"] = h5py.ExternalLink(str(tmp_path / "secret"), "/x")
    log.file["soft"] = h5py.SoftLink("/y")
    file = log.file
    layout = h5py.VirtualLayout(shape=(5,), dtype=float)
    layout[:] = h5py.VirtualSource(str(tmp_path / "secret"), "x", shape=(5,))
    file.create_virtual_dataset("virtual", layout).attrs["MATLAB_class"] = np.bytes_("double")
    raw = file.create_dataset("raw", (5,), float, external=[(str(tmp_path / "secret"), 0, 40)])
    raw.attrs["MATLAB_class"] = np.bytes_("double")
    file["round"] = file["/"]
    path = log.save({"y": np.arange(6.0)})
    recording = read(path)
    assert "y" in recording.channels
    assert all(values.size == 6 for values in (c.values for c in recording.channels.values()))
    (damage,) = found(recording, "recording.variables_damaged")
    assert "in another file" in damage.evidence["reason"]


def test_groups_in_several_places_are_walked_once(tmp_path):
    """Thirty groups, each twice in the one before, are a billion structures; a group in itself has no end."""
    log = Matlab(tmp_path / "log")
    groups = [log.file.create_group(f"#refs#/g{i}") for i in range(30)]
    for outer, inner in pairwise(groups):
        outer["a"] = outer["b"] = inner
    log.put(groups[-1], "v", T)
    log.file["fan"] = groups[0]
    log.put(log.file, "turn", {"x": T})
    log.file["turn/self"] = log.file["turn"]
    begin = time.process_time()
    recording = read(log.save({"y": T}))
    assert time.process_time() - begin < 5
    deep = "fan." + "a." * 29 + "v"
    assert recording.channels.keys() == {deep, "turn.x", "y"}
    (damage,) = found(recording, "recording.variables_damaged")
    assert "several places" in damage.evidence["reason"]
    assert damage.value == 30


def test_what_can_be_no_variable_takes_no_other_along(tmp_path):
    log = Matlab(tmp_path / "log")
    log.file[b"no \xff text"] = T
    log.file.create_dataset("nothing", data=h5py.Empty("f8")).attrs["MATLAB_class"] = np.bytes_("double")
    half = log.file.create_dataset("half", data=np.array([[104], [0xD83D]], np.uint16))  # of a character beyond 16 bits
    half.attrs["MATLAB_class"] = np.bytes_("char")
    recording = read(log.save({"y": T}))
    assert list(recording.channels) == ["y"]
    assert recording.unread == {"half": "text"}
    assert values_of(recording, "recording.variables_damaged") == [2]


def test_absurd_sizes_are_refused(tmp_path):
    log = Matlab(tmp_path / "log")
    huge = log.file.create_dataset("huge", (10**12,), float, chunks=(1000,))
    huge.attrs["MATLAB_class"] = np.bytes_("double")
    recording = read(log.save({"y": np.arange(6.0)}))
    assert list(recording.channels) == ["y"]
    (damage,) = found(recording, "recording.variables_damaged")
    assert "announces 8000000000000 bytes" in damage.evidence["reason"]


def test_damage_is_no_crash_and_no_wrong_value(tmp_path):
    # MATLAB's own layout has checksums for values at most; the newer one has them for what describes the values, too.
    path = Matlab(tmp_path / "log", libver="latest").save(CONTENT)
    raw, sound = path.read_bytes(), content(read(path))
    rng = np.random.default_rng(1)
    found = 0
    for k in range(60):
        bad = bytearray(raw)
        if k % 4 == 0:
            del bad[int(rng.integers(600, len(bad))) :]
        else:
            bad[int(rng.integers(600, len(bad)))] ^= int(rng.integers(1, 256))
        path.write_bytes(bad)
        try:
            recording = read(path)
        except ReadError:
            continue
        for name in recording.channels.keys() & sound.keys():
            found += 1
            assert recording.channel(name).values.tolist() == sound[name][0]
    assert found > 100


def test_without_h5py_it_is_said_what_to_do(tmp_path, monkeypatch):
    path = Matlab(tmp_path / "log").save({"y": np.arange(6.0)})
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(ReadError, match=r"vsalog\[matlab\]") as caught:
        read(path)
    assert "-v7" in str(caught.value)


def test_a_changed_byte_never_takes_samples_away_without_a_word(tmp_path):
    """Nothing vouches for what describes the numbers in HDF5's older layouts, which MATLAB writes."""
    small = {name: value for name, value in CONTENT.items() if name != "image"}
    path = Matlab(tmp_path / "log").save(small)
    raw, sound, said = path.read_bytes(), content(read(path)), read(path).findings
    rng, unseen = np.random.default_rng(11), 0
    # Most of the file is empty: only bytes that are something, or lie next to these, are changed.
    filled = np.flatnonzero(np.convolve(np.frombuffer(raw, np.uint8) > 0, np.ones(5), "same"))
    for place in rng.choice(filled[filled > 512], 700, replace=False).tolist():
        bad = bytearray(raw)
        bad[place] ^= int(rng.integers(1, 256))
        path.write_bytes(bad)
        try:
            recording = read(path)
        except ReadError:
            continue
        found = content(recording)
        if all(one in said for one in recording.findings):
            lost = {name for name in sound.keys() - found.keys() if not name.startswith(tuple(recording.unread))}
            assert len(lost) <= len(found.keys() - sound.keys()), place  # they may have another name
            unseen += any(found[name][0] != sound[name][0] for name in found.keys() & sound.keys())
    assert not unseen


def test_a_dataset_without_values_is_no_row_of_zeros(tmp_path):
    log = Matlab(tmp_path / "log")
    chunked = log.file.create_dataset("y", shape=(20, 1), chunks=(10, 1), dtype="f8")
    chunked[:10] = 1.0
    for made in (chunked, log.file.create_dataset("z", shape=(20, 1), dtype="f8")):
        made.attrs["MATLAB_class"] = np.bytes_("double")
    recording = read(log.save({"x": T}))
    assert list(recording.channels) == ["x"]
    assert values_of(recording, "recording.variables_damaged") == [2]


def test_members_that_are_listed_but_not_found_are_reported(tmp_path):
    path = Matlab(tmp_path / "log").save(CONTENT)
    raw, sound, told = path.read_bytes(), read(path), 0
    for tree in re.finditer(b"TREE\0\0", raw):  # groups; the first name that the tree leads to lies far off
        bad = bytearray(raw)
        bad[tree.start() + 25] ^= 254
        path.write_bytes(bad)
        try:
            recording = read(path)
        except ReadError:  # that of the file itself
            continue
        lost = sound.channels.keys() - recording.channels.keys()
        assert not lost or "recording.variables_damaged" in codes(recording)
        told += bool(lost)
    assert told > 1
