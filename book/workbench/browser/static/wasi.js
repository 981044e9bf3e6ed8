// A Python session in a Web Worker: CPython as one WebAssembly file, on a shim for WASI.
// It answers the messages of runtime.js. A turn is one call into the file's `turn`; the session's
// variables stay between turns. Python asks this side through `host.call`, the file's one door.
import { ConsoleStdout, Directory, File, OpenFile, PreopenDirectory, WASI } from './wasi/index.js';
import { doorFor } from './door.js';
import { unzip } from './unzip.js';

const LIBRARY = 'python315.zip';
const MODULES = '/usr/local/lib';
const PLOTTING = `${MODULES}/${LIBRARY}/matplotlib/mpl-data`;
// What the session runs first.
const BEGIN = `
import sys
import _host
sys.path[:0] = ['/book', '/book/book']
from workbench.browser.guest import door, session
door.opened_by(_host.call)
session.start()
`;
const NO_FAULT = 0;
const FAULT = -2;
const ALL_RIGHTS = (1n << 30n) - 1n;

let exports = null;
let root = null;
let answer = null; // of the door: header and arrays -> header and arrays

/** Bytes of a file that is stored compressed; `say` hears how many have come, of all. */
async function fetched(address, say) {
    const response = await fetch(address);
    if (!response.ok) throw new Error(`${address}: ${response.status}`);
    const reader = response.body.getReader();
    const counted = new ReadableStream({
        async pull(controller) {
            const { done, value } = await reader.read();
            if (done) return controller.close();
            say(value.length);
            controller.enqueue(value);
        },
    });
    return new Response(
        address.endsWith('.gz') ? counted.pipeThrough(new DecompressionStream('gzip')) : counted,
        { headers: { 'content-type': address.includes('.wasm') ? 'application/wasm' : '' } },
    );
}

/** The folder at a path from the root, made if it is not there. */
function folderAt(parts) {
    let folder = root;
    for (const part of parts) {
        if (!folder.contents.has(part)) folder.contents.set(part, new Directory(new Map()));
        folder = folder.contents.get(part);
    }
    return folder;
}

function split(path) {
    const parts = path.split('/').filter(part => part !== '');
    return [parts.slice(0, -1), parts.at(-1)];
}

function writeFile(path, bytes) {
    const [folder, name] = split(path);
    folderAt(folder).contents.set(name, new File(bytes));
}

function readFile(path) {
    const [parts, name] = split(path);
    const file = folderAt(parts).contents.get(name);
    return file instanceof File ? file.data : null;
}

/** The answer to a call from Python: bytes in, bytes out. */
function door(pointer, length, toPointer, toLength) {
    try {
        const request = new Uint8Array(exports.memory.buffer, pointer >>> 0, length >>> 0).slice();
        const response = answer(request);
        const place = exports.host_alloc(response.length) >>> 0;
        new Uint8Array(exports.memory.buffer, place, response.length).set(response);
        const memory = new DataView(exports.memory.buffer);
        memory.setUint32(toPointer >>> 0, place, true);
        memory.setUint32(toLength >>> 0, response.length, true);
        return NO_FAULT;
    } catch (error) {
        console.warn(error);
        return FAULT;
    }
}

/** A file that is loaded from the host when it is opened, and forgotten when it is closed. */
class RemoteFile extends File {
    constructor(address, bytes) {
        super(new ArrayBuffer(0));
        this.address = address;
        this.bytes = bytes;
    }

    get size() {
        return BigInt(this.data.byteLength || this.bytes);
    }

    path_open(...how) {
        if (this.data.byteLength === 0) {
            const request = new XMLHttpRequest();
            request.open('GET', this.address, false); // Python waits for it
            request.responseType = 'arraybuffer';
            request.send();
            if (request.status !== 200) throw new Error(`${this.address}: ${request.status}`);
            this.data = new Uint8Array(request.response);
        }
        const opened = super.path_open(...how);
        opened.fd_obj.fd_close = () => {
            this.data = new Uint8Array(0);
            return 0;
        };
        return opened;
    }
}

