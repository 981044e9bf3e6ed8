// The editor of cells and answers: CodeMirror with Python's colours, brackets and completion. The
// tabulator key goes on to the next button; Ctrl-] indents.
import { element } from './elements.js';

const OFFER = "__import__('workbench.browser.guest.session', fromlist=['offer']).offer";

/** Names that what stands before the cursor can become in the session: "np.lin" np.linspace. */
async function names(mirror, runtime) {
    const cursor = mirror.getCursor();
    const [begun] = mirror.getLine(cursor.line).slice(0, cursor.ch).match(/[\w.]*$/);
    const list = [];
    await runtime.run(`${OFFER}(${JSON.stringify(begun)})`, { name: 'names', onoutput: output => output.type === 'names' && list.push(...output.names) });
    return { list, from: { line: cursor.line, ch: cursor.ch - begun.length }, to: cursor };
}

export class Editor {
    /** `act` is what Shift and Enter do; names are offered while the session of `runtime` is idle. */
    constructor({ source, label, act, change, runtime }) {
        this.place = element('div', { className: 'browser-source' });
        const offer = () => runtime.idle && this.mirror.showHint({ hint: mirror => names(mirror, runtime), completeSingle: false });
        this.mirror = window.CodeMirror(this.place, {
            value: source,
            mode: 'python',
            indentUnit: 4,
            matchBrackets: true,
            autoCloseBrackets: true,
            viewportMargin: Infinity,
            screenReaderLabel: label,
            extraKeys: { 'Shift-Enter': act, 'Ctrl-Space': offer, Tab: false, 'Shift-Tab': false },
        });
        this.mirror.on('change', change);
        this.mirror.on('inputRead', (_, { text }) => text[0] === '.' && offer());
    }

    get value() {
        return this.mirror.getValue();
    }

    set value(source) {
        this.mirror.setValue(source);
    }
}
