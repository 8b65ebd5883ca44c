// Reads a recording with @mcap/core and prints what it holds as JSON: schemas and channels by topic, messages of the pictures.
import { McapIndexedReader } from "@mcap/core";
import { ZstdCodec } from "zstd-codec";
import { open } from "node:fs/promises";

const zstd = await new Promise((resolve) => ZstdCodec.run((codec) => resolve(new codec.Simple())));
const file = await open(process.argv[2]);
const readable = {
  size: async () => BigInt((await file.stat()).size),
  read: async (offset, length) => {
    const bytes = new Uint8Array(Number(length));
    await file.read(bytes, 0, Number(length), Number(offset));
    return bytes;
  },
};
const reader = await McapIndexedReader.Initialize({
  readable,
  decompressHandlers: { zstd: (packed) => zstd.decompress(packed) },
});
const text = new TextDecoder();
const found = {};
for await (const message of reader.readMessages({ topics: process.argv.slice(3) })) {
  const channel = reader.channelsById.get(message.channelId);
  const schema = reader.schemasById.get(channel.schemaId);
  found[channel.topic] ??= {
    encoding: channel.messageEncoding,
    schemaName: schema.name,
    schemaEncoding: schema.encoding,
    schema: JSON.parse(text.decode(schema.data)),
    messages: [],
  };
  found[channel.topic].messages.push([Number(message.logTime), JSON.parse(text.decode(message.data))]);
}
console.log(JSON.stringify(found));
