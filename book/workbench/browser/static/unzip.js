// The files of a zip archive, as pairs of a path and its bytes; stored and deflated members only.

const END = 0x06054b50;
const DEFLATED = 8;

async function inflated(bytes) {
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream('deflate-raw'));
    return new Response(stream).arrayBuffer();
}

export async function unzip(buffer) {
    const view = new DataView(buffer);
    let end = buffer.byteLength - 22;
    while (view.getUint32(end, true) !== END) end -= 1;
    const count = view.getUint16(end + 10, true);
    let place = view.getUint32(end + 16, true);
    const files = [];
    for (let k = 0; k < count; k += 1) {
        const method = view.getUint16(place + 10, true);
        const size = view.getUint32(place + 20, true);
        const [name, extra, comment] = [28, 30, 32].map(from => view.getUint16(place + from, true));
        const header = view.getUint32(place + 42, true);
        const path = new TextDecoder().decode(new Uint8Array(buffer, place + 46, name));
        const from = header + 30 + view.getUint16(header + 26, true) + view.getUint16(header + 28, true);
        const packed = buffer.slice(from, from + size);
        if (!path.endsWith('/')) files.push([path, method === DEFLATED ? inflated(packed) : packed]);
        place += 46 + name + extra + comment;
    }
    return Promise.all(files.map(async ([path, bytes]) => [path, await bytes]));
}
