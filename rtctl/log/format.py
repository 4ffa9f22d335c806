"""What a log is made of: its topics, its two kinds of message, and its one error.

A file has the profile ``ros2``, and every channel is CDR described by a ros2msg text: rows are the very bytes of
their table's dtype, everything else is JSON in a ``std_msgs/msg/String``. Channels encoded as JSON would read more
nicely in some viewers, but rosbags refuses a whole file for a single one that is described by a JSON schema.
"""

import struct
from typing import Any

import msgspec
import numpy as np

from hal.errors import RtctlError
from hal.signals import ROS_TYPES
from rtctl.record import CDR_HEADER

PROFILE = "ros2"
HEADER_NAME = "rtctl"
CONTROLLER = "/controller"
TRUTH = "/truth"
EVENTS = "/events"
PARAMETERS = "/parameters"
PLANS = "/plans"
HASH = "/hash"
BLACKBOX = "/blackbox"
"""Opened by its first message: most runs have none."""
JSON_TOPICS = (EVENTS, PARAMETERS, PLANS, HASH)

ROW_SCHEMA = "rtctl/msg/{}"
STRING_SCHEMA = "std_msgs/msg/String"
STRING_MESSAGE = "string data\n"

NUMPY_TYPES = {ros: code for code, ros in ROS_TYPES.items()}


class LogError(RtctlError):
    """A log cannot be written or read."""

    exit_code = 6


def encode_json(payload: Any) -> bytes:
    """A CDR string holding `payload`, plain Python values; NaN becomes null."""
    text = msgspec.json.encode(payload)
    return CDR_HEADER + struct.pack("<I", len(text) + 1) + text + b"\0"


def decode_json(data: bytes) -> Any:
    """The payload back from a CDR string."""
    (length,) = struct.unpack_from("<I", data, len(CDR_HEADER))
    start = len(CDR_HEADER) + 4
    return msgspec.json.decode(data[start : start + length - 1])


def dtype_of(message: str) -> np.dtype:
    """The dtype of the rows a flat ros2msg text describes, so that old logs open whatever today's table says.

    Arrays come back with one dimension, as the text knows no other.

    Raises:
        LogError: the text is not flat, or names a type that no table has.
    """
    fields: list[tuple] = []
    for line in message.splitlines():
        words = line.partition("#")[0].split()
        if not words:
            continue
        kind, bracket, count = words[0].partition("[")
        size = count.removesuffix("]")
        if len(words) != 2 or kind not in NUMPY_TYPES or (bracket and not size.isdigit()):
            raise LogError(
                "a message of this log is not a flat record", value=line.strip(), bound=" | ".join(NUMPY_TYPES)
            )
        fields.append((words[1], NUMPY_TYPES[kind], (int(size),)) if bracket else (words[1], NUMPY_TYPES[kind]))
    return np.dtype(fields)
