// Reads a recording with the independent reader @mcap/core and decodes its rows with protobufjs by the schemas in it:
//   npm install @mcap/core @mcap/nodejs @mcap/support protobufjs && node mcap_core.mjs FILE.mcap
import { open } from "node:fs/promises";
import { McapIndexedReader } from "@mcap/core";
import { FileHandleReadable } from "@mcap/nodejs";
import { loadDecompressHandlers } from "@mcap/support";
import protobuf from "protobufjs";
import descriptor from "protobufjs/ext/descriptor/index.js";

const path = process.argv[2];
const handle = await open(path, "r");
const reader = await McapIndexedReader.Initialize({
  readable: new FileHandleReadable(handle),
  decompressHandlers: await loadDecompressHandlers(),
});
const decoders = new Map();
for (const channel of reader.channelsById.values()) {
  const schema = reader.schemasById.get(channel.schemaId);
  if (channel.messageEncoding === "json") {
    JSON.parse(new TextDecoder().decode(schema.data));
    decoders.set(channel.id, (data) => JSON.parse(new TextDecoder().decode(data)));
  } else {
    const root = protobuf.Root.fromDescriptor(descriptor.FileDescriptorSet.decode(schema.data));
    const type = root.lookupType(schema.name);
    decoders.set(channel.id, (data) => type.toObject(type.decode(data), { longs: Number, defaults: true }));
  }
}
let last = 0n, messages = 0;
const counts = new Map(), samples = new Map();
for await (const message of reader.readMessages({ validateCrcs: true })) {
  if (message.logTime < last) throw new Error(`message ${messages} goes back in time`);
  last = message.logTime;
  const channel = reader.channelsById.get(message.channelId);
  const decoded = decoders.get(channel.id)(message.data);
  counts.set(channel.topic, (counts.get(channel.topic) ?? 0) + 1);
  if (counts.get(channel.topic) === 100) samples.set(channel.topic, decoded);
  messages++;
}
for (const [topic, count] of [...counts].sort()) {
  const stated = reader.statistics.channelMessageCounts.get([...reader.channelsById.values()].find((c) => c.topic === topic).id);
  if (BigInt(count) !== stated) throw new Error(`${topic}: ${count} messages read, ${stated} stated`);
  console.log(`${topic}: ${count} messages`);
}
const names = new Set();
for await (const attachment of reader.readAttachments()) names.add(attachment.name);
console.log(`attachments: ${[...names].join(", ")}`);
console.log(`one row of /arm: ${JSON.stringify(samples.get("/arm"), (_, v) => (typeof v === "bigint" ? Number(v) : v))}`);
console.log(`${messages} messages read and decoded in order of time, checksums right`);