/** Says that files may be written in it: C's `access` asks for the rights that a folder hands on. */
class WritableFolder extends PreopenDirectory {
    fd_fdstat_get() {
        const { ret, fdstat } = super.fd_fdstat_get();
        fdstat.fs_rights_base = fdstat.fs_rights_inherited = ALL_RIGHTS;
        return { ret, fdstat };
    }
}

/** What Python writes to stdout or stderr, as whole characters. */
function stream(name) {
    const decoder = new TextDecoder('utf-8');
    return new ConsoleStdout(bytes => {
        const text = decoder.decode(bytes.slice(), { stream: true });
        postMessage({ kind: 'output', output: { type: name, text } });
    });
}

function say(bytes) {
    postMessage({ kind: 'progress', bytes });
}

/** Load everything and start Python; `module` is the compiled file, where another worker has it. */
async function start({ base, module, about }) {
    const at = name => new URL(`files/${name}`, base).href;
    const [compiled, library, plotting, book] = await Promise.all([
        module ?? fetched(at('python.wasm.gz'), say).then(r => WebAssembly.compileStreaming(r)),
        fetched(at('library.zip'), say).then(r => r.arrayBuffer()),
        fetched(at('plotting.zip'), say).then(r => r.arrayBuffer()).then(unzip),
        fetched(at('book.zip'), say).then(r => r.arrayBuffer()).then(unzip),
    ]);
    const folders = new WritableFolder('/', new Map());
    root = folders.dir;
    ['tmp', 'user/plotting', 'book'].forEach(path => folderAt(path.split('/')));
    const data = new PreopenDirectory(PLOTTING, new Map());
    const kept = root;
    root = data.dir;
    plotting.forEach(([path, bytes]) => writeFile(path, bytes));
    root = kept;
    book.forEach(([path, bytes]) => writeFile(`book/${path}`, bytes));
    about.recordings.forEach(({ path, bytes }) => {
        const [folder, name] = split(`book/recordings/${path}`);
        const address = new URL(`recordings/${path}`, base).href;
        folderAt(folder).contents.set(name, new RemoteFile(address, bytes));
    });
    answer = await doorFor(at('opencv.js.gz'), say);
    const wasi = new WASI(
        ['/usr/local/bin/python.wasm'],
        ['TMPDIR=/tmp', 'PYTHONTZPATH=', 'HOME=/user', 'MPLCONFIGDIR=/user/plotting', 'MPLBACKEND=agg', 'OMP_NUM_THREADS=1'],
        [
            new OpenFile(new File([])),
            stream('stdout'),
            stream('stderr'),
            new PreopenDirectory(MODULES, new Map([[LIBRARY, new File(library)]])),
            data,
            folders,
        ],
    );
    const instance = await WebAssembly.instantiate(compiled, {
        wasi_snapshot_preview1: wasi.wasiImport,
        host: { call: door },
    });
    wasi.inst = instance;
    exports = instance.exports;
    exports._initialize?.();
    return { code: turn(BEGIN), module: compiled };
}

/** One turn of the session: its source is run in `__main__`. */
function turn(source) {
    const bytes = new TextEncoder().encode(source);
    const place = exports.host_alloc(bytes.length) >>> 0;
    new Uint8Array(exports.memory.buffer, place, bytes.length).set(bytes);
    return exports.turn(place, bytes.length);
}

const ANSWERS = {
    start,
    run: ({ source }) => ({ code: turn(source), memory: exports.memory.buffer.byteLength }),
    write: ({ path, bytes }) => writeFile(path, bytes),
    read: ({ path }) => readFile(path),
};

self.onmessage = async ({ data }) => {
    const { id, kind } = data;
    try {
        postMessage({ id, kind: 'done', value: await ANSWERS[kind](data) });
    } catch (error) {
        postMessage({ id, kind: 'failed', message: String(error?.message ?? error) });
    }
};
