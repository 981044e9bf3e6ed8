// A chapter's page with cells that run: Run, Run all above, Edit at each, and one bar for all.
import { Editor } from './editor.js';
import { button, element } from './elements.js';
import { linked, linkTo } from './links.js';
import { show } from './outputs.js';
import { Runtime } from './runtime.js';

const MBIT_S = 50;
const START_S = 15; // of the processor, to a first figure (tests/benchmarks/bench_browser.py)
const PAGE = location.pathname.split('/').at(-1).replace('.html', '');

/** What the reader has written in place of a source, kept in this browser. */
class Edits {
    static key(cell) {
        return `trinolab/edit/${PAGE}/${cell.number}`;
    }

    static of(cell) {
        const kept = JSON.parse(localStorage.getItem(Edits.key(cell)) ?? 'null');
        return kept && kept.of === cell.stored ? kept.source : null; // another edition's cell is another cell
    }

    static keep(cell, source) {
        if (source === cell.stored) localStorage.removeItem(Edits.key(cell));
        else localStorage.setItem(Edits.key(cell), JSON.stringify({ of: cell.stored, source }));
    }
}

/** One cell of code on the page. */
class Cell {
    constructor(place, stored, after, number, book) {
        Object.assign(this, { place, stored, after, number, book });
        this.input = place.querySelector('.cell_input');
        this.output = place.querySelector('.cell_output');
        this.status = element('span', { className: 'browser-status' });
        this.status.setAttribute('role', 'status');
        this.result = element('div', { className: 'browser-result', hidden: true });
        this.toggle = button('Stored output', () => this.showStored(this.output.hidden));
        this.toggle.hidden = true;
        this.editButton = button('Edit', () => this.turn(), `Edit cell ${number + 1}`);
        this.linkButton = button('Copy link', () => this.copyLink(), `Copy link to cell ${number + 1}`);
        this.linkButton.hidden = true;
        this.tools = element('div', { className: 'browser-tools' },
            button('Run', () => book.run([this]), `Run cell ${number + 1}`),
            button('Run all above', () => book.run(book.cells.slice(0, number)), `Run all above cell ${number + 1}`),
            this.editButton, this.linkButton, this.toggle, this.status);
        place.append(this.tools, this.result);
        if (this.output) place.append(this.output);
        const kept = Edits.of(this);
        if (kept !== null) this.edit(kept);
    }

    get source() {
        return this.editor?.value ?? this.stored;
    }

    /** Edit the source, or go back to the stored one. */
    turn() {
        if (this.editor) {
            this.putBack();
        } else {
            this.edit(this.stored);
            this.editor.mirror.focus();
        }
    }

    /** Show a source that can be changed. */
    edit(source) {
        this.editor?.place.replaceWith(this.input);
        this.editor = new Editor({
            source,
            label: `Source of cell ${this.number + 1}; Shift and Enter run it`,
            act: () => this.book.run([this]),
            change: () => Edits.keep(this, this.editor.value),
            runtime: this.book.runtime,
        });
        this.input.replaceWith(this.editor.place);
        this.editor.place.closest('details')?.setAttribute('open', '');
        this.editor.mirror.refresh();
        this.name('Back to the book\u2019s');
        this.linkButton.hidden = false;
    }

    name(text) {
        this.editButton.textContent = text;
        this.editButton.ariaLabel = `${text} cell ${this.number + 1}`;
    }

    /** Show the stored source again. */
    putBack() {
        this.editor.place.replaceWith(this.input);
        this.editor = null;
        Edits.keep(this, this.stored);
        this.name('Edit');
        this.linkButton.hidden = true;
    }

    /** A link that carries the source goes to the address bar and the clipboard. */
    async copyLink() {
        history.replaceState(null, '', await linkTo(this.number + 1, this.source));
        await navigator.clipboard?.writeText(location.href).catch(() => {});
        this.say('the link is in the address bar, and copied where the browser allows it');
    }

    showStored(yes) {
        this.output.hidden = !yes;
        this.toggle.textContent = yes ? 'Hide the stored output' : 'Stored output';
    }

    say(text, kind = '') {
        this.status.textContent = text;
        this.status.dataset.kind = kind;
    }

    /** Run here; returns false where what follows cannot go on. */
    async run(runtime) {
        this.say('running');
        this.result.replaceChildren();
        const begin = performance.now();
        const name = `cell_${this.number + 1}`;
        const keep = output => {
            if (output.type === 'glue') this.book.glued[output.name] = output.value;
        };
        let { error, memory } = await runtime.run(this.source, {
            name,
            onoutput: output => {
                keep(output);
                show(output, this.result);
                this.result.hidden = this.result.childElementCount === 0;
            },
        });
        if (!error && this.after) ({ error, memory } = await runtime.run(this.after, { name, onoutput: keep }));
        this.book.memory(memory);
        const seconds = ((performance.now() - begin) / 1000).toFixed(1);
        if (error?.cannot) {
            this.result.hidden = true;
            if (this.output) this.showStored(true);
            this.say(`cannot run in a browser: ${error.cannot}. The stored output is shown.`, 'cannot');
            return true;
        }
        if (error) {
            show({ type: 'stderr', text: error.text }, this.result);
            this.result.hidden = false;
            this.say(`failed after ${seconds} s`, 'failed');
            return false;
        }
        this.caption();
        if (this.output && !this.result.hidden) {
            this.toggle.hidden = false;
            this.showStored(false);
        }
        this.say(`ran here in ${seconds} s`, 'done');
        return true;
    }

