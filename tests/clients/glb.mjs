// What gltf-validator says of a file, which may refer to no other: its report as JSON.
//
//     node glb.mjs GLTF_VALIDATOR FILE.glb
import { readFileSync } from 'node:fs';

const [package_, file] = process.argv.slice(2);
const { validateBytes } = await import(`${package_}/module.mjs`);
const report = await validateBytes(new Uint8Array(readFileSync(file)), {
    maxIssues: 0, externalResourceFunction: uri => Promise.reject(`refers to ${uri}`),
});
console.log(JSON.stringify(report));
