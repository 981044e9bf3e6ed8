// A session of Python behind one interface: start, run, files, interrupt. The session is in a worker,
// wasi.js, and messages go to and fro.

const BASE = new URL('../', import.meta.url); // of the folder _browser

// the cells' own `__main__` has no name of ours
const ANSWER = "__import__('workbench.browser.guest.session', fromlist=['answer']).answer()";

/** A session of Python in a worker. Outputs of a run go to its `onoutput`, one after the other. */
export class Runtime {
    constructor({ onprogress = () => {} } = {}) {
        this.onprogress = onprogress;
        this.worker = null;
        this.waiting = new Map();
        this.number = 0;
        this.onoutput = () => {};
        this.queue = Promise.resolve();
        this.idle = false; // Python is there, and runs nothing
        this.module = null; // the compiled file, which other sessions may share
    }

    /** What runs here: its name, the sizes of its files and what it says of itself. */
    static async about() {
        Runtime.known ??= fetch(new URL('runtime.json', BASE)).then(response => response.json());
        return Runtime.known;
    }

    /** Load the runtime and start a session; true from now on means that Python is there. */
    async start(module = null) {
        this.starting ??= this.#start(module);
        return this.starting;
    }

    async #start(module) {
        const about = await Runtime.about();
        let bytes = 0;
        let said = '';
        this.onoutput = ({ text }) => { said += text; };
        this.worker = new Worker(new URL('static/wasi.js', BASE), { type: 'module' });
        this.worker.onmessage = ({ data }) => {
            if (data.kind === 'progress') {
                bytes += data.bytes;
                this.onprogress(Math.min(bytes / about.bytes, 1));
            } else if (data.kind === 'output') {
                this.onoutput(data.output);
            } else {
                const { resolve, reject } = this.waiting.get(data.id);
                this.waiting.delete(data.id);
                if (data.kind === 'done') resolve(data.value);
                else reject(new Error(data.message));
            }
        };
        this.worker.onerror = event => this.#lose(`the worker ended: ${event.message}`);
        module ??= Runtime.module;
        const { code, module: compiled } = await this.#ask('start', { base: BASE.href, module, about });
        if (code !== 0) throw new Error(`Python did not start: ${said}`);
        this.module = Runtime.module = compiled; // another session of this page need not compile it
        this.idle = true;
        this.onprogress(1);
    }

    /** Run source in the session. Resolves with {error}: null, or what the cell raised, as text. */
    run(source, { name = 'cell', onoutput = () => {} } = {}) {
        const turn = async () => {
            await this.start();
            this.idle = false;
            let error = null;
            this.onoutput = output => {
                if (output.type === 'error') error = output;
                else onoutput(output);
            };
            await this.write('tmp/request.json', new TextEncoder().encode(JSON.stringify({ source, name })).buffer);
            const { code, memory } = await this.#ask('run', { source: ANSWER });
            if (code !== 0) throw new Error(`the session ended with ${code}`);
            this.idle = true;
            return { error, memory };
        };
        const result = this.queue.then(turn);
        this.queue = result.catch(() => {});
        return result;
    }

    /** Write bytes, an ArrayBuffer, to a path from the root of the session's own file system. */
    write(path, bytes) {
        return this.#ask('write', { path, bytes });
    }

    /** The bytes of a file, or null. */
    read(path) {
        return this.#ask('read', { path });
    }

    /** End what runs, now. The session's variables are lost: the next run starts a new one. */
    interrupt() {
        this.#lose('stopped: the session\u2019s variables are lost');
    }

    #ask(kind, about) {
        this.number += 1;
        const id = this.number;
        return new Promise((resolve, reject) => {
            this.waiting.set(id, { resolve, reject });
            this.worker.postMessage({ id, kind, ...about });
        });
    }

    #lose(why) {
        this.worker?.terminate();
        this.worker = null;
        this.starting = undefined;
        this.idle = false;
        this.waiting.forEach(({ reject }) => reject(new Error(why)));
        this.waiting.clear();
        this.queue = Promise.resolve();
    }
}
