// What the pages of all engines share: what their address asks for, panel, camera, and how they end.

document.body.insertAdjacentHTML('beforeend', `
<style>
    body { margin: 0; overflow: hidden; background: #000; font: 14px system-ui, sans-serif; color: #eee; }
    canvas { display: block; width: 100vw; height: 100vh; touch-action: none; }
    form { position: fixed; top: 12px; left: 12px; padding: 10px 14px; border-radius: 8px; background: #000a; }
    label { margin-right: 10px; }
    #message { position: fixed; bottom: 12px; left: 12px; right: 12px; white-space: pre-wrap; }
</style>
<form id="panel">
    <label><input type="radio" name="show" value="both"> both</label>
    <label><input type="radio" name="show" value="direct"> direct</label>
    <label><input type="radio" name="show" value="indirect"> indirect</label>
    <br>
    <label>exposure <input type="range" name="exposure" min="-4" max="18" step="0.1"> <output></output> EV</label>
</form>`);
const query = new URLSearchParams(location.search);
const panel = document.getElementById('panel');

/// Says so; gives it back.
export function failed(error) {
    message.textContent = String(error);
    document.body.dataset.state = 'failed';
    return error;
}

/// camera= as lpvbake render takes it: 'inside', { azimuth, elevation, distance } of an orbit, or { eye, at, fov }.
function readCamera(text) {
    const wrong = new Error(`camera=${text} is none of X,Y,Z:TX,TY,TZ[:FOV], orbit[:AZIMUTH,ELEVATION[,DISTANCE]] and inside`);
    const numbers = (part, least, most) => {
        const values = part.split(',').map(value => value.trim() === '' ? NaN : Number(value));
        if (values.length < least || values.length > most || !values.every(Number.isFinite))
            throw wrong;
        return values;
    };
    if (text === 'inside')
        return text;
    const parts = text.split(':');
    if (parts[0] === 'orbit' && parts.length <= 2) {
        const [azimuth, elevation, distance] = parts.length > 1 ? numbers(parts[1], 2, 3) : [28.6, 20.1];
        if (Math.abs(elevation) > 90 || distance <= 0)
            throw wrong;
        return { azimuth, elevation, distance };
    }
    if (parts.length < 2 || parts.length > 3)
        throw wrong;
    const [eye, at, [fov]] = [numbers(parts[0], 3, 3), numbers(parts[1], 3, 3), numbers(parts[2] ?? '45', 1, 1)];
    if (!(fov > 0 && fov <= 175) || eye.every((value, axis) => value === at[axis]))
        throw wrong;
    return { eye, at, fov };
}

/// Where the eye of an orbit around `at` stands; `distance` where it has none.
function eyeOf(orbit, at, distance) {
    const [azimuth, elevation] = [orbit.azimuth, orbit.elevation].map(degrees => degrees * Math.PI / 180);
    const way = [Math.cos(elevation) * Math.sin(azimuth), Math.sin(elevation), Math.cos(elevation) * Math.cos(azimuth)];
    return at.map((value, axis) => value + (orbit.distance ?? distance) * way[axis]);
}

