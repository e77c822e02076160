// What ktx-parse and three.js' Zstandard decoder make of a KTX2 file: its facts as JSON on standard
// output, its texels to a file.
//
//     node ktx2.mjs KTX_PARSE THREE FILE.ktx2 TEXELS
import { readFileSync, writeFileSync } from 'node:fs';

const [parser, three, file, texels] = process.argv.slice(2);
const { read } = await import(`${parser}/dist/index.mjs`);
const { ZSTDDecoder } = await import(`${three}/examples/jsm/libs/zstddec.module.js`);
const { keyValue, levels: [level], dataFormatDescriptor: [descriptor], ...header } =
    read(new Uint8Array(readFileSync(file)));
const decoder = new ZSTDDecoder();
await decoder.init();
writeFileSync(texels, decoder.decode(level.levelData, level.uncompressedByteLength));
console.log(JSON.stringify({
    ...header, descriptor, keys: Object.keys(keyValue), bytes: level.uncompressedByteLength,
    description: keyValue.lpvbake && JSON.parse(new TextDecoder().decode(keyValue.lpvbake).replace(/\0$/, '')),
}));