    /** Give the last figure that the cell has drawn the caption of the stored one. */
    caption() {
        const caption = this.output?.querySelector('figcaption');
        const image = [...this.result.querySelectorAll('img')].at(-1);
        if (!caption || !image) return;
        const stored = this.output.querySelector('figure img');
        image.alt = stored.alt;
        image.classList.add(...stored.classList);
        const figure = element('figure');
        image.replaceWith(figure);
        figure.append(image, caption.cloneNode(true));
    }
}

/** All cells of the page, and the one session that runs them. */
class Book {
    constructor() {
        const stored = JSON.parse(document.getElementById('browser-cells').textContent);
        const places = document.querySelectorAll('div.cell');
        this.runtime = new Runtime({ onprogress: share => this.progress(share) });
        this.share = element('progress', { max: 1, value: 0, hidden: true });
        this.share.setAttribute('aria-label', 'The runtime is loaded');
        this.said = element('span', { className: 'browser-said' });
        this.said.setAttribute('role', 'status');
        this.used = element('span', { className: 'browser-memory' });
        this.stopButton = button('Stop', () => this.stop());
        this.stopButton.disabled = true;
        this.bar = element('div', { className: 'browser-bar' },
            button('Run all', () => this.run(this.cells)), this.stopButton,
            button('Restart', () => this.restart()), this.share, this.said, this.used);
        this.bar.setAttribute('role', 'region');
        this.bar.setAttribute('aria-label', 'Run this chapter in the browser');
        this.cells = stored.map(({ source, after }, k) => new Cell(places[k], source, after, k, this));
        document.querySelector('article.bd-article h1').after(this.bar);
        this.running = false;
        this.glued = {}; // the numbers that the text quotes, as they came out here
        this.turns = Promise.resolve();
        this.stopped = 0;
        Runtime.about().then(({ name, bytes, numbers }) => {
            const seconds = Math.round(8 * bytes / MBIT_S / 1e6);
            this.say(`Cells run here, on ${name}. The first run loads ${Math.round(bytes / 1e6)} MB, once: ${seconds} s at ${MBIT_S} Mbit/s, `
                + `and ${START_S} s of computing until a first figure.`);
            if (numbers) this.bar.append(element('a', { href: '../browser_numbers.html', textContent: 'Numbers of two platforms' }));
        });
    }

    say(text) {
        this.said.textContent = text;
    }

    memory(bytes) {
        this.used.textContent = `${Math.round(bytes / 2 ** 20)} MB of memory`;
    }

    progress(share) {
        this.share.hidden = share === 1;
        this.share.value = share;
        if (share < 1) this.say(`loading the runtime: ${Math.round(100 * share)} %`);
    }

    /** Run cells one after the other, after those that wait already. */
    run(cells) {
        const round = this.stopped;
        const turn = async () => {
            if (round !== this.stopped) return;
            this.running = true;
            this.stopButton.disabled = false;
            try {
                if (!this.runtime.starting) this.say('starting Python');
                await this.runtime.start();
                for (const cell of cells) {
                    this.say(`running cell ${cell.number + 1} of ${this.cells.length}`);
                    this.current = cell;
                    if (!(await cell.run(this.runtime))) {
                        this.say(`cell ${cell.number + 1} failed`);
                        return;
                    }
                }
                this.say(`ran ${cells.length === 1 ? `cell ${cells[0].number + 1}` : `${cells.length} cells`}`);
            } catch (error) {
                this.current?.say(error.message, 'failed');
                this.say(error.message);
            } finally {
                this.running = false;
                this.stopButton.disabled = true;
            }
        };
        this.turns = this.turns.then(turn);
        return this.turns;
    }

    stop() {
        this.stopped += 1;
        this.runtime.interrupt();
    }

    /** Forget all variables. The next run starts anew. */
    restart() {
        this.stop();
        this.cells.forEach(cell => {
            cell.say('');
            cell.result.replaceChildren();
            cell.result.hidden = true;
            cell.toggle.hidden = true;
            if (cell.output) cell.output.hidden = false;
        });
        this.used.textContent = '';
        this.say('restarted: no variable is kept');
    }
}

if ('serviceWorker' in navigator && window.isSecureContext) {
    navigator.serviceWorker.register(new URL('../../serviceworker.js', import.meta.url));
}
window.book = new Book();
linked().then(found => {
    const cell = found && window.book.cells[found.number - 1];
    if (!cell) return;
    cell.edit(found.source);
    cell.say('from the link, not run yet');
    cell.place.scrollIntoView();
});
