// The messages of runtime.js, answered by a worker that has a session of Python.

/**
 * Answer them by a session: `start(about)` gives the compiled file or null, `turn(source)` a code,
 * `memory()` bytes; `writeFile(path, bytes)`, `readFile(path)`.
 */
export function answerBy({ start, turn, memory, writeFile, readFile }) {
    const say = bytes => postMessage({ kind: 'progress', bytes });
    const kinds = {
        async start(data) {
            const module = await start({ ...data, say });
            return { code: turn(data.about.source), module };
        },
        run: ({ source }) => ({ code: turn(source), memory: memory() }),
        write({ path, bytes }) {
            writeFile(path, bytes);
            return null;
        },
        read: ({ path }) => readFile(path),
    };
    self.onmessage = async ({ data }) => {
        const { id, kind } = data;
        try {
            postMessage({ id, kind: 'done', value: await kinds[kind](data) });
        } catch (error) {
            postMessage({ id, kind: 'failed', message: String(error?.message ?? error) });
        }
    };
}

/** Take what Python writes to `name`, stdout or stderr, as bytes; whole characters go on. */
export function written(name) {
    const decoder = new TextDecoder('utf-8');
    return bytes => {
        const text = decoder.decode(bytes.slice(), { stream: true });
        postMessage({ kind: 'output', output: { type: name, text } });
    };
}
