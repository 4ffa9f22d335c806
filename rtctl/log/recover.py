"""Makes a whole file of a log that was cut short or damaged."""

from dataclasses import dataclass
from pathlib import Path

from mcap.opcode import Opcode
from mcap.records import Channel, Metadata, Schema
from mcap.writer import Writer

from rtctl.log.format import CONTROLLER, PROFILE, STRING_SCHEMA, LogError, dtype_of
from rtctl.log.reader import ROW_START, mapped
from rtctl.log.scan import MESSAGE_HEAD, Definitions, Scan, parse
from rtctl.log.writer import LIBRARY

CHUNK_BYTES = 192 * 1024


@dataclass(frozen=True)
class RecoverReport:
    """What a recovery kept: rows of all tables, bytes in no complete record, last tick of the controller."""

    rows: int
    dropped_bytes: int
    last_tick: int | None


def recover(source: str | Path, target: str | Path) -> RecoverReport:
    """Rewrite every complete record of `source` into the new file `target`, with index and footer.

    Any damage is survived, down to an empty source; a row is kept exactly if its chunk is whole.

    Raises:
        LogError: the source cannot be read, or the target exists or cannot be written.
    """
    data = mapped(Path(source))
    try:
        with Path(target).open("xb") as file:
            return _rewrite(data, Writer(file, chunk_size=CHUNK_BYTES))
    except FileExistsError:
        raise LogError("the target exists", value=str(target), remedy="choose another name") from None
    except OSError as error:
        raise LogError("cannot write the recovered log", value=f"{target}: {error.strerror}") from error


def _rewrite(data: memoryview, writer: Writer) -> RecoverReport:
    definitions = Definitions()
    for opcode, body in Scan(data):
        definitions.note(opcode, body)
    described = definitions.described()
    tick_at = _tick_offset(described)
    writer.start(profile=PROFILE, library=LIBRARY)
    scan = Scan(data)
    numbers: dict[int, int] | None = None
    rows, last_tick = 0, None
    for opcode, body in scan:
        if opcode == Opcode.METADATA:
            metadata = parse(Metadata, body)
            writer.add_metadata(metadata.name, metadata.metadata)
        if opcode != Opcode.MESSAGE:
            continue
        numbers = numbers or _register(writer, described)
        channel, sequence, log_time, publish_time = MESSAGE_HEAD.unpack_from(body)
        if channel not in numbers:
            continue
        writer.add_message(numbers[channel], log_time, bytes(body[MESSAGE_HEAD.size :]), publish_time, sequence)
        rows += described[channel][1].name != STRING_SCHEMA
        if channel in tick_at:
            start = ROW_START + tick_at[channel]
            last_tick = int.from_bytes(body[start : start + 8], "little", signed=True)
    if numbers is None:
        _register(writer, described)
    writer.finish()
    return RecoverReport(rows, scan.lost_bytes, last_tick)


def _register(writer: Writer, described: dict[int, tuple[Channel, Schema]]) -> dict[int, int]:
    """Define everything anew; old channel number -> new one."""
    schemas = {schema.id: schema for _, schema in described.values()}
    new = {i: writer.register_schema(s.name, s.encoding, s.data) for i, s in schemas.items()}
    return {i: writer.register_channel(c.topic, c.message_encoding, new[s.id]) for i, (c, s) in described.items()}


def _tick_offset(described: dict[int, tuple[Channel, Schema]]) -> dict[int, int]:
    """Channel of the controller's rows -> where in a row the tick is."""
    return {
        i: dtype_of(schema.data.decode()).fields["tick"][1]  # type: ignore[index]
        for i, (channel, schema) in described.items()
        if channel.topic == CONTROLLER
    }
