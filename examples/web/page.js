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

/// The camera that the address names, else that of the file, else one outside before the volume.
function viewOf(given, { grid: { dims, origin, cell } }) {
    if (query.has('camera')) {
        const [eye, at, fov] = query.get('camera').split(':').map(part => part.split(',').map(Number));
        return { eye, at, fov: fov ? fov[0] : 45 };
    }
    const middle = origin.map((value, axis) => value + dims[axis] * cell / 2);
    if (given) {
        const { eye, way, fov } = given;
        const ahead = way.reduce((sum, value, axis) => sum + value * (middle[axis] - eye[axis]), 0);
        return { eye, at: eye.map((value, axis) => value + Math.max(ahead, cell) * way[axis]), fov };
    }
    const radius = cell * Math.hypot(...dims) / 2;
    return { eye: middle.map((value, axis) => value + 2.7 * radius * [0.28, 0.19, 0.94][axis]), at: middle, fov: 45 };
}

/// Shows what `load(scene, volume)` makes of the two addresses: { facts, canvas, camera, draw }. The camera
/// of the file is { eye, way, fov } or null; fov is in degrees from top to bottom, all in glTF's axes.
/// `draw({ eye, at, fov, show, exposure })` draws at once; light is to be multiplied by exposure.
export async function present(load) {
    try {
        const { facts, canvas, camera, draw } =
            await load(query.get('scene') ?? '../cornell_box.gltf', query.get('volume') ?? '../cornell_box_atlas.ktx2');
        const view = viewOf(camera, facts);
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
        message.textContent = '';
        document.body.dataset.state = 'ready';
    } catch (error) {
        failed(error);
    }
}

/// The lights of the bake: type, color, intensity (lux, candela), position, direction, spot, range.
export const lightsOf = ({ metadata }) => JSON.parse(metadata.lights ?? '[]');

/// The mean of the sky that was baked, nits.
export const skyOf = ({ metadata }) => (metadata.sky ?? '0,0,0').split(',').map(Number);
