// What Python asks of the page's side, through one call that takes bytes and gives bytes.
// A frame is the length of a header (4 bytes), the header as JSON, and the bytes of its arrays,
// one after the other; the header's `arrays` holds the type and the shape of each.
import { blobs, callOpenCV, constant, loadOpenCV, mixture } from './opencv.js';

const TYPES = {
    uint8: Uint8Array, int8: Int8Array, uint16: Uint16Array, int16: Int16Array,
    int32: Int32Array, float32: Float32Array, float64: Float64Array,
};

export function unpack(frame) {
    const length = new DataView(frame.buffer, frame.byteOffset).getUint32(0, true);
    const header = JSON.parse(new TextDecoder().decode(frame.subarray(4, 4 + length)));
    let place = 4 + length;
    const arrays = header.arrays.map(({ type, shape }) => {
        const bytes = shape.reduce((a, b) => a * b, 1) * TYPES[type].BYTES_PER_ELEMENT;
        const values = new TYPES[type](frame.slice(place, place + bytes).buffer);
        place += bytes;
        return { type, shape, values };
    });
    return { ...header, arrays };
}

export function pack(header, arrays = []) {
    const about = { ...header, arrays: arrays.map(({ type, shape }) => ({ type, shape })) };
    const text = new TextEncoder().encode(JSON.stringify(about));
    const all = arrays.map(({ values }) => new Uint8Array(values.buffer, values.byteOffset, values.byteLength));
    const frame = new Uint8Array(4 + text.length + all.reduce((sum, one) => sum + one.length, 0));
    new DataView(frame.buffer).setUint32(0, text.length, true);
    frame.set(text, 4);
    let place = 4 + text.length;
    for (const bytes of all) {
        frame.set(bytes, place);
        place += bytes.length;
    }
    return frame;
}

const ANSWERS = {
    output({ output }) {
        postMessage({ kind: 'output', output });
        return pack({});
    },
    constant: ({ name }) => pack({ value: constant(name) }),
    opencv({ name, arguments: given }, arrays) {
        const { values, results } = callOpenCV(name, given, arrays);
        return pack({ values }, results);
    },
    blobs: ({ parameters }, [image]) => pack({ points: blobs(parameters, image) }),
    mixture(about, [image]) {
        const { made, mask } = mixture(about, image);
        return pack({ number: made }, mask ? [mask] : []);
    },
};

/** The function that answers frames, with OpenCV.js loaded from an address. */
export async function doorFor(address, say) {
    await loadOpenCV(address, say);
    return frame => {
        const { asks, arrays, ...rest } = unpack(frame);
        try {
            return ANSWERS[asks](rest, arrays);
        } catch (error) {
            return pack({ error: String(error?.message ?? error) });
        }
    };
}
