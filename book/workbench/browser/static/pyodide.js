// A Python session in a Web Worker on Pyodide, for hosts that have a release of it beside the pages.
// It answers the messages of runtime.js, as wasi.js does.
import { doorFor } from './door.js';
import { answerBy, written } from './messages.js';
import { unzip } from './unzip.js';

let python = null;

function stream(name) {
    const take = written(name);
    return {
        write(bytes) {
            take(bytes);
            return bytes.length;
        },
    };
}

function folderOf(path) {
    const folder = path.split('/').slice(0, -1).join('/');
    python.FS.mkdirTree(`/${folder}`);
    return [`/${folder}`, path.split('/').at(-1)];
}

function writeFile(path, bytes) {
    const [folder, name] = folderOf(path);
    python.FS.writeFile(`${folder}/${name}`, new Uint8Array(bytes));
}

function readFile(path) {
    return python.FS.analyzePath(`/${path}`).exists ? python.FS.readFile(`/${path}`) : null;
}

/** Load Pyodide and the packages that its lock names; a missing one is an error that names it. */
async function start({ base, about, say }) {
    const at = path => new URL(path, base).href;
    const { loadPyodide } = await import(at('pyodide/pyodide.mjs'));
    python = await loadPyodide({ indexURL: at('pyodide/'), packages: about.packages, env: { HOME: '/user', MPLBACKEND: 'agg' } });
    python.setStdout(stream('stdout'));
    python.setStderr(stream('stderr'));
    for (const name of about.archives) {
        const bytes = await (await fetch(at(`files/${name}`))).arrayBuffer();
        say(bytes.byteLength);
        (await unzip(bytes)).forEach(([path, content]) => writeFile(`book/${path}`, content));
    }
    about.recordings.forEach(({ path }) => {
        const [folder, name] = folderOf(`book/recordings/${path}`);
        python.FS.createLazyFile(folder, name, at(`recordings/${path}`), true, false);
    });
    const answer = await doorFor(at('files/opencv.js.gz'), say);
    python.registerJsModule('_host', { call: frame => answer(frame) });
    return null;
}

function turn(source) {
    try {
        python.runPython(source);
        return 0;
    } catch (error) {
        postMessage({ kind: 'output', output: { type: 'stderr', text: String(error.message) } });
        return 1;
    }
}

answerBy({ start, turn, memory: () => python._module.HEAP8.length, writeFile, readFile });
