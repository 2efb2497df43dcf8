// What Foxglove's own readers find in MCAP files of ROS 2 messages, as JSON on standard output:
//
//     NODE_PATH=<folder>/node_modules node read_log.cjs FILE...
//
// One object per file. Every number is written as the 16 hexadecimal digits of its double, so that no bit is lost on
// the way: JSON has neither -0 nor NaN.

"use strict";

const { createHash } = require("crypto");
const { readFile } = require("fs/promises");
const { McapIndexedReader, McapStreamReader } = require("@mcap/core");
const { loadDecompressHandlers } = require("@mcap/support");
const { parse } = require("@foxglove/rosmsg");
const { ros2jazzy } = require("@foxglove/rosmsg-msgs-common");
const { MessageReader } = require("@foxglove/rosmsg2-serialization");

const double = new DataView(new ArrayBuffer(8));

function bits(number) {
  double.setFloat64(0, Number(number));
  return double.getBigUint64(0).toString(16).padStart(16, "0");
}

function exact(value) {
  if (typeof value === "number" || typeof value === "bigint") {
    return bits(value);
  }
  if (value instanceof Uint8Array) {
    return Buffer.from(value).toString("hex");
  }
  if (ArrayBuffer.isView(value)) {
    return Array.from(value, bits).join("");
  }
  if (Array.isArray(value)) {
    return value.map(exact);
  }
  if (typeof value === "object") {
    return Object.fromEntries(Object.entries(value).map(([name, part]) => [name, exact(part)]));
  }
  return value; // string, boolean
}

function digest(data) {
  return createHash("sha256").update(data).digest("hex");
}

// Names of the types in a schema that Foxglove knows otherwise from ROS 2 Jazzy, or not at all.
function unlikeJazzy(schemaName, definitions) {
  const short = (name) => name.replace("/msg/", "/");
  const fields = (definition) =>
    JSON.stringify(definition?.definitions.map((field) => ({ ...field, type: short(field.type) })));
  return definitions
    .map((definition) => [short(definition.name ?? schemaName), definition])
    .filter(([name, definition]) => fields(definition) !== fields(ros2jazzy[name]))
    .map(([name]) => name);
}

function text(data) {
  return new TextDecoder("utf-8", { fatal: true }).decode(data);
}

// By the index, as Foxglove opens a file: messages in order of log time.
async function indexed(data, decompressHandlers) {
  const readable = {
    size: async () => BigInt(data.length),
    read: async (offset, size) => new Uint8Array(data.subarray(Number(offset), Number(offset + size))),
  };
  const reader = await McapIndexedReader.Initialize({ readable, decompressHandlers });
  const found = { profile: reader.header.profile, schemas: {}, channels: {}, metadata: {}, messages: [] };
  const decoders = new Map();
  for (const [id, schema] of reader.schemasById) {
    const definitions = parse(text(schema.data), { ros2: true });
    decoders.set(id, new MessageReader(definitions, { timeType: "sec,nanosec" }));
    found.schemas[schema.name] = { encoding: schema.encoding, unlikeJazzy: unlikeJazzy(schema.name, definitions) };
  }
  for (const channel of reader.channelsById.values()) {
    found.channels[channel.topic] = {
      encoding: channel.messageEncoding,
      schema: reader.schemasById.get(channel.schemaId).name,
      metadata: Object.fromEntries(channel.metadata),
      count: Number(reader.statistics.channelMessageCounts.get(channel.id) ?? 0n),
    };
  }
  for await (const record of reader.readMetadata()) {
    found.metadata[record.name] = Object.fromEntries(record.metadata);
  }
  found.compressions = [...new Set(reader.chunkIndexes.map((chunk) => chunk.compression))];
  for await (const message of reader.readMessages({ validateCrcs: true })) {
    const channel = reader.channelsById.get(message.channelId);
    found.messages.push([
      channel.topic,
      String(message.logTime),
      String(message.publishTime),
      digest(message.data),
      exact(decoders.get(channel.schemaId).readMessage(message.data)),
    ]);
  }
  return found;
}

// As a stream: messages in the order of the file, no index used.
function streamed(data, decompressHandlers) {
  const reader = new McapStreamReader({ decompressHandlers, validateCrcs: true });
  const topics = new Map();
  const messages = [];
  reader.append(data);
  for (let record = reader.nextRecord(); record; record = reader.nextRecord()) {
    if (record.type === "Channel") {
      topics.set(record.id, record.topic);
    } else if (record.type === "Message") {
      messages.push([topics.get(record.channelId), String(record.logTime), String(record.publishTime), digest(record.data)]);
    }
  }
  return { messages, done: reader.done() };
}

async function main(paths) {
  const decompressHandlers = await loadDecompressHandlers();
  const found = [];
  for (const path of paths) {
    const data = await readFile(path);
    found.push({ ...(await indexed(data, decompressHandlers)), streamed: streamed(data, decompressHandlers) });
  }
  process.stdout.write(JSON.stringify(found));
}

main(process.argv.slice(2)).catch((error) => {
  console.error(error);
  process.exitCode = 1;
});