/// The name of the file at an address.
const nameOf = url => decodeURIComponent(url.split(/[?#]/)[0].split('/').pop());

/// What there is to say where the volume's scene has another name; its own may hold it.
const otherScene = (scene, volume, facts) => !volume || !facts.scene || nameOf(scene) === facts.scene ? ''
    : `${volume} was baked of ${facts.scene}, this is ${nameOf(scene)}: is it another scene?`;

/// Turns the eye around what it looks at, as the pointer is dragged, and brings it nearer.
function orbit(canvas, view, redraw) {
    canvas.addEventListener('pointermove', ({ buttons, movementX, movementY }) => {
        if (buttons === 0)
            return;
        const [x, y, z] = view.eye.map((value, axis) => value - view.at[axis]);
        const radius = Math.hypot(x, y, z);
        const turn = Math.atan2(x, z) - movementX / 200;
        const up = Math.max(-1.5, Math.min(1.5, Math.asin(y / radius) + movementY / 200));
        const way = [Math.cos(up) * Math.sin(turn), Math.sin(up), Math.cos(up) * Math.cos(turn)];
        view.eye = way.map((value, axis) => view.at[axis] + radius * value);
        redraw();
    });
    canvas.addEventListener('wheel', event => {
        event.preventDefault();
        view.eye = view.eye.map((value, axis) => view.at[axis] + (value - view.at[axis]) * 1.001 ** event.deltaY);
        redraw();
    });
}

/// The camera that the address names, else that of the file, else one outside before the volume. From
/// inside it looks along the longer side of the volume.
function viewOf(asked, given, { grid: { dims, origin, cell } }) {
    const middle = origin.map((value, axis) => value + dims[axis] * cell / 2);
    const radius = cell * Math.hypot(...dims) / 2;
    if (asked?.eye)
        return asked;
    if (asked === 'inside') {
        const way = dims[0] > dims[2] ? [1, 0, 0] : [0, 0, 1], half = 0.4 * cell * Math.max(dims[0], dims[2]);
        return { eye: middle.map((value, axis) => value + half * way[axis]), at: middle, fov: 60 };
    }
    if (asked)
        return { eye: eyeOf(asked, middle, 2.7 * radius), at: middle, fov: 45 };
    if (given) {
        const { eye, way, fov } = given;
        const ahead = way.reduce((sum, value, axis) => sum + value * (middle[axis] - eye[axis]), 0);
        return { eye, at: eye.map((value, axis) => value + Math.max(ahead, cell) * way[axis]), fov };
    }
    return { eye: middle.map((value, axis) => value + 2.7 * radius * [0.28, 0.19, 0.94][axis]), at: middle, fov: 45 };
}

/// Shows what `load(scene, volume)` makes of the two addresses: { facts, canvas, camera, draw }. The camera
/// of the file is { eye, way, fov } or null; fov is in degrees from top to bottom, all in glTF's axes.
/// `draw({ eye, at, fov, show, exposure })` draws at once; light is to be multiplied by exposure.
export async function present(load) {
    try {
        const asked = query.has('camera') ? readCamera(query.get('camera')) : null;
        if (query.has('scene') && !query.get('volume'))
            throw new Error(`volume= is missing: give NAME_atlas.ktx2 of lpvbake bake -o NAME.ktx2 --target threejs`);
        const scene = query.get('scene') ?? '../cornell_box.gltf', volume = query.get('volume') ?? '../cornell_box_atlas.ktx2';
        const { facts, canvas, camera, draw } = await load(scene, volume);
        const view = viewOf(asked, camera, facts);
        const { show, exposure } = panel.elements;
        show.value = query.get('show') ?? 'both';
        exposure.value = query.get('exposure') ?? facts.metadata.exposure ?? 6;
        panel.hidden = query.get('panel') === '0';
        const redraw = () => {
            panel.querySelector('output').value = Number(exposure.value).toFixed(1);
            draw({ ...view, show: show.value, exposure: 1 / (1.2 * 2 ** exposure.value) });
        };
        panel.addEventListener('input', redraw);
        addEventListener('resize', redraw);
        orbit(canvas, view, redraw);
        redraw();
        message.textContent = otherScene(scene, volume, facts.metadata);
        document.body.dataset.state = 'ready';
    } catch (error) {
        failed(error);
    }
}

/// The lights of the bake: type, color, intensity (lux, candela), position, direction, spot, range.
export const lightsOf = ({ metadata }) =>
    JSON.parse(metadata.lights ?? '[]').filter(light => !light.static); // the volume has the light of those

/// The mean of the sky that was baked, nits.
export const skyOf = ({ metadata }) => (metadata.sky ?? '0,0,0').split(',').map(Number);
