// A light volume in a page, for an engine that has no such thing: its 3D textures, and GLSL that makes
// light of them. Volumes are those of `--target threejs -o NAME.ktx2`: one file, NAME_atlas.ktx2, or with
// `--packing ratio --precision unorm8` half of it, NAME_sh_l0.ktx2 and what stands beside it.
import { read } from 'ktx-parse';
import { ZSTDDecoder } from 'zstddec';

/// Texels by their number in KTX2, as src/io/README.md lists them.
const forms = {
    37: { form: 'RGBA8', array: Uint8Array },
    97: { form: 'RGBA16F', array: Uint16Array },
    109: { form: 'RGBA32F', array: Float32Array },
    123: { form: 'RGB9E5', array: Uint32Array },
};
const bands = ['l0', 'l1_y', 'l1_z', 'l1_x', 'l2_xy', 'l2_yz', 'l2_z2', 'l2_xz', 'l2_x2y2'];

async function loadTexture(url) {
    const response = await fetch(url);
    if (!response.ok)
        throw new Error(`${url}: ${response.status} ${response.statusText}`);
    const noVolume = new Error(`${url} is no light volume: give NAME_atlas.ktx2 of lpvbake bake -o NAME.ktx2 --target threejs`);
    const bytes = new Uint8Array(await response.arrayBuffer());
    if (!(bytes[1] === 0x4b && bytes[2] === 0x54 && bytes[3] === 0x58)) // "KTX"
        throw noVolume;
    const { vkFormat, pixelWidth, pixelHeight, pixelDepth, levels, keyValue } = read(bytes);
    if (!keyValue.lpvbake)
        throw noVolume;
    if (!forms[vkFormat])
        throw new Error(`${url} has texels that this page does not know (VkFormat ${vkFormat})`);
    const zstd = new ZSTDDecoder();
    await zstd.init();
    const texels = zstd.decode(levels[0].levelData, levels[0].uncompressedByteLength);
    const { form, array } = forms[vkFormat];
    return {
        form, width: pixelWidth, height: pixelHeight, depth: pixelDepth,
        texels: new array(texels.buffer, texels.byteOffset, texels.byteLength / array.BYTES_PER_ELEMENT),
        facts: JSON.parse(new TextDecoder().decode(keyValue.lpvbake).replace(/\0$/, '')),
    };
}

const number = value => Number.isInteger(value) ? value.toFixed(1) : String(value);
const vec3 = values => `vec3(${values.map(number).join(', ')})`;

/// The channels of the textures: look-ups of each, and what "sh_l1_y.r" is by them.
function channelsOf({ packing, files, grid: { dims } }) {
    const lookUps = [], channels = {};
    const add = (names, coordinates, sampler, { low, high }) => {
        const texel = `texel${lookUps.length}`;
        lookUps.push(`vec4 ${texel} = texture(volume${sampler}, ${coordinates});`);
        names.forEach((name, i) => {
            const value = `${texel}.${'xyzw'[i]}`;
            channels[name] = low ? `(${number(low[i])} + ${number(high[i] - low[i])} * ${value})` : value;
        });
    };
    if (packing === 'atlas') {
        const slices = dims[2] + 2; // of a block, one more at either end
        files[0].blocks.forEach((names, block) => {
            add(names, `vec3(at.xy / cells.xy, (at.z + ${number(block * slices + 1)}) / ${number(files[0].blocks.length * slices)})`, 0, {});
        });
    } else {
        files.filter(file => file.low).forEach((file, i) => add(file.channels, 'at / cells', i, file));
    }
    return { lookUps, channels };
}

/// `vec3 irradiance(vec3 position, vec3 normal)`, in lux, in GLSL ES 3.00. As three.js does, and as the
/// volume is fitted to, it looks half a cell before the surface.
function glslOf(facts, count) {
    const { dims, origin, cell, turn: [x, y, z, w] = [0, 0, 0, 1] } = facts.grid;
    // Columns: the lattice's axes in the world's.
    const axes = [[1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)],
                  [2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)],
                  [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)]];
    const { lookUps, channels } = channelsOf(facts);
    const isRatio = facts.packing === 'ratio';
    const coefficients = bands.map((band, k) => {
        const colours = ['r', 'g', 'b'].map(colour => channels[`sh_${band}.${colour}`] ?? '0.0');
        return `    vec3 c${k} = vec3(${colours.join(', ')})${isRatio && k > 0 ? ' * c0' : ''};`;
    });
    return `
${Array.from({ length: count }, (_, i) => `uniform highp sampler3D volume${i};`).join('\n')}
vec3 irradiance(vec3 position, vec3 normal) {
    const vec3 cells = ${vec3(dims)};
    const mat3 axes = mat3(${axes.map(vec3).join(', ')});
    vec3 at = clamp(((position - ${vec3(origin)}) / ${number(cell)} + 0.5 * normal) * axes, vec3(0.5), cells - 0.5);
    ${lookUps.join('\n    ')}
${coefficients.join('\n')}
    float x = normal.x, y = normal.y, z = normal.z;
    return max(vec3(0.0), 0.88622693 * c0 + 1.02332671 * (c1 * y + c2 * z + c3 * x)
        + 0.85808553 * (c4 * x * y + c5 * y * z + c7 * x * z)
        + 0.24770796 * c6 * (3.0 * z * z - 1.0) + 0.42904277 * c8 * (x * x - y * y));
}
`;
}

/// `textures` (each its form, width, height, depth and texels; filtered linearly, clamped at the edges)
/// are for the samplers volume0, volume1, ... of `glsl`; `facts` is the description that the files hold.
export async function loadVolume(url) {
    const first = await loadTexture(url), { facts } = first;
    if (!['atlas', 'ratio'].includes(facts.packing) || facts.convention !== 'radiance' || facts.axes !== 'gltf')
        throw new Error(`${url} is packed by ${facts.packing}: bake or convert with --target threejs`);
    const light = facts.files.filter(file => file.low ?? file.blocks);
    const textures = await Promise.all(light.map(({ file }) => {
        const beside = new URL(file, new URL(url, location)).href;
        return facts.packing === 'atlas' ? first : loadTexture(beside);
    }));
    return { textures, glsl: glslOf(facts, textures.length), facts };
}
