"""Bags that are made to take memory."""

import struct
import sys

import pytest
from rosbags.rosbag2 import storage_mcap

from mrp_sumo.bags import reader
from mrp_sumo.bags.reader import read_fleet_log
from mrp_sumo.errors import MrpSumoError

MAGIC = b"\x89MCAP0\r\n"
METADATA = """\
rosbag2_bagfile_information:
  version: 8
  storage_identifier: mcap
  relative_file_paths: [bag.mcap]
  duration: {nanoseconds: 10}
  starting_time: {nanoseconds_since_epoch: 0}
  message_count: 1
  compression_format: ''
  compression_mode: ''
  topics_with_message_count: []
  files: []
"""


def record(kind, content):
    return bytes([kind]) + struct.pack("<Q", len(content)) + content


def text(of):
    return struct.pack("<I", len(of)) + of.encode()


def bomb(size, says):
    """An MCAP file with one chunk of so many zeros, which says that it is as large as `says`."""
    compressor = storage_mcap.zstd.ZstdCompressor()
    packed = b"".join(compressor.compress(bytes(2**20)) for _ in range(size // 2**20)) + compressor.flush()
    chunk = struct.pack("<QQQI", 0, 10, says, 0) + text("zstd") + struct.pack("<Q", len(packed)) + packed
    head = MAGIC + record(1, text("ros2") + text("x"))
    body = head + record(6, chunk) + record(15, struct.pack("<I", 0))
    index = struct.pack("<QQQQIQ", 0, 10, len(head), len(record(6, chunk)), 0, 0) + text("zstd") + struct.pack("<QQ", len(packed), says)
    statistics = struct.pack("<QHIIIIQQI", 1, 1, 1, 0, 0, 1, 0, 10, 0)
    return body + record(8, index) + record(11, statistics) + record(2, struct.pack("<QQI", len(body), 0, 0)) + MAGIC


@pytest.mark.skipif(sys.platform != "linux", reason="limits memory as only Linux can tell it")
@pytest.mark.parametrize("says", [2**29, 1000])
def test_chunk_that_swells_is_refused_before_it_has_the_memory(tmp_path, monkeypatch, says):
    monkeypatch.setattr(reader, "LEAST_BYTES", 2**27)
    (tmp_path / "metadata.yaml").write_text(METADATA)
    (tmp_path / "bag.mcap").write_bytes(bomb(2**29, says))
    with pytest.raises(MrpSumoError, match=r"takes more memory than a bag of 0\.. MB may"):
        read_fleet_log(tmp_path)
