"""info and recover on every file of the MCAP conformance suite: none is damaged, and nothing of it is lost."""

from __future__ import annotations

import io

import pytest
from conformance import CONTENTS, DIGEST, File, digest, files
from mcap import records
from mcap.reader import NonSeekingReader

from tire_dynamics.bag import BagReader
from tire_dynamics.cli.info import info
from tire_dynamics.cli.recover import recover

SUITE = list(files())


def test_the_files_are_those_that_are_published():
    assert len(SUITE) == 416
    assert digest(SUITE) == DIGEST


def messages_of(data: bytes) -> list[tuple]:
    """Everything about the messages of a file, as the mcap library reads it."""
    rows = NonSeekingReader(io.BytesIO(data)).iter_messages(log_time_order=False)
    return [
        (
            *(schema and (schema.name, schema.encoding, schema.data) or ("", "", b"")),
            *(channel.topic, channel.message_encoding, tuple(channel.metadata.items())),
            *(message.log_time, message.publish_time, message.sequence, message.data),
        )
        for schema, channel, message in rows
    ]


def sent(file: File) -> list[tuple]:
    """The same of what a file was made from."""
    [schema] = file.of(records.Schema) or [records.Schema(0, b"", "", "")]
    [channel] = file.of(records.Channel) or [None]
    return [
        (
            *(schema.name, schema.encoding, schema.data),
            *(channel.topic, channel.message_encoding, tuple(channel.metadata.items())),
            *(message.log_time, message.publish_time, message.sequence, message.data),
        )
        for message in file.of(records.Message)
    ]


@pytest.mark.slow
@pytest.mark.parametrize("content", CONTENTS)
def test_every_file_is_right_in_info_and_recover(tmp_path, content):
    some = [file for file in SUITE if file.name.split("-")[0] == content]
    assert some
    for file in some:
        path = tmp_path / "in.mcap"
        path.write_bytes(file.data)
        expected = sent(file)
        times = [row[-4] for row in expected]

        said = info(path)
        assert said["damage"] is None and said["repair"] is None, file.name
        assert said["messages"] == len(expected), file.name
        topics = [(one["name"], one["type"], one["messages"]) for one in said["topics"]]
        assert topics == ([("example", expected[0][0], len(expected))] if expected else []), file.name
        assert (said["begin_ns"], said["end_ns"]) == ((min(times), max(times)) if times else (None, None)), file.name
        metadata = {record.name: record.metadata for record in file.of(records.Metadata)}
        # Of a file without an index of them, metadata records are found only where it is walked through.
        assert said["metadata"] == metadata or (not said["metadata"] and "mdx" not in file.features), file.name

        account = recover(path, tmp_path / "out", force=True, quiet=True)
        attachments = len(file.of(records.Attachment))
        assert account.kept == ({"example": len(expected)} if expected else {}), file.name
        assert not account.reasons and not account.gaps and not account.bytes_skipped, file.name
        assert account.dropped == ({"attachments, which are not copied": attachments} if attachments else {})
        assert account.whole == (attachments == 0), file.name
        assert account.expected == (len(expected) if "st" in file.features else None), file.name
        [whole] = (tmp_path / "out").glob("*.mcap")
        assert messages_of(whole.read_bytes()) == expected, file.name
        got = {name: record for name, record in BagReader(whole).metadata.items() if name != "rosbag2"}
        assert got == metadata, file.name
