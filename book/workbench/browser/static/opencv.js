// Calls of OpenCV.js from Python: numbers go as they are, {array: k} is a matrix made of the k-th
// array, {out: 1} a matrix that the call fills, {size: [w, h]} and {point: [x, y]} what they say,
// {scalar: [...]} four numbers, {vector: [k, ...]} a list of matrices, {outs: 1} a list that is filled.

let cv = null;

const DEPTHS = { uint8: 0, int8: 1, uint16: 2, int16: 3, int32: 4, float32: 5, float64: 6 };
const TYPES = Object.keys(DEPTHS);
const VALUES = {
    uint8: 'data', int8: 'data8S', uint16: 'data16U', int16: 'data16S',
    int32: 'data32S', float32: 'data32F', float64: 'data64F',
};

export async function loadOpenCV(address, say) {
    const response = await fetch(address);
    if (!response.ok) throw new Error(`${address}: ${response.status}`);
    const packed = await response.blob();
    say(packed.size);
    const text = await new Response(packed.stream().pipeThrough(new DecompressionStream('gzip'))).blob();
    const place = URL.createObjectURL(new Blob([text], { type: 'text/javascript' }));
    cv = await (await import(place)).default();
    URL.revokeObjectURL(place);
}

/** A matrix of an array: (rows, columns) or (rows, columns, channels); one axis is a column. */
function matrix({ type, shape, values }) {
    const [rows, columns = 1, channels = 1] = shape;
    const made = new cv.Mat(rows, columns, DEPTHS[type] + (cv.CV_8UC2 - cv.CV_8UC1) * (channels - 1));
    made[VALUES[type]].set(values);
    return made;
}

function array(made) {
    const type = TYPES[made.depth()];
    const channels = made.channels();
    const shape = channels === 1 ? [made.rows, made.cols] : [made.rows, made.cols, channels];
    const whole = made.isContinuous() ? made : made.clone();
    const values = made.rows * made.cols === 0 ? new Uint8Array(0) : whole[VALUES[type]].slice();
    if (whole !== made) whole.delete();
    return { type, shape, values };
}

function listed(vector) {
    return Array.from({ length: vector.size() }, (_, k) => vector.get(k));
}

export function callOpenCV(name, given, arrays) {
    const kept = []; // to be freed
    const filled = [];
    const keep = one => (kept.push(one), one);
    const parse = one => {
        if (one === null || typeof one !== 'object') return one;
        if ('array' in one) return keep(matrix(arrays[one.array]));
        if ('inout' in one) return filled.push(keep(matrix(arrays[one.inout]))), filled.at(-1);
        if ('out' in one) return filled.push(keep(new cv.Mat())), filled.at(-1);
        if ('outs' in one) return filled.push(keep(new cv.MatVector())), filled.at(-1);
        if ('size' in one) return new cv.Size(...one.size);
        if ('point' in one) return new cv.Point(...one.point);
        if ('scalar' in one) return new cv.Scalar(...one.scalar);
        if ('criteria' in one) return new cv.TermCriteria(...one.criteria);
        if ('vector' in one) {
            const vector = keep(new cv.MatVector());
            one.vector.forEach(k => vector.push_back(keep(matrix(arrays[k]))));
            return vector;
        }
        throw new Error(`no such argument: ${JSON.stringify(one)}`);
    };
    if (typeof cv[name] !== 'function') throw new Error(`OpenCV.js has no ${name}`);
    try {
        const returned = cv[name](...given.map(parse));
        const results = [];
        const values = [];
        if (returned instanceof cv.Mat) results.push(array(keep(returned)));
        for (const one of filled) {
            if (one instanceof cv.MatVector) {
                const parts = listed(one).map(part => keep(part));
                values.push(parts.length);
                results.push(...parts.map(array));
            } else {
                results.push(array(one));
            }
        }
        return { values: { returned: plain(returned), counts: values }, results };
    } catch (error) {
        if (typeof error === 'number' && cv.exceptionFromPtr) throw new Error(cv.exceptionFromPtr(error).msg);
        throw error;
    } finally {
        kept.forEach(one => one.delete());
    }
}

/** What a call returned, as numbers: a rectangle or moments are objects of numbers. */
function plain(returned) {
    if (returned === undefined || returned === null || returned instanceof cv.Mat) return null;
    if (typeof returned !== 'object' || Array.isArray(returned)) return returned;
    return Object.fromEntries(Object.entries(returned).filter(([, value]) => typeof value === 'number'));
}

export function constant(name) {
    return typeof cv[name] === 'number' ? cv[name] : cv[name]?.value ?? null;
}

/** The blobs of an image: [u, v, size] each. */
export function blobs(parameters, image) {
    const [detector, one, points] = [new cv.SimpleBlobDetector(), matrix(image), new cv.KeyPointVector()];
    const chosen = Object.assign(detector.getParams(), parameters);
    detector.setParams(chosen);
    detector.detect(one, points);
    const found = listed(points).map(({ pt, size }) => [pt.x, pt.y, size]);
    [detector, one, points, chosen].forEach(each => each.delete());
    return found;
}

const mixtures = [];

/** A new model of the background, or the mask of an image by one that is there. */
export function mixture({ number, given, rate }, image) {
    if (number === undefined) return { made: mixtures.push(new cv.BackgroundSubtractorMOG2(...given)) - 1 };
    const [one, mask] = [matrix(image), new cv.Mat()];
    mixtures[number].apply(one, mask, rate);
    const result = array(mask);
    [one, mask].forEach(each => each.delete());
    return { made: number, mask: result };
}
